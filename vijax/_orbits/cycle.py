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
from .._hybrid.law import rebound
from .._hybrid.limits import IMPACT, limits_of
from .._hybrid.sticking import chatter_time
from .._hybrid.tied_friction import in_laws
from .._hybrid.transition import Instant
from .._jax.arrays import Scalar
from .._machine.derivatives import rates
from .._machine.machine import Machine, prepare, state_before_contact
from .._machine.numbers import MachineNumbers
from .._machine.state import AHEAD, BEHIND, State
from .._system.waves import phase_at, turned
from .._trajectory.event_log import EventLog, event_log
from .condensation import Flights, over_flights
from .rigid_modes import closing_pin, of_positions
from .sequence import NOTHING, Sequence, held_in
from .switching_events import leading_zeros_of, switched_end, switched_instant, with_stretches_of

# MOMENT: duration, in forcing periods, below which a flight has none when residuals are divided by it.
MOMENT = 1e-12
# Share of a row along a shift that a cycle may progress by, above which that is pinned in place of its slider.
_PINNED = 1e-9


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
        speed: of approach to the stop at each impact, 0 for other events, (events,).
        grip: that each impact leaves, see `SwitchedEnd`, (events, stops); None without friction of contacts.
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
    """State `z`, time in forcing periods, gaps accumulated since the last contact; `grip` of the event before, see `SwitchedEnd`."""

    z: Array
    time: Array
    gap: Array
    grip: Any = None


class Event(NamedTuple):
    """The event at the end of a flight, and the modes before and after it, see `Sequence`; for `zeros` `leading_zeros_of`."""

    kind: Int[Array, ""]
    stop: Int[Array, ""]
    mode: Int[Array, " stops"] | Bool[Array, " stops"]
    mode_after: Int[Array, " stops"] | Bool[Array, " stops"]
    zeros: Any = None


def prepared(
    numbers: MachineNumbers, flow: AbstractFlow, num_periods: Scalar
) -> tuple[Machine, AbstractFlow]:
    """The machine and its flow, prepared for a run of n periods."""
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
        duration = _duration(problem, place, flight)
        there, (value, speed), _ = fly_to_event(machine, flow, place, flight.event, duration)
        return there, ((value, speed, there.grip), place if has_moments else None)

    place, (of_events, begins) = jax.lax.scan(one, place, _flights_of(problem, unknowns))
    values, speeds, grips = jax.tree.map(lambda a: a[:-1], of_events)
    return Residual(values, _closing(problem, place.z - unknowns.z), speeds, grips), begins


def _closing(problem: Problem, gone: Array) -> Array:
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
    _, (begins, speeds) = over_flights(one, first, _flights_of(problem, unknowns, count), num)
    return begins, speeds[:-1]


def slider_pin(problem: Problem, scale: Float[Array, " state"]) -> Float[Array, "state state"]:
    """The matrix that adds row . dx - de of each slider that sticks all along to the closing of its stretch e.

    Such a cycle belongs to a family, one for each place of the slider, row . x - e, which comes back by itself: one closing
    follows from the others. The step of Newton's method then keeps the slider where it is, as `rigid_modes.py` says of shifts.
    """
    contacts = problem.machine.contacts
    num = contacts.num_sliders
    mode, rows = jnp.asarray(problem.sequence.mode)[:, -num:], contacts.rows[-num:]
    is_stuck = ~jnp.any((mode == AHEAD) | (mode == BEHIND), axis=0)
    if problem.drift is not None:  # a shift that sliders alone resist is pinned already
        is_stuck = is_stuck & ~jnp.any(jnp.abs(rows @ problem.drift) > _PINNED * jnp.abs(rows), axis=1)
    size = rows.shape[1]
    stretches = jnp.eye(size, dtype=scale.dtype)[-num:]
    places = jnp.concatenate([rows, -stretches], axis=1) * scale[None] / scale[-1]
    zeros = jnp.zeros_like(stretches)
    return jnp.concatenate([zeros, stretches], axis=1).T @ (is_stuck[:, None] * places)


