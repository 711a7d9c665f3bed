"""Scan of cycles between their events for the least gaps and contact forces, sample by sample."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.limits import CLOSE, IMPACT, OPEN
from .._jax.arrays import Scalar
from .._jax.xla import in_lanes_of, is_any
from .._machine.state import AHEAD, BEHIND, CLOSED, FREE, INSIDE, SPRING
from .._orbits.cycle import Moment
from .._orbits.sequence import SECOND, Sequence as CycleEvents, effective, held_in, kept_in
from .._trajectory.batched import row_of_lane
from .minima import dip
from .tolerances import END_OF_FLIGHT

# `_DENSITY`: samples per radian of the fastest part of the motion. `_DENSER`: the same where readings have a derivative less:
# of several minima that is refined which is lowest between samples.
# `_MOST`: largest number of samples on a flight.
# `_STEPS`: Newton steps from a sampled minimum to the minimum.
_DENSITY, _DENSER, _MOST, _STEPS = 0.7, 1.4, 10_000, 6


# `_OF_GAP`, `OF_FORCE`: number of time derivatives of gaps and of contact forces in a reading, the value included; of
# machines with friction or compliant contacts as many of all guards as of forces.
_OF_GAP, OF_FORCE = 4, 3


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
            mass free, (stops,), or force beyond the grip of friction that is torn off; infinite if there is none.
        rise_flight: the number of the flight that this event begins, (stops,).
        is_plastic: whether impacts have no rebound, (stops,).
        last: duration of the flight after the last event, in forcing periods.
        grip: what each impact leaves of the grip of friction that it brings to rest, see `EndOfFlight`, (events, stops); None
            without friction of contacts.
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
    grip: Any = None


class GapsAndForces(NamedTuple):
    """Gaps with three time derivatives, contact forces with two, (stops,) each; time in forcing periods."""

    gap: list[Array]
    force: list[Array]


class Course(NamedTuple):
    """The flights of a cycle as a scan needs them, with lanes last if there are any.

    Attributes:
        sequence: events of the cycle.
        begins: moments at which its flights begin.
        flights: their durations, that of the flight behind the last event included, (events + 1,).
        count: number of events.
        skipped: part of the first flight before the cycle begins.
        whole: duration of the cycle.
        passed: number of the last event plus one if that lies beyond the end of the cycle, hence begins the first
            flight; else 0.
        last: duration of the flight after the last event.
        density: samples per forcing period.
        phase: phase where the cycle begins, in forcing periods.
        is_plastic: whether impacts have no rebound, (stops,).
        had: number of events that each element has had before each flight, see `elements_of_events`, (events + 1, stops).
        before: number of the last flight before each that has a length, or of the one before it: the events between them
            are at one instant, (events + 1,).
        follows: flags of the guards of elements that follow others, see `side_by_side.py`; None if there are none.
    """

    sequence: CycleEvents
    begins: Moment
    flights: Array
    count: Array
    skipped: Array
    whole: Array
    passed: Array
    last: Array
    density: Array
    phase: Array
    is_plastic: Array
    had: Array
    before: Array
    follows: Array | None = None


class _Minima(NamedTuple):
    """Lowest minimum of each stop found so far.

    Attributes:
        value: value at the minimum, (stops,).
        since: time of the minimum since the beginning of its flight, and the two ends of its bracket, (3, stops).
        flight: number of its flight, (stops,).
    """

    value: Array
    since: Array
    flight: Array

    def lowered(self, is_minimum: Array, value: Array, since: Array, flight: Array) -> "_Minima":
        """The lower one of this and of another minimum on a flight, which counts where `is_minimum`."""
        is_lower = is_minimum & (value < self.value)
        return _Minima(
            jnp.where(is_lower, value, self.value),
            jnp.where(is_lower, since, self.since),
            jnp.where(is_lower, flight, self.flight),
        )


class _Scan(NamedTuple):
    """State of the scan: flight, sample on it, last reading, lowest minima so far."""

    flight: Array
    sample: Array
    before: GapsAndForces
    gaps: _Minima
    forces: _Minima
    rises: _Minima


# From the beginning of a flight, its mode and the time since then, in forcing periods, to gaps and forces.
Reading = Callable[[Moment, Array, Array], GapsAndForces]


def density_of(sequence: CycleEvents) -> float:
    """Samples per radian of the fastest part of the motion."""
    return _DENSITY if sequence.num_groups == 1 else _DENSER


def least_margins(course: Course, reading: Reading) -> LeastMargins:
    """Scan cycles between their events, of one or of many with lanes last."""
    nothing, unread = _before_the_scan(course)
    first = 0 * course.count
    scan = _Scan(first, first, unread, nothing, nothing, nothing)
    is_on = lambda scan: jnp.any(scan.flight <= course.count)  # noqa: E731
    one = partial(_next_sample, course, reading)
    scan = jax.lax.while_loop(is_on, one, in_lanes_of(course.begins.time, scan))
    (gap, force), (gap_time, force_time) = _refined(course, reading, scan.gaps, scan.forces)
    return LeastMargins(
        gap=gap,
        gap_time=gap_time - course.phase,
        gap_flight=scan.gaps.flight,
        force=force,
        force_time=force_time - course.phase,
        force_flight=scan.forces.flight,
        rise=scan.rises.value,
        rise_flight=scan.rises.flight,
        is_plastic=course.is_plastic,
        last=course.last,
    )


def _next_sample(course: Course, reading: Reading, scan: _Scan) -> _Scan:
    """The scan behind its next sample."""
    sequence, count = course.sequence, course.count
    k, i, before = scan[:3]
    is_on, k = k <= count, jnp.minimum(k, count)
    begin, mode = of_flight((course.begins, sequence.mode), k)
    held, idle = sequence.for_guards(held_in(mode)), kept_in(mode)
    idle = None if idle is None else sequence.for_guards(idle)
    skipped, longest = limits_of_flight(course, k)
    # A rejected Newton iterate may have zero forcing frequency, hence an infinite period.
    num = jnp.clip(jnp.ceil(longest * course.density), 1, _MOST)
    step = longest / num
    since = skipped + step * i
    now = reading(begin, mode, since)
    is_first, is_last = i == 0, ~(i < num)  # True for NaN, which ends the scan of the flight
    # The gap is least at an interior minimum, the contact force there or where a stick begins.
    left = sequence.for_guards(_leaving_stops(course, k))
    gap = dip(before.gap, now.gap, step, (i == 1) & left)
    has_length = is_on & ~is_first & (longest > END_OF_FLIGHT * course.whole)
    turns = has_length & ~held & gap.is_there
    turns = turns if idle is None else turns & ~idle
    gaps = scan.gaps.lowered(turns, gap.value, gap.times(since, step), k)
    # A release before the start of the cycle leaves a first flight of no length, on which the stop does not hold; between events
    # of one instant it ceases to. Elements that keep each other at rest take over each other's load on a flight, whose mode is
    # that at its end. A follower has no load to hand over.
    keeps = idle if idle is None or course.follows is None else idle & ~course.follows
    is_begun = is_on & is_first & (longest > END_OF_FLIGHT * course.whole)

    def of_held() -> _Minima:
        force = dip(before.force, now.force, step, jnp.zeros_like(held))
        least = jnp.where(is_first, now.force[0], force.value)
        at = jnp.where(is_first, since, force.times(since, step))
        counts = (
            is_begun if keeps is None else is_begun & ~(jnp.any(keeps, axis=0, keepdims=True) & (least < 0))
        )
        is_least = held & (counts | (has_length & force.is_there))
        return scan.forces.lowered(is_least, least, at, k)

    forces = jax.lax.cond(is_any(held), of_held, lambda: scan.forces)
    if sequence.num_groups > 1:  # a contact with one guard has no event at which that is not zero
        gaps, forces = _with_cut_guards(course, k, (before, now), is_on & is_first, (gaps, forces))
    # After an impact without rebound gap and speed are zero: only the acceleration can separate the mass, unless others keep it.
    # A rigid stop has no guard in the second group, whose margins would be zero.
    rests = is_on & is_first & ~held & sequence.for_first_guards(_is_after_plastic(course, k))
    rests = rests if idle is None else rests & ~idle
    rises = scan.rises.lowered(rests, now.gap[2], since, k)
    following, sample = jnp.where(is_last, k + 1, k), jnp.where(is_last, 0, i + 1)
    return _Scan(jnp.where(is_on, following, scan.flight), sample, now, gaps, forces, rises)


def _with_cut_guards(
    course: Course,
    k: Array,
    readings: tuple[GapsAndForces, GapsAndForces],
    is_first: Array,
    minima: tuple[_Minima, _Minima],
) -> tuple[_Minima, _Minima]:
    """The minima of guards with those at the event before flight `k`, where another event cuts a flight off.

    The sliding velocity may fall before an impact, or rise behind it. Where a compliant contact opens by one guard, or closes
    again before it is left, the other one may fall, and so may those of an element at rest that the event of another sets
    free. `readings` are those just before the event and just behind it; `minima` those of elements that do not hold, and of
    those that do.
    """
    sequence, last, (before, now), (gaps, forces) = course.sequence, jnp.maximum(k - 1, 0), readings, minima
    if not len(sequence.kind):
        return minima
    kind, duration = of_flight((sequence.kind, course.flights), last)
    is_own = _have_had(course, last, k)
    # Between events of one instant not all that they change has changed.
    least = END_OF_FLIGHT * course.whole
    is_cut, is_behind = (is_first & (k > 0) & (a > least) for a in (duration, of_flight(course.flights, k)))
    mode, following = (of_flight(sequence.mode, flight) for flight in (last, k))
    slides_in = lambda mode: sequence.for_guards((mode == AHEAD) | (mode == BEHIND))  # noqa: E731
    is_jump = is_begin = is_end = kind == IMPACT
    if course.begins.grip is not None:  # friction of a contact begins and ends with that
        is_begin, is_end = (is_jump | sequence.for_guards(a == FREE) for a in (mode, following))
        # Behind an impact in which it stops it begins at no velocity.
        is_begin = is_begin & ~sequence.for_guards(of_flight(course.begins.grip, k) > 0)
    slid, slides = slides_in(mode) & is_end, slides_in(following) & is_begin
    opens, closes = is_own & (mode == CLOSED), is_own & (mode == INSIDE) & (kind == CLOSE + SECOND)
    falls = slid | jnp.concatenate([opens & (kind == OPEN + SECOND) | closes, opens & (kind == OPEN)])
    at = lambda time: jnp.broadcast_to(time, gaps.since.shape)  # noqa: E731
    gaps = gaps.lowered(is_cut & falls & (before.gap[1] < 0), before.gap[0], at(duration), last)
    freed = held_in(mode) & ~held_in(effective(following)) & ~is_own
    freed = sequence.for_guards(freed) & (before.force[1] < 0)
    forces = forces.lowered(is_cut & freed, before.force[0], at(duration), last)
    return gaps.lowered(is_behind & slides & (now.gap[1] > 0), now.gap[0], at(0 * duration), k), forces


def _before_the_scan(course: Course) -> tuple[_Minima, GapsAndForces]:
    """No minimum, and no reading."""
    none = jnp.zeros(course.sequence.for_guards(course.is_plastic).shape, course.whole.dtype)
    nothing = _Minima(none + jnp.inf, jnp.stack([none] * 3), jnp.zeros(none.shape, course.count.dtype))
    num = _OF_GAP if course.sequence.num_groups == 1 else OF_FORCE
    return nothing, GapsAndForces([none] * num, [none] * OF_FORCE)


def of_flight(rows: Any, flight: Array) -> Any:
    """Rows of a flight, of one cycle or of many with lanes last."""
    return jax.tree.map(lambda a: row_of_lane(jnp.asarray(a), flight), rows)


def limits_of_flight(course: Course, flight: Array) -> tuple[Array, Array]:
    """Time from which on a flight belongs to the cycle, and for how long."""
    skipped = jnp.where(flight == 0, course.skipped, 0)
    return skipped, jnp.clip(of_flight(course.flights, flight) - skipped, 0, course.whole)


def _leaving_stops(course: Course, flight: Array) -> Array:
    """Flags of the stops that masses leave at the beginning of a flight, (stops,).

    A contact that others kept closed is left as one that held, and so is friction that others kept at rest.
    """
    sequence = course.sequence
    rests = held_in(effective(sequence.mode))
    if not len(sequence.kind):
        return jnp.zeros(rests.shape[1:], bool)
    event = jnp.where(flight > 0, flight, course.passed) - 1
    before = jnp.where(flight > 0, of_flight(course.before, flight), jnp.maximum(event, 0))
    is_own = _have_had(course, before, event + 1)
    rested = of_flight(rests, before)
    if sequence.num_groups > 1:  # a slider leaves its limit beside another one too, whose event is both
        at, after = (of_flight(sequence.mode, one) for one in (before, jnp.maximum(event, 0) + 1))
        is_own = is_own | ((at == AHEAD) | (at == BEHIND)) & (after == SPRING)
    return (event >= 0) & ~of_flight(rests, flight) & (is_own | rested)


def _is_after_plastic(course: Course, flight: Array) -> Array:
    """Flag of the stop whose impact without rebound begins a flight, (stops,)."""
    sequence, is_plastic = course.sequence, course.is_plastic
    if not len(sequence.kind):
        return jnp.zeros(is_plastic.shape, bool)
    last = jnp.maximum(flight - 1, 0)
    is_own = _have_had(course, last, flight)
    return (flight > 0) & (of_flight(sequence.kind, last) == IMPACT) & is_own & is_plastic


def _have_had(course: Course, first: Array, last: Array) -> Array:
    """Flags of the elements that have an event between two flights, (stops,)."""
    return of_flight(course.had, last) > of_flight(course.had, first)


def _refined(course: Course, reading: Reading, gaps: _Minima, forces: _Minima) -> tuple[Array, Array]:
    """Values and times of the minima, (2, stops), by Newton's method on the slope within each bracket.

    Others stay unrefined.
    """
    num = len(gaps.value)
    if not num:  # no stops
        return jnp.stack([gaps.value, forces.value]), jnp.stack([gaps.value, forces.value])
    values, flights = (jnp.stack([getattr(a, name) for a in (gaps, forces)]) for name in ("value", "flight"))
    values, flights = (a.reshape(2 * num, *a.shape[2:]) for a in (values, flights))
    sinces = jnp.concatenate([gaps.since, forces.since], axis=1)
    starts = jax.vmap(lambda flight: of_flight(course.begins.time, flight))(flights)

    def one(row: Array, value: Array, flight: Array, since: Array) -> tuple[Array, Array]:
        begin, mode = of_flight((course.begins, course.sequence.mode), flight)

        def nearer(step: Array, at: tuple[Array, ...]) -> tuple[Array, ...]:
            since, lower, upper, _ = at
            found = reading(begin, mode, since)
            value, slope, rate = (
                jnp.concatenate(own)[row] for own in zip(found.gap[:3], found.force[:3], strict=True)
            )
            lower, upper = jnp.where(slope < 0, since, lower), jnp.where(slope < 0, upper, since)
            newton = since - slope / jnp.where(rate > 0, rate, 1)
            is_inside = (rate > 0) & (newton >= lower) & (newton <= upper)
            following = jnp.where(is_inside, newton, (lower + upper) / 2)
            return jnp.where(step < _STEPS, following, since), lower, upper, value

        first, lower, upper = since
        found, *_, least = jax.lax.fori_loop(0, _STEPS + 1, nearer, (first, lower, upper, value))
        is_minimum = jnp.isfinite(value) & (lower < upper)
        return jnp.where(is_minimum, least, value), jnp.where(is_minimum, found, first)

    def refined() -> tuple[Array, Array]:
        rows = jnp.arange(2 * num), values, flights, jnp.moveaxis(sinces, 1, 0)
        if flights.ndim == 1:
            return jax.vmap(one)(*rows)
        # Readings of many cycles are vectorised over these. Mostly no stop holds in any: then no force has a minimum.
        is_any_there = lambda value: jnp.any(jnp.isfinite(value))  # noqa: E731
        as_it_is = lambda row: (row[1], row[3][0])  # noqa: E731
        of_row = lambda row: jax.lax.cond(is_any_there(row[1]), lambda row: one(*row), as_it_is, row)  # noqa: E731
        return jax.lax.map(of_row, rows)

    values, since = jax.lax.cond(is_any(jnp.isfinite(values)), refined, lambda: (values, sinces[0]))
    return tuple(a.reshape(2, num, *a.shape[1:]) for a in (values, starts + since))
