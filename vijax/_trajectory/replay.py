"""A trajectory once more, flight by flight, for its derivatives.

Derivatives are those of a motion with given events in a given order. Where the flow between events has a closed form,
its `flow_map`, steps are of no interest to them. The motion is followed without derivatives first, which records its
flights from event to event; then it is repeated with one evaluation of the flow map for each flight, by the same
transitions. Values come from the record, so nothing drifts, and derivatives from the repetition, which is
differentiable forward any number of times. Its cost is that of the events, not of the steps, for every direction.
Where the flow map is a matrix exponential, a step by a Taylor series costs much less: steps are recorded and repeated.

The record has room for `_ROOM` flights: both alternate until the motion ends, so there is no bound on the events.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow, Flight
from .._hybrid.just_after import accelerations_towards
from .._hybrid.transition import Instant
from .._jax.arrays import Scalar
from .._jax.concrete import stop_gradients
from .._jax.xla import AbstractTask, compute_once, in_one_kernel, in_parts, is_any, not_constant, while_any
from .._machine.contacts import Held
from .._machine.kinds import COMPLIANT
from .._machine.machine import Machine
from .._machine.state import State
from .._system.waves import speeds, turned
from .batched import Writing, put
from .loop import Carry, LoopTask, is_finite
from .records import Leg

# Flights of a trajectory that are recorded before they are repeated. So many of a group of lanes fit the cache.
_ROOM = 32


class Record(NamedTuple):
    """Flights from event to event, or steps, (rows, ...).

    Attributes:
        flight: the whole flight.
        periods: forcing periods that ended during it.
    """

    flight: Flight
    periods: Int[Array, "..."]


class _Recording(NamedTuple):
    """Carry of the recording.

    Attributes:
        state: the motion.
        goal: number of goals reached.
        steps: number of steps.
        is_finite: whether the motion stayed finite.
        record: the flights, (rows + 1, ...); the last row takes what is not kept.
        rows: number of flights recorded.
        duration: time since the last of them.
        periods: forcing periods that ended since.
    """

    state: State
    goal: Int[Array, "..."]
    steps: Int[Array, "..."]
    is_finite: Bool[Array, "..."]
    record: Record
    rows: Int[Array, "..."]
    duration: Scalar
    periods: Int[Array, "..."]


class _Recorder(AbstractTask):
    """Loop body that records flights."""

    task: LoopTask

    def is_live(self, carry: _Recording) -> Bool[Array, "..."]:
        """True where the motion continues and there is room."""
        return self.task.goes_on(carry) & (carry.rows < _ROOM)

    def step(self, carry: _Recording) -> _Recording:
        """Take one step; record the flight that ends with it, if one does."""
        live = self.is_live(carry)
        leg = self.task.fly_on(carry.state, carry.goal)
        instant, finite = leg.instant, is_finite(leg.after)
        duration = carry.duration + leg.flight.duration
        # A motion that is cut ends with a flight too.
        is_cut = (carry.steps + 1 >= self.task.most_steps) | ~finite
        is_row = (
            live & (instant.happened | leg.is_goal | is_cut)
            if repeats_whole_flights(self.task.flow, self.task.machine)
            else live
        )
        flight = eqx.tree_at(lambda f: f.duration, leg.flight, duration)
        row = jax.tree.map(lambda a: a[None], Record(flight, carry.periods))
        record, *_ = put(is_row, Writing(carry.record, row, carry.rows))
        return _Recording(
            state=jax.tree.map(lambda new, old: jnp.where(live, new, old), leg.onward, carry.state),
            goal=carry.goal + (live & leg.is_goal),
            steps=carry.steps + live,
            is_finite=carry.is_finite & (finite | ~live),
            record=record,
            rows=carry.rows + is_row,
            duration=jnp.where(live, jnp.where(is_row, 0, duration), carry.duration),
            periods=jnp.where(is_row, 0, carry.periods + (live & instant.arrived & ~leg.is_goal)),
        )


def repeats_whole_flights(flow: AbstractFlow, machine: Machine) -> bool:
    """True if flights from event to event are recorded; otherwise steps are, which end at knots of loads by tables."""
    return flow.flow_map_reaches_far and machine.tables is None


def _blank_recording(carry: Carry) -> _Recording:
    """Recording before the first step."""
    state, lanes = carry.state, carry.steps.shape
    nothing = jnp.zeros_like(state.time)
    flags = jnp.zeros(lanes, bool)
    flight = Flight(state, nothing, state.no_events, flags)
    if state.knots is not None:
        at_knots = jnp.zeros_like(state.knots.passed, bool)
        flight = Flight(state, nothing, state.no_events, flags, at_knots, flags)
    count = jnp.zeros(lanes, int)

    def rows(a: Array) -> Array:
        blank = jnp.zeros((_ROOM + 1, *a.shape), a.dtype)
        return jnp.moveaxis(blank, -1, 0) if lanes else blank

    record = jax.tree.map(rows, Record(flight, count))
    return _Recording(state, carry.goal, carry.steps, carry.is_finite, record, count, nothing, count)


class RecordedFlow(AbstractFlow):
    """Flow that repeats one recorded flight, with the derivatives of its flow map."""

    flow: AbstractFlow
    flight: Flight

    def fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        """Return the flight."""
        del machine, state, remaining, resolution
        return self.flight

    def propagate(
        self, machine: Machine, state: State, hold: Held, step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Evaluate the flow map, or take the step again."""
        if repeats_whole_flights(self.flow, machine):
            angle = speeds(state.phase, machine.pace) * step
            change = turned(state.phase, (-2 * jnp.sin(angle / 2) ** 2, jnp.sin(angle)))
            displacement, gain = self.flow.flow_map(machine, state, hold, step, change)
            v = state.v + gain
        else:
            # The terms of the series are computed again for derivatives: to keep them takes longer.
            take_step = jax.checkpoint(type(self.flow).propagate, prevent_cse=False)
            displacement, v, change = take_step(self.flow, machine, state, hold, step)
        contacts = machine.contacts
        if not (contacts.is_coupled and machine.can_stick):
            return displacement, v, change
        displacement, v = contacts.kept(state.x, displacement, v, hold, state.phase + change)
        return displacement, v, change

    def coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        """Coast as the flow does."""
        return self.flow.coast(machine, state, remaining)


