"""The equations of a cycle with a given sequence of events.

The unknowns are the start z0 = (x, v), in the frame of the stops, at the phase where the cycle begins, and the
durations of the flights in forcing periods. An impact ends a flight where its gap is zero, a release where the
contact force is zero, and so on: the guard of the event vanishes. After n forcing periods the state is the start again. The equations do not require that an
impact approaches its stop or that a stop is pressed. So a family of orbits is smooth through grazing, and continues
where it is not admissible. A run from the cycle decides whether it is admissible, see `search.py`.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._flow.across_knots import flow_map_across_knots
from .._flow.interface import AbstractFlow
from .._hybrid.tied_friction import in_laws
from .._hybrid.transition import Instant
from .._jax.arrays import Scalar
from .._machine.first_state import state_before_contact
from .._machine.kinds import RIGID
from .._machine.machine import Machine
from .._machine.numbers import MachineNumbers
from .._machine.preparation import prepare
from .._machine.state import State
from .._system.waves import phase_at, turned
from .._trajectory.event_log import EventLog, event_log
from .condensation import over_flights
from .rigid_modes import of_positions
from .sequence import NOTHING, Sequence, held_in
from .side_by_side import summed
from .switching_events import Event, end_of_flight, instant_of, leading_zeros_of, with_stretches_of

# MOMENT: duration, in forcing periods, below which a flight has none when residuals are divided by it.
MOMENT = 1e-12


class Unknowns(NamedTuple):
    """The unknowns that determine a cycle.

    Attributes:
        z: positions and velocities at its start, in the frame of the stops, (2 n,).
        flights: durations in forcing periods, (events,).
    """

    z: Float[Array, " state"]
    flights: Float[Array, " events"]


class Residual(NamedTuple):
    """The values that vanish on an orbit, and the speeds at its impacts.

    Attributes:
        events: gaps at the impacts, contact forces at the releases, (events,).
        closing: the state at the end minus the state at the start, (2 n,).
        speed: at which the guard of each event vanishes, see `EndOfFlight`, (events,).
        grip: that each impact leaves, see `EndOfFlight`, (events, stops); None without friction of contacts.
    """

    events: Float[Array, " events"]
    closing: Float[Array, " state"]
    speed: Float[Array, " events"]
    grip: Any = None


class Problem(eqx.Module):
    """A machine, and the sequence and the period of its cycle.

    Attributes:
        machine: the machine.
        flow: its prepared flow.
        sequence: the events of the cycle.
        num_periods: n, forcing periods.
        phase: phase where the cycle begins, in forcing periods.
        shifts: projection onto the shifts that the equations leave free, see `rigid_modes.py`, (n, n).
        drift: projection onto the shifts by which a cycle may come back displaced, (n, n); None without friction.
        is_autonomous: true where no load sets the period. The cycle begins right after its last event, so that the flight
            that closes it has no duration: the durations of the others add up to the period, and the start has no phase to
            choose. `num_periods` is unused.
    """

    machine: Machine
    flow: AbstractFlow
    sequence: Sequence
    num_periods: Scalar
    phase: Scalar
    shifts: Float[Array, "n n"]
    drift: Any = None
    is_autonomous: bool = eqx.field(static=True, default=False)

    def length(self, unknowns: Unknowns) -> Scalar:
        """Period of a cycle, in forcing periods or, without forcing, in units of time."""
        return jnp.sum(unknowns.flights) if self.is_autonomous else self.num_periods

    def rest_of_period(self, time: Scalar) -> Scalar:
        """Duration of the flight that closes the cycle, which begins at a time since phase 0."""
        return 0 * time if self.is_autonomous else self.phase + self.num_periods - time


class Moment(NamedTuple):
    """State `z`, time in forcing periods, gaps accumulated since the last contact; `grip` of the event before, see `EndOfFlight`."""

    z: Array
    time: Array
    gap: Array
    grip: Any = None


def prepared(
    numbers: MachineNumbers, flow: AbstractFlow, num_periods: Scalar
) -> tuple[Machine, AbstractFlow]:
    """The machine and its flow, prepared for a run of n periods; elements side by side are their sum."""
    numbers = summed(numbers)
    span, zeros = 2 * jnp.pi * num_periods / numbers.frequency, jnp.zeros_like(numbers.mean)
    machine = prepare(numbers, span, (0 * span, zeros, zeros), can_stick=True)
    return machine, flow.prepare(machine)


class CycleFlight(NamedTuple):
    """A flight, the event at its end, and whether it is the one after the last event, which closes the cycle."""

    event: Event
    duration: Scalar
    closes: Bool[Array, ""]


def residual(problem: Problem, unknowns: Unknowns) -> Residual:
    """Traverse the sequence once."""
    return _residual(problem, unknowns, has_moments=False)[0]


def residual_and_moments(problem: Problem, unknowns: Unknowns) -> tuple[Residual, Moment]:
    """`residual`, and the moments at which the flights begin, (events + 1, ...) each, those of padding included."""
    return _residual(problem, unknowns, has_moments=True)


def _residual(problem: Problem, unknowns: Unknowns, *, has_moments: bool) -> tuple[Residual, Any]:
    machine, flow = problem.machine, problem.flow
    place = initial_moment(problem, machine, unknowns.z)

    def one(place: Moment, flight: CycleFlight) -> tuple[Moment, tuple[tuple[Array, Array, Any], Any]]:
        duration = duration_of(problem, place, flight)
        there, (value, speed), _ = fly_to_event(machine, flow, place, flight.event, duration)
        return there, ((value, speed, there.grip), place if has_moments else None)

    place, (of_events, begins) = jax.lax.scan(one, place, flights_of(problem, unknowns))
    values, speeds, grips = jax.tree.map(lambda a: a[:-1], of_events)
    return Residual(values, closing_of(problem, place.z - unknowns.z), speeds, grips), begins


def closing_of(problem: Problem, gone: Array) -> Array:
    """Residual of the closing of a cycle, from the change of the state over it."""
    return gone if problem.drift is None else gone - of_positions(problem.drift) @ gone


def progression_of(problem: Problem, unknowns: Unknowns) -> Float[Array, " n"]:
    """Displacement over a cycle, zero where springs or contacts hold every mass."""
    if problem.drift is None:
        return jnp.zeros_like(problem.machine.mean)
    whole = eqx.tree_at(lambda own: own.drift, problem, None)
    return problem.drift @ jnp.split(residual(whole, unknowns).closing, 2)[0]


def traverse(
    problem: Problem, unknowns: Unknowns, count: Int[Array, ""] | None
) -> tuple[Moment, Float[Array, " events"]]:
    """Moments at which the flights begin, (events + 1, ...) each, and the approach speeds at the events.

    Only the first `count` events are traversed, or all if it is None, see `over_flights`.
    """
    machine, flow = problem.machine, problem.flow

    def one(place: Moment, flight: CycleFlight) -> tuple[Moment, tuple[Moment, Array]]:
        there, (_, speed), _ = fly_to_event(machine, flow, place, flight.event, flight.duration)
        return there, (place, speed)

    first = initial_moment(problem, machine, unknowns.z)
    num = None if count is None else count + 1
    _, (begins, speeds) = over_flights(one, first, flights_of(problem, unknowns, count), num)
    return begins, speeds[:-1]


def flights_of(problem: Problem, unknowns: Unknowns, count: Int[Array, ""] | None = None) -> CycleFlight:
    """All flights of a cycle; the one that closes it comes after `count` others, or after the padding."""
    sequence, room = problem.sequence, len(unknowns.flights)
    mode, zeros = jnp.asarray(sequence.mode), _zeros_of(problem)
    event = Event(
        kind=jnp.append(sequence.kind, NOTHING),
        stop=jnp.append(sequence.stop, 0),
        mode=mode,
        mode_after=jnp.concatenate([mode[1:], mode[-1:]]),
        zeros=None if zeros is None else jnp.append(zeros, 0),
    )
    return CycleFlight(
        event, jnp.append(unknowns.flights, 0), jnp.arange(room + 1) == (room if count is None else count)
    )


def duration_of(problem: Problem, place: Moment, flight: CycleFlight) -> Scalar:
    return jnp.where(flight.closes, problem.rest_of_period(place.time), flight.duration)


def log_of_cycle(problem: Problem, unknowns: Unknowns, room: int) -> EventLog:
    """Log of all events of an orbit, with room for `room` of them; differentiable.

    It comes from the equations of the cycle, which are exact where a run of an unstable orbit diverges from it.
    """
    machine, flow = problem.machine, problem.flow

    def one(place: Moment, flight: tuple[Event, Scalar]) -> tuple[Moment, tuple[Instant, Array]]:
        event, duration = flight
        there, _, end = fly_to_event(machine, flow, place, event, duration)
        return there, (instant_of(machine, end, event, there.time * machine.period), end.phase)

    flights = events_of(problem), unknowns.flights
    instants, phases = jax.lax.scan(one, initial_moment(problem, machine, unknowns.z), flights)[1]
    return event_log(machine, instants, phases, room)


def state_at(problem: Problem, unknowns: Unknowns, time: Scalar) -> Float[Array, " state"]:
    """State of a cycle `time` forcing periods after its start and after all events until then, in the stops' frame."""
    machine, flow = problem.machine, problem.flow
    count = jnp.sum(problem.sequence.is_event)
    until = jnp.cumsum(unknowns.flights)

    def one(carry: tuple[Moment, Array], flight: tuple[Event, Scalar, Array, Array]):
        moment, mode = carry
        event, duration, ends, is_event = flight
        there = fly_to_event(machine, flow, moment, event, duration)[0]
        is_passed = is_event & (ends <= time)
        moment = jax.tree.map(lambda a, b: jnp.where(is_passed, a, b), there, moment)
        return (moment, jnp.where(is_passed, event.mode_after, mode)), None

    flights = events_of(problem), unknowns.flights, until, jnp.arange(len(until)) < count
    begin = initial_moment(problem, machine, unknowns.z), jnp.asarray(problem.sequence.mode)[0]
    (moment, mode), _ = jax.lax.scan(one, begin, flights)
    x, v, *_ = flow_map(machine, flow, moment, mode, problem.phase + time - moment.time)
    return jnp.concatenate([machine.moved(jnp.split(moment.z, 2)[0], x), v])


