"""Margins between the events of many cycles at once: the scan of `margin_scan.py`, every number an array over lanes."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._jax.arrays import shapes_of_row, with_rows_first, with_rows_last
from .._lanes.kernels import kernel_of, pruned
from .._orbits.cycle import Moment, Problem, moved_by
from .._orbits.sequence import Sequence
from .admissibility import Margins, course_of, read, with_margins_at_events
from .batch_moments import Moments
from .margin_scan import Course, LeastMargins, least_margins, of_flight
from .parameter_family import ExtendedCycle, ParameterFamily


def margins_of_cycles(
    families: ParameterFamily, sequences: Sequence, places: ExtendedCycle, begins: Moment
) -> LeastMargins:
    """`margins_of_cycle` of many cycles, along the first axis.

    Raises:
        NotImplementedError: if a law of the machine is made of what `lanes_last` does not know.
    """
    family, sequence, place = shapes_of_row((families, sequences, places))
    problem = eqx.filter_eval_shape(lambda *of: of[0].problem(*of[1:]), family, sequence, place.p)
    begin, mode = shapes_of_row(shapes_of_row((begins, sequences.mode)))
    picked, reading = pruned(_read, problem, begin, mode, place.p)

    def prepared(
        family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, begins: Moment
    ) -> tuple[list, Course]:
        problem = family.problem(sequence, place.p)
        return picked(problem), course_of(problem, family.unknowns(place), begins)

    numbers, course = jax.vmap(prepared, out_axes=-1)(families, sequences, places, begins)
    with jax.numpy_rank_promotion("allow"):  # numbers of all lanes go with those of each
        found = with_rows_first(least_margins(course, lambda *of: kernel_of(reading)(numbers, *of)))

    def whole(
        family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, begins: Moment, found: LeastMargins
    ) -> LeastMargins:
        return with_margins_at_events(family.problem(sequence, place.p), begins, found)

    return jax.vmap(whole)(families, sequences, places, begins, found)


def rates_of_cycles(
    families: ParameterFamily,
    sequences: Sequence,
    places: ExtendedCycle,
    along: Array,
    moments: tuple[Moments, Moments],
    watched: LeastMargins,
) -> Margins:
    """Rates of the margins of many cycles along their branches, along the first axis, see `margins_at`; no force switches.

    Args:
        families: of the branches.
        sequences: of their cycles.
        places: the cycles.
        along: rate of the parameter.
        moments: of the cycles, and their rates.
        watched: their least margins.
    """
    (now, rates), stops = moments, watched.gap.shape[1]
    prepared = lambda family, sequence, place: family.linear_problem(sequence, place.p)  # noqa: E731
    begin, rate, mode = shapes_of_row(shapes_of_row((now.begins, rates.begins, sequences.mode)))
    equations = eqx.filter_eval_shape(prepared, *shapes_of_row((families, sequences, places)))
    picked, reading = pruned(_rates_of_reading, equations, begin, rate, mode, begin.time, begin.time)
    numbers = jax.vmap(lambda *of: picked(prepared(*of)), out_axes=-1)(families, sequences, places)
    begins, modes, along = with_rows_last((now.begins, sequences.mode, along))
    flights = with_rows_last(
        jnp.concatenate([watched.gap_flight, watched.force_flight, watched.rise_flight], axis=1)
    )
    times = [watched.gap_time, watched.force_time, jnp.full_like(watched.gap_time, -jnp.inf)]
    times = with_rows_last(jnp.concatenate(times, axis=1) + families.phase[:, None])

    def one(row: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        flight, time = row
        begin, rate, mode = of_flight((begins, with_rows_last(rates.begins), modes), flight)
        # Rises are those at the beginning of their flights: earlier times are clipped to it.
        return kernel_of(reading)(numbers, begin, rate, mode, jnp.maximum(time - begin.time, 0), along)

    with jax.numpy_rank_promotion("allow"):
        found = with_rows_first(jax.lax.map(one, (flights, times)))
    # (lanes, rows, stops): a row for each stop and kind of margin.
    gap, force, rise = (
        jnp.diagonal(a[:, k * stops : (k + 1) * stops], axis1=1, axis2=2) for k, a in enumerate(found)
    )
    return Margins(rates.speeds, gap, force, rise)


def _rates_of_reading(
    equations: tuple[Problem, Any], begin: Moment, rate: Moment, mode: Array, since: Array, along: Array
) -> tuple[Array, Array, Array]:
    """Rates of gaps, contact forces and accelerations of gaps at a time of a flight, of one cycle."""
    problem, change = equations

    def at(begin: Moment, step: Array) -> tuple[Array, Array, Array]:
        machine, flow = moved_by((problem.machine, problem.flow), change, step)
        found = read(machine, flow, begin, mode, since)
        return found.gap[0], found.force[0], found.gap[2]

    return jax.jvp(at, (begin, jnp.zeros_like(along)), (rate, along))[1]


def _read(problem: Problem, begin: Moment, mode: Array, since: Array) -> tuple:
    return read(problem.machine, problem.flow, begin, mode, since)
