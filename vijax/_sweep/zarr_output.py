"""A sweep that is written while it runs, so that memory holds only the part that is running.

Workers make the points of a block, run them and write the results themselves, wherever they are. The bits are those
of a sweep in memory: the flow between events, and whether any stop may hold its mass, are determined from all points
before any is run, and a block is run as a part of the whole.
"""

import math
import os
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import equinox as eqx
import numpy as np
import xarray as xr

from .._execution.cluster import part_of
from .._execution.points import LaneInput, with_values
from .._execution.runner import Counts
from .._execution.settings import ExecutionSettings
from .._execution.store import describe_sweep
from .._execution.tasks import as_executor, run_tasks
from .._execution.threads import Threads, count_cores
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._flow.taylor import TaylorFlow
from .._hybrid.sticking import can_any_stick
from .._progress import tqdm
from .._writing import saying_what_is_kept
from .dataset import coordinates_of, dataset, labelled, saved_times
from .folder import Folder, open_folder
from .grid import grid_points
from .outcomes import warn_of_endings
from .provenance import name_of_flow, origin
from .short_names import with_labels, with_names

# Version of the format, raised with every change of what is written.
_LAYOUT = "Zarr 3"
# Points that are checked in one task, before any is run.
_LOOKED_AT = 1 << 16


class _Sweep(eqx.Module):
    """Data common to all blocks.

    Attributes:
        base: machine and start where nothing is swept.
        counts: arguments of `sweep` for every point.
        flow: the requested flow between events.
        settings: sizes of lanes and queues.
        in_all: number of points.
        names: short names of swept quantities by path.
        quantities: names of quantities to add.
    """

    base: LaneInput
    counts: Counts
    flow: AbstractFlow | None
    settings: ExecutionSettings
    in_all: int
    names: dict[str, str]
    quantities: tuple[str, ...]

    def points(self, axes: dict[str, np.ndarray]) -> LaneInput:
        """Points of a block, two at least: an axis of length one means shared by all."""
        points = self._grid(axes)
        return part_of(points, np.arange(points.x0.shape[-1])) if self.in_all > 1 else points

    def _grid(self, axes: dict[str, np.ndarray]) -> LaneInput:
        return grid_points(self.base, axes, counts_periods=self.counts.times is None)

    def run(self, axes: dict[str, np.ndarray]) -> xr.Dataset:
        """Run a block as a part of the whole."""
        points, shape = self.points(axes), tuple(len(axis) for axis in axes.values())
        which = np.arange(math.prod(shape))
        motion = choose_flow(points.system, can_stick=self.counts.can_stick, wanted=self.flow, for_many=True)
        found = Threads(motion, self.counts, self.settings, self.in_all).run(points, which, lambda _: None)
        ds = dataset(self._grid(axes), axes, shape, self.counts, found, {}, self.quantities)
        return with_names(ds, self.names)


def write_sweep(
    out: str | os.PathLike[str],
    base: LaneInput,
    axes: dict[str, np.ndarray],
    names: dict[str, str],
    quantities: tuple[str, ...],
    counts: Counts,
    flow: AbstractFlow | None,
    executor: object,
    settings: ExecutionSettings,
    *,
    progress: bool,
) -> xr.Dataset:
    """Run a sweep into a folder, or continue one there, and open it.

    The folder is made if missing. `base` is the machine and start where nothing is swept, `axes` the values of every
    swept quantity, `names` the short names of some, `quantities` what is added to the dataset.

    Raises:
        ValueError: if the folder holds something else, or Zarr is not installed.
    """
    if find_spec("zarr") is None:
        raise ValueError("Argument `out` needs Zarr: pip install 'vijax[io]'.")
    workers = None if executor is None else as_executor(executor)
    shape = tuple(len(axis) for axis in axes.values())
    cores = (settings.cores or count_cores()) if workers is None else 1
    sweep = _Sweep(base, counts, flow, replace(settings, cores=cores), math.prod(shape), names, quantities)
    sweep = _checked_sweep(sweep, axes, workers)
    block = _block_of(shape, cores * settings.chunk_of(counts.work))
    folder = _open_or_begin(Folder(Path(out).absolute(), shape, block, counts.max_impacts), sweep, axes, flow)
    with tqdm(total=sweep.in_all, unit="point", disable=not progress) as bar:

        def missing() -> Iterator[tuple[int, tuple]]:
            is_done = folder.done()
            # Random order, so that several processes share the work.
            for number in np.random.default_rng().permutation(math.prod(folder.blocks)).tolist():
                part = _part(axes, folder, number)
                size = math.prod(len(axis) for axis in part.values())
                if is_done(number):
                    bar.update(size)
                else:
                    yield size, (sweep, part, folder, number)

        for size, _ in run_tasks(workers, _write_block, missing(), settings.in_flight):
            bar.update(size)
    ds = folder.open()
    warn_of_endings(ds, "max_impacts_reached", "max_steps_reached", "non_finite", "friction_paradox")
    return ds


