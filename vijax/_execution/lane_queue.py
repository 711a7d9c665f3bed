"""Many trajectories as lanes of one loop, fed from a queue.

A loop over lanes lasts as long as its slowest lane. A lane that is done therefore takes the next point from a queue.
When enough lanes are done, the loop ends, their results are stored, new points are gathered, and the loop starts
again. Points in order of decreasing work leave little of the last round idle.

Where points are carried, a queue holds chains. A lane that is done continues with the next point of its chain, from
its present state, and takes the next chain at the end of its own.

Impacts and states at the ends of recorded periods are appended to rows that the host takes away. Memory therefore
does not depend on their number, and the transient writes nothing.
"""

from functools import lru_cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._jax.arrays import UNROLLED, Reals
from .._jax.programs import Programs
from .._jax.xla import are_sums_in_kernels, in_one_kernel, in_parts, options_for_lanes
from .._machine.kinds import FRICTION, RIGID
from .._machine.machine import Machine
from .._machine.numbers import MachineNumbers
from .._machine.preparation import AUTOMATIC_MAX_STEPS, default_max_steps, prepare
from .._machine.state import State
from .._trajectory.loop import steps_fit_one_kernel
from .._trajectory.observer import nothing_observed
from .._trajectory.step import initial_state
from .._trajectory.tangent_frame import Tangents, first_tangents
from .carry_start import carried_start
from .lane_loop import EndStates, LaneTask, Progress, Work, has_room, is_live, is_written_out, run_turns
from .packed import PackedPoints, PointLayout, unpack
from .records import impact_rows, mark_rows
from .settings import DEFAULT_SETTINGS, ExecutionSettings


class Queue(eqx.Module):
    """State of a run over many points.

    Attributes:
        progress: lanes and their log.
        point: point of each lane; the number of points, if it has none.
        is_new: whether a lane has not begun with its point.
        ends: results of the points that are done.
        following: next waiting point, among those that start a chain.
    """

    progress: Progress
    point: Int[Array, " lanes"]
    is_new: Bool[Array, " lanes"]
    ends: EndStates
    following: Int[Array, ""]


class Points(NamedTuple):
    """Machines and starts of some points.

    Attributes:
        numbers: the machines; leaves have points, or a single one for all, as their last axis.
        flow: the motion between events, likewise.
        x0: positions at the start, (n, points).
        v0: velocities at the start, (n, points).
    """

    numbers: MachineNumbers
    flow: AbstractFlow
    x0: Reals
    v0: Reals


class LaneProgram(NamedTuple):
    """Static choices of the loop over lanes: its program is compiled for these, and for shapes.

    Attributes:
        layout: places of the `Points` in what is packed.
        can_stick: whether any stop of any point may hold its mass.
        has_tangents: whether small changes evolve with the motions.
        observed: names of what is observed, see `observer.py`.
        is_timed: whether marks are given times, see `Counts`.
    """

    layout: PointLayout
    can_stick: bool
    has_tangents: bool = False
    observed: tuple[str, ...] = ()
    is_timed: bool = False


# Most masses, stops or harmonics of a machine in one kernel: in larger ones products of matrices take longer than by a
# library. Where XLA knows no option to leave sums to kernels, most lanes of one, and most masses, stops or harmonics times
# lanes: it divides larger operations among threads, which a kernel cannot contain. The default of lanes has room for
# the largest machine.
_LARGEST = 32
# Most of them whose numbers each point has for itself: matrices of more, one for each lane, leave the cache.
_FEW = 8
_MOST_LANES, _MOST_NUMBERS = 2 * DEFAULT_SETTINGS.lanes, UNROLLED * DEFAULT_SETTINGS.lanes


def are_small(points: Points) -> bool:
    """True for machines of few numbers, whose loop over lanes is one kernel, if the lanes are few enough."""
    return steps_fit_one_kernel(points.numbers, points.flow, _FEW)


