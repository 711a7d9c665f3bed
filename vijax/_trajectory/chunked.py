"""Trajectories of concrete numbers: one program for all machines of a size, called until the end.

It has room for a fixed number of events and saved states; longer requests go in, and their results come out, piece by
piece. So only another size of machine compiles anew, and the user can interrupt between calls.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals
from .._jax.xla import compile_lightly
from .._machine.numbers import MachineNumbers
from .._machine.state import State, with_memory
from .event_log import EventLog, Restarts
from .grazing import Grazing
from .loop import (
    Carry,
    Choices,
    LoopArguments,
    LoopTask,
    finish,
    is_over,
    prepare_loop,
    run_without_derivatives,
)
from .solution import Solution

# Bounds of one call: logged events, saved states, and steps, which take less than a second.
_EVENTS, _GOALS, _STEPS = 1024, 256, 1 << 18

Rows = TypeVar("Rows", EventLog, Restarts)


class _Saved(eqx.Module):
    """States saved by one call, (goals, n)."""

    xs: Array
    vs: Array


class CallProgress(eqx.Module):
    """Progress of a trajectory, from which the next call continues.

    Attributes:
        state: the motion.
        goals: number of goals reached by this call, including the end.
        steps: number of steps so far.
        rows: number of instants logged by this call, in the first call including the start.
        num_events: number of events so far.
        known_until: time of the last logged instant.
        is_finite: whether the motion stayed finite.
        is_paused: whether another call is needed.
        grazing: closest approach to grazing.
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


@compile_lightly
def _call(
    numbers: MachineNumbers, flow: AbstractFlow, request: LoopArguments, left: CallProgress, choices: Choices
) -> tuple[Solution, _Saved, CallProgress]:
    """One call; the solution holds only the first saved state, as most requests have no more."""
    solution, left = _run(numbers, flow, request, left, choices)
    names = lambda s: (s.ts, s.xs, s.vs)  # noqa: E731
    first = eqx.tree_at(names, solution, [a[:1] for a in names(solution)])
    return first, _Saved(solution.xs, solution.vs), left


def _run(
    numbers: MachineNumbers,
    flow: AbstractFlow,
    request: LoopArguments,
    left: CallProgress,
    choices: Choices,
) -> tuple[Solution, CallProgress]:
    """Follow a trajectory from its start, or from the progress of the call before.

    Args:
        numbers: numbers of the machine.
        flow: the motion between events.
        request: arguments of the loop.
        left: progress of the call before; ignored if `left.steps` is 0.
        choices: the static choices.

    Returns:
        Trajectory with the events and saved states of this call, and its progress.
    """
    request = jax.tree.map(jnp.asarray, request)
    prepare = partial(_begin, choices=choices)
    task, last = run_without_derivatives(prepare, (numbers, flow, request, left))
    solution = finish(task, last, request, choices)
    left = CallProgress(
        state=last.state,
        goals=last.goal,
        steps=last.steps,
        rows=last.log.rows,
        num_events=last.log.num_events,
        known_until=last.log.known_until,
        is_finite=last.is_finite,
        is_paused=last.is_finite & (last.steps < task.max_steps) & ~is_over(task, last, request),
        grazing=last.grazing,
    )
    return solution, left


def _begin(
    numbers: MachineNumbers,
    flow: AbstractFlow,
    request: LoopArguments,
    left: CallProgress,
    choices: Choices,
) -> tuple[LoopTask, Carry]:
    task, carry = prepare_loop(numbers, flow, request, choices)
    carry = _gone_on(carry, left)
    return eqx.tree_at(lambda t: t.last_step, task, carry.steps + request.max_turns), carry


def _gone_on(carry: Carry, left: CallProgress) -> Carry:
    """Initial carry of a call: that of the start, or continued from the call before."""
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
    # Empty arrays for events and saved states are the same in both.
    return jax.tree.map(lambda a, b: b if a is b else jnp.where(goes_on, a, b), before, carry)


def follow_known(
    numbers: MachineNumbers, flow: AbstractFlow, request: LoopArguments, *, can_stick: bool
) -> Solution:
    """Follow a trajectory of NumPy numbers, with any number of `request.goals`."""
    ts, left = request.goals, empty_progress(numbers, flow)
    choices = Choices(can_stick, _EVENTS, is_whole=False)
    calls: list[_Taken] = []
    num_reached = 0
    while True:
        window = _window(request, num_reached)
        solution, saved, left = _call(numbers, flow, window, left, choices)
        is_done = not np.asarray(left.is_paused)
        if is_done and not calls and len(ts) == 1 and request.max_events == _EVENTS:
            return solution
        left = jax.tree.map(np.asarray, left)
        calls.append(_taken(solution, saved, left, int(window.num_goals)))
        num_reached += len(calls[-1].xs)
        if is_done:
            return _joined(solution, ts, calls, int(request.max_events))