def moved_by(tree: Any, change: Any, by: Scalar) -> Any:
    """The tree with `by` times its change added to every number that has one."""
    return jax.tree.map(lambda a, da: a if da is None else a + by * da, tree, change)


def initial_moment(problem: Problem, machine: Machine, z: Array) -> Moment:
    x, v = jnp.split(z, 2)
    held, contacts = held_in(problem.sequence.mode[0]), machine.contacts
    phase = phase_of(machine, problem.phase)
    x = contacts.with_closed_gaps(x, held & contacts.has_gap, phase)
    v = contacts.without_speeds(v, held, machine.phase_rate(phase))
    v = with_stretches_of(machine, v, problem.sequence.mode[0])
    gap = jax.lax.stop_gradient(contacts.gaps(x, phase))
    grip = -jnp.ones_like(gap) if machine.has_tied_friction else None
    return Moment(jnp.concatenate([x, v]), problem.phase + 0 * x[0], gap, grip)


def events_of(problem: Problem) -> Event:
    sequence = problem.sequence
    return Event(sequence.kind, sequence.stop, sequence.mode[:-1], sequence.mode[1:], _zeros_of(problem))


def _zeros_of(problem: Problem) -> Array | None:
    """`leading_zeros_of` the events; None if all contacts are rigid."""
    contacts = problem.machine.contacts
    if set(contacts.kinds) <= {RIGID}:
        return None
    return leading_zeros_of(problem.sequence, contacts.num_sliders)


