"""Runner on this machine: a queue of points on every core."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from threading import Event, Lock

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from .._flow.interface import AbstractFlow
from .._jax.memory_maps import make_room
from .._jax.xla import padding_allowed
from .._machine.machine import AUTOMATIC_MAX_STEPS
from .._system.system import ImpactSystem
from .lane_loop import Work
from .lane_queue import Queue, new_queue, run_lanes
from .points import LaneInput
from .records import PeriodEnd, joined, written_rows
from .runner import AbstractRunner, Counts, PointResults, join_results
from .settings import ExecutionSettings

# Queues begin one after another. Otherwise each would compile, and wait for Python's lock.
_STARTING = Lock()


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
        num_queues, shape = self._sizes(self.size_of(points), which)
        shares = split_evenly(points, which, num_queues)
        stop, x64 = Event(), bool(jax.config.read("jax_enable_x64"))
        workers = ThreadPoolExecutor(self.settings.cores or count_cores())
        try:
            jobs = {
                workers.submit(_run_queue, self, points, share, shape, tell, stop, x64): number
                for number, share in enumerate(shares)
            }
            return join_results(_as_they_end(jobs), shares)
        finally:
            stop.set()
            workers.shutdown(wait=True, cancel_futures=True)

    def size_of(self, points: LaneInput) -> int:
        """Number of points of the whole sweep, which determines what is compiled."""
        return points.x0.shape[-1] if self.in_all is None else self.in_all

    def _sizes(self, in_all: int, which: np.ndarray) -> tuple[int, tuple[int, int]]:
        """Number of queues, and the points and lanes of each, which follow from the size of the whole sweep."""
        num_lanes = self.settings.lanes
        width = self.settings.points if in_all > num_lanes else num_lanes
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
    points: LaneInput,
    share: np.ndarray,
    shape: tuple[int, int],
    tell: Callable[[int], object],
    stop: Event,
    x64: bool,
) -> PointResults:
    """Run a share of the points as one queue."""
    # JAX has its settings per thread. Numbers that all points share are broadcast.
    with jax.enable_x64(x64), jax.numpy_rank_promotion("allow"):
        with _STARTING:
            task, queue = _start(runner, points, share, shape)
        impacts, marks, is_left, reported = [], [], True, 0
        while is_left and not stop.is_set():
            queue, more = run_lanes(task, queue, can_stick=runner.counts.can_stick, is_carried=share.ndim > 1)
            is_left, progress = bool(more), queue.progress
            impacts.append(written_rows(progress.impacts))
            marks.append(written_rows(progress.marks))
            zeros = (_whole(0), _whole(0))
            queue = eqx.tree_at(lambda q: (q.progress.impacts.size, q.progress.marks.size), queue, zeros)
            done = int(np.sum(np.asarray(queue.ends.steps)[: share.size] > 0))
            tell(done - reported)
            reported = done
    ends, state = queue.ends, queue.ends.state
    columns = {"x": state.x, "v": state.v, "held": state.held, "periods": state.periods} | {
        name: getattr(ends, name) for name in ("num_impacts", "num_sticks", "steps", "is_finite")
    }
    kept = {name: np.asarray(a)[..., : share.size] for name, a in columns.items()}
    kept |= _sections(joined(marks), runner.counts.record, share.size)
    return PointResults(kept, joined(impacts), int(queue.progress.turns) * shape[1]).numbered(share)


def _whole(number: int) -> Array:
    return jax.device_put(np.asarray(number, jax.dtypes.canonicalize_dtype(int)))


def _sections(marks: PeriodEnd, record: int, num_points: int) -> dict[str, np.ndarray]:
    """The marks as tables, (..., periods, points)."""
    tables = {}
    for name in ("x", "v", "held_time", "growth"):
        rows = getattr(marks, name)
        if rows is None:
            continue
        table = np.zeros((rows.shape[1], record, num_points), rows.dtype)
        table[:, marks.period, marks.point] = rows.T
        tables[f"section_{name}"] = table
    return tables


def _of_queue(
    numbers: tuple[ImpactSystem, AbstractFlow], filled: np.ndarray, *, is_long: bool
) -> tuple[ImpactSystem, AbstractFlow]:
    """Numbers of some points.

    Either all numbers but the frequency are shared by all points, or none is: two programs then serve, whatever is
    swept. A program that shares all numbers that are not swept takes 6 to 9 % less time, if only the start or a stop
    is swept, and seconds to compile: it is for long sweeps.
    """

    def of_each(a: Array | np.ndarray) -> Array:
        a = np.asarray(a)
        each = a[..., filled] if a.shape[-1] > 1 else np.broadcast_to(a, (*a.shape[:-1], len(filled)))
        return jax.device_put(np.ascontiguousarray(each))

    def where_swept(a: Array | np.ndarray) -> Array:
        return of_each(a) if a.shape[-1] > 1 else jax.device_put(a)

    if is_long:
        return jax.tree.map(where_swept, numbers)
    frequency = lambda numbers: numbers[0].forcing.frequency  # noqa: E731
    rest = eqx.tree_at(frequency, numbers, np.zeros(1))
    is_shared = all(a.shape[-1] == 1 for a in jax.tree.leaves(rest))
    others = jax.tree.map(where_swept if is_shared else of_each, rest)
    return eqx.tree_at(frequency, others, of_each(frequency(numbers)))


def _start(
    runner: Threads, points: LaneInput, share: np.ndarray, shape: tuple[int, int]
) -> tuple[tuple, Queue]:
    """Make a queue of some points, filled up to one width: one shape, one compilation, made here."""
    counts, settings, (width, num_lanes) = runner.counts, runner.settings, shape
    filled = np.append(share, np.zeros(width - share.size, int))
    is_long = runner.size_of(points) * (counts.transient + counts.record) > settings.long
    system, motion = _of_queue((points.system, runner.flow), filled, is_long=is_long)
    x0, v0 = (jax.device_put(a[:, filled]) for a in (points.x0, points.v0))
    periods = (counts.transient, counts.transient + counts.record)
    max_steps = AUTOMATIC_MAX_STEPS if counts.max_steps is None else counts.max_steps
    numbers = (share.size, share.shape[-1], *periods, max_steps, counts.max_impacts, 0)
    work = Work(*map(_whole, numbers))
    task = (motion, system, x0, v0, work)
    queue = new_queue(system, x0, num_lanes, motion, settings, has_tangents=counts.lyapunov)
    queue, _ = run_lanes(task, queue, can_stick=counts.can_stick, is_carried=share.ndim > 1)  # no turn yet
    return eqx.tree_at(lambda t: t[4].max_turns, task, _whole(settings.turns)), queue
