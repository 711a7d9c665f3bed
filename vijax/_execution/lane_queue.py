"""Many trajectories as lanes of one loop, fed from a queue.

A loop over lanes lasts as long as its slowest lane. A lane that is done therefore takes the next point from a queue.
When enough lanes are done, the loop ends, their results are stored, new points are gathered, and the loop starts
again. Points in order of decreasing work leave little of the last round idle.

Where points are carried, a queue holds chains. A lane that is done continues with the next point of its chain, from
its present state, and takes the next chain at the end of its own.

Impacts and states at the ends of recorded periods are appended to rows that the host takes away. Memory therefore
does not depend on their number, and the transient writes nothing.
"""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int, PyTree

from .._flow.interface import AbstractFlow
from .._jax.arrays import UNROLLED, Reals
from .._jax.xla import PLAIN, in_one_kernel
from .._machine.machine import AUTOMATIC_MAX_STEPS, Machine, default_max_steps, prepare
from .._machine.numbers import num_harmonics, numbers_of
from .._machine.state import State
from .._system.system import ImpactSystem
from .._trajectory.step import initial_state
from .._trajectory.tangent_frame import Tangents, first_tangents
from .carry_start import carried_start
from .lane_loop import EndStates, LaneTask, Progress, Work, has_room, is_live, run_turns
from .records import impact_rows, mark_rows
from .settings import DEFAULT_SETTINGS, ExecutionSettings


class Queue(eqx.Module):
    """State of a run over many points.

    Attributes:
        progress: lanes and their log.
        point: point of each lane; the number of points, if it has none.
        ends: results of the points that are done.
        following: next waiting point, among those that start a chain.
    """

    progress: Progress
    point: Int[Array, " lanes"]
    ends: EndStates
    following: Int[Array, ""]


def new_queue(
    system: ImpactSystem,
    x0: Float[Array, "n points"],
    num_lanes: int,
    flow: AbstractFlow | None = None,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
    *,
    has_tangents: bool = False,
) -> Queue:
    """A queue with all lanes idle, for points that start at `x0`.

    Lanes carry the memory of `flow` from step to step; none, if `flow` is left out. Only the room for records matters
    of the `settings`. With `has_tangents` small changes evolve with the motions.
    """
    (n, points), stops, dtype = x0.shape, len(system.stops), x0.dtype
    harmonics = num_harmonics(system)

    def fill(dtype: DTypeLike, *shape: int, value: int = 0) -> Array:
        return jax.device_put(np.full(shape, value, dtype))  # nothing to compile, unlike `jnp.full`

    def memory(size: int) -> PyTree:
        found = None if flow is None else flow.memory(fill(dtype, size))
        return jax.tree.map(lambda a: jax.device_put(np.array(a)), found)  # no two arrays share a buffer

    def nothing(size: int) -> EndStates:
        state = State(
            periods=fill(int, size),
            time=fill(dtype, size),
            time_low=fill(dtype, size),
            phase=fill(dtype, 2, harmonics, size),
            x=fill(dtype, n, size),
            v=fill(dtype, n, size),
            gap=fill(dtype, stops, size),
            held=fill(bool, stops, size),
            contact=fill(np.int8, stops, size),
            memory=memory(size),
        )
        counts = fill(int, stops, size), fill(int, stops, size)
        held_time = fill(dtype, stops, size)
        return EndStates(state, *counts, held_time, fill(int, size), fill(bool, size, value=True))

    impacts = impact_rows(max(settings.impact_rows, stops * num_lanes), dtype)  # room for one turn at least
    marks = mark_rows(max(settings.mark_rows, num_lanes), n, stops, dtype, has_growth=has_tangents)
    lanes = nothing(num_lanes)
    if has_tangents:
        empty = Tangents(fill(dtype, 2 * n, 2 * n, num_lanes), fill(dtype, 2 * n, num_lanes))
        lanes = _with_tangents(lanes, empty)
    progress = Progress(lanes, impacts, marks, fill(int))
    return Queue(progress, fill(int, num_lanes, value=points), nothing(points), fill(int))


