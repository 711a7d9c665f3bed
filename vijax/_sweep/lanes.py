"""Many trajectories side by side in one loop, fed from a queue.

A loop over lanes lasts as long as its slowest lane. So a lane that is done takes the next point from a
queue: when enough lanes are done, the loop is left, their results are put aside and new points
gathered, and it goes on. With points in the order of falling work little of the last round is idle.

Impacts are written one after another, with the point they belong to, to a log of fixed size that the
host empties; so memory does not depend on how many there are, and nothing is written in the transient.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int

from .._advance import Instant, advance
from .._contact.start import first_state
from .._machine import Machine, State, prepare, start_period
from .._motion.flow import AbstractFlow
from .._system.system import ImpactSystem

# Rows of the log, and their columns: time since the transient, velocity before, stop, point, number
# of the impact among those of its point.
_ROWS, _COLUMNS = 1 << 15, 5


class Ends(eqx.Module):
    """What became of every point, points last.

    Attributes:
        state: at the end, (..., points).
        num_impacts: recorded impacts of each stop, (stops, points), also those that found no room.
        num_sticks: likewise.
        steps: steps taken, (points,).
        is_finite: whether it stayed finite, (points,).
    """

    state: State
    num_impacts: Int[Array, "stops points"]
    num_sticks: Int[Array, "stops points"]
    steps: Int[Array, " points"]
    is_finite: Bool[Array, " points"]


class Queue(eqx.Module):
    """Where a run over many points is.

    Attributes:
        lanes: what the lanes do.
        point: the point of each lane; the number of points, if it has none.
        ends: what became of the points that are done.
        following: the next point that waits.
        log: impacts, one a row, (rows, 5).
        num_rows: rows written.
        turns: turns of the loop, each a step of every lane, idle or not.
    """

    lanes: Ends
    point: Int[Array, " lanes"]
    ends: Ends
    following: Int[Array, ""]
    log: Float[Array, "rows columns"]
    num_rows: Int[Array, ""]
    turns: Int[Array, ""]


class Work(eqx.Module):
    """What is asked of every point: all that a call needs beside the points themselves.

    Attributes:
        num_points: points in the queue.
        transient: forcing periods before recording.
        num_periods: forcing periods in all.
        max_steps: the most steps of one point.
        max_impacts: recorded impacts of one point that are logged.
        max_turns: turns of the loop after which it returns to the host.
    """

    num_points: Int[Array, ""]
    transient: Int[Array, ""]
    num_periods: Int[Array, ""]
    max_steps: Int[Array, ""]
    max_impacts: Int[Array, ""]
    max_turns: Int[Array, ""]


def new_queue(
    system: ImpactSystem, x0: Float[Array, "n points"], num_lanes: int, flow: AbstractFlow | None = None
) -> Queue:
    """A queue with all lanes idle, for points that start at `x0` and are moved by `flow`."""
    (n, points), stops, dtype = x0.shape, len(system.stops), x0.dtype
    harmonics = system.forcing.amplitude.shape[0] if system.forcing.amplitude.ndim == 3 else 1

    def fill(dtype: DTypeLike, *shape: int, value: int = 0) -> Array:
        return jnp.asarray(np.full(shape, value, dtype))  # NumPy has nothing to compile

    def nothing(size: int) -> Ends:
        count, number, x = fill(int, stops, size), fill(dtype, size), fill(dtype, n, size)
        state = State(
            periods=fill(int, size),
            time=number,
            time_low=number,
            phase=fill(dtype, 2, harmonics, size),
            x=x,
            v=x,
            gap=fill(dtype, stops, size),
            held=fill(bool, stops, size),
            contact=fill(np.int8, stops, size),
            memory=None if flow is None else flow.memory(number),
        )
        return Ends(state, count, count, fill(int, size), fill(bool, size, value=True))

    idle = fill(int, num_lanes, value=points)
    rows = max(_ROWS, stops * num_lanes)  # one step at least
    log = fill(dtype, rows, _COLUMNS)
    return Queue(nothing(num_lanes), idle, nothing(points), fill(int), log, fill(int), fill(int))


@eqx.filter_jit(compiler_options={"xla_cpu_prefer_vector_width": 512})  # pyright: ignore[reportCallIssue]
def run_lanes(
    points: tuple[
        AbstractFlow, ImpactSystem, Float[Array, "n points"], Float[Array, "n points"], Work, Array
    ],
    queue: Queue,
    *,
    can_stick: bool,
) -> tuple[Queue, Bool[Array, ""]]:
    """Work on the queue until it is empty, the log full, or a number of steps done.

    Args:
        points: the motion, the machine (leaves carry points, or a single one for all, as their last
            axis), where each point starts and how fast, what is asked for, and True (see
            `compute_once`).
        queue: where the work is. The log is written from its beginning.
        can_stick: whether any stop of any point might hold its mass.

    Returns:
        Where it is then, and whether there is anything left to do.
    """
    flow, system, x0, v0, work, always = points
    period = 2 * jnp.pi / system.forcing.frequency
    machine = prepare(system, period, always, (jnp.zeros(1, x0.dtype), x0, v0), can_stick=can_stick)
    flow = flow.prepare(machine)
    zeros = jnp.zeros((machine.cosine.shape[0], x0.shape[1]), x0.dtype)
    phase0 = jnp.stack([zeros + 1, zeros])
    first = first_state(flow, machine, phase0, x0, v0)
    lanes, num_points = queue.point.size, x0.shape[1]
    stops = len(machine.masses)

    def is_open(queue: Queue, steps: Int[Array, ""]) -> Bool[Array, ""]:
        return (queue.num_rows + stops * lanes <= len(queue.log)) & (steps < work.max_turns)

    def feed(carry):
        queue, steps = carry
        of_lanes = lambda tree: _gather(tree, queue.point, num_points)  # noqa: E731
        motion, numbers = of_lanes(flow), of_lanes(machine)
        waiting = queue.following < work.num_points
        enough = jnp.where(waiting, lanes - max(lanes // 16, 1), 0)

        def goes_on(carry):
            queue, steps = carry
            return (jnp.sum(_is_live(work, queue)) > enough) & is_open(queue, steps)

        def step(carry):
            queue, steps = carry
            return _step(motion, numbers, phase0[..., :1], work, queue), steps + 1

        queue, steps = jax.lax.while_loop(goes_on, step, (queue, steps))
        return _refill(work, first, queue), steps

    def is_left(queue: Queue) -> Bool[Array, ""]:
        return (queue.following < work.num_points) | jnp.any(_is_live(work, queue))

    carry = (queue, jnp.zeros((), int))
    queue, _ = jax.lax.while_loop(lambda carry: is_left(carry[0]) & is_open(*carry), feed, carry)
    return queue, is_left(queue)


def _gather(tree, point: Int[Array, " lanes"], num_points: int):
    """The numbers of each lane's point; what all points share stays single."""

    def take(a: Array) -> Array:
        return a[..., point] if a.ndim and a.shape[-1] == num_points > 1 else a

    return jax.tree.map(take, tree)