def _window(request: LoopArguments, num_reached: int) -> LoopArguments:
    """Request of one call: the next goals, padded with the end."""
    waiting = request.goals[num_reached:]
    goals = np.full(_GOALS, request.t1)
    goals[: len(waiting)] = waiting[:_GOALS]
    return request._replace(
        goals=goals,
        num_goals=np.asarray(min(len(waiting), _GOALS)),
        is_last=np.asarray(len(waiting) <= _GOALS),
        max_turns=np.asarray(_STEPS),
    )


def empty_progress(numbers: MachineNumbers, flow: AbstractFlow) -> CallProgress:
    """Input of the first call, in the shapes of the progress of a call."""
    left = _nothing(*numbers.rows.shape, numbers.waves.num_harmonics, numbers.mass.dtype)
    if type(flow).memory is AbstractFlow.memory:  # no memory, not asked of the flow to save time
        return left
    memory = flow.memory(left.known_until)
    return eqx.tree_at(lambda left: left.state, left, with_memory(left.state, memory))


@lru_cache
def _nothing(num_contacts: int, n: int, num_harmonics: int, dtype: np.dtype) -> CallProgress:
    def zeros(dtype: DTypeLike, *shape: int) -> Array:
        return jax.device_put(np.zeros(shape, dtype))

    count, real, flag = zeros(int), zeros(dtype), zeros(bool)
    state = State(
        periods=count,
        time=real,
        time_low=real,
        phase=zeros(dtype, 2, num_harmonics),
        x=zeros(dtype, n),
        v=zeros(dtype, n),
        gap=zeros(dtype, num_contacts),
        held=zeros(bool, num_contacts),
        contact=zeros(np.int8, num_contacts),
    )
    return CallProgress(
        state=state,
        goals=count,
        steps=count,
        rows=count,
        num_events=count,
        known_until=real,
        is_finite=flag,
        is_paused=flag,
        grazing=Grazing(real, real, flag),
    )


@dataclass(frozen=True)
class _Taken:
    """Results of one call, without padding."""

    xs: np.ndarray
    vs: np.ndarray
    events: EventLog
    restarts: Restarts


def _taken(solution: Solution, saved: _Saved, left: CallProgress, most_goals: int) -> _Taken:
    num_goals = min(int(left.goals), most_goals)  # the end is not a saved state
    is_event = np.asarray(solution.events.stop) >= 0
    return _Taken(
        xs=np.asarray(saved.xs)[:num_goals],
        vs=np.asarray(saved.vs)[:num_goals],
        events=jax.tree.map(lambda a: np.asarray(a)[is_event], solution.events),
        restarts=jax.tree.map(lambda a: np.asarray(a)[: int(left.rows)], solution.restarts),
    )


def _joined(solution: Solution, ts: np.ndarray, calls: list[_Taken], max_events: int) -> Solution:
    """Solution of the last call with the results of all calls."""
    events, restarts = (
        _concatenated([getattr(call, name) for call in calls]) for name in ("events", "restarts")
    )
    # A stick has the time at which its chatter ends; events of a later call may come before it.
    order = np.argsort(events.t, kind="stable")[:max_events]
    events = jax.tree.map(
        lambda a: _filled(a[order], max_events, -1 if a.dtype.kind == "i" else np.nan), events
    )
    until = _filled(restarts.t, max_events + 1, np.inf)
    restarts = jax.tree.map(lambda a: _filled(a, max_events + 1, 0), restarts)
    restarts = eqx.tree_at(lambda rows: rows.t, restarts, until)
    saved = []
    for name, end in (("xs", solution.x1), ("vs", solution.v1)):
        reached = np.concatenate([getattr(call, name) for call in calls])
        rest = np.broadcast_to(end, (len(ts) - len(reached), *reached.shape[1:]))
        saved.append(np.concatenate([reached, rest]))
    names = lambda s: (s.ts, s.xs, s.vs, s.events, s.restarts)  # noqa: E731
    return eqx.tree_at(names, solution, jax.device_put((ts, *saved, events, restarts)))


def _concatenated(parts: list[Rows]) -> Rows:
    return jax.tree.map(lambda *columns: np.concatenate(columns), *parts)


def _filled(a: np.ndarray, size: int, value: int | float) -> np.ndarray:
    """First `size` rows of a column, padded with `value`."""
    return np.concatenate([a[:size], np.full((max(size - len(a), 0), *a.shape[1:]), value, a.dtype)])