def _write_block(sweep: _Sweep, axes: dict[str, np.ndarray], folder: Folder, number: int) -> None:
    """Run a block and write its results; called by a worker."""
    found = sweep.run(axes)
    with saying_what_is_kept(folder.path):
        folder.write(number, found)


def _part(axes: dict[str, np.ndarray], folder: Folder, number: int) -> dict[str, np.ndarray]:
    """Swept values of a block."""
    places = zip(axes.items(), folder.slices(number), strict=True)
    return {path: axis[place] for (path, axis), place in places}


def _block_of(shape: tuple[int, ...], size: int) -> tuple[int, ...]:
    """Shape of blocks of at most `size` points, neighbours along the last paths."""
    block = []
    for points in reversed(shape):
        block.append(min(points, max(size, 1)))
        size //= points
    return tuple(reversed(block))


def _checked_sweep(sweep: _Sweep, axes: dict[str, np.ndarray], workers: Executor | None) -> _Sweep:
    """The sweep with a flow that serves all its points, all of which are checked."""
    shape = tuple(len(axis) for axis in axes.values())
    whole = Folder(Path(), shape, _block_of(shape, _LOOKED_AT), 0)
    tasks = ((None, (sweep, _part(axes, whole, k))) for k in range(math.prod(whole.blocks)))
    findings = [found for _, found in run_tasks(workers, _look_at, tasks, sweep.settings.in_flight)]
    can_stick = any(can for can, _ in findings)
    fits = all(fits[can_stick] for _, fits in findings)
    flow = TaylorFlow() if sweep.flow is None and not fits else sweep.flow
    return replace(sweep, counts=replace(sweep.counts, can_stick=can_stick), flow=flow)


def _look_at(sweep: _Sweep, axes: dict[str, np.ndarray]) -> tuple[bool, tuple[bool, ...]]:
    """Flag that a stop may hold its mass, and flags that `TaylorFlow` is unnecessary without and with holding."""
    points = sweep.points(axes)
    can_stick = can_any_stick(points.system, points.x0, points.v0)
    fits = tuple(
        not isinstance(
            choose_flow(points.system, can_stick=can, wanted=sweep.flow, for_many=True), TaylorFlow
        )
        for can in (False, True)
    )
    return can_stick, fits


def _open_or_begin(
    folder: Folder, sweep: _Sweep, axes: dict[str, np.ndarray], flow: AbstractFlow | None
) -> Folder:
    """The folder, with the blocks that it has if it was begun before."""
    first = sweep.points(_part(axes, folder, 0))
    motion = choose_flow(first.system, can_stick=sweep.counts.can_stick, wanted=sweep.flow, for_many=True)
    attributes = origin(sweep.base, sweep.counts, flow=name_of_flow(motion, flow), carry=None, goes_on=False)
    one = with_values(sweep.base, {})
    given = axes | saved_times(sweep.counts)
    manifest = describe_sweep(attributes, given, one, flow, sweep.settings) | {"layout": _LAYOUT}
    if sweep.names:
        manifest["short names"] = sweep.names
    if sweep.quantities:
        manifest["quantities"] = list(sweep.quantities)
    coordinates = coordinates_of(one.system, axes, sweep.counts)
    coordinates = labelled(xr.Dataset(coords=coordinates, attrs=attributes))
    named = with_labels(with_names(coordinates, sweep.names), sweep.base.system)
    return open_folder(folder, named, manifest)