class Repetition(NamedTuple):
    """Carry of the repetition.

    Attributes:
        state: the motion.
        goal: number of goals reached.
        seen: what the observers of the task have seen, by their names.
    """

    state: State
    goal: Int[Array, "..."]
    seen: dict[str, Any]


@eqx.filter_custom_jvp
def _repeat(
    task: LoopTask, state: State, goal: Int[Array, "..."], row: Record, call: Callable[..., Any]
) -> Leg:
    del call
    return _repeat_once(task, state, goal, row)


@_repeat.def_jvp
def _repeat_jvp(primals, tangents):
    *primals, call = primals
    *tangents, _ = tangents
    moving, still = eqx.partition(
        primals, jax.tree.map(lambda t: t is not None, tangents, is_leaf=lambda t: t is None)
    )

    def linearized(moving, still):
        def of_moving(moving):
            found = _repeat_once(*eqx.combine(moving, still))
            return eqx.partition(found, eqx.is_inexact_array)

        out, lin, rest = jax.linearize(of_moving, moving, has_aux=True)
        return (out, rest), lin

    (out, rest), lin = call(linearized, moving, still)
    # XLA refuses large sums in a kernel, as products of matrices of contacts become where many tangents are side by side.
    contacts = primals[0].machine.contacts
    push = compute_once if contacts.is_coupled else call
    change = push(lambda lin, tangents: lin(tangents), lin, eqx.filter(tangents, lambda a: a is not None))
    return eqx.combine(out, rest), change


def _repeat_once(task: LoopTask, state: State, goal: Int[Array, "..."], row: Record) -> Leg:
    """Repeat one recorded flight and the transition at its end."""
    names = lambda s: (s.periods, s.time)  # noqa: E731
    there = state.periods + row.periods, state.time - row.periods * task.machine.period
    begin = eqx.tree_at(names, state, there)
    flight = row.flight
    if "log" in task.observers:
        flight = _with(lambda f: f.delays, flight, jnp.zeros(flight.is_event.shape, state.x.dtype))
    own = eqx.tree_at(lambda t: t.flow, task, RecordedFlow(task.flow, flight))
    leg = own.fly_on(begin, goal)
    instant = leg.instant
    if leg.flight.delays is not None:
        instant = _at_own_times(task.machine, leg.flight, leg.flight.delays, instant)
    return leg._replace(before=None, flight=None, after=None, instant=instant)


def _at_own_times(
    machine: Machine, flight: Flight, delay: Float[Array, "guards ..."], instant: Instant
) -> Instant:
    """The instant with the delays of its events, and speeds of compliant contacts with the derivatives of these times.

    Speeds of impacts have those of their own times, see `_hybrid/own_times.py`.
    """
    end, num = flight.end, len(instant.hit)
    if len(delay) > num:  # two guards of each element
        delay = jnp.where(flight.is_event[:num], delay[:num], delay[num:])
    instant = _with(lambda i: i.delay, instant, delay)
    if instant.switched is None or COMPLIANT not in machine.contacts.laws.kinds:
        return instant
    gain = accelerations_towards(machine.in_mode(end), end) * delay
    gain = jnp.where(instant.switched.closed | instant.switched.opened, gain, 0)
    return eqx.tree_at(
        lambda i: (i.velocity_minus, i.velocity_plus),
        instant,
        (instant.velocity_minus + gain, instant.velocity_plus + gain),
    )