def fly_to_event(
    machine: Machine, flow: AbstractFlow, place: Moment, event: Event, duration: Scalar
) -> tuple[Moment, tuple[Array, Array], State]:
    """Moment after a flight and its event; value that vanishes, and approach speed; state at the end of the flight."""
    contacts, before = machine.contacts, jnp.split(place.z, 2)[0]
    x, v, phase, change = flow_map(machine, flow, place, event.mode, duration)
    # Accumulated since the last contact, which keeps all digits of a light bounce; derivatives are the position's.
    start = contacts.gaps(before, phase - change)
    gap = contacts.gap_after(place.gap + start - jax.lax.stop_gradient(start), False, x, change)
    x = machine.moved(before, x)
    time = place.time + duration
    end = state_in_mode(machine, phase, x, v, event.mode, time * machine.period)
    after = end_of_flight(machine, end, gap, event)
    value = jnp.where(event.kind == NOTHING, duration, _regular(after.value, event, duration))
    z, gap = jnp.concatenate([after.x, after.v]), jax.lax.stop_gradient(after.gap)
    return Moment(z, time, gap, after.grip), (value, after.speed), end


def _regular(value: Scalar, event: Event, duration: Scalar) -> Scalar:
    """Value of a guard, divided by the duration of its flight as often as `leading_zeros_of` tells."""
    if event.zeros is None:
        return value
    divisor = jnp.where(event.zeros > 0, jnp.where(jnp.abs(duration) < MOMENT, MOMENT, duration), 1)
    return value / jnp.where(event.zeros == 2, divisor * divisor, divisor)


