"""What happens between the events of a cycle: how near masses come to their stops, how lightly they rest on them."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.interpolate import BPoly

from .._flow.interface import AbstractFlow
from .._machine.derivatives import approaches, contact_forces, derivatives
from .._machine.machine import Machine, resting_state
from .._orbits.cycle import Moment, Problem, Unknowns, begin_cycle, events_of, fly, leap
from .._types import Scalar
from .._xla import is_any

# Samples per radian of the fastest part of the motion, the most on a flight, and what it takes from there to the
# minimum by Newton's method.
_DENSITY, _MOST, _STEPS = 0.7, 10_000, 4
# Where the motion between two samples is looked at. Much closer at both ends: a mass that hardly leaves its stop turns
# back soon after the impact, the sooner the more bounces there were.
_AFTER, _BEFORE = 1e-6 * 2.5 ** np.arange(15), 1 - 1e-3 * 2.5 ** np.arange(7)
_NODES = np.concatenate([[0.0], _AFTER, [0.5, 0.62], _BEFORE[::-1], [1.0]])


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
    """Gaps with three derivatives and forces with two, by time in forcing periods, (stops,) each."""

    gap: list[Array]
    force: list[Array]


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
        num = jnp.clip(jnp.ceil(longest * radians * _DENSITY), 1, _MOST)
        step, since = duration / num, duration * i / num
        now = _read(machine, flow, begin, held, since)
        is_first, is_last = i == 0, ~(i < num)  # no end of a flight that is no number
        # A gap is least where a mass turns back; a force likewise, or where a stick begins.
        gap, force = (_dip(a, b, step) for a, b in zip(before, now, strict=True))
        turns = ~is_first & ~held & gap.is_there
        gaps = scan.gaps.lowered(turns, _lowest(gap.value, since - step * (1 - gap.part), held, begin, k))
        least = jnp.where(is_first, now.force[0], force.value)
        at = since - jnp.where(is_first, 0, step * (1 - force.part))
        forces = scan.forces.lowered(held & (is_first | force.is_there), _lowest(least, at, held, begin, k))
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
    gap, gap_time = _refined(machine, flow, scan.gaps, lambda reading: reading.gap)
    force, force_time = _refined(machine, flow, scan.forces, lambda reading: reading.force)
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


class _Dip(NamedTuple):
    """The lowest minimum between two samples, of each stop: whether there is one, its value, and where, from 0 to 1."""

    is_there: Array
    value: Array
    part: Array


def _dip(before: list[Array], now: list[Array], step: Array) -> _Dip:
    """The lowest minimum of the polynomial that has the values and derivatives of two samples."""
    ends = jnp.stack([a * step**order for side in (before, now) for order, a in enumerate(side)])
    values, slopes = (jnp.asarray(m, ends.dtype) @ ends for m in _at_nodes(len(before)))
    turns = (slopes[:-1] < 0) & (slopes[1:] >= 0)
    share = slopes[:-1] / jnp.where(turns, slopes[:-1] - slopes[1:], 1)
    widths = jnp.asarray(np.diff(_NODES), ends.dtype)[:, None]
    lowest = jnp.where(turns, values[:-1] + widths * share * slopes[:-1] / 2, jnp.inf)
    parts = jnp.asarray(_NODES[:-1], ends.dtype)[:, None] + widths * share
    at = jnp.argmin(lowest, axis=0)[None]
    pick = lambda a: jnp.take_along_axis(a, at, axis=0)[0]  # noqa: E731
    return _Dip(jnp.any(turns, axis=0), pick(lowest), pick(parts))


@cache
def _at_nodes(num: int) -> tuple[np.ndarray, np.ndarray]:
    """The polynomial of `num` values and derivatives at 0 and as many at 1, and its slope, at `_NODES`, by these."""
    by_each = BPoly.from_derivatives([0.0, 1.0], np.eye(2 * num).reshape(2, num, 2 * num))
    return by_each(_NODES), by_each(_NODES, nu=1)


def _refined(
    machine: Machine, flow: AbstractFlow, lowest: _Lowest, of: Callable[[_Reading], Sequence[Array]]
) -> tuple[Array, Array]:
    """Values and times of the minima by Newton's method on the slope; what is no minimum stays as it was read."""

    def one(low: _Lowest, stop: Array) -> tuple[Array, Array]:
        begin = Moment(low.z, low.start, jnp.zeros_like(lowest.value))

        def nearer(_: Array, since: Array) -> Array:
            _, slope, rate = (a[stop] for a in of(_read(machine, flow, begin, low.held, since))[:3])
            return since - jnp.where(rate == 0, 0, slope / jnp.where(rate == 0, 1, rate))

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
    gap = [machine.contacts.gaps(state.x, phase), *(-a for a in approaches(machine, state, now))]
    in_periods = lambda parts: [a * machine.period**order for order, a in enumerate(parts)]  # noqa: E731
    return _Reading(in_periods(gap), in_periods(contact_forces(machine, state, hold, now)))