def linearise(
    problem: Problem,
    unknowns: Unknowns,
    scale: Float[Array, " state"],
    count: Int[Array, ""] | None = None,
    change: tuple | None = None,
) -> tuple[Residual, Flights]:
    """The residual and its derivatives by the scaled unknowns, flight by flight.

    Args:
        problem: the equations of the cycle.
        unknowns: where to linearise.
        scale: sizes of positions and velocities, by which `z` is divided, (2 n,).
        count: number of flights that end with an event, see `over_flights`.
        change: derivatives of the machine and its flow by a parameter, which is then one of the unknowns.
    """
    size, p = len(scale), jnp.zeros(0 if change is None else 1, scale.dtype)

    def at(p: Array) -> tuple[Machine, AbstractFlow]:
        here = problem.machine, problem.flow
        return here if change is None else moved_by(here, change, p[0])

    def one(place: Moment, flight: CycleFlight):
        def moved(y: Array):
            here, p = place._replace(z=y[:size] * scale, time=y[size]), y[size + 1 : -1]
            there, (value, speed), _ = fly_to_event(*at(p), here, flight.event, y[-1])
            return (jnp.concatenate([there.z / scale, there.time[None], p]), value), (there, value, speed)

        duration = _duration(problem, place, flight)
        y = jnp.concatenate([place.z / scale, place.time[None], p, duration[None]])
        (forward, normal), (there, value, speed) = jax.jacfwd(moved, has_aux=True)(y)
        return there, (forward, normal, value, speed)

    def begun(y: Array):
        place = initial_moment(problem, at(y[size:])[0], y[:size] * scale)
        return jnp.concatenate([place.z / scale, place.time[None], y[size:]]), place

    begin, place = jax.jacfwd(begun, has_aux=True)(jnp.concatenate([unknowns.z / scale, p]))
    flights = _flights_of(problem, unknowns, count)
    num = None if count is None else count + 1
    place, (forward, normal, values, speeds) = over_flights(one, place, flights, num)
    # The flight that closes the cycle lasts as long as the others leave.
    last = forward[-1 if count is None else count]
    shortened = 0 if problem.is_autonomous else last[:size, -1]
    close = last[:size, :-1].at[:, size].add(-shortened)
    # Its place among the others is padding, which lanes with fewer events than another traverse.
    padding = jnp.eye(*forward.shape[1:]), jnp.eye(forward.shape[-1])[-1], jnp.zeros(())
    forward, normal, values = (
        jnp.where(flights.closes.reshape(-1, *[1] * pad.ndim), pad, a)[:-1]
        for pad, a in zip(padding, (forward, normal, values), strict=True)
    )
    found = Residual(values, _closing(problem, place.z - unknowns.z), speeds[:-1])
    drift = None if problem.drift is None else of_positions(problem.drift)
    pin = closing_pin(problem.shifts)
    if problem.machine.contacts.num_sliders:
        pin = pin + slider_pin(problem, scale)
    return found, Flights(begin, forward, normal, close, pin, drift)


def _flights_of(problem: Problem, unknowns: Unknowns, count: Int[Array, ""] | None = None) -> CycleFlight:
    """All flights of a cycle; the one that closes it comes after `count` others, or after the padding."""
    sequence, room = problem.sequence, len(unknowns.flights)
    num_sliders = problem.machine.contacts.num_sliders
    mode = jnp.asarray(sequence.mode)
    event = Event(
        kind=jnp.append(sequence.kind, NOTHING),
        stop=jnp.append(sequence.stop, 0),
        mode=mode,
        mode_after=jnp.concatenate([mode[1:], mode[-1:]]),
        zeros=jnp.append(leading_zeros_of(sequence, num_sliders), 0) if sequence.is_switching else None,
    )
    return CycleFlight(
        event, jnp.append(unknowns.flights, 0), jnp.arange(room + 1) == (room if count is None else count)
    )


def _duration(problem: Problem, place: Moment, flight: CycleFlight) -> Scalar:
    return jnp.where(flight.closes, problem.rest_of_period(place.time), flight.duration)