def state_in_mode(
    machine: Machine, phase: Array, x: Array, v: Array, mode: Array, time: Scalar | None = None
) -> State:
    """State in a mode of `Sequence`, with no contact just left."""
    state = state_before_contact(machine, phase, x, v, held_in(mode), time)
    return in_laws(machine, state, mode)


def flow_map(
    machine: Machine, flow: AbstractFlow, place: Moment, mode: Array, duration: Scalar
) -> tuple[Array, Array, Array, Array]:
    """Displacement over a flight in a mode, velocity and phase at its end, and the change of the phase."""
    if machine.tables is not None:
        return _flow_map_across_knots(machine, flow, place, mode, duration)
    num_harmonics = machine.waves.num_harmonics
    phase, angle = phase_at(2 * jnp.pi * place.time, num_harmonics), 2 * jnp.pi * duration
    half = phase_at(angle / 2, num_harmonics)[1]
    turn, slide = -2 * half**2, phase_at(angle, num_harmonics)[1]
    change = turned(phase, jnp.stack([turn, slide]))
    x, v = jnp.split(place.z, 2)
    state = state_in_mode(machine, phase, x, v, mode, place.time * machine.period)
    machine = machine.in_mode(state)
    hold = machine.hold(state.held)
    displacement, gain = flow.flow_map(machine, state, hold, duration * machine.period, change)
    return displacement, v + gain, phase + change, change


def _flow_map_across_knots(
    machine: Machine, flow: AbstractFlow, place: Moment, mode: Array, duration: Scalar
) -> tuple[Array, Array, Array, Array]:
    """`flow_map` under loads by tables."""
    phase, (x, v), time = phase_of(machine, place.time), jnp.split(place.z, 2), place.time * machine.period
    state = state_in_mode(machine, phase, x, v, mode, time)
    machine = machine.in_mode(state)
    hold = machine.hold(state.held)
    displacement, gain, end = flow_map_across_knots(
        flow, machine, state, hold, duration * machine.period, time
    )
    return displacement, v + gain, end, end - phase


def phase_of(machine: Machine, time: Scalar) -> Array:
    """Phase of the load at a time in forcing periods since phase 0."""
    phase = phase_at(2 * jnp.pi * time, machine.waves.num_harmonics)
    return phase if machine.tables is None else machine.with_tables_at(phase, time * machine.period)