# The queue is donated: its buffers, a few MB, are written in place instead of copied.
@eqx.filter_jit(
    donate="all-except-first",
    compiler_options={} if PLAIN else {"xla_cpu_prefer_vector_width": 512},  # pyright: ignore[reportCallIssue]
)
def run_lanes(
    points: tuple[AbstractFlow, ImpactSystem, Float[Array, "n points"], Float[Array, "n points"], Work],
    queue: Queue,
    *,
    can_stick: bool,
    is_carried: bool = False,
) -> tuple[Queue, Bool[Array, ""]]:
    """Work on the queue until it is empty, the log full, or a number of turns done.

    Args:
        points: the flow, the machine (leaves carry points, or a single one for all, as their last axis), initial
            positions and velocities, and the request.
        queue: present state of the work. The log is written from its beginning.
        can_stick: True where any stop of any point may hold its mass.
        is_carried: True where some points start where others end, see `Work`.

    Returns:
        The queue after that, and a flag that work is left.
    """
    flow, system, x0, v0, work = points
    period = 2 * jnp.pi / system.forcing.frequency
    machine = prepare(numbers_of(system), period, (jnp.zeros(1, x0.dtype), x0, v0), can_stick=can_stick)
    flow, work = flow.prepare(machine), _bounded(work, machine, x0.shape[1])
    num_points, num_lanes = x0.shape[1], queue.point.size
    zeros = jnp.zeros((machine.waves.num_harmonics, num_points), x0.dtype)
    phase0 = jnp.stack([zeros + 1, zeros])
    first = initial_state(flow, machine, phase0, x0, v0)
    last_turn = queue.progress.turns + work.max_turns
    is_small = max(machine.contacts.num, *machine.waves.cosine.shape[:2]) <= UNROLLED
    is_one_kernel = is_small and flow.fits_one_kernel
    run = partial(in_one_kernel, run_turns) if is_one_kernel else run_turns

    def start(point: Int[Array, " lanes"], before: EndStates) -> State:
        if not is_carried:
            return _gather(first, point, num_points)
        given, motion, numbers = (
            _gather(tree, point, num_points) for tree in ((system, x0, v0), flow, machine)
        )
        x, v = carried_start(given[0], (before.state.x, before.state.v), before.state.held, given[1:])
        has_before = point >= work.num_chains
        x, v = (jnp.where(has_before, a, own) for a, own in zip((x, v), given[1:], strict=True))
        return initial_state(
            motion, numbers, jnp.broadcast_to(phase0[..., :1], (*phase0.shape[:2], num_lanes)), x, v
        )

    def feed(queue: Queue) -> Queue:
        motion, numbers = (_gather(tree, queue.point, num_points) for tree in (flow, machine))
        is_waiting = _is_waiting(work, queue)
        num_busy = jnp.sum(queue.point < work.num_points)
        enough = jnp.where(is_waiting, jnp.maximum(num_busy - max(num_lanes // 16, 1), 0), 0)
        inputs = _of_lanes(work, queue.point)
        task = LaneTask(motion, numbers, phase0[..., :1], inputs, queue.point, enough, last_turn)
        progress, _ = run((queue.progress, task))
        return _refill(inputs, start, numbers, eqx.tree_at(lambda q: q.progress, queue, progress))

    def is_left(queue: Queue) -> Bool[Array, ""]:
        live = is_live(_of_lanes(work, queue.point), queue.progress.lanes, queue.point)
        return _is_waiting(work, queue) | jnp.any(live)

    def goes_on(queue: Queue) -> Bool[Array, ""]:
        return is_left(queue) & has_room(queue.progress) & (queue.progress.turns < last_turn)

    queue = jax.lax.while_loop(goes_on, feed, queue)
    return queue, is_left(queue)


def _is_waiting(work: Work, queue: Queue) -> Bool[Array, ""]:
    """True where a lane that is done has other work."""
    goes_on = queue.point + work.num_chains < work.num_points
    return (queue.following < work.num_chains) | jnp.any(goes_on)


def _bounded(work: Work, machine: Machine, num_points: int) -> Work:
    """The request with a bound on the steps of every point: as given, or far more than a sound motion takes.

    Impacts add steps in every period to those of the motion itself.
    """
    least = 100_000 + 10_000 * work.num_periods.astype(machine.rate.dtype)
    ample = default_max_steps(machine, work.num_periods * machine.period, least)
    bound = jnp.where(work.max_steps == AUTOMATIC_MAX_STEPS, ample, work.max_steps)
    return eqx.tree_at(lambda w: w.max_steps, work, jnp.broadcast_to(bound, num_points))


def _of_lanes(work: Work, point: Int[Array, " lanes"]) -> Work:
    """The request, with the bound on steps of each lane's point."""
    return eqx.tree_at(lambda w: w.max_steps, work, work.max_steps[point])


def _gather(tree, point: Int[Array, " lanes"], num_points: int):
    """Numbers of each lane's point; those shared by all points stay single."""

    def take(a: Reals) -> Reals:
        return a[..., point] if a.ndim and a.shape[-1] == num_points > 1 else a

    return jax.tree.map(take, tree)


def _refill(work: Work, start: Callable[[Array, EndStates], State], machine: Machine, queue: Queue) -> Queue:
    """Store the results of finished lanes and give these lanes new points."""
    lanes, num_points = queue.progress.lanes, queue.ends.steps.size
    free = ~is_live(work, lanes, queue.point)
    done = jnp.where(free, queue.point, num_points)
    ended = eqx.tree_at(lambda e: (e.state.x, e.state.v), lanes, machine.in_space(lanes.state))
    ended = _with_tangents(ended, None)
    ends = jax.tree.map(lambda all_, a: all_.at[..., done].set(a, mode="drop"), queue.ends, ended)
    on = queue.point + work.num_chains
    goes_on = free & (on < work.num_points)
    begins = free & ~goes_on
    candidate = queue.following + jnp.cumsum(begins) - begins
    begins = begins & (candidate < work.num_chains)
    is_new = goes_on | begins
    point = jnp.where(goes_on, on, jnp.where(begins, candidate, jnp.where(free, num_points, queue.point)))
    fresh = EndStates(
        state=start(point, ended),
        num_impacts=jnp.zeros_like(lanes.num_impacts),
        num_sticks=jnp.zeros_like(lanes.num_sticks),
        held_time=jnp.zeros_like(lanes.held_time),
        steps=jnp.zeros_like(lanes.steps),
        is_finite=jnp.ones_like(lanes.is_finite),
        tangents=None if lanes.tangents is None else first_tangents(lanes.state.x),
    )
    lanes = jax.tree.map(lambda new, old: jnp.where(is_new, new, old), fresh, lanes)
    progress = eqx.tree_at(lambda p: p.lanes, queue.progress, lanes)
    return Queue(progress, point, ends, queue.following + jnp.sum(begins))


def _with_tangents(ends: EndStates, tangents: Tangents | None) -> EndStates:
    return eqx.tree_at(lambda e: e.tangents, ends, tangents, is_leaf=lambda leaf: leaf is None)