def log_of_cycle(problem: Problem, unknowns: Unknowns, room: int) -> EventLog:
    """Log of all events of an orbit, with room for `room` of them; differentiable.

    It comes from the equations of the cycle, which are exact where a run of an unstable orbit diverges from it.
    """
    machine, flow = problem.machine, problem.flow
    contacts = machine.contacts

    def one(place: Moment, flight: tuple[Event, Scalar]) -> tuple[Moment, tuple[Instant, Array]]:
        event, duration = flight
        there, _, end = fly_to_event(machine, flow, place, event, duration)
        if contacts.is_switching:
            of_event, time = (event.kind, event.stop), there.time * machine.period
            return there, (switched_instant(machine, end, of_event, event.mode_after, time), end.phase)
        held, after = event.mode, event.mode_after
        hit = (jnp.arange(contacts.num) == event.stop) & (event.kind == IMPACT)
        stuck, left = after & ~held, held & ~after
        x, v = rebound(machine, end, hit, held & after)
        state, hold = state_before_contact(machine, end.phase, x, v, held, end.time), machine.hold(held)
        now = rates(machine, state, hold)
        pull, speed = contacts.pull(now.force, hold, end.phase), machine.approach(state)
        chatter = jnp.where(stuck, chatter_time(jnp.abs(speed), pull, contacts.light_restitution), 0)
        instant = Instant(
            hit=hit,
            stuck=stuck,
            released=left & (event.kind != NOTHING),
            velocity_minus=machine.approach(end),
            velocity_plus=speed,
            chatter=chatter,
            arrived=jnp.array(False),
            time=there.time * machine.period,
            impulse=contacts.impulses(end.v - v),
        )
        return there, (instant, end.phase)

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
    if contacts.is_switching:
        x = contacts.with_closed_gaps(x, held & ~contacts.has_no_gap, phase)
        v = with_stretches_of(machine, contacts.without_speeds(v, held, phase), problem.sequence.mode[0])
    else:
        x = contacts.with_closed_gaps(x, held, phase)
        v = contacts.with_zero_approach(v, held, machine.phase_rate(phase))
    gap = jax.lax.stop_gradient(contacts.gaps(x, phase))
    grip = -jnp.ones_like(gap) if machine.has_tied_friction else None
    return Moment(jnp.concatenate([x, v]), problem.phase + 0 * x[0], gap, grip)


def events_of(problem: Problem) -> Event:
    sequence, num_sliders = problem.sequence, problem.machine.contacts.num_sliders
    zeros = leading_zeros_of(sequence, num_sliders) if sequence.is_switching else None
    return Event(sequence.kind, sequence.stop, sequence.mode[:-1], sequence.mode[1:], zeros)


def fly_to_event(
    machine: Machine, flow: AbstractFlow, place: Moment, event: Event, duration: Scalar
) -> tuple[Moment, tuple[Array, Array], State]:
    """Moment after a flight and its event; value that vanishes, and approach speed; state at the end of the flight."""
    contacts, before = machine.contacts, jnp.split(place.z, 2)[0]
    x, v, phase, change = flow_map(machine, flow, place, event.mode, duration)
    # Accumulated since the last contact, which keeps all digits of a light bounce; derivatives are the position's.
    start = contacts.gaps(before, phase - change)
    gap = place.gap + start - jax.lax.stop_gradient(start) - contacts.towards(x, change)
    x = machine.moved(before, x)
    time = place.time + duration
    at_event = jnp.arange(contacts.num) == event.stop
    end = state_in_mode(machine, phase, x, v, event.mode, time * machine.period)
    if contacts.is_switching:
        gap = jnp.where(contacts.has_no_gap, 1, gap)
        after = switched_end(machine, end, gap, (event.kind, event.stop), event.mode_after)
        divisor = jnp.where(event.zeros > 0, jnp.where(jnp.abs(duration) < MOMENT, MOMENT, duration), 1)
        value = after.value / jnp.where(event.zeros == 2, divisor * divisor, divisor)
        value = jnp.where(event.kind == NOTHING, duration, value)
        z, gap = jnp.concatenate([after.x, after.v]), jax.lax.stop_gradient(after.gap)
        moment = Moment(z, time, gap, after.grip)
        return moment, (value, after.speed), end
    held, held_after = event.mode, event.mode_after
    counted, hold = eqx.tree_at(lambda s: s.gap, end, gap), machine.hold(held)
    read = lambda of_stops: jnp.sum(jnp.where(at_event, of_stops, 0))  # noqa: E731
    is_impact = event.kind == IMPACT
    value = duration  # of what fills a sequence up
    for limit in limits_of(machine):
        value = jnp.where(event.kind == limit.event, read(limit.value(machine, counted, hold)), value)
    speed = jnp.where(is_impact, read(machine.approach(end)), 0)
    hit = at_event & is_impact
    placed, v = rebound(machine, end, hit, held & held_after)
    # Placing the hit contact at gap zero moves the gaps of others that share its inertia, until the cycle is found.
    counted_on = gap - contacts.along(placed - x)
    gap = jnp.where(hit, 0, jnp.where(contacts.sharing_mass(hit), contacts.gaps(placed, phase), counted_on))
    v = contacts.with_zero_approach(v, held_after, machine.phase_rate(phase))
    return Moment(jnp.concatenate([placed, v]), time, jax.lax.stop_gradient(gap)), (value, speed), end


def state_in_mode(
    machine: Machine, phase: Array, x: Array, v: Array, mode: Array, time: Scalar | None = None
) -> State:
    """State in a mode of `Sequence`, with no contact just left."""
    state = state_before_contact(machine, phase, x, v, held_in(mode), time)
    return in_laws(machine, state, mode) if machine.contacts.is_switching else state


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
