"""The loop that follows one trajectory, and its results.

Known numbers go through one program for all machines of a size, see `windows.py`: it has room for a fixed
number of events and saved states, and is called again until all is done. Traced values, under `jit`, `vmap`
or derivatives, take one call, with room for all that was asked.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._machine.machine import OWN_BOUND, Machine, ample_steps, in_periods, prepare
from .._machine.numbers import Numbers, numbers_of
from .._machine.state import State, start_period
from .._refusal import lock
from .._system.system import ImpactSystem
from .._types import UNROLLED_ALONE, Reals, Scalar
from .._xla import AbstractTask, bounded_while_any, differentiable, in_one_kernel, while_any
from .event_log import Log, empty_log, event_log, write
from .grazing import Grazing, nothing_met, update_grazing
from .solution import RESULTS, Solution, told
from .step import advance, begin

# `max_turns` of a call that does all at once: the largest number of 32 bits, as JAX may have no 64-bit ones.
NO_PAUSE = np.iinfo(np.int32).max


class Request(NamedTuple):
    """Arguments of one call of the loop; a tuple, as one is made at every call, which takes a module 50 microseconds.

    Attributes:
        t0: start of the trajectory.
        t1: its end.
        x0: positions at the start, (n,).
        v0: velocities there, (n,).
        goals: times at which to save the state in this call, (goals,); what they leave free is filled with t1.
        num_goals: how many they are.
        is_last: whether the end is reached in this call, unless it is interrupted.
        max_steps: bound on the steps in all, `OWN_BOUND` for one by the rate of the machine.
        max_events: the most events that are logged in all.
        max_turns: steps after which this call comes back.
        is_sound: whether to start at all.
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
        log: the events.
        xs: saved positions, (goals + 1, n); what is not saved is written to the last row.
        vs: saved velocities, likewise.
        goal: goals reached in this call.
        steps: steps so far.
        is_finite: whether the motion stayed finite.
        grazing: the closest to grazing it came.
    """

    state: State
    log: Log
    xs: Float[Array, "goals n"]
    vs: Float[Array, "goals n"]
    goal: Int[Array, ""]
    steps: Int[Array, ""]
    is_finite: Bool[Array, ""]
    grazing: Grazing


class Task(AbstractTask):
    """The loop body and all that it depends on, so that derivatives see it."""

    flow: AbstractFlow
    machine: Machine
    t0: Scalar
    phase0: Float[Array, "2 harmonics"]
    goal_periods: Int[Array, " goals"]
    goal_times: Float[Array, " goals"]
    num_goals: Int[Array, ""]
    resolution: Scalar
    max_steps: Int[Array, ""]
    last_step: Int[Array, ""]
    max_events: Int[Array, ""]

    def is_live(self, carry: Carry) -> Bool[Array, ""]:
        """Whether there is anything left to do in this call."""
        is_on = carry.is_finite & (carry.steps < jnp.minimum(self.max_steps, self.last_step))
        return is_on & (carry.goal < self.num_goals) & carry.log.has_room(self.max_events)

    def step(self, carry: Carry) -> Carry:
        """One step of the motion, its events logged and its state saved where asked for."""
        state, live = carry.state, self.is_live(carry)
        goal = jnp.minimum(carry.goal, self.goal_times.size - 1)
        is_last_period = state.periods >= self.goal_periods[goal]
        target = jnp.where(is_last_period, self.goal_times[goal], self.machine.period)
        after, instant = advance(self.flow, self.machine, state, target, self.resolution)
        is_saved = live & instant.arrived & is_last_period
        slot = jnp.where(is_saved, carry.goal, self.goal_times.size)
        is_finite = jnp.all(jnp.isfinite(after.x + after.v)) & jnp.isfinite(after.time)
        grazing = update_grazing(self.machine, state, after, instant, carry.grazing, live)
        after = start_period(after, self.phase0, instant.arrived & ~is_last_period)
        x, v = self.machine.in_space(after)
        time = self.t0 + state.periods * self.machine.period + instant.time
        save = partial(jax.lax.dynamic_update_index_in_dim, index=slot, axis=0)
        return Carry(
            state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
            log=write(carry.log, after, instant, time, live, self.max_events),
            xs=save(carry.xs, x),
            vs=save(carry.vs, v),
            goal=carry.goal + is_saved,
            steps=carry.steps + live,
            is_finite=carry.is_finite & (is_finite | ~live),
            grazing=grazing,
        )


class Left(eqx.Module):
    """Where a trajectory stands, from where another call goes on.

    Attributes:
        state: the motion.
        goals: goals reached by this call, the end among them.
        steps: steps so far.
        rows: instants that this call logged, the start among them in the first.
        num_events: events so far.
        known_until: time of the last logged instant.
        is_finite: whether the motion stayed finite.
        is_paused: whether there is more to do.
        grazing: the closest to grazing it came.
    """

    state: State
    goals: Reals
    steps: Reals
    rows: Reals
    num_events: Reals
    known_until: Reals
    is_finite: Reals
    is_paused: Reals
    grazing: Grazing


class Asked(NamedTuple):
    """What is decided before a trajectory is followed in one call.

    Attributes:
        room: the most events logged.
        can_stick: whether any stop might hold its mass.
        max_reverse_steps: see `simulate`.
        raises: whether derivatives that would go back too far raise; else they are NaN.
    """

    room: int
    can_stick: bool
    max_reverse_steps: int
    raises: bool


def run_whole(
    machine: ImpactSystem | Numbers, flow: AbstractFlow, request: Request, asked: Asked
) -> Solution:
    """Follow a trajectory in one call, differentiably."""
    return differentiable(_forwards, _backwards, (machine, flow, request, asked))


def _forwards(whole: tuple[ImpactSystem | Numbers, AbstractFlow, Request, Asked]) -> Solution:
    return _run_whole(*whole, while_any)


def _backwards(whole: tuple[ImpactSystem | Numbers, AbstractFlow, Request, Asked]) -> Solution:
    asked = whole[3]
    refuse = partial(factor_in_reverse, raises=asked.raises)
    return _run_whole(*whole, partial(bounded_while_any, max_steps=asked.max_reverse_steps, refuse=refuse))


def _run_whole(
    machine: ImpactSystem | Numbers, flow: AbstractFlow, request: Request, asked: Asked, loop: Callable
) -> Solution:
    numbers = machine if isinstance(machine, Numbers) else numbers_of(machine)
    arguments = numbers, flow, request, None
    task, carry = _begin(*arguments, room=asked.room, can_stick=asked.can_stick)
    return _finish(task, loop(task, carry), request, asked.room)[0]


def run(
    numbers: Numbers, flow: AbstractFlow, request: Request, left: Left, *, room: int, can_stick: bool
) -> tuple[Solution, Left]:
    """Follow a trajectory from its start, or from where the call before it left it.

    Args:
        numbers: of the machine.
        flow: the motion between events.
        request: what is asked for.
        left: where to go on; the start, if `left.steps` is 0.
        room: the most events logged by this call.
        can_stick: whether any stop might hold its mass.

    Returns:
        The trajectory, with what this call saw of it, and where it stands.
    """
    request = jax.tree.map(jnp.asarray, request)
    prepare = partial(_begin, room=room, can_stick=can_stick)
    return _finish(*one_way(prepare, (numbers, flow, request, left)), request, room)


def run_for_log(
    numbers: Numbers, flow: AbstractFlow, request: Request, *, room: int, can_stick: bool
) -> tuple[Log, RESULTS, Float[Array, " state"]]:
    """Follow a trajectory for its log alone, without derivatives: the log, what became of it, and its end (x, v)."""
    request = jax.tree.map(jnp.asarray, request)
    task, carry = _begin(numbers, flow, request, None, room=room, can_stick=can_stick)
    last = while_any(task, carry)
    solution, _ = _finish(task, last, request, room)
    return last.log, solution.result, jnp.concatenate([solution.x1, solution.v1])


def one_way(prepare: Callable[..., tuple[AbstractTask, Any]], arguments: tuple) -> tuple[Any, Any]:
    """A loop without derivatives and its preparation, compiled into one kernel where possible: the task, the last carry.

    The preparation too, as constants cannot be handed to a kernel.
    """

    def loop(arguments: tuple) -> tuple[AbstractTask, Any, tuple]:
        task, carry = prepare(*arguments)
        return task, jax.lax.while_loop(lambda c: task.is_live(c), lambda c: task.step(c), carry), arguments

    numbers, flow, *_ = arguments
    is_small = max(*numbers.rows.shape, numbers.waves.num_harmonics) <= UNROLLED_ALONE
    # Coordinates of a full mass matrix are made by LAPACK, which no kernel can call.
    is_small = is_small and numbers.mass.ndim == 1
    run = partial(in_one_kernel, loop) if is_small and flow.fits_one_kernel else loop
    return run(arguments)[:2]


def _begin(
    numbers: Numbers, flow: AbstractFlow, r: Request, left: Left | None, *, room: int, can_stick: bool
) -> tuple[Task, Carry]:
    t0, span = r.t0, r.t1 - r.t0
    machine = prepare(numbers, jnp.where(span > 0, span, 1), (t0, r.x0, r.v0), can_stick=can_stick)
    flow = flow.prepare(machine)
    max_steps = jnp.where(r.max_steps == OWN_BOUND, ample_steps(machine, span), r.max_steps)
    phase0 = machine.phase_at(t0)
    goals = jnp.append(r.goals, r.t1)
    goal_periods, goal_times = in_periods(machine, goals - t0)
    first = begin(flow, machine, phase0, r.x0, r.v0, t0)
    carry = Carry(
        state=first,
        log=empty_log(first, t0, room, is_whole=left is None, has_impulses=machine.contacts.is_coupled),
        xs=jnp.zeros((goals.size + 1, r.x0.size), r.x0.dtype),
        vs=jnp.zeros((goals.size + 1, r.x0.size), r.x0.dtype),
        goal=jnp.array(0),
        steps=jnp.array(0),
        is_finite=r.is_sound,
        grazing=nothing_met(t0),
    )
    if left is not None:
        carry = _gone_on(carry, left)
    task = Task(
        flow=flow,
        machine=machine,
        t0=t0,
        phase0=phase0,
        goal_periods=goal_periods,
        goal_times=goal_times,
        num_goals=r.num_goals + r.is_last,
        resolution=4 * jnp.finfo(t0.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(r.t1)),
        max_steps=max_steps,
        last_step=carry.steps + r.max_turns,
        max_events=r.max_events,
    )
    return task, carry


def _gone_on(carry: Carry, left: Left) -> Carry:
    """The carry of a call that goes on, if there was one before it."""
    goes_on = left.steps > 0
    log = eqx.tree_at(
        lambda log: (log.rows, log.num_events, log.events_before, log.known_until),
        carry.log,
        (jnp.zeros_like(carry.log.rows), left.num_events, left.num_events, left.known_until),
    )
    before = eqx.tree_at(
        lambda c: (c.state, c.log, c.steps, c.is_finite, c.grazing),
        carry,
        (left.state, log, left.steps, left.is_finite, left.grazing),
    )
    # Empty room is the same in both.
    return jax.tree.map(lambda a, b: b if a is b else jnp.where(goes_on, a, b), before, carry)


def factor_in_reverse(is_cut: Bool[Array, ""], *, raises: bool) -> Scalar:
    """Factor of reverse-mode derivatives: 1, or NaN or an error if the loop back was too short."""
    factor = jnp.where(is_cut, jnp.nan, 1.0)
    if raises:
        number, sentences = told(RESULTS.where(is_cut, RESULTS.max_reverse_steps_reached, RESULTS.successful))
        factor = factor * lock(number, sentences)
    return factor


def _finish(task: Task, last: Carry, request: Request, room: int) -> tuple[Solution, Left]:
    machine, t0, t1 = task.machine, task.t0, request.t1
    state, log, ts = last.state, last.log, request.goals
    is_reached = (jnp.arange(ts.size) < last.goal)[:, None]
    is_done = request.is_last & (last.goal >= task.num_goals)
    is_full = log.num_events > request.max_events
    result = RESULTS.where(is_full, RESULTS.max_events_reached, RESULTS.successful)
    result = RESULTS.where(is_done, result, RESULTS.max_steps_reached)
    result = RESULTS.where(last.is_finite, result, RESULTS.non_finite)
    result = RESULTS.where(request.is_sound, result, RESULTS.unsound_start)
    x1, v1 = machine.in_space(state)
    time = t0 + state.periods * machine.period + state.time
    solution = Solution(
        ts=ts,
        xs=jnp.where(is_reached, last.xs[: ts.size], x1),
        vs=jnp.where(is_reached, last.vs[: ts.size], v1),
        x1=x1,
        v1=v1,
        stuck1=state.held,
        events=event_log(machine, log.kept_instants(), log.kept().phase, room),
        num_events=jnp.minimum(log.num_events, request.max_events),
        num_steps=last.steps,
        num_rejected=task.flow.num_rejected(state.memory),
        grazing=last.grazing,
        result=result,
        t0=t0,
        t1=t1,
        machine=machine,
        flow=task.flow,
        restarts=log.kept(),
        max_steps=task.max_steps,
        known_until=jnp.where(is_full, log.known_until, jnp.where(is_done, t1, time)),
    )
    left = Left(
        state=state,
        goals=last.goal,
        steps=last.steps,
        rows=log.rows,
        num_events=log.num_events,
        known_until=log.known_until,
        is_finite=last.is_finite,
        is_paused=last.is_finite & (last.steps < task.max_steps) & ~is_done,
        grazing=last.grazing,
    )
    return solution, left
