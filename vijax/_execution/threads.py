"""Runner on this machine: a queue of points on every core."""

import math
import os
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import nullcontext
from functools import partial
from threading import Event, Lock

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from .._flow.interface import AbstractFlow
from .._jax.memory_maps import make_room
from .._jax.xla import padding_allowed
from .._machine.numbers import numbers_of, with_base
from .._machine.preparation import AUTOMATIC_MAX_STEPS
from .._trajectory.observer import OF_BASE
from .lane_queue import LaneProgram, Points, Queue, are_small, new_queue, run_lanes
from .packed import pack
from .points import LaneInput
from .records import PeriodEnd, joined, written_rows
from .runner import AbstractRunner, Counts, PointResults, join_results
from .settings import ExecutionSettings

# A program is compiled once, not by every thread. Programs that this process has, by what they are compiled for.
_COMPILING = Lock()
_COMPILED: set[Hashable] = set()
# Most numbers in the tables of all points of a queue, 32 megabytes.
_OF_TABLES = 1 << 22
_ALL_BUT_TURNS = np.array([1, 1, 1, 1, 1, 1, 0])


def count_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads(AbstractRunner):
    """Runner on every core of this process: XLA releases Python's lock while it works.

    Attributes:
        flow: the flow between events.
        counts: arguments of `sweep` for every point.
        settings: sizes of lanes and queues.
        in_all: number of points of the whole sweep, where the given points are a part of it.
    """

    flow: AbstractFlow
    counts: Counts
    settings: ExecutionSettings
    in_all: int | None = None

    def run(self, points: LaneInput, which: np.ndarray, tell: Callable[[int], object]) -> PointResults:
        """Run points in threads, a queue in each."""
        make_room()
        numbers = numbers_of(points.system)
        if set(OF_BASE) & set(self.counts.observed):
            numbers = with_base(numbers, points.system)
        own = Points(numbers, self.flow, points.x0, points.v0)
        num_queues, shape = self._sizes(own, which)
        shares = split_evenly(points, which, num_queues)
        stop, x64 = Event(), bool(jax.config.read("jax_enable_x64"))
        workers = ThreadPoolExecutor(self.settings.cores or count_cores())
        try:
            jobs = {
                workers.submit(_run_queue, self, own, share, shape, tell, stop, x64): number
                for number, share in enumerate(shares)
            }
            return join_results(_as_they_end(jobs), shares)
        finally:
            stop.set()
            workers.shutdown(wait=True, cancel_futures=True)

    def _sizes(self, points: Points, which: np.ndarray) -> tuple[int, tuple[int, int]]:
        """Number of queues, and the points and lanes of each.

        They follow from the size of the whole sweep. Small machines have queues of one size: preparing points that are not there
        takes less than another program.
        """
        in_all = points.x0.shape[-1] if self.in_all is None else self.in_all
        num_lanes = self.settings.lanes
        is_wide = in_all > num_lanes or (are_small(points) and points.numbers.tables is None)
        width = max(min(self.settings.points, _most_points(points)), num_lanes) if is_wide else num_lanes
        cores = self.settings.cores or count_cores()
        num_queues = max(-(-which.size // width), min(cores, -(-which.shape[-1] // num_lanes)))
        return num_queues, (width, num_lanes)


def split_evenly(points: LaneInput, which: np.ndarray, num_shares: int) -> list[np.ndarray]:
    """Divide points evenly.

    Points with the longest periods take most work: they come first, spread over all shares. Chains stay whole.
    """
    frequency = np.broadcast_to(points.system.forcing.frequency, points.x0.shape[-1])[which]
    order = which[..., np.argsort(frequency.reshape(-1, which.shape[-1])[0], kind="stable")]
    return [order[..., k::num_shares] for k in range(num_shares)]


def _as_they_end(jobs: dict[Future, int]) -> Iterator[tuple[int, PointResults]]:
    """Numbers and results of jobs, or the first error. Waits in short intervals, so that an interrupt is noticed."""
    while jobs:
        done, _ = wait(jobs, timeout=0.5, return_when=FIRST_COMPLETED)
        for job in done:
            yield jobs.pop(job), job.result()


@padding_allowed  # here, because the setting is per thread
def _run_queue(
    runner: Threads,
    points: Points,
    share: np.ndarray,
    shape: tuple[int, int],
    tell: Callable[[int], object],
    stop: Event,
    x64: bool,
) -> PointResults:
    """Run a share of the points as one queue."""
    # JAX has its settings per thread. Numbers that all points share are broadcast.
    with jax.enable_x64(x64), jax.numpy_rank_promotion("allow"):
        call, queue = _start(runner, points, share, shape)
        impacts, marks, is_left, reported = [], [], True, 0
        while is_left and not stop.is_set():
            queue, more = call(queue)
            is_left, progress = bool(more), queue.progress
            impacts.append(written_rows(progress.impacts))
            marks.append(written_rows(progress.marks))
            done = int(np.sum(np.asarray(queue.ends.steps)[: share.size] > 0))
            tell(done - reported)
            reported = done
    ends, state = queue.ends, queue.ends.state
    columns = {"x": state.x, "v": state.v, "held": state.held, "periods": ends.marks} | {
        name: getattr(ends, name) for name in ("num_impacts", "num_sticks", "steps", "is_finite")
    }
    columns |= ends.observed
    kept = {name: np.asarray(a)[..., : share.size] for name, a in columns.items()}
    kept |= _sections(joined(marks), runner.counts.record, share.size)
    return PointResults(kept, joined(impacts), int(queue.progress.turns) * shape[1]).numbered(share)


def _sections(marks: PeriodEnd, record: int, num_points: int) -> dict[str, np.ndarray]:
    """The marks as tables, (..., periods, points)."""
    tables, place = {}, marks.mark.astype(np.intp) * num_points + marks.point
    for name in ("x", "v", "held_time", "growth"):
        rows = getattr(marks, name)
        if rows is None:
            continue
        table = np.zeros((rows.shape[1], record * num_points), rows.dtype)
        for k, column in enumerate(rows.T):
            table[k, place] = column
        tables[f"section_{name}"] = table.reshape(-1, record, num_points)
    return tables


def _start(
    runner: Threads, points: Points, share: np.ndarray, shape: tuple[int, int]
) -> tuple[Callable[[Queue], tuple[Queue, Array]], Queue]:
    """A call that works on the queue of some points, filled up to one width, and the new queue."""
    counts, settings, (width, num_lanes) = runner.counts, runner.settings, shape
    filled = np.append(share, np.zeros(width - share.size, int))
    layout, packed = pack(points, filled, repeated=_repeated(points))
    times = None if counts.times is None else _padded(counts.times, packed.own.dtype)
    program = LaneProgram(layout, counts.can_stick, counts.lyapunov, counts.observed, times is not None)
    periods = (counts.transient, counts.transient + counts.record)
    max_steps = AUTOMATIC_MAX_STEPS if counts.max_steps is None else counts.max_steps
    work = np.array(
        [share.size, share.shape[-1], *periods, max_steps, counts.max_impacts, settings.turns],
        jax.dtypes.canonicalize_dtype(int),
    )
    queue = new_queue(program, width, num_lanes, settings)
    call = partial(run_lanes, program, packed, work, times)
    key = program, shape, packed.own.dtype, settings, 0 if times is None else len(times)
    with _COMPILING if key not in _COMPILED else nullcontext():
        if key not in _COMPILED:
            # Compiles, and takes no turn yet.
            queue, _ = run_lanes(program, packed, work * _ALL_BUT_TURNS, times, queue)
            _COMPILED.add(key)
    return call, queue


def _padded(times: tuple[float, ...], dtype: np.dtype) -> np.ndarray:
    """Times of marks, the last repeated up to a power of two, so that one program serves many numbers of them."""
    size = 1 << (len(times) - 1).bit_length()
    return np.asarray((*times, *times[-1:] * (size - len(times))), dtype)


def _most_points(points: Points) -> int:
    """Most points of a queue whose own tables of the load fit into some megabytes: a power of two."""
    rows = [math.prod(a.shape[:-1]) for a in jax.tree.leaves(points.numbers.tables) if a.shape[-1] > 1]
    return 1 << (_OF_TABLES // max(sum(rows), 1)).bit_length() - 1


def _repeated(points: Points) -> Points | bool:
    """Flags of the numbers that are repeated for every point; tables of loads, which are long, are not."""
    are_own = _are_all_own(points)
    if points.numbers.tables is None:
        return are_own
    flags = jax.tree.map(lambda _: are_own, points)
    of_tables = jax.tree.map(lambda _: False, points.numbers.tables)
    return eqx.tree_at(lambda p: p.numbers.tables, flags, of_tables)


def _are_all_own(points: Points) -> bool:
    """True where numbers that points share are repeated for each, so that one program serves whatever is swept.

    So it is for small machines. The numbers of a large one are many, and two programs serve: one where all points
    share all numbers but the frequency, one where they share none.
    """
    if are_small(points):
        return True
    rest = eqx.tree_at(lambda p: (p.numbers.frequency, p.x0, p.v0), points, [np.zeros(1)] * 3)
    return any(np.shape(a)[-1] > 1 for a in jax.tree.leaves(rest))
