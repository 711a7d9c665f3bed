"""Loop that follows a trajectory, or several with lanes last, and its results.

Concrete numbers go through one program for all machines of a size, see `chunked.py`: it has room for a fixed number of
events and saved states, and is called again until the end. Traced values, under `jit`, `vmap` or derivatives, take one
call with room for the whole request, see `single_call.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, reduce
from operator import and_
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._jax.arrays import UNROLLED_ALONE, Flag, Reals, Scalar
from .._jax.packing import pack
from .._jax.xla import AbstractTask, in_one_kernel, in_parts, not_constant, while_any
from .._machine.machine import Machine, in_periods
from .._machine.numbers import MachineNumbers
from .._machine.preparation import AUTOMATIC_MAX_STEPS, default_max_steps, prepare
from .._machine.state import State
from .batched import row_of_lane, to_all
from .event_log import event_log
from .records import AbstractObserver, GrazingWatch, Leg, Logging, Saving
from .results import RESULTS
from .solution import Solution
from .step import flight_to, initial_state, outcome

# `max_turns` of a call without a pause: the largest 32-bit integer, as JAX may have no 64-bit ones.
UNLIMITED_STEPS = np.iinfo(np.int32).max


@dataclass(frozen=True)
class Choices:
    """Static choices of a trajectory in one hashable object: its program is compiled for these, and for shapes.

    Attributes:
        can_stick: whether any stop may hold its mass.
        room: bound on the logged events.
        is_whole: whether the log of this call is the only one.
        raises: whether results that are not successful raise.
    """

    can_stick: bool
    room: int
    is_whole: bool = True
    raises: bool = False


class LoopArguments(NamedTuple):
    """Arguments of one call of the loop; a tuple, because every call makes one and a module takes 50 microseconds.

    Attributes:
        t0: start of the trajectory.
        t1: its end.
        x0: positions at the start, (n,).
        v0: velocities at the start, (n,).
        goals: times at which to save the state in this call, (goals,), padded with t1.
        num_goals: number of goals without padding.
        is_last: whether this call reaches the end, unless it is interrupted.
        max_steps: bound on the steps of all calls, `AUTOMATIC_MAX_STEPS` for one by the rate of the machine.
        max_events: bound on the logged events of all calls.
        max_turns: bound on the steps of this call.
        is_sound: whether the start is valid; if not, no step is taken.
    """

    t0: Reals
    t1: Reals
    x0: Reals
    v0: Reals
    goals: Reals
    num_goals: Reals
    is_last: Reals
    max_steps: Reals
    max_events: Reals
    max_turns: Reals
    is_sound: Reals


class Carry(eqx.Module):
    """Carry of the loop.

    Attributes:
        state: the motion.
        goal: number of goals reached in this call.
        steps: number of steps so far.
        is_finite: whether the motion stayed finite.
        seen: what each observer has seen, by its name.
    """

    state: State
    goal: Int[Array, "..."]
    steps: Int[Array, "..."]
    is_finite: Bool[Array, "..."]
    seen: dict[str, Any]


class LoopTask(AbstractTask):
    """Body of the loop over steps and all that it depends on, so that derivatives see it.

    Attributes:
        flow: the motion between events.
        machine: the machine.
        t0: start of the trajectory.
        phase0: phase of the load there.
        goal_periods: times of the goals in whole periods.
        goal_times: the rest of each.
        num_goals: number of goals of this call.
        resolution: times closer than this are one instant.
        max_steps: bound on the steps of all calls.
        last_step: number of steps after which this call ends.
        observers: what records the motion, by name.
    """

    flow: AbstractFlow
    machine: Machine
    t0: Scalar
    phase0: Float[Array, "2 harmonics ..."]
    goal_periods: Int[Array, "goals ..."]
    goal_times: Float[Array, "goals ..."]
    num_goals: Int[Array, "..."]
    resolution: Scalar
    max_steps: Int[Array, "..."]
    last_step: Int[Array, "..."]
    observers: dict[str, AbstractObserver]

    def is_live(self, carry: Carry) -> Bool[Array, "..."]:
        """True where this call has work left: a finite motion, steps and goals, and no observer ends it."""
        flags = [observer.goes_on(carry.seen[name]) for name, observer in self.observers.items()]
        return reduce(and_, (flag for flag in flags if flag is not None), self.goes_on(carry))

    def goes_on(self, carry: Any) -> Bool[Array, "..."]:
        """True where the motion is finite, and has steps and goals left."""
        return carry.is_finite & (carry.steps < self.most_steps) & (carry.goal < self.num_goals)

    @property
    def most_steps(self) -> Int[Array, "..."]:
        """Bound on the steps of this call."""
        return jnp.minimum(self.max_steps, self.last_step)

    def step(self, carry: Carry) -> Carry:
        """Take one step, and record it."""
        state, live = carry.state, self.is_live(carry)
        leg = self.fly_on(state, carry.goal).in_lanes(live)
        return Carry(
            state=jax.tree.map(lambda new, old: jnp.where(live, new, old), leg.onward, state),
            goal=carry.goal + leg.is_goal,
            steps=carry.steps + live,
            is_finite=carry.is_finite & (is_finite(leg.after) | ~live),
            seen=self.observed(carry.seen, leg, live),
        )

    def observed(self, seen: dict[str, Any], leg: Leg, live: Flag) -> dict[str, Any]:
        """Show a step to the observers; what is without one stays as it is."""
        return seen | {
            name: observer.update(self.machine, seen[name], leg, live)
            for name, observer in self.observers.items()
        }

    def fly_on(self, state: State, goal: Int[Array, "..."]) -> Leg:
        """Fly towards the goal, at most to the end of the period."""
        last = jnp.minimum(goal, len(self.goal_times) - 1)
        goal_periods, goal_time = (row_of_lane(a, last) for a in (self.goal_periods, self.goal_times))
        target, is_last_period = next_target(self.machine, state, (goal_periods, goal_time))
        flight = flight_to(self.flow, self.machine, state, target, self.resolution)
        after, instant = outcome(self.machine, flight)
        is_goal = instant.arrived & is_last_period
        onward = self.machine.start_period(after, self.phase0, instant.arrived & ~is_goal)
        time = self.t0 + state.periods * self.machine.period + instant.time
        return Leg(state, flight, after, onward, instant, time, is_goal, goal)


def next_target(
    machine: Machine, state: State, goal: tuple[Int[Array, "..."], Scalar]
) -> tuple[Scalar, Bool[Array, "..."]]:
    """Local time at which to end a step at the latest, and whether it is that of the goal, or the end of a period before.

    `goal` is counted in whole periods and a rest, see `in_periods`.
    """
    is_last_period = state.periods >= goal[0]
    return jnp.where(is_last_period, goal[1], machine.period), is_last_period


def is_finite(state: State) -> Bool[Array, "..."]:
    """True where a motion is finite, and no friction of contacts was left without a choice."""
    finite = jnp.all(jnp.isfinite(state.x + state.v), axis=0) & jnp.isfinite(state.time)
    return finite if state.mode is None or state.mode.paradox is None else finite & ~state.mode.paradox


def run_without_derivatives(
    prepare: Callable[..., tuple[AbstractTask, Any]], arguments: tuple
) -> tuple[Any, Any]:
    """Run a loop without derivatives after its preparation; the task and the last carry.

    Both form one kernel where possible, the preparation too because constants cannot be passed to a kernel.
    """
    numbers, flow, *_ = arguments
    return run_loop(prepare, arguments, in_kernel=fits_one_kernel(numbers, flow, UNROLLED_ALONE))


def run_loop(
    prepare: Callable[..., tuple[AbstractTask, Any]], arguments: tuple, *, in_kernel: bool
) -> tuple[Any, Any]:
    """`run_without_derivatives` with arguments in any form, for instance packed."""

    def loop(arguments: tuple) -> tuple[AbstractTask, Any, tuple]:
        task, carry = prepare(*arguments)
        return task, while_any(task, carry), arguments

    run = partial(in_one_kernel, loop) if in_kernel else loop
    return run(arguments)[:2]


def fits_one_kernel(numbers: MachineNumbers, flow: AbstractFlow, most: int) -> bool:
    """True if preparation and loop of a machine with at most so many masses, contacts and harmonics can be one kernel."""
    # Coordinates of a full mass matrix are computed by LAPACK, which no kernel can call.
    return numbers.mass.ndim < numbers.stiffness.ndim and steps_fit_one_kernel(numbers, flow, most)


def steps_fit_one_kernel(numbers: MachineNumbers, flow: AbstractFlow, most: int) -> bool:
    """True if the loop alone can be one kernel, after its preparation."""
    size = max(*numbers.rows.shape[:2], numbers.waves.num_harmonics)
    return size <= most and flow.fits_one_kernel and numbers.has_arithmetic_force


def run_prepared(
    task: LoopTask, carry: Carry, *, in_kernel: bool, has_parts: bool = False
) -> tuple[LoopTask, Carry]:
    """Run a loop after its preparation, as one kernel or as one for each part of a step; the task and the last carry."""

    def loop(pair: tuple[LoopTask, Carry]) -> tuple[LoopTask, Carry]:
        task, carry = pair
        return task, while_any(task, carry)

    run = partial(in_parts if has_parts else in_one_kernel, loop) if in_kernel else loop
    return run(not_constant((task, carry)) if in_kernel else (task, carry))


def prepare_loop(
    numbers: MachineNumbers,
    flow: AbstractFlow,
    r: LoopArguments,
    choices: Choices,
) -> tuple[LoopTask, Carry]:
    """Loop and initial carry of a request, for one trajectory or several with lanes last.

    Args:
        numbers: numbers of the machine.
        flow: the motion between events.
        r: request, with its own numbers in every lane.
        choices: the static choices.
    """
    observers = {
        "log": Logging(r.max_events, choices.room, choices.is_whole),
        "saved": Saving(len(r.goals) + 1, len(r.x0)),
        "grazing": GrazingWatch(),
    }
    task, first = begin_loop(numbers, flow, r, observers, can_stick=choices.can_stick)
    return task, first_carry(task, first, r.is_sound)


def begin_loop(
    numbers: MachineNumbers,
    flow: AbstractFlow,
    r: LoopArguments,
    observers: dict[str, AbstractObserver],
    *,
    can_stick: bool,
) -> tuple[LoopTask, State]:
    """Loop of a request, and the first state of its motion."""
    t0, span = r.t0, r.t1 - r.t0
    machine = prepare(numbers, jnp.where(span > 0, span, 1), (t0, r.x0, r.v0), can_stick=can_stick)
    flow = flow.prepare(machine)
    max_steps = jnp.where(r.max_steps == AUTOMATIC_MAX_STEPS, default_max_steps(machine, span), r.max_steps)
    phase0 = machine.phase_at_start(t0)
    goals = jnp.concatenate([r.goals, r.t1[None]])
    goal_periods, goal_times = in_periods(machine, goals - t0)
    first = initial_state(flow, machine, phase0, r.x0, r.v0, t0)
    if t0.ndim:
        first = to_all(first, *t0.shape)
    task = LoopTask(
        flow=flow,
        machine=machine,
        t0=t0,
        phase0=phase0,
        goal_periods=goal_periods,
        goal_times=goal_times,
        num_goals=r.num_goals + r.is_last,
        resolution=4 * jnp.finfo(t0.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(r.t1)),
        max_steps=max_steps,
        last_step=r.max_turns,
        observers=observers,
    )
    return task, first


def first_carry(task: LoopTask, first: State, is_sound: Bool[Array, "..."]) -> Carry:
    """Carry before the first step, from a state."""
    lanes, paradox = task.t0.shape, None if first.mode is None else first.mode.paradox
    return Carry(
        state=first,
        goal=jnp.zeros(lanes, int),
        steps=jnp.zeros(lanes, int),
        is_finite=is_sound if paradox is None else is_sound & ~paradox,
        seen={name: one.first(task.machine, first, task.t0) for name, one in task.observers.items()},
    )


def is_over(task: LoopTask, last: Carry, request: LoopArguments) -> Bool[Array, "..."]:
    """True where the trajectory reached its end."""
    return request.is_last & (last.goal >= task.num_goals)


def result_of(task: LoopTask, last: Carry, request: LoopArguments) -> RESULTS:
    """Result code of the trajectory of this call."""
    mode, is_full = last.state.mode, last.seen["log"].num_events > request.max_events
    result = RESULTS.where(is_full, RESULTS.max_events_reached, RESULTS.successful)
    result = RESULTS.where(is_over(task, last, request), result, RESULTS.max_steps_reached)
    result = RESULTS.where(last.is_finite, result, RESULTS.non_finite)
    if mode is not None and mode.paradox is not None:
        result = RESULTS.where(mode.paradox, RESULTS.friction_paradox, result)
    return RESULTS.where(request.is_sound, result, RESULTS.unsound_start)


def finish(task: LoopTask, last: Carry, request: LoopArguments, choices: Choices) -> Solution:
    """Trajectory with the events and saved states of this call."""
    machine, t0, t1 = task.machine, task.t0, request.t1
    state, log, (xs, vs), ts = last.state, last.seen["log"], last.seen["saved"], request.goals
    is_reached = (jnp.arange(ts.size) < last.goal)[:, None]
    is_done, is_full = is_over(task, last, request), log.num_events > request.max_events
    x1, v1 = machine.in_space(state)
    num_stops, num_sliders = machine.contacts.num_stops, machine.contacts.num_sliders
    # A contact that friction keeps closed holds too, without a force.
    at_rest = state.held if state.mode is None else state.held | state.is_kept_closed
    time = t0 + state.periods * machine.period + state.time
    return Solution(
        ts=ts,
        xs=jnp.where(is_reached, xs[: ts.size], x1),
        vs=jnp.where(is_reached, vs[: ts.size], v1),
        x1=x1,
        v1=v1,
        stuck1=at_rest[:num_stops],
        sticking1=at_rest[num_stops : machine.contacts.num - num_sliders],
        events=event_log(machine, log.kept_instants(), log.kept().phase, choices.room, log.places),
        num_events=jnp.minimum(log.num_events, request.max_events),
        num_steps=last.steps,
        num_rejected=task.flow.num_rejected(state.memory),
        grazing=last.seen["grazing"],
        result=result_of(task, last, request),
        t0=t0,
        t1=t1,
        prepared=pack((machine, task.flow)),
        restarts=log.kept(),
        max_steps=task.max_steps,
        known_until=jnp.where(is_full, log.known_until, jnp.where(is_done, t1, time)),
        last_sliders=machine.contacts.sliders(state.x, state.v) if num_sliders else None,
    )
