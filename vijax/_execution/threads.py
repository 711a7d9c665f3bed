"""A queue of points on every core: the host's side of a sweep."""

import os
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from threading import Event, Lock

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from .._flow.interface import AbstractFlow
from .._xla import padding_allowed
from .lane_loop import Rows, Work
from .lane_queue import OWN_BOUND, Queue, new_queue, run_lanes
from .points import Point

# Enough lanes to hide the overhead of the compiled loop, few enough to stay in the cache; enough points
# to a queue that its end, where lanes have nothing left to do, is a small part of it.
_LANES, _POINTS = 96, 2048
# Turns of the loop after which it comes back, so that it can be watched and interrupted.
_TURNS = 1 << 14


@dataclass(frozen=True)
class Counts:
    """What is asked of every point: see `sweep`; `max_steps` is None where every point has its own bound."""

    transient: int
    record: int
    max_impacts: int
    max_steps: int | None
    can_stick: bool


@dataclass(frozen=True)
class Found:
    """What came of some points.

    Attributes:
        ends: `x`, `v`, `held`, `periods`, `num_impacts`, `num_sticks`, `steps`, `is_finite` and `section`
            (`x`, `v` and time held at the end of each recorded period), the points as last axis.
        impacts: one row an impact: time, velocity, stop, point, number, time to the end of its chatter.
        lane_steps: steps of all lanes, idle ones included.
    """

    ends: dict[str, np.ndarray]
    impacts: np.ndarray
    lane_steps: int


def count_cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_points(
    points: Point,
    flow: AbstractFlow,
    counts: Counts,
    tell: Callable[[int], object] = lambda _: None,
    *,
    which: np.ndarray | None = None,
) -> Found:
    """Run points, a queue on every core: XLA lets go of Python while it works.

    Args:
        points: the machines and starts of a whole sweep, whose size decides what is compiled; `x0` and `v0`
            have all points as their last axis.
        flow: the motion between events.
        counts: what is asked of every point.
        tell: called with the number of points done since the last call.
        which: the points to run, in increasing order; all if left out.

    Returns:
        What came of them, in their order; the impacts with their numbers in the whole sweep.
    """
    in_all = points.x0.shape[-1]
    which = np.arange(in_all) if which is None else which
    num_points = len(which)
    num_lanes = _LANES if in_all > _LANES else max(8, 1 << (in_all - 1).bit_length())
    width = _POINTS if in_all > num_lanes else num_lanes
    cores = count_cores()
    num_queues = max(-(-num_points // width), min(cores, -(-num_points // num_lanes)))
    # The longest periods have most to do: they come first, and every queue has its share of them.
    frequency = np.broadcast_to(points.system.forcing.frequency, in_all)[which]
    order = which[np.argsort(frequency, kind="stable")]
    shares = [order[k::num_queues] for k in range(num_queues)]
    stop, shape = Event(), (width, num_lanes)
    starting = Lock()
    workers = ThreadPoolExecutor(cores)
    try:
        jobs = [
            workers.submit(_run_queue, points, flow, counts, share, shape, tell, stop, starting)
            for share in shares
        ]
        _wait_for(jobs)
    finally:
        stop.set()
        workers.shutdown(wait=True, cancel_futures=True)
    parts = [job.result() for job in jobs]
    back = np.argsort(np.concatenate(shares))
    ends = {name: np.concatenate([part.ends[name] for part in parts], axis=-1) for name in parts[0].ends}
    ends = {name: a[..., back] for name, a in ends.items()}
    impacts = np.concatenate([part.impacts for part in parts])
    return Found(ends, impacts, sum(part.lane_steps for part in parts))


def _wait_for(jobs: list[Future]) -> None:
    """Wait in short turns, so that an interrupt is heard, and raise the first error."""
    waiting = set(jobs)
    while waiting:
        done, waiting = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
        for job in done:
            job.result()


@padding_allowed  # here, for it is a matter of threads
def _run_queue(
    points: Point,
    flow: AbstractFlow,
    counts: Counts,
    share: np.ndarray,
    shape: tuple[int, int],
    tell: Callable[[int], object],
    stop: Event,
    starting: Lock,
) -> Found:
    """Run some points."""
    with jax.numpy_rank_promotion("allow"):  # what all points share is broadcast to them
        with starting:  # one after another: each would compile, and wait for Python's lock
            task, queue = _start(points, flow, counts, share, shape)
        impacts, marks, is_left, told = [], [], True, 0
        while is_left and not stop.is_set():
            queue, more = run_lanes(task, queue, can_stick=counts.can_stick)
            is_left, progress = bool(more), queue.progress
            impacts.append(_taken(progress.impacts))
            marks.append(_taken(progress.marks))
            zeros = (_whole(0), _whole(0))
            queue = eqx.tree_at(lambda q: (q.progress.impacts.size, q.progress.marks.size), queue, zeros)
            done = int(np.sum(np.asarray(queue.ends.steps)[: len(share)] > 0))
            tell(done - told)
            told = done
    ends, state = queue.ends, queue.ends.state
    columns = {"x": state.x, "v": state.v, "held": state.held, "periods": state.periods} | {
        name: getattr(ends, name) for name in ("num_impacts", "num_sticks", "steps", "is_finite")
    }
    kept = {name: np.asarray(a)[..., : len(share)] for name, a in columns.items()}
    kept["section"] = _section(np.concatenate(marks), counts.record, len(share))
    found = np.concatenate(impacts)
    found[:, 3] = share[found[:, 3].astype(int)]
    return Found(kept, found, int(queue.progress.turns) * shape[1])


def _whole(number: int) -> Array:
    return jax.device_put(np.asarray(number, jax.dtypes.canonicalize_dtype(int)))


def _taken(rows: Rows) -> np.ndarray:
    """A copy of what is written: the room is used again."""
    return np.array(np.asarray(rows.room)[: int(rows.size)])


def _section(marks: np.ndarray, record: int, num_points: int) -> np.ndarray:
    """The marks as a table, (marks, periods, points)."""
    section = np.zeros((marks.shape[1] - 2, record, num_points), marks.dtype)
    point, period = marks[:, :2].T.astype(int)
    section[:, period, point] = marks[:, 2:].T
    return section


def _start(
    points: Point, flow: AbstractFlow, counts: Counts, share: np.ndarray, shape: tuple[int, int]
) -> tuple[tuple, Queue]:
    """Make a queue of some points, filled up to one width: one shape, one compilation, made here."""
    width, num_lanes = shape
    filled = np.append(share, np.zeros(width - len(share), int))
    cut = lambda a: jax.device_put(np.asarray(a) if a.shape[-1] == 1 else np.asarray(a)[..., filled])  # noqa: E731
    system, motion = jax.tree.map(cut, (points.system, flow))
    x0, v0 = (jax.device_put(a[:, filled]) for a in (points.x0, points.v0))
    periods = (counts.transient, counts.transient + counts.record)
    max_steps = OWN_BOUND if counts.max_steps is None else counts.max_steps
    numbers = (len(share), *periods, max_steps, counts.max_impacts, 0)
    work = Work(*map(_whole, numbers))
    task = (motion, system, x0, v0, work)
    queue = new_queue(system, x0, num_lanes, motion)
    queue, _ = run_lanes(task, queue, can_stick=counts.can_stick)  # no turn yet
    return eqx.tree_at(lambda t: t[4].max_turns, task, _whole(_TURNS)), queue
