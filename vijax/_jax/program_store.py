"""Compiled programs on disk, for later processes.

JAX's own cache keeps what XLA compiles; to look a program up there it must be traced and lowered, which takes as long.
Here a program is looked up by what it is made from: the function, its static arguments, the shapes of its arrays,
all source of this package, the releases of the others, and the processor. What cannot be named in this way, for
instance a function or a class of the user or a derivative, is looked up by its lowered text.
"""

import hashlib
import io
import logging
import os
import pickle
import platform
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
from platformdirs import user_cache_path

from .file_lock import locked

try:
    from jax.experimental.serialize_executable import deserialize_and_load, serialize
except ImportError:  # without it nothing is stored
    serialize = deserialize_and_load = None

_log = logging.getLogger(__name__)

# `_MOST`: bytes in a folder above which the programs that were not used for longest are removed, down to `_AFTER`.
_MOST, _AFTER = 2**30, 3 * 2**28
_SUFFIX, _TEMPORARY, _LOCK = ".program", ".unfinished", ".lock"
# Environment variable: a folder for programs, or one of `_OFF`.
_VARIABLE, _OFF = "VIJAX_PROGRAMS", ("0", "off", "no", "false")
# Releases of these are part of a key, so that their functions and classes can be part of static arguments.
_RELEASES = ("jax", "jaxlib", "equinox", "diffrax", "lineax", "optimistix", "numpy")
_TRUSTED = {
    "vijax",
    "builtins",
    "collections",
    "copyreg",
    "enum",
    "functools",
    "jaxtyping",
    "operator",
    *_RELEASES,
}


class StoredProgram(NamedTuple):
    """A compiled program, and the tree of its results with placeholders for arrays."""

    run: Callable
    results: Any


