"""Turns of the loop over lanes: a step of every lane, and its impacts written down.

The loop is one kernel. It is left when enough lanes are done to be given new points.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._advance import Instant, advance
from .._machine import Machine, State, start_period
from .._motion.flow import AbstractFlow
from .._xla import compute_once


class Ends(eqx.Module):
    """What became of every point, points last.

    Attributes:
        state: at the end, (..., points).
        num_impacts: recorded impacts of each stop, (stops, points), also those that found no room.
        num_sticks: likewise.
        held_time: for how long each stop held its mass in the recorded periods, (stops, points).
        steps: steps taken, (points,).
        is_finite: whether it stayed finite, (points,).
    """

    state: State
    num_impacts: Int[Array, "stops points"]
    num_sticks: Int[Array, "stops points"]
    held_time: Float[Array, "stops points"]
    steps: Int[Array, " points"]
    is_finite: Bool[Array, " points"]


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


class Progress(eqx.Module):
    """What a turn changes.

    Attributes:
        lanes: what the lanes do.
        log: impacts, one a row, (rows, 6): time since the transient, velocity before, stop, point, number
            of the impact among those of its point, time to the end of the chatter that it completes (or 0).
        num_rows: rows written.
        section: x, v and `held_time` at the end of every recorded period, (points, periods, 2 n + stops).
        turns: turns so far, each a step of every lane, idle or not.
    """

    lanes: Ends
    log: Float[Array, "rows columns"]
    num_rows: Int[Array, ""]
    section: Float[Array, "points periods marks"]
    turns: Int[Array, ""]


class Task(eqx.Module):
    """What a turn needs beside it.

    Attributes:
        flow: the motion, of each lane.
        machine: the numbers, of each lane.
        phase0: phase of the forcing at the start of a period.
        work: what is asked of every point.
        point: the point of each lane; the number of points or more, if it has none.
        is_enough: so many lanes at work are left alone; with fewer the loop ends.
        last_turn: the number of turns at which it ends in any case.
    """

    flow: AbstractFlow
    machine: Machine
    phase0: Float[Array, "2 harmonics 1"]
    work: Work
    point: Int[Array, " lanes"]
    is_enough: Int[Array, ""]
    last_turn: Int[Array, ""]


def turn_until_fed(progress_and_task: tuple[Progress, Task]) -> tuple[Progress, Task]:
    """Take turns until too few lanes are at work, the log is full, or it was long enough."""
    progress, task = progress_and_task

    def goes_on(progress: Progress) -> Bool[Array, ""]:
        num_live = jnp.sum(is_live(task.work, progress.lanes, task.point))
        return (num_live > task.is_enough) & has_room(progress) & (progress.turns < task.last_turn)

    return jax.lax.while_loop(goes_on, lambda progress: _turn(task, progress), progress), task


def is_live(work: Work, lanes: Ends, point: Int[Array, " lanes"]) -> Bool[Array, " lanes"]:
    """Lanes that have something left to do."""
    is_on = lanes.is_finite & (lanes.steps < work.max_steps) & (point < work.num_points)
    return is_on & (lanes.state.periods < work.num_periods)


def has_room(progress: Progress) -> Bool[Array, ""]:
    """Whether the log can take what one more turn may write."""
    return progress.num_rows + progress.lanes.num_impacts.size <= len(progress.log)


def _turn(task: Task, progress: Progress) -> Progress:
    lanes, machine, work = progress.lanes, task.machine, task.work
    state, live = lanes.state, compute_once(is_live, work, lanes, task.point)
    resolution = 4 * jnp.finfo(state.x.dtype).eps * machine.period
    after, instant = advance(task.flow, machine, state, machine.period, resolution)
    is_finite = jnp.isfinite(after.time) & jnp.all(jnp.isfinite(after.x + after.v), axis=0)
    counted = live & (state.periods >= work.transient)
    passed = (state.periods - work.transient) * machine.period + instant.time
    hit = instant.hit & counted
    after = start_period(after, task.phase0, instant.arrived)
    number = jnp.sum(lanes.num_impacts, axis=0) + jnp.cumsum(hit, axis=0) - hit
    signs = jnp.asarray(machine.signs, passed.dtype)[:, None]
    stop, velocity = jnp.arange(len(hit))[:, None], signs * instant.velocity_minus
    columns = [passed, velocity, stop, task.point, number, instant.chatter]
    moved = Ends(
        state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
        num_impacts=lanes.num_impacts + hit,
        num_sticks=lanes.num_sticks + (instant.stuck & counted),
        held_time=lanes.held_time + jnp.where(counted, _held(state, instant), 0),
        steps=lanes.steps + live,
        is_finite=is_finite | ~live,
    )
    log, num_rows = _write(progress.log, progress.num_rows, hit & (number < work.max_impacts), columns)
    section = _mark(progress.section, task, moved, counted & instant.arrived)
    return Progress(moved, log, num_rows, section, progress.turns + 1)


def _held(state: State, instant: Instant) -> Float[Array, "stops lanes"]:
    """For how long each stop held its mass in a step; a stick counts from the end of its chatter."""
    return jnp.where(state.held, instant.time - state.time, 0) - instant.chatter


def _write(
    log: Float[Array, "rows columns"],
    num_rows: Int[Array, ""],
    kept: Bool[Array, "stops lanes"],
    columns: list[Array],
) -> tuple[Float[Array, "rows columns"], Int[Array, ""]]:
    """Append a row for each impact that is kept, those of several stops of one lane in their order."""
    values = [jnp.broadcast_to(a, kept.shape).ravel() for a in columns]

    def put(carry, place):
        log, row = carry
        here = [a[place].astype(log.dtype) for a in values]
        return jax.lax.dynamic_update_index_in_dim(log, jnp.stack(here), row, 0), row + 1

    return _for_each(kept.ravel(), put, (log, num_rows))


def _mark(
    section: Float[Array, "points periods marks"], task: Task, moved: Ends, is_mark: Bool[Array, " lanes"]
) -> Float[Array, "points periods marks"]:
    """Write where the lanes are at the end of a recorded period."""
    rows = jnp.concatenate([moved.state.x, moved.state.v, moved.held_time])
    period = moved.state.periods - 1 - task.work.transient

    def put(section, lane):
        row = jax.lax.dynamic_index_in_dim(rows, lane, 1, keepdims=False)
        place = (task.point[lane], period[lane], 0)
        return jax.lax.dynamic_update_slice(section, row[None, None], place)

    return _for_each(is_mark, put, section)


def _for_each(flags: Bool[Array, " places"], put: Callable, carry):
    """Call `put` for every place whose flag is up, one after another: in a turn there are few."""
    if flags.size == 0:
        return carry
    places = jnp.arange(flags.size, dtype=jnp.int32)

    def next_after(place: Int[Array, ""] | int) -> Int[Array, ""]:
        return jnp.min(jnp.where(flags & (places > place), places, jnp.int32(flags.size)))

    def step(carry):
        carry, place = carry
        return put(carry, place), next_after(place)

    carry, _ = jax.lax.while_loop(lambda carry: carry[1] < flags.size, step, (carry, next_after(-1)))
    return carry
