"""Margins between the events of many cycles at once: the scan of `admissibility.py`, every number an array over lanes."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._lanes.kernels import kernel_of, pruned
from .._orbits.cycle import Moment, Problem
from .._orbits.sequence import Sequence
from .admissibility import Course, LeastMargins, course_of, least_margins, read, with_margins_at_events
from .parameter_family import ExtendedCycle, ParameterFamily


def margins_of_cycles(
    families: ParameterFamily, sequences: Sequence, places: ExtendedCycle, begins: Moment
) -> LeastMargins:
    """`margins_of_cycle` of many cycles, along the first axis.

    Raises:
        NotImplementedError: if a law of the machine is made of what `lanes_last` does not know.
    """
    of_one = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), (families, sequences, places))
    family, sequence, place = of_one
    problem = eqx.filter_eval_shape(lambda *of: of[0].problem(*of[1:]), family, sequence, place.p)
    begin = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[2:], a.dtype), begins)
    mode = jax.ShapeDtypeStruct(sequence.mode.shape[1:], sequence.mode.dtype)
    picked, reading = pruned(_read, problem, begin, mode, place.p)

    def prepared(
        family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, begins: Moment
    ) -> tuple[list, Course]:
        problem = family.problem(sequence, place.p)
        return picked(problem), course_of(problem, family.unknowns(place), begins)

    numbers, course = jax.vmap(prepared, out_axes=-1)(families, sequences, places, begins)
    with jax.numpy_rank_promotion("allow"):  # numbers of all lanes go with those of each
        found = least_margins(course, lambda *of: kernel_of(reading)(numbers, *of))
    found = jax.tree.map(lambda a: jnp.moveaxis(a, -1, 0), found)

    def whole(
        family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, begins: Moment, found: LeastMargins
    ) -> LeastMargins:
        return with_margins_at_events(family.problem(sequence, place.p), begins, found)

    return jax.vmap(whole)(families, sequences, places, begins, found)


def _read(problem: Problem, begin: Moment, mode: Array, since: Array) -> tuple:
    return read(problem.machine, problem.flow, begin, mode, since)
