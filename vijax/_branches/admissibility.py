"""Admissibility of a cycle between its events: least gaps of free masses, least contact forces of held ones."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._hybrid.guards import select_active
from .._hybrid.limits import FORCE, GAP, IMPACT
from .._jax.arrays import Scalar
from .._jax.xla import in_lanes_of, is_any
from .._machine.derivatives import derivatives
from .._machine.machine import Machine
from .._machine.state import KEPT, STICKING
from .._orbits.cycle import Moment, Problem, Unknowns, flow_map, state_in_mode, traverse
from .._orbits.sequence import NOTHING, Sequence as CycleEvents, effective, held_in
from .minima import dip

# `_DENSITY`: samples per radian of the fastest part of the motion.
# `_MOST`: largest number of samples on a flight.
# `_STEPS`: Newton steps from a sampled minimum to the minimum.
_DENSITY, _MOST, _STEPS = 0.7, 10_000, 6
# `_OF_GAP`, `_OF_FORCE`: number of time derivatives of gaps and of contact forces in a reading, the value included; of
# machines with friction or compliant contacts as many of all guards as of forces.
_OF_GAP, _OF_FORCE = 4, 3


class LeastMargins(NamedTuple):
    """Least gap of each stop while its mass is free, least contact force while the stop holds.

    Of machines with friction or compliant contacts the least value of each guard instead, (guards,), see `guards_of`: as
    `gap` while its element does not hold, as `force` while it does.

    Attributes:
        gap: lowest minimum of the gap, where a mass turns back without impact, negative beyond the stop, (stops,);
            infinite if there is none.
        gap_time: its time, in forcing periods since the start, (stops,).
        gap_flight: the number of its flight, (stops,).
        force: least contact force, (stops,); infinite if the stop never holds.
        force_time: its time, in forcing periods since the start, (stops,).
        force_flight: the number of its flight, (stops,).
        rise: least acceleration away from each stop after an impact without rebound (restitution 0) that leaves its
            mass free, (stops,); infinite if there is none.
        rise_flight: the number of the flight that this impact begins, (stops,).
        is_plastic: whether impacts have no rebound, (stops,).
        last: duration of the flight after the last event, in forcing periods.
    """

    gap: Float[Array, " stops"]
    gap_time: Float[Array, " stops"]
    gap_flight: Int[Array, " stops"]
    force: Float[Array, " stops"]
    force_time: Float[Array, " stops"]
    force_flight: Int[Array, " stops"]
    rise: Float[Array, " stops"]
    rise_flight: Int[Array, " stops"]
    is_plastic: Bool[Array, " stops"]
    last: Scalar


class Margins(NamedTuple):
    """Quantities that stay positive on an admissible cycle: approach speeds, and gap, force, rise of `LeastMargins`."""

    speeds: Float[Array, " events"]
    gap: Float[Array, " stops"]
    force: Float[Array, " stops"]
    rise: Float[Array, " stops"]


class _GapsAndForces(NamedTuple):
    """Gaps with three time derivatives, contact forces with two, (stops,) each; time in forcing periods."""

    gap: list[Array]
    force: list[Array]


class _Minima(NamedTuple):
    """Lowest minimum of each stop found so far.

    Attributes:
        value: value at the minimum.
        since: time of the minimum since the beginning of its flight, and the two ends of its bracket, (stops, 3).
        mode: mode of this flight, see `Sequence`, (stops, stops).
        z: state at the beginning of this flight, (stops, 2 n).
        start: time of this beginning.
        flight: number of this flight.
    """

    value: Array
    since: Array
    mode: Array
    z: Array
    start: Array
    flight: Array

    def lowered(self, is_minimum: Array, other: "_Minima") -> "_Minima":
        """Lower minimum of both for each stop; the other counts where `is_minimum`."""
        is_lower = is_minimum & (other.value < self.value)
        return _Minima(
            *(
                jnp.where(is_lower if a.ndim == 1 else is_lower[:, None], b, a)
                for a, b in zip(self, other, strict=True)
            )
        )


class _Scan(NamedTuple):
    """State of the scan: flight, sample on it, last reading, lowest minima so far."""

    flight: Array
    sample: Array
    before: _GapsAndForces
    gaps: _Minima
    forces: _Minima
    rises: _Minima


def margins_of_cycle(problem: Problem, unknowns: Unknowns, begins: Moment | None = None) -> LeastMargins:
    """Scan a cycle between its events for the least gap and contact force of each stop.

    Args:
        problem: the equations of the cycle.
        unknowns: the cycle.
        begins: moments at which its flights begin, see `traverse`, if they are known.
    """
    machine, flow, sequence = problem.machine, problem.flow, problem.sequence
    count, room = jnp.sum(sequence.is_event), len(sequence.kind)
    begins = traverse(problem, unknowns, count)[0] if begins is None else begins
    radians = machine.rate * machine.period
    whole = problem.length(unknowns)
    last = whole - jnp.sum(unknowns.flights)
    begins_behind = (last < 0) | problem.is_autonomous
    # The event of a negative first flight lies before the start, hence ends the last flight before the cycle ends.
    early = jnp.minimum(unknowns.flights[0], 0) if room else 0.0
    flights = jnp.append(unknowns.flights, 0).at[count].set(last + early)

    def one(scan: _Scan) -> _Scan:
        k, i, before = scan[:3]
        begin, mode, duration = _at(begins, k), jnp.asarray(sequence.mode)[k], flights[k]
        held, idle = _of_guards(machine, held_in(mode)), _idle_guards(machine, mode)
        skipped = jnp.where(k == 0, jnp.clip(-last, 0), 0)
        longest = jnp.clip(duration - skipped, 0, whole)
        # A rejected Newton iterate may have zero forcing frequency, hence an infinite period.
        num = jnp.clip(jnp.ceil(longest * radians * _DENSITY), 1, _MOST)
        step = longest / num
        since = skipped + step * i
        now = _read(machine, flow, begin, mode, since)
        is_first, is_last = i == 0, ~(i < num)  # True for NaN, which ends the scan of the flight
        # The gap is least at an interior minimum, the contact force there or where a stick begins.
        left = _of_guards(machine, _leaving_stops(sequence, k, jnp.where(begins_behind, count, 0)))
        has_left = (i == 1) & left
        gap = dip(before.gap, now.gap, step, has_left)
        force = dip(before.force, now.force, step, jnp.zeros_like(held))
        has_length = ~is_first & (longest > 0)
        turns = has_length & ~held & gap.is_there
        turns = turns if idle is None else turns & ~idle
        gaps = scan.gaps.lowered(turns, _lowest(gap.value, gap.times(since, step), mode, begin, k))
        least = jnp.where(is_first, now.force[0], force.value)
        at = jnp.where(is_first, since, force.times(since, step))
        # A release before the start of the cycle leaves a first flight of no length, on which the stop does not hold.
        is_begun = is_first & ((k > 0) | (longest > 0))
        is_least = held & (is_begun | (has_length & force.is_there))
        forces = scan.forces.lowered(is_least, _lowest(least, at, mode, begin, k))
        # After an impact without rebound gap and speed are zero: only the acceleration can separate the mass.
        rests = is_first & ~held & _of_guards(machine, _is_after_plastic(machine, sequence, k))
        rises = scan.rises.lowered(rests, _lowest(now.gap[2], since, mode, begin, k))
        return _Scan(jnp.where(is_last, k + 1, k), jnp.where(is_last, 0, i + 1), now, gaps, forces, rises)

    begin = _at(begins, 0)
    is_switching = machine.contacts.is_switching
    none = jnp.full(machine.contacts.num * (2 if is_switching else 1), jnp.inf)
    nothing = _lowest(none, 0 * begin.time, jnp.asarray(sequence.mode)[0], begin, jnp.array(0))
    unread = _GapsAndForces([0 * none] * (_OF_FORCE if is_switching else _OF_GAP), [0 * none] * _OF_FORCE)
    scan = _Scan(jnp.array(0), jnp.array(0), unread, nothing, nothing, nothing)
    scan = jax.lax.while_loop(lambda scan: scan.flight <= count, one, in_lanes_of(begin.time, scan))
    (gap, force), (gap_time, force_time) = _refined(machine, flow, scan.gaps, scan.forces)
    return LeastMargins(
        gap=gap,
        gap_time=gap_time - problem.phase,
        gap_flight=scan.gaps.flight,
        force=force,
        force_time=force_time - problem.phase,
        force_flight=scan.forces.flight,
        rise=scan.rises.value,
        rise_flight=scan.rises.flight,
        is_plastic=machine.contacts.is_plastic,
        last=last,
    )


def margins_at(problem: Problem, begins: Moment, speeds: Array, watched: LeastMargins) -> Margins:
    """Margins at the times of `watched`, to be differentiated: to first order the time of a minimum has no effect."""
    machine, flow, sequence = problem.machine, problem.flow, problem.sequence
    stops = jnp.arange(len(watched.gap))

    def read(flight: Array, time: Array) -> _GapsAndForces:
        begin = _at(begins, flight)
        since = jnp.maximum(time + problem.phase - jax.lax.stop_gradient(begin.time), 0)
        return _read(machine, flow, begin, jnp.asarray(sequence.mode)[flight], since)

    flights = jnp.concatenate([watched.gap_flight, watched.force_flight, watched.rise_flight])
    # Rises at the beginning of their flights: earlier times are clipped to it.
    times = jnp.concatenate([watched.gap_time, watched.force_time, jnp.full_like(watched.gap_time, -jnp.inf)])
    gap, force, rise = (
        jax.tree.map(lambda a: a[stops, stops], part)
        for part in _split_in_three(jax.vmap(read)(flights, times))
    )
    return Margins(speeds=speeds, gap=gap.gap[0], force=force.force[0], rise=rise.gap[2])


def _split_in_three(readings: _GapsAndForces) -> list[_GapsAndForces]:
    return [jax.tree.map(lambda a, k=k: jnp.split(a, 3)[k], readings) for k in range(3)]


def _at(begins: Moment, flight: Array | int) -> Moment:
    return jax.tree.map(lambda a: a[flight], begins)


def _leaving_stops(sequence: CycleEvents, flight: Array, passed: Array) -> Array:
    """Flags of the stops that masses leave at the beginning of a flight, (stops,).

    A contact that others kept closed is left as one that held, and so is friction that others kept at rest.
    `passed` is the number of the last event plus one if that lies beyond the end of the cycle, hence begins the first
    flight; else 0.
    """
    rests = held_in(effective(sequence.mode))
    if not len(sequence.kind):
        return jnp.zeros(rests.shape[1], bool)
    event = jnp.where(flight > 0, flight, passed) - 1
    before = jnp.maximum(event, 0)
    is_own = (jnp.arange(rests.shape[1]) == sequence.stop[before]) & (sequence.kind[before] != NOTHING)
    return (event >= 0) & ~rests[flight] & (is_own | rests[before])


def _is_after_plastic(machine: Machine, sequence: CycleEvents, flight: Array) -> Array:
    """Flag of the stop whose impact without rebound begins a flight, (stops,)."""
    if not len(sequence.kind):
        return jnp.zeros(machine.contacts.num, bool)
    before = jnp.maximum(flight - 1, 0)
    is_impact = (flight > 0) & (sequence.kind[before] == IMPACT)
    is_own = jnp.arange(machine.contacts.num) == sequence.stop[before]
    return is_impact & is_own & machine.contacts.is_plastic


def _of_guards(machine: Machine, of_stops: Array) -> Array:
    """Flags of guards from those of their contacts: one guard a contact, two where forces switch."""
    return jnp.concatenate([of_stops, of_stops]) if machine.contacts.is_switching else of_stops


def _idle_guards(machine: Machine, mode: Array) -> Array | None:
    """Flags of guards of elements that others keep at rest; None if there are none."""
    if not machine.contacts.is_switching:
        return None
    return _of_guards(machine, (mode >= KEPT) & (mode < STICKING))


def _lowest(value: Array, since: Array, mode: Array, begin: Moment, flight: Array) -> _Minima:
    """Minimum of each stop on one flight."""
    rows = lambda a: jnp.broadcast_to(a, (len(value), *a.shape))  # noqa: E731
    since = jnp.broadcast_to(since, (3, len(value))).T
    return _Minima(value, since, rows(mode), rows(begin.z), rows(begin.time), rows(flight))


def _refined(machine: Machine, flow: AbstractFlow, gaps: _Minima, forces: _Minima) -> tuple[Array, Array]:
    """Values and times of the minima, (2, stops), by Newton's method on the slope within each bracket.

    Others stay unrefined.
    """
    lowest = jax.tree.map(lambda *a: jnp.concatenate(a), gaps, forces)
    if not len(gaps.value):  # no stops
        return jnp.stack([gaps.value, forces.value]), jnp.stack([gaps.start, forces.start])

    def one(low: _Minima, row: Array) -> tuple[Array, Array]:
        begin = Moment(low.z, low.start, jnp.zeros(machine.contacts.num, gaps.value.dtype))

        def nearer(step: Array, at: tuple[Array, ...]) -> tuple[Array, ...]:
            since, lower, upper, _ = at
            reading = _read(machine, flow, begin, low.mode, since)
            value, slope, rate = (
                jnp.concatenate(own)[row] for own in zip(reading.gap[:3], reading.force[:3], strict=True)
            )
            lower, upper = jnp.where(slope < 0, since, lower), jnp.where(slope < 0, upper, since)
            newton = since - slope / jnp.where(rate > 0, rate, 1)
            is_inside = (rate > 0) & (newton >= lower) & (newton <= upper)
            following = jnp.where(is_inside, newton, (lower + upper) / 2)
            return jnp.where(step < _STEPS, following, since), lower, upper, value

        first, lower, upper = low.since
        since, lower, upper, value = jax.lax.fori_loop(
            0, _STEPS + 1, nearer, (first, lower, upper, low.value)
        )
        is_minimum = jnp.isfinite(low.value) & (low.since[1] < low.since[2])
        since = jnp.where(is_minimum, since, first)
        return jnp.where(is_minimum, value, low.value), low.start + since

    is_found = is_any(jnp.isfinite(lowest.value))
    refined = lambda: jax.vmap(one)(lowest, jnp.arange(len(lowest.value)))  # noqa: E731
    values, times = jax.lax.cond(is_found, refined, lambda: (lowest.value, lowest.start + lowest.since[:, 0]))
    return values.reshape(2, -1), times.reshape(2, -1)


def _read(machine: Machine, flow: AbstractFlow, begin: Moment, mode: Array, since: Array) -> _GapsAndForces:
    """Gaps and contact forces, or all guards, `since` forcing periods after the beginning of a flight."""
    x, v, phase, _ = flow_map(machine, flow, begin, mode, since)
    x, time = jnp.split(begin.z, 2)[0] + x, (begin.time + since) * machine.period
    state = state_in_mode(machine, phase, x, v, mode, time)
    machine, hold = machine.in_mode(state), machine.hold(state.held)
    now = derivatives(machine, state, hold)
    if machine.contacts.is_switching:
        of = lambda limit: limit.derivatives(machine, state, hold, now)[:_OF_FORCE]  # noqa: E731
        guards = [a * machine.period**order for order, a in enumerate(select_active(machine, state, of))]
        return _GapsAndForces(guards, guards)
    in_periods = lambda limit: [  # noqa: E731
        a * machine.period**order for order, a in enumerate(limit.derivatives(machine, state, hold, now))
    ]
    return _GapsAndForces(in_periods(GAP), in_periods(FORCE))
