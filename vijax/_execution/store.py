"""A sweep kept on disk chunk by chunk, so that it can be stopped, or killed, and resumed.

A store is a folder with a manifest, `sweep.json`, which describes the sweep, and a file for every chunk of points
that is done, named by a digest of its points, their machines and starts. Every run looks into the store first. A
carried sweep therefore needs no code of its own: called again, it visits the same pieces of its chains and finds the
finished ones on disk.

The result of a point does not depend on the points run beside it, not by a bit, as long as the flow is chosen for all
points together and the compiled shapes are those of the whole sweep. A chunk is therefore run as a part of the whole
sweep, and neither chunks nor interruptions change anything.

A file is first written under a temporary name. It ends in a checksum of its content, of the sweep and of its place
there. A file that was cut off, damaged, or copied from elsewhere is not used but made again.

Several processes may work on one store. The file system, which makes a name once, decides which process begins it.
There are no locks, which a killed process would keep: every process visits the chunks in an order of its own, and
checks just before running one whether another has finished it. Two may run the same chunk at the same time, with the
same bits; whole files replace each other.
"""

import contextlib
import hashlib
import io
import json
import os
import uuid
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._flow.interface import AbstractFlow
from .._system.force import BoundForce, force_of, program_of
from .._system.system import ImpactSystem
from .._writing import naming_argument, saying_what_is_kept
from .points import LaneInput
from .records import Impact
from .runner import AbstractRunner, PointResults, join_results
from .settings import ExecutionSettings
from .threads import count_cores

# Version of the format, raised with every change of `PointResults` or of its format: older stores are refused.
_LAYOUT = 5
_MANIFEST = "sweep.json"
# Prefix of the columns of the impacts, which share a file with the ends of the points.
_OF_IMPACTS = "impacts."
# Settings that determine how points are cut into chunks, or who runs them, but no bit of the results.
_FREE_SETTINGS = ("cores", "in_flight", "chunk_periods", "min_chunk", "max_chunk")


class Store(AbstractRunner):
    """Runner that keeps results in a folder and gives points without results to another runner.

    Attributes:
        runner: the other runner.
        folder: folder of the store.
        points_per_chunk: points of one file.
        sweep: digest of the manifest.
    """

    runner: AbstractRunner
    folder: Path
    points_per_chunk: int
    sweep: str

    def run(self, points: LaneInput, which: np.ndarray, tell: Callable[[int], object]) -> PointResults:
        """Read the chunks that are done; run and keep the others."""
        num_chunks = min(-(-which.size // self.points_per_chunk), which.shape[-1])  # chains stay whole
        chunks = np.array_split(which, num_chunks, axis=-1)
        parts: dict[int, PointResults] = {}
        files: dict[int, Path] = {}

        def missing() -> Iterator[tuple[int, np.ndarray]]:
            # Random order, so that processes share the work; results are joined in the order of the points.
            for number in np.random.default_rng().permutation(len(chunks)).tolist():
                chunk = chunks[number]
                of_chunk = jax.tree.map(
                    lambda a, chunk=chunk: a if a.shape[-1] == 1 else a[..., chunk], points
                )
                files[number] = self.folder / f"{_digest((of_chunk, chunk))}.npz"
                found = _read(self, files[number])
                if found is None:
                    yield number, chunk
                else:
                    parts[number] = found
                    tell(chunk.size)

        for number, found in self.runner.run_each(points, missing(), tell):
            _keep(self, files[number], found)
            parts[number] = found
        return join_results(parts.items(), chunks)


def open_store(
    path: str | os.PathLike[str],
    manifest: dict[str, Any],
    runner: AbstractRunner,
    settings: ExecutionSettings,
    work: int,
) -> Store:
    """Begin a store, or continue one that holds the same sweep.

    Args:
        path: its folder, made if missing.
        manifest: description of the sweep, see `describe_sweep`.
        runner: runs the points without results.
        settings: chunk sizes of a new store.
        work: of a point, see `Counts`.

    Raises:
        ValueError: if the folder holds something else; the message says what differs.
    """
    folder, file = Path(path), Path(path) / _MANIFEST
    if not file.exists():
        _begin(folder, manifest, settings, work)
    # Read the manifest even after `_begin`: another process may have written it.
    size = read_manifest(folder, _MANIFEST, manifest, lambda recorded: int(recorded["points_per_chunk"]))
    digest = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode())
    return Store(runner, folder, size, digest.hexdigest())


def read_manifest(
    folder: Path, name: str, manifest: dict[str, Any], size: Callable[[Any], Any], *within: str
) -> Any:
    """Read the size of chunks stored beside a manifest, if that manifest is the given one.

    Args:
        folder: folder of the store.
        name: name of the JSON file in it.
        manifest: description of the sweep.
        size: takes the size of chunks stored beside the manifest.
        within: keys in the file under which both stand.
    """
    file = folder / name
    try:
        found = json.loads(file.read_text())
        for key in within:
            found = found[key]
        there, recorded = found["sweep"], size(found)
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"The file {file} of a store is damaged: delete the folder.") from error
    clause = difference(there, manifest)
    if clause is not None:
        raise ValueError(
            f"The store {folder} holds another sweep: {clause}. Name another folder, or delete this one."
        )
    return recorded


