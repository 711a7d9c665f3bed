"""Corrector of pseudo-arclength continuation: Newton's method on a cycle with parameter, with one equation more."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from .._jax.arrays import Scalar
from .._jax.xla import in_lanes_of
from .._orbits.condensation import Condensed, Pencil, Weights, basis_of_kernel, condense, solve_condensed
from .._orbits.cycle import Moment
from .._orbits.linear_cycle import LinearCourse, linearise, linearise_course
from .._orbits.newton import has_converged, is_worth_a_step
from .._orbits.sequence import Sequence
from .parameter_family import ExtendedCycle, ParameterFamily

_MAX_STEPS = 12


class Corrected(NamedTuple):
    """Result of a correction.

    Attributes:
        place: the cycle and its parameter.
        tangent: of the branch there, of length 1, in the direction of the weights.
        multipliers: (2 n,).
        speeds: of approach at the impacts, (events,).
        residual: largest error of the closing, scaled.
        first: length of the first Newton step.
        num_steps: number of Newton steps.
        is_converged: whether the last step is rounding.
    """

    place: ExtendedCycle
    tangent: ExtendedCycle
    multipliers: Complex[Array, " state"]
    speeds: Float[Array, " events"]
    residual: Scalar
    first: Scalar
    num_steps: Int[Array, ""]
    is_converged: Bool[Array, ""]


class NewtonState(NamedTuple):
    """Iterate of Newton's method, of one cycle, or of many with the lanes last."""

    place: ExtendedCycle
    pencil: Pencil
    tangent: ExtendedCycle
    speeds: Array
    residual: Array
    first: Array
    step: Array
    last: Array
    num_steps: Array


# The next guess, the state of the last step, and the course of the cycle there.
_Iterate = tuple[ExtendedCycle, NewtonState, LinearCourse]


def is_going_on(now: NewtonState, tolerance: Array) -> Array:
    """True where another Newton step is worth it."""
    return is_worth_a_step(now.step, now.last, now.num_steps, _MAX_STEPS, tolerance=tolerance)


def corrected_of(last: NewtonState, size_of_tangent: Array, multipliers: Array) -> Corrected:
    """Result of the last step of Newton's method, of one cycle, or of many with the lanes last."""
    return Corrected(
        place=last.place,
        tangent=ExtendedCycle(*(a / size_of_tangent for a in last.tangent)),
        multipliers=multipliers,
        speeds=last.speeds,
        residual=last.residual,
        first=last.first,
        num_steps=last.num_steps,
        is_converged=has_converged(last.step),
    )


def correct(
    family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle, weights: ExtendedCycle, target: Scalar
) -> tuple[Corrected, LinearCourse]:
    """Solve the equations of a sequence and `weights . place = target`, for instance with a tangent as weights.

    The course of the cycle comes from the last of Newton's steps.
    """
    count = jnp.sum(sequence.is_event)
    of_start = Weights(jnp.append(weights.z, weights.p), weights.flights)
    size = len(guess.z)

    def one(now: _Iterate) -> _Iterate:
        here, before, _ = now
        problem, change = family.linear_problem(sequence, here.p)
        found, flights, course = linearise_course(problem, family.unknowns(here), family.scale, count, change)
        equations = condense(flights, count, of_start)
        closing = found.closing / family.scale

        def solved(share: Array, target: Array) -> ExtendedCycle:
            values = -share * found.events, -share * closing
            start, durations = solve_condensed(equations, *values, count, target)
            return ExtendedCycle(start[:size], durations, start[size])

        shares = jnp.array([1, 0], closing.dtype)
        targets = jnp.stack([target - here.along(weights), jnp.ones_like(target)])
        both = jax.vmap(solved)(shares, targets)
        step, tangent = (jax.tree.map(lambda a, k=k: a[k], both) for k in (0, 1))
        length = jnp.max(jnp.abs(jnp.concatenate([step.z, step.flights, step.p[None]])))
        first = jnp.where(before.num_steps == 0, length, before.first)
        pencil = _at_fixed_parameter(equations, size)
        newton = NewtonState(
            here,
            pencil,
            tangent,
            found.speed,
            jnp.max(jnp.abs(closing)),
            first,
            length,
            before.step,
            before.num_steps + 1,
        )
        return here.moved(step, 1.0), newton, course

    nothing = _no_course(guess, sequence, has_grip=family.has_tied_friction)
    begun = in_lanes_of(target, (guess, before_the_first_step(guess), nothing))
    _, last, course = jax.lax.while_loop(lambda now: is_going_on(now[1], family.tolerance), one, begun)
    size_of_tangent = jnp.sqrt(last.tangent.along(last.tangent))
    return corrected_of(last, size_of_tangent, family.multipliers(last.pencil, sequence)), course


def evaluate_at(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, tangent: ExtendedCycle
) -> Corrected:
    """`Corrected` of a known cycle and of the tangent of its branch, without Newton's method."""
    count, zero = jnp.sum(sequence.is_event), jnp.zeros_like(place.p)
    found, flights = linearise(family.problem(sequence, place.p), family.unknowns(place), family.scale, count)
    pencil = condense(flights, count).pencil
    return Corrected(
        place=place,
        tangent=tangent,
        multipliers=family.multipliers(pencil, sequence),
        speeds=found.speed,
        residual=jnp.max(jnp.abs(found.closing / family.scale)),
        first=zero,
        num_steps=jnp.array(0),
        is_converged=jnp.array(True),
    )


def _at_fixed_parameter(equations: Condensed, size: int) -> Pencil:
    """Pencil of the neighbours at the same parameter."""
    end, start = equations.pencil
    basis = basis_of_kernel(start[size])
    return Pencil(end @ basis, start[:size] @ basis)


def before_the_first_step(guess: ExtendedCycle) -> NewtonState:
    """State of Newton's method at a guess, of one cycle, or of many with the lanes last."""
    zero, size = jnp.zeros_like(guess.p), len(guess.z)
    big, square = zero + jnp.finfo(zero.dtype).max, jnp.zeros((size, size, *zero.shape), zero.dtype)
    pencil, none = Pencil(square, square), jnp.zeros(zero.shape, int)
    return NewtonState(guess, pencil, guess, jnp.zeros_like(guess.flights), zero, zero, big, big, none)


def _no_course(guess: ExtendedCycle, sequence: Sequence, *, has_grip: bool) -> LinearCourse:
    """A course of zeros in the shapes of that of a cycle with one parameter."""
    events, size, stops = len(guess.flights), len(guess.z), sequence.mode.shape[1]
    zeros = lambda *shape: jnp.zeros(shape, guess.z.dtype)  # noqa: E731
    grip = (zeros(events + 1, stops), zeros(events, stops, size + 3)) if has_grip else (None, None)
    begins = Moment(zeros(events + 1, size), zeros(events + 1), zeros(events + 1, stops), grip[0])
    forward = zeros(events, size + 2, size + 3)
    return LinearCourse(begins, zeros(size + 2, size + 1), forward, zeros(events, size + 3), grip[1])
