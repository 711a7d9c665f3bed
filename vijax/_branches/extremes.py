"""Largest and smallest positions and velocities of a cycle, and their rates along a branch.

An extreme lies inside a flight, where its coordinate is stationary, or at one of its ends, where an event turns it. Inside, its
time has no effect on its value to first order. At the end of a flight its time moves with the event.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._flow.interface import AbstractFlow
from .._jax.arrays import Scalar
from .._jax.xla import in_lanes_of
from .._machine.machine import Machine
from .._orbits.cycle import Moment, Problem, Unknowns, flow_map, traverse
from .._orbits.sequence import Sequence
from .admissibility import course_of
from .kernels import CycleEquations
from .margin_scan import Course, limits_of_flight, of_flight
from .parameter_family import ExtendedCycle, ParameterFamily

# Side of a flight on which an extreme lies.
BEGIN, INSIDE, END = -1, 0, 1
# Samples on a flight, as a multiple of those for gaps, and the most.
_DENSER, _MOST = 2.0, 10_000
# Halvings of the bracket of an extreme.
_HALVINGS = 52


class Extremes(NamedTuple):
    """Largest and smallest value of every position and velocity of a cycle, (2, 2 n) each.

    Attributes:
        value: in space.
        slope: its derivative along the branch.
        flight: number of its flight.
        since: its time since the beginning of the flight, in forcing periods.
        side: `BEGIN`, `INSIDE` or `END` of the flight.
    """

    value: Float[Array, "2 state"]
    slope: Float[Array, "2 state"]
    flight: Int[Array, "2 state"]
    since: Float[Array, "2 state"]
    side: Int[Array, "2 state"]


def state_on_flight(
    machine: Machine, flow: AbstractFlow, begin: Moment, mode: Array, since: Scalar
) -> Float[Array, " state"]:
    """State in space, some forcing periods after the beginning of a flight."""
    x, v, phase, _ = flow_map(machine, flow, begin, mode, since)
    of_frame = jnp.concatenate(machine.relative_to_stops(phase, 0 * x, 0 * v))
    return jnp.concatenate([machine.moved(jnp.split(begin.z, 2)[0], x), v]) - of_frame


def extremes_of_cycle(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, direction: ExtendedCycle
) -> Extremes:
    """Extremes of a cycle, and their rates in a direction, the tangent of a branch."""
    # Of two parameters the branch is along the first.
    place, direction, whole = _first_alone(place), _first_alone(direction), place.p
    equations = CycleEquations(*family.linear_problem(sequence, whole), place.p)
    count = jnp.sum(sequence.is_event)

    def moments_at(at: ExtendedCycle) -> Moment:
        return traverse(equations.at(at.p), family.unknowns(at), count)[0]

    begins, moved = jax.jvp(moments_at, (place,), (direction,))
    course = course_of(equations.problem, family.unknowns(place), begins)
    found = _refined(equations.problem, course, _sampled(equations.problem, course))
    # The flight that closes the cycle lasts as long as the others leave.
    rest = jnp.zeros_like(place.p) if family.is_autonomous else -jnp.sum(direction.flights)
    lasts = jnp.append(direction.flights, rest).at[count].set(rest)

    def value_at(begins: Moment, p: Scalar, flight: Array, since: Array) -> Array:
        problem = equations.at(p)
        begin, mode = of_flight((begins, sequence.mode), flight)
        return state_on_flight(problem.machine, problem.flow, begin, mode, since)

    def one(flight: Array, since: Array, side: Array) -> tuple[Array, Array]:
        of_time = jnp.where(side == END, lasts[flight], 0)
        at = lambda begins, p, since: value_at(begins, p, flight, since)  # noqa: E731
        return jax.jvp(at, (begins, place.p, since), (moved, direction.p, of_time))

    values, slopes = jax.vmap(jax.vmap(one))(found.flight, found.since, found.side)
    own = jnp.arange(values.shape[1])
    return found._replace(value=values[:, own, own], slope=slopes[:, own, own])


def _first_alone(place: ExtendedCycle) -> ExtendedCycle:
    """A cycle, or a direction, with the first parameter alone."""
    return place._replace(p=jnp.ravel(place.p)[0])


class _Sampled(NamedTuple):
    """Best sample of every extreme so far: value times sign, flight, time since its beginning, and ends of its bracket."""

    value: Array
    flight: Array
    since: Array
    low: Array
    high: Array


def _sampled(problem: Problem, course: Course) -> _Sampled:
    """Best samples of the extremes, (2, 2 n) each."""
    machine, sequence, count = problem.machine, problem.sequence, course.count
    n = len(course.begins.z[0])
    signs = jnp.array([[1.0] * n, [-1.0] * n], course.whole.dtype)

    def one(state: tuple[Array, Array, _Sampled]) -> tuple[Array, Array, _Sampled]:
        k, i, best = state
        flight = jnp.minimum(k, count)
        begin, mode = of_flight((course.begins, sequence.mode), flight)
        first, longest = limits_of_flight(course, flight)
        num, step = _samples(course, longest)
        since = first + step * i
        value = signs * state_on_flight(machine, problem.flow, begin, mode, since)[None]
        # The end of a forced cycle is its beginning, and counts once.
        is_end = (k == count) & ~(i < num) & (not problem.is_autonomous)
        is_better = (value > best.value) & (k <= count) & ~is_end
        ends = jnp.maximum(since - step, first), jnp.minimum(since + step, first + longest)
        new = _Sampled(value, flight, since, *ends)
        best = jax.tree.map(lambda a, b: jnp.where(is_better, a, b), new, best)
        is_last = ~(i < num)
        return jnp.where(is_last, k + 1, k), jnp.where(is_last, 0, i + 1), best

    zero = 0 * signs
    none = _Sampled(zero - jnp.inf, zero.astype(count.dtype), zero, zero, zero)
    begun = in_lanes_of(course.begins.time, (0 * count, 0 * count, none))
    return jax.lax.while_loop(lambda state: jnp.any(state[0] <= count), one, begun)[2]


def _refined(problem: Problem, course: Course, best: _Sampled) -> Extremes:
    """The extremes near the best samples, by halving the brackets of their slopes."""
    machine, sequence, count = problem.machine, problem.sequence, course.count
    n = best.value.shape[1]
    signs = jnp.array([[1.0] * n, [-1.0] * n], course.whole.dtype)
    numbers = jnp.array([[*range(n)]] * 2)
    begin_of_last, length_of_last = limits_of_flight(course, count)
    end_of_last = begin_of_last + length_of_last
    step_of_last = _samples(course, length_of_last)[1]

    def slope_on(flight: Array, sign: Array, row: Array) -> Callable[[Array], Array]:
        begin, mode = of_flight((course.begins, sequence.mode), flight)
        state = lambda since: state_on_flight(machine, problem.flow, begin, mode, since)  # noqa: E731
        return lambda since: sign * jax.jvp(state, (since,), (jnp.ones_like(since),))[1][row]

    def one(sign: Array, row: Array, best: _Sampled) -> tuple[Array, Array, Array]:
        flight, low, high = best.flight, best.low, best.high
        # No event begins or ends the cycle itself: an extreme beside its beginning may lie before its end.
        is_first = (
            (flight == 0) & (best.since <= limits_of_flight(course, flight)[0]) & (not problem.is_autonomous)
        )
        falls = is_first & (slope_on(flight, sign, row)(low) < 0)
        flight = jnp.where(falls, count, flight)
        low, high = jnp.where(falls, end_of_last - step_of_last, low), jnp.where(falls, end_of_last, high)
        slope = slope_on(flight, sign, row)

        def halved(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            middle = (ends[0] + ends[1]) / 2
            rises = slope(middle) > 0
            return jnp.where(rises, middle, ends[0]), jnp.where(rises, ends[1], middle)

        first, longest = limits_of_flight(course, flight)
        begins_here = (flight > 0) | problem.is_autonomous
        is_begin = (low <= first) & (slope(low) <= 0) & begins_here
        is_end = (high >= first + longest) & (slope(high) >= 0) & (flight < count)
        ends = jax.lax.fori_loop(0, _HALVINGS, halved, (low, high))
        since = jnp.where(is_begin, low, jnp.where(is_end, high, (ends[0] + ends[1]) / 2))
        return flight, since, jnp.where(is_begin, BEGIN, jnp.where(is_end, END, INSIDE))

    flight, since, side = jax.vmap(jax.vmap(one))(signs, numbers, best)
    return Extremes(signs * best.value, 0 * best.value, flight, since, side)


def _samples(course: Course, longest: Array) -> tuple[Array, Array]:
    """Number of steps from sample to sample on a flight, and their length."""
    num = jnp.clip(jnp.ceil(longest * course.density * _DENSER), 2, _MOST)
    return num, longest / num


def extreme_values(
    problem: Problem, unknowns: Unknowns, flights: Array, sinces: Array, sides: Array
) -> tuple[Array, Array, Array]:
    """States at some times of a cycle, their rates by time, and the ends of their flights, (extremes, ...).

    Unlike those of `extremes_of_cycle` they have reverse derivatives. At the end of a flight its duration takes the place of
    the time.
    """
    machine, sequence = problem.machine, problem.sequence
    begins = traverse(problem, unknowns, None)[0]
    lasts = jnp.append(unknowns.flights, 0)

    def one(flight: Array, since: Array, side: Array) -> tuple[Array, Array, Array]:
        end = jnp.where(side == END, lasts[flight], 0)
        since = jnp.where(side == INSIDE, since, end)
        begin, mode = jax.tree.map(lambda a: a[flight], (begins, jnp.asarray(sequence.mode)))
        state = lambda since: state_on_flight(machine, problem.flow, begin, mode, since)  # noqa: E731
        value, rate = jax.jvp(state, (since,), (jnp.ones_like(since),))
        return value, rate, end

    return jax.vmap(one)(flights, sinces, sides)