def _begin(folder: Path, manifest: dict[str, Any], settings: ExecutionSettings, work: int) -> None:
    """Write the manifest, unless another process does at this moment."""
    file = folder / _MANIFEST
    if folder.exists():
        is_other = not folder.is_dir() or any(f.suffix != ".part" for f in folder.iterdir())
        if is_other and not file.exists():
            raise ValueError(
                f"Argument `store` must name a new or empty folder, or a store, but {folder} is neither."
            )
    size = (settings.cores or count_cores()) * settings.chunk_of(work)
    text = json.dumps({"points_per_chunk": size, "sweep": manifest}, indent=1)
    with naming_argument("store", folder):
        folder.mkdir(parents=True, exist_ok=True)
        _write(file, text.encode(), _first_come)


def describe_sweep(
    attributes: dict[str, Any],
    axes: dict[str, np.ndarray],
    points: LaneInput,
    flow: AbstractFlow | None,
    settings: ExecutionSettings,
) -> dict[str, Any]:
    """Manifest: everything that determines the results of a sweep to the last bit.

    Attributes are those of `origin`. The flow is the requested one, None if left out. The settings determine what is
    compiled.
    """
    recorded = {name: a for name, a in attributes.items() if name not in ("numpy_version", "python_version")}
    return {
        "layout": _LAYOUT,
        **recorded,
        **{name: json.loads(attributes[name]) for name in ("system", "family") if name in attributes},
        "force_parameters": json.loads(attributes.get("force_parameters", "{}")),
        "values": {path: _summary(axis) for path, axis in axes.items()},
        "starts": _digest((points.x0, points.v0)),
        "numbers of the force": _digest(points.system.force),
        "program of the force": _program(points.system),
        "numbers of the flow": _digest(eqx.filter(flow, eqx.is_array)),
        "settings": {name: a for name, a in asdict(settings).items() if name not in _FREE_SETTINGS},
    }


def _keep(store: Store, file: Path, found: PointResults) -> None:
    impacts = {f"{_OF_IMPACTS}{name}": column for name, column in vars(found.impacts).items()}
    arrays: dict[str, Any] = {"lane_steps": found.lane_steps, **impacts, **found.ends}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    data = buffer.getvalue()
    with saying_what_is_kept(store.folder):
        _write(file, data + _checksum(store, file, data), os.replace)


def _read(store: Store, file: Path) -> PointResults | None:
    """Content of a chunk's file; None if it is missing, incomplete, or of another sweep or place."""
    if not file.exists():
        return None
    data = file.read_bytes()
    data, checksum = data[:-32], data[-32:]
    if _checksum(store, file, data) != checksum:
        return None
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        ends = dict(arrays)
    names = [name for name in ends if name.startswith(_OF_IMPACTS)]
    impacts = Impact(**{name.removeprefix(_OF_IMPACTS): ends.pop(name) for name in names})
    return PointResults(impacts=impacts, lane_steps=int(ends.pop("lane_steps")), ends=ends)


def _checksum(store: Store, file: Path, data: bytes) -> bytes:
    """The 32 bytes that end a chunk's file."""
    return hashlib.sha256(f"{store.sweep} {file.name} ".encode() + data).digest()


def _write(file: Path, data: bytes, name: Callable[[Path, Path], object]) -> None:
    """Write a file under a unique temporary name, and give it its own name once it is whole."""
    part = file.with_suffix(f".{uuid.uuid4().hex}.part")
    try:
        part.write_bytes(data)
        name(part, file)
    finally:
        part.unlink(missing_ok=True)


def _first_come(part: Path, file: Path) -> None:
    """Name a file unless the name is taken: the first writer wins."""
    try:
        os.link(part, file)
    except FileExistsError:
        return
    except OSError:  # a file system without links
        with contextlib.suppress(FileExistsError), file.open("xb") as made:
            made.write(part.read_bytes())


def _digest(tree: object) -> str:
    """Digest of the numbers of a tree."""
    digest = hashlib.sha256()
    for leaf in map(np.asarray, jax.tree.leaves(tree)):
        digest.update(f"{leaf.dtype}{leaf.shape}".encode())
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()[:32]


def _program(system: ImpactSystem) -> str:
    """Digest of the program of a force, whose name may stay the same while its body changes."""
    if not isinstance(system.force, BoundForce):
        return "none"
    force = force_of(system)
    return _digest(program_of(jax.tree.map(lambda a: a[..., 0], force), system.num_masses))


def _summary(values: np.ndarray) -> str:
    first, last = values.ravel()[[0, -1]]
    return f"{' x '.join(map(str, values.shape))} values from {first} to {last} ({_digest(values)[:8]})"


def difference(there: object, here: object, name: str = "") -> str | None:
    """The first difference of two manifests, as a clause; None if there is none."""
    if isinstance(there, dict) and isinstance(here, dict):
        pairs = [(f"{name}.{key}".lstrip("."), there.get(key), here.get(key)) for key in {**there, **here}]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        pairs = [(f"{name}[{k}]", a, b) for k, (a, b) in enumerate(zip(there, here, strict=True))]
    else:
        there, here = ("missing" if a is None else a for a in (there, here))
        return None if there == here else f"`{name}` is {there} there, but {here} here"
    return next((clause for n, a, b in pairs if (clause := difference(a, b, n))), None)