def _is_live(work: Work, queue: Queue) -> Bool[Array, " lanes"]:
    """Lanes that have something left to do."""
    lanes = queue.lanes
    is_on = lanes.is_finite & (lanes.steps < work.max_steps) & (queue.point < queue.ends.steps.size)
    return is_on & (lanes.state.periods < work.num_periods)


def _refill(work: Work, first: State, queue: Queue) -> Queue:
    """Put aside what the lanes that are done found, and give them new points."""
    num_points = queue.ends.steps.size
    free = ~_is_live(work, queue)
    done = jnp.where(free, queue.point, num_points)
    ends = jax.tree.map(lambda all_, a: all_.at[..., done].set(a, mode="drop"), queue.ends, queue.lanes)
    candidate = queue.following + jnp.cumsum(free) - free
    is_new = free & (candidate < work.num_points)
    point = jnp.where(is_new, candidate, jnp.where(free, num_points, queue.point))
    fresh = Ends(
        state=_gather(first, point, num_points),
        num_impacts=jnp.zeros_like(queue.lanes.num_impacts),
        num_sticks=jnp.zeros_like(queue.lanes.num_sticks),
        steps=jnp.zeros_like(queue.lanes.steps),
        is_finite=jnp.ones_like(queue.lanes.is_finite),
    )
    lanes = jax.tree.map(lambda new, old: jnp.where(is_new, new, old), fresh, queue.lanes)
    following = queue.following + jnp.sum(is_new)
    return Queue(lanes, point, ends, following, queue.log, queue.num_rows, queue.turns)


def _step(
    flow: AbstractFlow,
    machine: Machine,
    phase0: Float[Array, "2 harmonics 1"],
    work: Work,
    queue: Queue,
) -> Queue:
    """One step of every lane."""
    lanes, live = queue.lanes, _is_live(work, queue)
    state = lanes.state
    resolution = 4 * jnp.finfo(state.x.dtype).eps * machine.period
    after, instant = advance(flow, machine, state, machine.period, resolution)
    is_finite = jnp.isfinite(after.time) & jnp.all(jnp.isfinite(after.x + after.v), axis=0)
    counted = live & (state.periods >= work.transient)
    passed = (state.periods - work.transient) * machine.period + instant.time
    hit = instant.hit & counted
    after = start_period(after, phase0, instant.arrived)
    log, num_rows = _write(machine, work, queue, hit, passed, instant)
    moved = Ends(
        state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
        num_impacts=lanes.num_impacts + hit,
        num_sticks=lanes.num_sticks + (instant.stuck & counted),
        steps=lanes.steps + live,
        is_finite=is_finite | ~live,
    )
    return Queue(moved, queue.point, queue.ends, queue.following, log, num_rows, queue.turns + 1)


def _write(
    machine: Machine,
    work: Work,
    queue: Queue,
    hit: Bool[Array, "stops lanes"],
    passed: Float[Array, " lanes"],
    instant: Instant,
) -> tuple[Float[Array, "rows columns"], Int[Array, ""]]:
    """Append the impacts of this step, those of several stops of one lane in their order."""
    stops, _ = hit.shape
    if stops == 0:
        return queue.log, queue.num_rows
    number = jnp.sum(queue.lanes.num_impacts, axis=0) + jnp.cumsum(hit, axis=0) - hit
    kept = (hit & (number < work.max_impacts)).ravel()
    row = jnp.where(kept, queue.num_rows + jnp.cumsum(kept) - 1, len(queue.log))
    signs = jnp.asarray(machine.signs, passed.dtype)[:, None]
    columns = (passed, signs * instant.velocity_minus, jnp.arange(stops)[:, None], queue.point, number)
    values = [jnp.broadcast_to(a, hit.shape).astype(passed.dtype).ravel() for a in columns]
    put = lambda log: log.at[row].set(jnp.stack(values, axis=-1), mode="drop")  # noqa: E731
    log = jax.lax.cond(jnp.any(kept), put, lambda log: log, queue.log)
    return log, queue.num_rows + jnp.sum(kept)
