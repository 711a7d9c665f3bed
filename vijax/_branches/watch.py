"""What happens between the events of a cycle: how near masses come to their stops, how lightly they rest on them."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._flow.interface import AbstractFlow
from .._machine.derivatives import approaches, contact_forces, derivatives
from .._machine.machine import Machine, resting_state
from .._orbits.cycle import Moment, Problem, Unknowns, begin_cycle, events_of, fly, leap
from .._types import Scalar
from .._xla import is_any

# Samples per radian of the fastest part of the motion, the most on a flight, and what it takes from there to the
# minimum by Newton's method.
_DENSITY, _MOST, _STEPS = 1.3, 10_000, 4


class Watched(NamedTuple):
    """The least gap while free and the least force while held, of each stop.

    Attributes:
        gap: where a mass turns back from its stop without touching it, negative where it is beyond, (stops,);
            infinite if it never does.
        gap_time: when, in forcing periods since the start, (stops,).
        gap_flight: on which flight, (stops,).
        force: on each stop that holds, (stops,); infinite if it never does.
        force_time: when, (stops,).
        force_flight: on which flight, (stops,).
        last: the duration of the flight after the last event, in forcing periods.
    """

    gap: Float[Array, " stops"]
    gap_time: Float[Array, " stops"]
    gap_flight: Int[Array, " stops"]
    force: Float[Array, " stops"]
    force_time: Float[Array, " stops"]
    force_flight: Int[Array, " stops"]
    last: Scalar


class _Reading(NamedTuple):
    """Gaps, speeds of approach and their rates, forces, their rates and curvatures, (stops,) each."""

    gap: Array
    speed: Array
    speed_rate: Array
    force: Array
    force_rate: Array
    force_curvature: Array


class _Lowest(NamedTuple):
    """The lowest minimum so far, of each stop: its value, and where it is.

    Attributes:
        value: of the minimum.
        since: the time since the last event.
        held: the stops that hold, (stops, stops).
        z: the state after the last event, (stops, 2 n).
        start: the time of that event.
        flight: number of the flight.
    """

    value: Array
    since: Array
    held: Array
    z: Array
    start: Array
    flight: Array

    def lowered(self, is_minimum: Array, other: "_Lowest") -> "_Lowest":
        """The lower of two, where the other is a minimum."""
        is_lower = is_minimum & (other.value < self.value)
        return _Lowest(
            *(
                jnp.where(is_lower if a.ndim == 1 else is_lower[:, None], b, a)
                for a, b in zip(self, other, strict=True)
            )
        )


class _Scan(NamedTuple):
    """Where the search is: the flight, the sample on it, where that flight began, the last reading."""

    flight: Array
    sample: Array
    begin: Moment
    before: _Reading
    gaps: _Lowest
    forces: _Lowest


def watch(problem: Problem, unknowns: Unknowns) -> Watched:
    """Look closely at a cycle between its events."""
    machine, flow, sequence = problem.machine, problem.flow, problem.sequence
    count, room = jnp.sum(sequence.is_event), len(sequence.kind)
    radians = machine.rate * machine.period
    flights = jnp.append(unknowns.flights, 0).at[count].set(problem.num_periods - jnp.sum(unknowns.flights))
    events = jax.tree.map(lambda a: jnp.concatenate([a, a[-1:]]) if room else None, events_of(sequence))

    def one(scan: _Scan) -> _Scan:
        k, i, begin, before = scan[:4]
        held, duration = sequence.held[k], flights[k]
        longest = jnp.clip(duration, 0, problem.num_periods)
        # A parameter tried in vain may make any machine, as one without a load, whose period is without end.
        num = jnp.minimum(jnp.ceil(longest * radians * _DENSITY) + 1, _MOST)
        step, since = duration / num, duration * i / num
        now = _read(machine, flow, begin, held, since)
        is_first, is_last = i == 0, ~(i < num)  # no end of a flight that is no number
        # A gap is least where a mass turns back; a force likewise, or where a stick begins.
        turns = ~is_first & ~held & (before.speed > 0) & (now.speed <= 0)
        part = before.speed / jnp.where(turns, before.speed - now.speed, 1)
        dip = before.gap - step * machine.period * part * before.speed / 2
        gaps = scan.gaps.lowered(turns, _lowest(dip, since - step * (1 - part), held, begin, k))
        lifts = held & (is_first | ((before.force_rate < 0) & (now.force_rate >= 0)))
        slopes = before.force_rate - now.force_rate
        part = jnp.where(is_first | (slopes == 0), 1, before.force_rate / jnp.where(slopes == 0, 1, slopes))
        least = jnp.where(is_first, now.force, jnp.minimum(before.force, now.force))
        forces = scan.forces.lowered(lifts, _lowest(least, since - step * (1 - part), held, begin, k))
        if room:
            event = jax.tree.map(lambda a: a[k], events)
            after = lambda: fly(machine, flow, begin, event, duration)[0]  # noqa: E731
            there = jax.lax.cond(is_any(is_last), after, lambda: begin)
            begin = jax.tree.map(lambda a, b: jnp.where(is_last, a, b), there, begin)
        return _Scan(jnp.where(is_last, k + 1, k), jnp.where(is_last, 0, i + 1), begin, now, gaps, forces)

    begin = begin_cycle(problem, machine, unknowns.z)
    none = jnp.full(machine.contacts.num, jnp.inf)
    nothing = _lowest(none, 0 * begin.time, sequence.held[0], begin, jnp.array(0))
    first = _read(machine, flow, begin, sequence.held[0], 0 * begin.time)
    scan = _Scan(jnp.array(0), jnp.array(0), begin, first, nothing, nothing)
    scan = jax.lax.while_loop(lambda scan: scan.flight <= count, one, scan)
    gap, gap_time = _refined(machine, flow, scan.gaps, _of_gap)
    force, force_time = _refined(machine, flow, scan.forces, _of_force)
    return Watched(
        gap=gap,
        gap_time=gap_time - problem.phase,
        gap_flight=scan.gaps.flight,
        force=force,
        force_time=force_time - problem.phase,
        force_flight=scan.forces.flight,
        last=flights[count],
    )


def _lowest(value: Array, since: Array, held: Array, begin: Moment, flight: Array) -> _Lowest:
    """A minimum of each stop on one flight."""
    rows = lambda a: jnp.broadcast_to(a, (len(value), *a.shape))  # noqa: E731
    since = jnp.broadcast_to(since, value.shape)
    return _Lowest(value, since, rows(held), rows(begin.z), rows(begin.time), rows(flight))


def _of_gap(reading: _Reading) -> tuple[Array, Array, Array]:
    return reading.gap, reading.speed, reading.speed_rate


def _of_force(reading: _Reading) -> tuple[Array, Array, Array]:
    return reading.force, reading.force_rate, reading.force_curvature


def _refined(
    machine: Machine, flow: AbstractFlow, lowest: _Lowest, of: Callable[[_Reading], tuple]
) -> tuple[Array, Array]:
    """Values and times of the minima by Newton's method on the slope; what is no minimum stays as it was read."""

    def one(low: _Lowest, stop: Array) -> tuple[Array, Array]:
        begin = Moment(low.z, low.start, jnp.zeros_like(lowest.value))

        def nearer(_: Array, since: Array) -> Array:
            _, slope, rate = (a[stop] for a in of(_read(machine, flow, begin, low.held, since)))
            return since - jnp.where(rate == 0, 0, slope / jnp.where(rate == 0, 1, rate)) / machine.period

        since = jax.lax.fori_loop(0, _STEPS, nearer, low.since)
        value = of(_read(machine, flow, begin, low.held, since))[0][stop]
        is_near = jnp.abs(since - low.since) * machine.rate * machine.period < 1 / _DENSITY
        is_minimum = jnp.isfinite(low.value) & (low.since > 0) & is_near
        since = jnp.where(is_minimum, since, low.since)
        return jnp.where(is_minimum, value, low.value), low.start + since

    is_found = is_any(jnp.isfinite(lowest.value))
    refined = lambda: jax.vmap(one)(lowest, jnp.arange(len(lowest.value)))  # noqa: E731
    return jax.lax.cond(is_found, refined, lambda: (lowest.value, lowest.start + lowest.since))


def _read(machine: Machine, flow: AbstractFlow, begin: Moment, held: Array, since: Array) -> _Reading:
    """The motion some forcing periods after the last event."""
    x, v, phase, _ = leap(machine, flow, begin, held, since)
    x, time = jnp.split(begin.z, 2)[0] + x, (begin.time + since) * machine.period
    state = resting_state(machine, phase, x, v, held, time)
    hold = machine.hold(held)
    now = derivatives(machine, state, hold)
    speed, speed_rate, _ = approaches(machine, state, now)
    gap = machine.contacts.gaps(state.x, phase)
    return _Reading(gap, speed, speed_rate, *contact_forces(machine, state, hold, now))