def _fit_one_kernel(points: Points, num_lanes: int) -> bool:
    """True where the loop over these lanes is one kernel."""
    if are_sums_in_kernels():
        return steps_fit_one_kernel(points.numbers, points.flow, _LARGEST)
    most = min(UNROLLED, _MOST_NUMBERS // num_lanes)
    return num_lanes <= _MOST_LANES and steps_fit_one_kernel(points.numbers, points.flow, most)


def new_queue(program: LaneProgram, width: int, num_lanes: int, settings: ExecutionSettings) -> Queue:
    """A queue with all lanes idle and room for `width` points, made by NumPy, which compiles nothing.

    Only the room for records matters of the `settings`.
    """
    structure, shapes, place = _shapes(program, width, num_lanes, settings)
    arrays = [np.zeros(shape, dtype) for shape, dtype in shapes]
    arrays[place].fill(width)
    return jax.tree.unflatten(structure, arrays)


@lru_cache
def _shapes(
    program: LaneProgram, width: int, num_lanes: int, settings: ExecutionSettings
) -> tuple[Any, list[tuple[tuple[int, ...], Any]], int]:
    """Structure of a queue, shapes and types of its arrays, and the place of `Queue.point` among them."""
    queue = jax.eval_shape(partial(_zeros, program, width, num_lanes, settings))
    leaves, structure = jax.tree.flatten(queue)
    place = next(k for k, leaf in enumerate(leaves) if leaf is queue.point)
    return structure, [(leaf.shape, leaf.dtype) for leaf in leaves], place


def _zeros(program: LaneProgram, width: int, num_lanes: int, settings: ExecutionSettings) -> Queue:
    points: Points = unpack(program.layout, program.layout.empty(width))
    num_stops, has_tangents = points.numbers.num_stops, program.has_tangents
    (stops, n), dtype = points.numbers.rows.shape[:2], points.x0.dtype
    columns, knots, mode = points.numbers.num_columns, points.numbers.knots_layout, points.numbers.mode_layout

    def nothing(size: int) -> EndStates:
        real, whole = jnp.zeros(size, dtype), jnp.zeros(size, int)
        of_stops = jnp.zeros((stops, size), dtype)
        state = State(
            periods=whole,
            time=real,
            time_low=real,
            phase=jnp.zeros((2, columns, size), dtype),
            x=jnp.zeros((n, size), dtype),
            v=jnp.zeros((n, size), dtype),
            gap=of_stops,
            held=of_stops.astype(bool),
            contact=of_stops.astype(jnp.int8),
            memory=points.flow.memory(real),
            mode=None if mode is None else mode.idle(of_stops),
            knots=None if knots is None else knots.blank(real),
        )
        counts = of_stops.astype(int), of_stops.astype(int)
        observed = nothing_observed(program.observed, state, num_stops, points.numbers.num_sliders)
        goals = whole if program.is_timed else None
        return EndStates(state, *counts, of_stops, whole, whole.astype(bool), None, observed, goals)

    impacts = impact_rows(max(settings.impact_rows, stops * num_lanes), dtype)  # room for one turn at least
    marks = mark_rows(max(settings.mark_rows, num_lanes), n, stops, dtype, has_growth=has_tangents)
    lanes = nothing(num_lanes)
    if has_tangents:
        frame = jnp.zeros((2 * n, 2 * n, num_lanes), dtype)
        lanes = _with_tangents(lanes, Tangents(frame, frame[0]))
    whole = jnp.zeros((), int)
    point = jnp.zeros(num_lanes, int)
    return Queue(Progress(lanes, impacts, marks, whole), point, point.astype(bool), nothing(width), whole)


def run_lanes(
    program: LaneProgram,
    packed: PackedPoints,
    counts: Int[np.ndarray, " counts"],
    times: Float[np.ndarray, " marks"] | None,
    queue: Queue,
) -> tuple[Queue, Bool[Array, ""]]:
    """Work on the queue until it is empty, the log full, or a number of turns done.

    Args:
        program: the static choices.
        packed: the points, see `Points`.
        counts: the entries of `Work`.
        times: given times of the marks, padded with the last; None where the ends of periods are marks.
        queue: present state of the work, which is used up. The log is written from its beginning.

    Returns:
        The queue after that, and a flag that work is left.
    """
    return lane_programs(program, packed, counts, times, queue)


def _run_lanes(
    program: LaneProgram,
    packed: PackedPoints,
    counts: Int[Array, " counts"],
    times: Float[Array, " marks"] | None,
    queue: Queue,
) -> tuple[Queue, Bool[Array, ""]]:
    work = Work(*counts)
    last_turn = queue.progress.turns + work.max_turns
    rows = jnp.asarray(packed.own).T  # those of a point side by side: a lane takes them at once

    def feed(queue: Queue) -> Queue:
        own = rows[jnp.minimum(queue.point, len(rows) - 1)].T
        points = unpack(program.layout, PackedPoints(own, packed.shared))
        task = _task(points, program, work, times, queue, last_turn)
        lanes = _started(points, task, queue)
        run = run_turns
        if _fit_one_kernel(points, queue.point.size):
            run = partial(in_parts, run_turns) if _are_parts(task) else partial(in_one_kernel, run_turns)
        progress, _ = run((eqx.tree_at(lambda p: p.lanes, queue.progress, lanes), task))
        return _refilled(task, eqx.tree_at(lambda q: q.progress, queue, progress))

    def goes_on(queue: Queue) -> Bool[Array, ""]:
        return _is_left(work, queue) & has_room(queue.progress) & (queue.progress.turns < last_turn)

    # The host has taken what was written.
    written = lambda q: (q.progress.impacts.size, q.progress.marks.size)  # noqa: E731
    queue = jax.lax.while_loop(goes_on, feed, eqx.tree_at(written, queue, replace_fn=jnp.zeros_like))
    return queue, _is_left(work, queue)


# Kinds of elements of the machines whose step is small enough for one kernel.
_IN_ONE_KERNEL = set(), {RIGID}, {FRICTION}


def _are_parts(task: LaneTask) -> bool:
    """True where the parts of a step are kernels, as a step is too large for one."""
    return set(task.machine.contacts.kinds) not in _IN_ONE_KERNEL and not is_written_out(task)


# The queue is donated: its buffers, a few MB, are written in place instead of copied.
lane_programs = Programs(_run_lanes, options_for_lanes, donates_last=True)


def _is_left(work: Work, queue: Queue) -> Bool[Array, ""]:
    """True where any work is left."""
    return _is_waiting(work, queue) | jnp.any(queue.point < work.num_points)


def _is_waiting(work: Work, queue: Queue) -> Bool[Array, ""]:
    """True where a lane that is done has other work."""
    goes_on = queue.point + work.num_chains < work.num_points
    return (queue.following < work.num_chains) | jnp.any(goes_on)


def _task(
    points: Points,
    program: LaneProgram,
    work: Work,
    times: Float[Array, " marks"] | None,
    queue: Queue,
    last_turn: Int[Array, ""],
) -> LaneTask:
    """Constants of the loop: the points of the lanes, prepared."""
    numbers, x0, v0 = points.numbers, points.x0, points.v0
    span = 2 * jnp.pi / numbers.frequency if times is None else times[-1:]
    machine = prepare(numbers, span, (jnp.zeros(1, x0.dtype), x0, v0), can_stick=program.can_stick)
    zeros = jnp.zeros((machine.waves.num_harmonics, 1), x0.dtype)
    num_lanes = queue.point.size
    num_busy = jnp.sum(queue.point < work.num_points)
    enough = jnp.where(_is_waiting(work, queue), jnp.maximum(num_busy - max(num_lanes // 16, 1), 0), 0)
    return LaneTask(
        flow=points.flow.prepare(machine),
        machine=machine,
        phase0=machine.with_tables(jnp.stack([zeros + 1, zeros])),
        work=_bounded(work, machine, times, num_lanes),
        point=queue.point,
        enough=enough,
        last_turn=last_turn,
        times=None if times is None else times[:, None],
    )


def _bounded(work: Work, machine: Machine, times: Float[Array, " marks"] | None, num_lanes: int) -> Work:
    """The request with a bound on the steps of every lane: as given, or far more than a sound motion takes.

    Impacts add steps in every period to those of the motion itself.
    """
    if times is None:
        least = 100_000 + 10_000 * work.num_marks.astype(machine.rate.dtype)
        ample = default_max_steps(machine, work.num_marks * machine.period, least)
    else:
        ample = default_max_steps(machine, times[-1:])
    bound = jnp.where(work.max_steps == AUTOMATIC_MAX_STEPS, ample, work.max_steps)
    return eqx.tree_at(lambda w: w.max_steps, work, jnp.broadcast_to(bound, num_lanes))


def _started(points: Points, task: LaneTask, queue: Queue) -> EndStates:
    """The lanes, those with a new point at its start: its own, or where the point before it ended."""
    lanes, before = queue.progress.lanes, queue.progress.lanes.state
    starts = points.x0, points.v0
    carried = carried_start(points.numbers, (before.x, before.v), before.held, starts)
    has_before = task.point >= task.work.num_chains
    x, v = (jnp.where(has_before, a, own) for a, own in zip(carried, starts, strict=True))
    phase = jnp.broadcast_to(task.phase0, before.phase.shape)
    first = initial_state(task.flow, task.machine, phase, x, v)
    fresh = EndStates(
        state=first,
        num_impacts=jnp.zeros_like(lanes.num_impacts),
        num_sticks=jnp.zeros_like(lanes.num_sticks),
        held_time=jnp.zeros_like(lanes.held_time),
        steps=jnp.zeros_like(lanes.steps),
        is_finite=jnp.ones_like(lanes.is_finite),
        tangents=None if lanes.tangents is None else first_tangents(task.machine, first),
        observed=nothing_observed(
            tuple(lanes.observed),
            lanes.state,
            task.machine.contacts.num_stops,
            task.machine.contacts.num_sliders,
        ),
        goals=None if lanes.goals is None else jnp.zeros_like(lanes.goals),
    )
    return jax.tree.map(lambda new, old: jnp.where(queue.is_new, new, old), fresh, lanes)


def _refilled(task: LaneTask, queue: Queue) -> Queue:
    """Store the results of finished lanes and give these lanes new points."""
    work, lanes, num_points = task.work, queue.progress.lanes, queue.ends.steps.size
    free = ~is_live(work, lanes, queue.point)
    in_space = [
        jnp.where(free, of, own)
        for of, own in zip(task.machine.in_space(lanes.state), (lanes.state.x, lanes.state.v), strict=True)
    ]
    lanes = eqx.tree_at(lambda e: (e.state.x, e.state.v), lanes, in_space)
    done = jnp.where(free, queue.point, num_points)
    ended = _with_tangents(lanes, None)
    ends = jax.tree.map(lambda all_, a: all_.at[..., done].set(a, mode="drop"), queue.ends, ended)
    on = queue.point + work.num_chains
    goes_on = free & (on < work.num_points)
    begins = free & ~goes_on
    candidate = queue.following + jnp.cumsum(begins) - begins
    begins = begins & (candidate < work.num_chains)
    point = jnp.where(goes_on, on, jnp.where(begins, candidate, jnp.where(free, num_points, queue.point)))
    return Queue(
        progress=eqx.tree_at(lambda p: p.lanes, queue.progress, lanes),
        point=point,
        is_new=goes_on | begins,
        ends=ends,
        following=queue.following + jnp.sum(begins),
    )


def _with_tangents(ends: EndStates, tangents: Tangents | None) -> EndStates:
    return eqx.tree_at(lambda e: e.tangents, ends, tangents, is_leaf=lambda leaf: leaf is None)
