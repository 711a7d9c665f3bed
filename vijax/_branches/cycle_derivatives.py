"""Derivatives of the equations of a cycle, of first to third order."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._orbits.cycle import Unknowns, residual
from .._orbits.sequence import Sequence
from .kernels import CycleEquations
from .parameter_family import ExtendedCycle, ParameterFamily
from .requests import KernelCall, Requests, ask


def jacobian(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle
) -> Float[Array, "equations unknowns"]:
    """Scaled Jacobian of all equations by the start and the durations, rows and columns of padding included."""
    size = len(place.z)
    problem = family.problem(sequence, place.p)

    def of(y: Array) -> Array:
        found = residual(problem, Unknowns(y[:size] * family.scale, y[size:]))
        return jnp.concatenate([found.closing / family.scale, found.events])

    return jax.jacfwd(of)(jnp.concatenate([place.z, place.flights]))


def slope(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, direction: ExtendedCycle
) -> Float[Array, " equations"]:
    """Derivative of the equations of `jacobian` along a direction, which may move the parameter."""
    return _along(_equations_at(family, sequence, place), direction)(place)


def curvature(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, u: ExtendedCycle, v: ExtendedCycle
) -> Float[Array, " equations"]:
    """Second derivative of the equations of `jacobian` along two directions, one of which may move the parameter."""
    return _along(_along(_equations_at(family, sequence, place), u), v)(place)


def third_derivative(
    family: ParameterFamily,
    sequence: Sequence,
    place: ExtendedCycle,
    u: ExtendedCycle,
    v: ExtendedCycle,
    w: ExtendedCycle,
) -> Float[Array, " equations"]:
    """Third derivative of the equations of `jacobian` along three directions at fixed parameter."""
    return _along(_along(_along(_equations_at(family, sequence, place), u), v), w)(place)


def derivative_at(
    kernel: Callable[..., Array], sequence: Sequence, place: ExtendedCycle, *directions: ExtendedCycle
) -> Requests[np.ndarray]:
    """One of these derivatives, without the rows of padding."""
    num = len(place.z) + len(place.flights)
    return np.asarray((yield from ask(KernelCall(kernel, sequence, (place, *directions)))))[:num]


def square_jacobian(sequence: Sequence, place: ExtendedCycle) -> Requests[np.ndarray]:
    """`jacobian` without padding."""
    found = yield from derivative_at(jacobian, sequence, place)
    return found[:, : len(found)]


def _equations_at(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle
) -> Callable[[ExtendedCycle], Array]:
    """Scaled residuals as a function of the cycle, linear in the parameter about that of a place; two parameters are fixed."""
    if place.p.ndim:
        fixed = family.problem(sequence, place.p)
        problem_at = lambda p: fixed  # noqa: E731
    else:
        problem_at = CycleEquations.of(family, sequence, place).at

    def at(place: ExtendedCycle) -> Array:
        found = residual(problem_at(place.p), family.unknowns(place))
        return jnp.concatenate([found.closing / family.scale, found.events])

    return at


def _along(f: Callable[[ExtendedCycle], Array], direction: ExtendedCycle) -> Callable[[ExtendedCycle], Array]:
    """Derivative of a function along a direction."""
    return lambda place: jax.jvp(f, (place,), (direction,))[1]
