"""Turns of the loop over lanes: a step of every lane, and the record of its impacts.

The loop is one kernel (see `in_one_kernel`). It ends when enough lanes are done and can take new points. A turn takes 70
to 90 nanoseconds a lane. These measures reduce it:

- Fences (`compute_once`) at every result that several others share: 1700 operations a step where XLA made 2300.
- Conditionals over all lanes skip what no lane needs: sticking is a quarter of the work. (A second kernel without it,
  which hands over lanes that come near sticking, gains no more and takes seconds to compile.)
- A division takes as long as ten multiplications: 14 of 62 divisions and roots are left.
- The impacts of a turn are written in a loop, because they are few and a kernel cannot contain a scatter. Their places
  are bits of words: to look for each among all lanes took a third of a turn.

Every loop of XLA over the lanes has a fixed cost, some 2 microseconds a turn together, so few lanes are slow; many do
not fit into the cache, and idle at the end of a queue: from 64 to 128 the time per lane hardly changes. The turn
written out element by element, by `lanes_last`, took as long and compiled longer; with one element whose force switches it
takes a seventh less and compiles no longer. Steps longer than 3 / rate save
none: with limits of 3, 4, 6 and 9 a period of case (a) takes 8.3, 8.3, 8.9 and 9.8 steps, as the proof that no event
occurs ends most of them.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._flow.modal import PreparedModalFlow
from .._hybrid.transition import Instant
from .._jax.arrays import append_axes
from .._jax.xla import as_part, compute_once
from .._lanes.transform import lanes_last
from .._machine.kinds import RIGID
from .._machine.machine import Machine, in_periods
from .._machine.state import State
from .._machine.tables import row_at
from .._trajectory.loop import is_finite, next_target
from .._trajectory.observer import Observed, observe
from .._trajectory.step import advance
from .._trajectory.tangent_frame import Tangents, advance_with
from .records import Impact, PeriodEnd, RecordBatch, append


class EndStates(eqx.Module):
    """End of every point's trajectory, points last.

    Attributes:
        state: final state, (..., points).
        num_impacts: recorded impacts of each stop, (stops, points), including those that found no room.
        num_sticks: the same for sticks.
        held_time: time for which each stop held its mass in the recorded periods, (stops, points).
        steps: steps taken, (points,).
        is_finite: flags of trajectories that stayed finite, (points,).
        tangents: small changes that evolve with the motion, and their growth since the last end of a period. None
            where not requested, and once a point is done.
        observed: extremes and integrals over the recorded periods, see `observer.py`; empty where none is requested.
        goals: number of given times reached; None where the ends of periods are marks.
    """

    state: State
    num_impacts: Int[Array, "stops points"]
    num_sticks: Int[Array, "stops points"]
    held_time: Float[Array, "stops points"]
    steps: Int[Array, " points"]
    is_finite: Bool[Array, " points"]
    tangents: Tangents | None = None
    observed: Observed = eqx.field(default_factory=dict)
    goals: Int[Array, " points"] | None = None

    @property
    def marks(self) -> Int[Array, " points"]:
        """Marks passed so far, see `Counts`; those of the transient included."""
        return self.state.periods if self.goals is None else self.goals


class Work(eqx.Module):
    """Request common to all points: periods, bounds, room.

    Attributes:
        num_points: points in the queue.
        num_chains: points that start a chain and come first; point k starts where point k - num_chains ended. All
            points, where nothing is carried.
        transient: forcing periods before recording.
        num_marks: marks in all, see `Counts`.
        max_steps: most steps of one point, (); of every point or lane, once the loop has its machines.
        max_impacts: most recorded impacts of one point that are logged.
        max_turns: turns of the loop after which it returns to the host.
    """

    num_points: Int[Array, ""]
    num_chains: Int[Array, ""]
    transient: Int[Array, ""]
    num_marks: Int[Array, ""]
    max_steps: Int[Array, "..."]
    max_impacts: Int[Array, ""]
    max_turns: Int[Array, ""]


class Progress(eqx.Module):
    """Carry of the loop: what a turn changes.

    Attributes:
        lanes: states and counts of the lanes.
        impacts: recorded impacts, see `Impact`.
        marks: ends of recorded periods, see `PeriodEnd`.
        turns: turns so far, each a step of every lane, idle or not.
    """

    lanes: EndStates
    impacts: RecordBatch
    marks: RecordBatch
    turns: Int[Array, ""]


class LaneTask(eqx.Module):
    """Constants of the loop: what a turn reads.

    Attributes:
        flow: flow of each lane.
        machine: machine of each lane.
        phase0: phase of the forcing at the start of a period.
        work: request common to all points.
        point: point of each lane; the number of points or more, if it has none.
        enough: number of working lanes at which, or below which, the loop ends.
        last_turn: turn at which the loop ends in any case.
        times: given times of the marks, (marks, 1); None where the ends of periods are marks.
    """

    flow: AbstractFlow
    machine: Machine
    phase0: Float[Array, "2 harmonics ..."]
    work: Work
    point: Int[Array, " lanes"]
    enough: Int[Array, ""]
    last_turn: Int[Array, ""]
    times: Float[Array, "marks 1"] | None = None

    @property
    def span(self) -> Float[Array, "..."]:
        """Time to which rounding errors of times are relative."""
        return self.machine.period if self.times is None else self.times[-1]

    def target(self, lanes: EndStates) -> tuple[Float[Array, "..."], Bool[Array, "..."] | None]:
        """Local time at which a step ends at the latest, and whether a mark is there; None where each is one."""
        if self.times is None or lanes.goals is None:
            return self.machine.period, None
        goal = in_periods(self.machine, row_at(self.times, lanes.goals))
        return next_target(self.machine, lanes.state, goal)


def run_turns(progress_and_task: tuple[Progress, LaneTask]) -> tuple[Progress, LaneTask]:
    """Take turns until too few lanes work, the log is full, or the last turn is reached."""
    progress, task = progress_and_task

    def goes_on(progress: Progress) -> Bool[Array, ""]:
        num_live = jnp.sum(is_live(task.work, progress.lanes, task.point))
        return (num_live > task.enough) & has_room(progress) & (progress.turns < task.last_turn)

    return jax.lax.while_loop(goes_on, lambda progress: _turn(task, progress), progress), task


def is_live(work: Work, lanes: EndStates, point: Int[Array, " lanes"]) -> Bool[Array, " lanes"]:
    """Lanes with work left."""
    is_on = lanes.is_finite & (lanes.steps < work.max_steps) & (point < work.num_points)
    return is_on & (lanes.marks < work.num_marks)


def has_room(progress: Progress) -> Bool[Array, ""]:
    """True where the log has room for one more turn."""
    lanes = progress.lanes
    has_room_for_impacts = progress.impacts.has_room(lanes.num_impacts.size)
    return has_room_for_impacts & progress.marks.has_room(lanes.steps.size)


class Recorded(NamedTuple):
    """Records of a step, lanes last.

    Attributes:
        is_impact: flags of impacts to be logged, (stops,).
        impact: the impacts.
        is_end: whether a mark is passed, ().
        end: the state there.
    """

    is_impact: Bool[Array, "stops ..."]
    impact: Impact
    is_end: Bool[Array, "..."]
    end: PeriodEnd


def _turn(task: LaneTask, progress: Progress) -> Progress:
    lanes, found = _step(task, progress.lanes)
    return Progress(
        lanes,
        append(progress.impacts, found.is_impact, found.impact),
        append(progress.marks, found.is_end, found.end),
        progress.turns + 1,
    )


def _step(task: LaneTask, lanes: EndStates) -> tuple[EndStates, Recorded]:
    """A step of every lane, and its records."""
    machine = task.machine
    state, live = lanes.state, compute_once(is_live, task.work, lanes, task.point)
    resolution = 4 * jnp.finfo(state.x.dtype).eps * task.span
    target, at_mark = task.target(lanes)
    step = task.flow, machine, state, target, resolution
    if lanes.tangents is None:
        call = lanes_last(advance) if is_written_out(task) else advance
        (after, instant), tangents = call(*step), None
    else:
        after, instant, tangents = advance_with(lanes.tangents, *step)
    return as_part(_recorded, task, lanes, live, at_mark, after, instant, tangents)


def _recorded(
    task: LaneTask,
    lanes: EndStates,
    live: Bool[Array, " lanes"],
    at_mark: Bool[Array, " lanes"] | None,
    after: State,
    instant: Instant,
    tangents: Tangents | None,
) -> tuple[EndStates, Recorded]:
    """The lanes after a step, and its records."""
    machine, work, state = task.machine, task.work, lanes.state
    finite = is_finite(after)
    counted = live & (lanes.marks >= work.transient)
    passes = instant.arrived if at_mark is None else instant.arrived & at_mark
    is_over = instant.arrived if at_mark is None else instant.arrived & ~at_mark
    passed = (state.periods - work.transient) * machine.period + instant.time
    hit = instant.hit & counted
    after = machine.start_period(after, task.phase0, is_over)
    number = jnp.sum(lanes.num_impacts, axis=0) + jnp.cumsum(hit, axis=0) - hit
    stop, velocity = jnp.arange(len(hit)), machine.contacts.signed(instant.velocity_minus)
    if (of_stops := machine.velocity_of_stops(after.phase)) is not None:
        velocity += of_stops
    impact = Impact(
        time=passed,
        velocity=velocity,
        chatter=instant.chatter,
        stop=append_axes(stop, hit),
        point=task.point,
        number=number,
    )
    settles = lanes.marks < work.transient
    kept = None if tangents is None else tangents.start_period(machine, after, instant.arrived, settles)
    observed = lanes.observed
    if observed:
        observed = observe(observed, task.flow, machine, state, instant.time, counted)
    moved = EndStates(
        state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
        num_impacts=lanes.num_impacts + hit,
        num_sticks=lanes.num_sticks + (instant.stuck & counted),
        held_time=lanes.held_time + jnp.where(counted, _held(state, instant), 0),
        steps=lanes.steps + live,
        is_finite=lanes.is_finite & (finite | ~live),
        tangents=jax.tree.map(lambda new, old: jnp.where(live, new, old), kept, lanes.tangents),
        observed=observed,
        goals=None if lanes.goals is None else lanes.goals + (live & passes),
    )
    x, v = machine.in_space(moved.state)
    end = PeriodEnd(
        point=task.point,
        mark=lanes.marks - work.transient,
        x=x,
        v=v,
        held_time=moved.held_time,
        growth=None if tangents is None else tangents.growth,
    )
    is_impact, is_end = hit & (number < work.max_impacts), counted & passes
    return moved, Recorded(is_impact, impact, is_end, end)


def is_written_out(task: LaneTask) -> bool:
    """True where a step written out element by element is faster: where one element switches, of one or two masses."""
    machine = task.machine
    is_small = machine.contacts.num == 1 and max(machine.num_masses, machine.waves.num_harmonics) <= 2
    switches = machine.contacts.kinds != (RIGID,)
    return is_small and switches and isinstance(task.flow, PreparedModalFlow)


def _held(state: State, instant: Instant) -> Float[Array, "stops lanes"]:
    """Time for which each stop held its mass in a step; a stick counts from the end of its chatter."""
    return jnp.where(state.held, instant.time - state.time, 0) - instant.chatter
