"""Moments at which the flights of many cycles begin, and their rates along the branches, every number an array over lanes."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._jax.arrays import shapes_of_lane, shapes_of_row, with_rows_first, with_rows_last
from .._lanes.kernels import kernel_of, pruned
from .._orbits.cycle import Moment, Problem, fly_to_event, initial_moment, moved_by
from .._orbits.sequence import NOTHING, Sequence
from .batch_pass import WeightedFlight, flights_of
from .parameter_family import ExtendedCycle, ParameterFamily


class Moments(NamedTuple):
    """Moments at which the flights of cycles begin, (events + 1, ...) each, approach speeds at their ends, (events, ...)."""

    begins: Moment
    speeds: Array


def moments_of_cycles(
    families: ParameterFamily, sequences: Sequence, places: ExtendedCycle, along: ExtendedCycle
) -> tuple[Moments, Moments]:
    """Moments of many cycles and their rates along directions, along the first axis.

    Raises:
        NotImplementedError: if a law of the machine is made of what `lanes_last` does not know.
    """
    prepared = lambda family, sequence, place: family.linear_problem(sequence, place.p)  # noqa: E731
    sequence, place, way, scale = with_rows_last((sequences, places, along, families.scale))
    flights = flights_of(sequence, place.flights, way.flights)
    # Arguments of both kernels, of one cycle.
    equations = eqx.filter_eval_shape(prepared, *shapes_of_row((families, sequences, places)))
    z, p, flight = *shapes_of_row((places.z, places.p)), shapes_of_row(shapes_of_lane(flights))
    begun = eqx.filter_eval_shape(_begun, equations, z, z, p)
    begin, past = pruned(_begun, equations, z, z, p), pruned(_past_event, equations, flight, begun, p)
    picked = lambda *of: tuple(pick(prepared(*of)) for pick, _ in (begin, past))  # noqa: E731
    of_begin, of_past = jax.vmap(picked, out_axes=-1)(families, sequences, places)
    now = kernel_of(begin[1])(of_begin, place.z * scale, way.z * scale, way.p)

    def one(k: Array, state: tuple) -> tuple:
        now, before, speeds = state
        event = jax.tree.map(lambda a: a[k], flights)
        after, speed = kernel_of(past[1])(of_past, event, now, way.p)
        put = partial(jax.tree.map, lambda rows, row: rows.at[k].set(row))
        return after, put(before, now), put(speeds, speed)

    rows = lambda a: jnp.zeros((len(flights.duration), *a.shape), a.dtype)  # noqa: E731
    nothing = now, jax.tree.map(rows, now), (rows(way.p), rows(way.p))
    num = 1 + jnp.max(jnp.sum(sequences.kind != NOTHING, axis=1))
    _, (begins, rates), speeds = with_rows_first(jax.lax.fori_loop(0, num, one, nothing))
    speed, rise = (a[:, :-1] for a in speeds)  # the flight that closes a cycle has none
    return Moments(begins, speed), Moments(rates, rise)


def _begun(equations: tuple[Problem, Any], z: Array, rate: Array, along: Array) -> tuple[Moment, Moment]:
    """The moment at which a cycle begins and its rate, by those of its start in the frame of the stops."""
    problem, change = equations

    def at(z: Array, step: Array) -> Moment:
        machine, _ = moved_by((problem.machine, problem.flow), change, step)
        return initial_moment(problem, machine, z)

    return jax.jvp(at, (z, jnp.zeros_like(along)), (rate, along))


def _past_event(
    equations: tuple[Problem, Any], flight: WeightedFlight, now: tuple[Moment, Moment], along: Array
) -> tuple[tuple[Moment, Moment], tuple[Array, Array]]:
    """The moment behind the event of a flight and its rate, and the speed there and its rate; itself if there is none."""
    problem, change = equations

    def at(before: Moment, duration: Array, step: Array) -> tuple[Moment, Array]:
        machine, flow = moved_by((problem.machine, problem.flow), change, step)
        there, (_, speed), _ = fly_to_event(machine, flow, before, flight.event, duration)
        return there, speed

    given, ways = (now[0], flight.duration, jnp.zeros_like(along)), (now[1], flight.weight, along)
    (there, speed), (rate, rise) = jax.jvp(at, given, ways)
    either = partial(jax.tree.map, lambda a, b: jnp.where(flight.is_event, a, b))
    return either((there, rate), now), either((speed, rise), (0 * speed, 0 * rise))