class ProgramStore:
    """Compiled programs in a folder, shared by any number of processes.

    A file is written under another name first. It begins with a checksum: a damaged one is removed and made again.

    Args:
        folder: the folder.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def load(self, key: str) -> StoredProgram | None:
        """Program of a key; None if there is none that can be used."""
        assert deserialize_and_load is not None
        file = self._file(key)
        try:
            data = file.read_bytes()
        except OSError:
            return None
        try:
            if hashlib.sha256(data[32:]).digest() != data[:32]:
                raise ValueError("checksum")
            program, results = pickle.loads(data[32:])  # machine code is trusted as much as this
            _find_lapack()
            run = deserialize_and_load(*program)
        except Exception as error:  # which error a damaged or foreign file causes depends on where
            _log.info("%s cannot be used and is removed: %s", file, error)
            with suppress(OSError):
                file.unlink()
            return None
        with suppress(OSError):
            os.utime(file)  # the time of last use, by which programs are removed
        return StoredProgram(run, results)

    def save(self, key: str, compiled: Any, results: Any) -> None:
        """Store a compiled program; does nothing if that is impossible."""
        assert serialize is not None
        try:
            if _calls_python(compiled):
                return
            data = _bytes_of((serialize(compiled), results))
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self.folder, suffix=_TEMPORARY, delete=False) as file:
                try:
                    file.write(hashlib.sha256(data).digest() + data)
                    file.close()
                    os.replace(file.name, self._file(key))
                except BaseException:
                    os.unlink(file.name)
                    raise
            self._make_room()
        except Exception as error:  # a full disk, a folder of someone else, a program that JAX cannot write
            _log.info("A program was not stored in %s: %s", self.folder, error)

    @contextmanager
    def maker(self, key: str, tell_waiting: Callable[[], None]) -> Iterator[None]:
        """Be the only one who makes a program, in this process and all others that use the folder.

        Waits while another one makes it, after `tell_waiting()`; look for the program again inside. Where no lock can be
        made, in a folder that cannot be written for instance, there is none.
        """
        with suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with locked(self.folder / f"{key}{_LOCK}", tell_waiting):
            yield

    def can_write(self) -> bool:
        """True if programs can be stored."""
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self.folder, suffix=_TEMPORARY):
                return True
        except OSError:
            return False

    def _file(self, key: str) -> Path:
        return self.folder / f"{key}{_SUFFIX}"

    def _make_room(self) -> None:
        """Remove the programs that were not used for longest, if there are too many, and remains of killed processes."""
        found = []
        for entry in os.scandir(self.folder):
            if entry.name.endswith((_SUFFIX, _TEMPORARY, _LOCK)):
                with suppress(OSError):  # another process may remove it now
                    stat = entry.stat()
                    found.append((stat.st_mtime, stat.st_size, entry.path))
        size = sum(size for _, size, _ in found)
        if size <= _MOST:
            return
        for _, own, path in sorted(found):
            if size <= _AFTER:
                break
            size -= own
            with suppress(OSError):
                os.unlink(path)


class _Active:
    """The store of this process, and whether it has been chosen."""

    def __init__(self):
        self.is_chosen = False
        self.store: ProgramStore | None = None


_active = _Active()


def store_programs(folder: Path | None) -> None:
    """Choose the folder for programs; None: do not store any, nor use a folder in which anybody could place some."""
    if folder is not None and _is_open_to_all(folder):
        _log.warning(
            "Programs are not stored in %s, as others can write there: choose a private folder.", folder
        )
        folder = None
    _active.is_chosen, _active.store = True, None if folder is None else ProgramStore(folder)


def _is_open_to_all(folder: Path) -> bool:
    """True if a folder belongs to another user, or all users can write there; where users have no numbers, False."""
    if not folder.exists() or not hasattr(os, "getuid"):
        return False
    stat = folder.stat()
    return stat.st_uid != os.getuid() or bool(stat.st_mode & 0o002)


def program_store() -> ProgramStore | None:
    """The store of this process, or None: a folder of the user unless the environment names another, or none."""
    if not _active.is_chosen:
        named = os.environ.get(_VARIABLE, "")
        if named.lower() in _OFF:
            store_programs(None)
        else:
            store_programs(Path(named).expanduser() if named else user_cache_path("vijax") / "programs")
    is_usual = serialize is not None and jax.default_backend() == "cpu" and jax.local_device_count() == 1
    return _active.store if is_usual else None


def key_of(*parts: Any) -> str | None:
    """Name of a program that is made from these parts; None if a part has no name that outlasts the process."""
    try:
        text = _bytes_of(parts)
    except Exception:  # `pickle` raises what the classes of the parts raise
        return None
    return hashlib.sha256(_environment() + text).hexdigest()


class _KeyPickler(pickle.Pickler):
    """Pickles trees of plain values, and functions and classes of known releases by their names.

    Equal trees have equal bytes: without a memo these do not depend on which values are one object.
    """

    def __init__(self, file: io.BytesIO):
        super().__init__(file, protocol=5)
        self.fast = True

    def reducer_override(self, obj: Any) -> Any:
        """Refuse what is not of a known release, and write a structure of JAX as a tree."""
        if isinstance(obj, jax.tree_util.PyTreeDef):
            return jax.tree.structure, (jax.tree.unflatten(obj, [_LEAF] * obj.num_leaves),)
        own = obj if isinstance(obj, type) or (callable(obj) and hasattr(obj, "__qualname__")) else type(obj)
        if (own.__module__ or "builtins").partition(".")[0] not in _TRUSTED:
            raise pickle.PicklingError(f"{own} is not of a known release")
        return NotImplemented


# Leaf of a structure that is written as a tree.
_LEAF = 0


def _bytes_of(tree: Any) -> bytes:
    file = io.BytesIO()
    _KeyPickler(file).dump(tree)
    return file.getvalue()


def _calls_python(compiled: Any) -> bool:
    """True if a program calls back into this process, or may."""
    parts = compiled._executable._unloaded_executable  # JAX tells it nowhere else
    return any((parts.host_callbacks, parts.keepalive, parts.unordered_effects, parts.ordered_effects))


@cache
def _find_lapack() -> None:
    """Let JAX find the routines of LAPACK, which it does when it first lowers one: a loaded program jumps to them."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), "float32"))


@cache
def _environment() -> bytes:
    """Digest of all that a program depends on besides its parts: source, releases, processor, compiler settings."""
    digest = hashlib.sha256()
    package = Path(__file__).parents[1]
    for file in sorted(package.rglob("*.py")):
        digest.update(str(file.relative_to(package)).encode() + b"\0" + file.read_bytes())
    releases = [(name, version(name)) for name in _RELEASES]
    settings = [(name, os.environ.get(name)) for name in ("XLA_FLAGS", "JAX_PLATFORMS", "VIJAX_PLAIN")]
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    digest.update(repr((platform.python_version(), releases, settings, cores, _processor())).encode())
    return digest.digest()


def _processor() -> str:
    """Name of the processor and of its instructions."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return "\n".join(next((a for a in lines if a.startswith(key)), "") for key in ("model name", "flags"))
    return f"{platform.machine()} {platform.processor()}"