def _with(name: Callable[[Any], Any], tree: Any, value: Array) -> Any:
    """The same with a field that runs leave out."""
    return eqx.tree_at(name, tree, value, is_leaf=lambda leaf: leaf is None)


def repeat_flights(task: LoopTask, carry: Carry, *, has_log: bool, has_saved: bool, in_kernel: bool) -> Carry:
    """Follow a trajectory, differentiably in forward mode.

    Args:
        task: loop body with everything it depends on.
        carry: its first carry.
        has_log: whether to log events; otherwise the log stays empty.
        has_saved: whether to save states; otherwise they stay zero.
        in_kernel: whether the recording fits one kernel.

    Returns:
        Last carry, in which only derivatives and what they belong to are of use: neither counts of steps nor grazing.
    """
    recorder = _Recorder(stop_gradients(task))
    begun = _blank_recording(stop_gradients(carry))
    needed = {"log": has_log, "saved": has_saved}
    task = replace(task, observers={name: task.observers[name] for name in needed if needed[name]})
    seen = {name: carry.seen[name] for name in task.observers}
    if has_log:
        seen["log"] = _with(
            lambda log: log.instants.delay, seen["log"], jnp.zeros_like(seen["log"].instants.chatter)
        )
    first, call = _with_tangents(Repetition(carry.state, carry.goal, seen)), compute_once
    if in_kernel:
        recorder, begun, task, first = not_constant((recorder, begun, task, first))
        # The step of a machine whose forces switch is too large for one kernel to compile soon.
        call = in_parts if task.machine.contacts.is_switching else _in_kernel

    def turn(both: tuple[_Recording, Repetition, Bool[Array, "..."]]):
        recording, repeated, _ = both
        recording = call(_record_on, recorder, recording)
        repeated = _repeat_all(task, repeated, recording.record, recording.rows, call)
        return recording, repeated, is_any(recorder.task.goes_on(recording))

    start = begun, first, is_any(recorder.task.goes_on(begun))
    recording, last, _ = jax.lax.while_loop(lambda both: both[2], turn, start)
    return Carry(last.state, last.goal, recording.steps, recording.is_finite, carry.seen | last.seen)


def _with_tangents(carry: Repetition) -> Repetition:
    """The same with a tangent of every number, zero or not.

    Otherwise JAX traces the derivative of a loop once more for every set of tangents that turns out not to stay zero.
    """
    floats, rest = eqx.partition(carry, eqx.is_inexact_array)
    return eqx.combine(_same(floats), rest)


@jax.custom_jvp
def _same(tree: Repetition) -> Repetition:
    return tree


@_same.defjvp
def _same_jvp(primals, tangents):
    return primals[0], tangents[0]  # JAX replaces zeros that it knows by arrays of zeros


def _record_on(recorder: _Recorder, recording: _Recording) -> _Recording:
    """Record flights until there is no more room, or the motion ends."""
    return while_any(recorder, recording._replace(rows=jnp.zeros_like(recording.rows)))


def _repeat_all(
    task: LoopTask,
    repeated: Repetition,
    record: Record,
    rows: Int[Array, "..."],
    call: Callable[..., Any],
) -> Repetition:
    """Repeat all recorded flights, the lanes together."""
    if rows.ndim:
        record = jax.tree.map(lambda a: jnp.moveaxis(a, 0, -1), record)

    def one(now: tuple[Int[Array, ""], Repetition]) -> tuple[Int[Array, ""], Repetition]:
        k, (state, goal, seen) = now
        row = jax.tree.map(lambda a: jax.lax.dynamic_index_in_dim(a, k, 0, keepdims=False), record)
        live = k < rows
        leg = _repeat(task, state, goal, row, call).in_lanes(live)
        seen = task.observed(seen, leg, live)
        state = jax.tree.map(lambda new, old: jnp.where(live, new, old), leg.onward, state)
        return k + 1, Repetition(state, goal + leg.is_goal, seen)

    is_on = lambda now: is_any(now[0] < rows)  # noqa: E731
    return jax.lax.while_loop(is_on, one, (jnp.zeros_like(rows, shape=()), repeated))[1]


def _in_kernel(function: Callable[..., Any], *given: Any) -> Any:
    """Call a function as one kernel, which hands back what it may not read."""
    return in_one_kernel(lambda *given: (function(*given), given), *given)[0]
