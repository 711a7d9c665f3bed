"""Arithmetic of discs: where the series of a force are for complex times around now.

A disc has a centre, the value of a series now, a radius, which bounds how far its values are from it, and the least size of these.
What is bounded by M on times within R has coefficients below M / R^k.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from .algebra import Operand, is_known
from .operations import (
    Chosen,
    Fixed,
    Integral,
    InverseIntegral,
    Linear,
    Operation,
    Product,
    Quotient,
    Square,
    SquareRoot,
    chosen,
)
from .plan import Plan
from .powers import ClosingPower, CubeRoot, Power
from .quotients import inverse_cosh
from .series import AbstractSeries


class Disc(NamedTuple):
    """Values within a radius of a centre.

    Attributes:
        centre: value now.
        radius: largest distance from it; infinite, or NaN, where a singularity may be on the disc.
        inner: bound of the least size where it is better known than from these, else None.
    """

    centre: Any
    radius: Any
    inner: Any = None

    @property
    def least(self) -> Any:
        """Bound of the least size."""
        plain = jnp.maximum(jnp.abs(self.centre) - self.radius, 0)
        return plain if self.inner is None else jnp.where(plain > self.inner, plain, self.inner)

    @property
    def most(self) -> Any:
        """Bound of the largest size."""
        return jnp.abs(self.centre) + self.radius


def discs_of(
    plan: Plan, values: AbstractSeries, given: Mapping[Operand, Any], series: Iterable[int]
) -> dict[Operand, Disc]:
    """Discs of some series of a force.

    Args:
        plan: operations.
        values: series of which order 0 is there.
        given: radii of the time, positions and velocities; all other series that are given do not change.
        series: those wanted.

    Returns:
        Their discs, and those of all that they are made of.
    """
    centre = lambda a: float(a) if is_known(a) else values.coefficient(a, 0)  # noqa: E731
    discs = {a: Disc(centre(a), radius) for a, radius in given.items()}
    needed = _needed(plan, series)
    by_out = {operation.out: operation for operation in plan.operations}

    def of(operand: Operand) -> Disc:
        is_moving = not is_known(operand) and operand in discs
        return discs[operand] if is_moving else Disc(centre(operand), 0.0)

    for operation in plan.operations:
        if operation.out in needed:
            value = centre(operation.out)
            radius = _radius(operation, of, value)
            discs[operation.out] = Disc(value, radius, _inner(operation, by_out, of))
    return discs


def _needed(plan: Plan, series: Iterable[int]) -> set[int]:
    needed = set(series)
    fixed = {operation.out for operation in plan.operations if isinstance(operation, Fixed)}
    for operation in reversed(plan.operations):
        if operation.out in needed:
            own = operation.of if isinstance(operation, Integral) else operation.sources
            needed.update(a for a in own if not is_known(a))
    return needed - fixed


def _inner(operation: Operation, by_out: Mapping[int, Operation], of: Callable[[Operand], Disc]) -> Any:
    """Least size of functions that grow, and of what is made of them; None of all else."""
    if isinstance(operation, Linear) and (found := _inner_of_square(operation, by_out, of)) is not None:
        return found
    if isinstance(operation, Integral):
        return _LEAST[operation.value](of(operation.of[0])) if operation.value in _LEAST else None
    if not isinstance(operation, Linear | Product | Square):
        return None
    discs = [of(a) for a in operation.sources]
    if not isinstance(operation, Linear):
        return math.prod(disc.least for disc in (discs if isinstance(operation, Product) else 2 * discs))
    if all(disc.inner is None for disc in discs):
        return None
    sizes = [
        (abs(c) * disc.least, abs(c) * disc.most) for c, disc in zip(operation.factors, discs, strict=True)
    ]
    sizes.append((abs(operation.constant), abs(operation.constant)))
    most = sum(high for _, high in sizes)
    least: Any = 0.0
    for k, (low, _) in enumerate(sizes):
        rest = low - sum(high for j, (_, high) in enumerate(sizes) if j != k)
        least = jnp.where(rest > least, rest, least)
    return jnp.where(jnp.isfinite(most), least, 0.0) if len(sizes) > 2 else least


def _inner_of_square(
    operation: Linear, by_out: Mapping[int, Operation], of: Callable[[Operand], Disc]
) -> Any:
    """Least size of c (b + a^2) with b > 0: that of the product of the distances from two imaginary numbers."""
    moving = [k for k, a in enumerate(operation.args) if not isinstance(of(a).radius, float)]
    if len(moving) != 1 or not isinstance(by_out.get(operation.args[moving[0]]), Square):
        return None
    c, square = operation.factors[moving[0]], of(by_out[operation.args[moving[0]]].args[0])
    still = [
        f * of(a).centre
        for k, (f, a) in enumerate(zip(operation.factors, operation.args, strict=True))
        if k not in moving
    ]
    b = (operation.constant + sum(still)) / c
    distance = jnp.sqrt(jnp.maximum(b + square.centre**2, 0)) - square.radius
    return jnp.where(b > 0, abs(c) * jnp.maximum(distance, 0) ** 2, 0.0)


def _radius(operation: Operation, of: Callable[[Operand], Disc], value: Any) -> Any:
    """Radius of the disc of a series whose value at the centre is known."""
    discs = [of(a) for a in operation.sources]
    for kind, radius in _BY_KIND.items():
        if isinstance(operation, kind):
            return radius(operation, of, value, *discs)
    raise NotImplementedError(f"The operation {type(operation).__name__} has no discs.")


def _of_sum(operation: Any, of: Any, value: Any, *discs: Disc) -> Any:
    return sum(abs(c) * disc.radius for c, disc in zip(operation.factors, discs, strict=True))


def _of_product(operation: Any, of: Any, value: Any, one: Disc, other: Disc) -> Any:
    return jnp.abs(one.centre) * other.radius + other.most * one.radius


def _of_quotient(operation: Any, of: Any, value: Any, one: Disc, other: Disc) -> Any:
    size = jnp.abs(value)
    near = _over(one.radius + size * other.radius, other.least)
    far = size + _over(one.most, other.least)  # of a denominator that overflows
    return jnp.where(near < far, near, far)


def _of_power(operation: Any, of: Any, value: Any, disc: Disc) -> Any:
    return _radius_of_power(disc.centre, disc.radius, of(operation.args[1]).centre, operation.is_clipped)


def _of_choice(operation: Any, of: Any, value: Any, *discs: Disc) -> Any:
    return chosen(of(operation.args[0]).centre, [disc.radius for disc in discs])


def _of_integral(operation: Any, of: Any, value: Any, *discs: Disc) -> Any:
    return RADII[operation.value](*map(of, operation.of))


_BY_KIND: dict[type, Callable[..., Any]] = {
    Linear: _of_sum,
    Product: _of_product,
    Square: lambda operation, of, value, disc: (jnp.abs(disc.centre) + disc.most) * disc.radius,
    Quotient: _of_quotient,
    SquareRoot: lambda operation, of, value, disc: _radius_of_power(disc.centre, disc.radius, 0.5),
    CubeRoot: lambda operation, of, value, disc: _radius_of_power(disc.centre, disc.radius, 1 / 3),
    ClosingPower: lambda operation, of, value, disc: _radius_of_power(
        disc.centre, disc.radius, operation.exponent, True
    ),
    Power: _of_power,
    Chosen: _of_choice,
    Integral: _of_integral,
    InverseIntegral: lambda operation, of, value, disc: RADII[operation.value](disc),
}


def _over(a: Any, b: Any) -> Any:
    """A / b, infinite where b is not positive."""
    return jnp.where(b > 0, a / jnp.where(b > 0, b, 1), jnp.inf)


def _radius_of_power(a: Any, r: Any, p: Any, is_clipped: bool = False) -> Any:
    """By the mean value theorem; where the disc reaches zero infinite, but for a power that begins or ends there its size."""
    size = jnp.abs(a)
    edge = jnp.where(p > 1, size + r, size - r)
    is_inside = (size > r) | (r == 0)
    slope = jnp.abs(p) * jnp.power(jnp.where(edge > 0, edge, 1), p - 1)
    beyond: Any = jnp.inf
    if is_clipped:
        beyond = jnp.where(p > 0, 2 * jnp.power(jnp.where(is_inside, 1, size + r), p), jnp.inf)
    return jnp.where(is_inside, jnp.where(r == 0, 0, slope * r), beyond)


def _exponential(a: Any, r: Any) -> Any:
    # One exponential: a product of two would be 0 times infinity.
    return jnp.exp(a + r) - jnp.exp(a)


def _circular(a: Any, r: Any) -> Any:
    return jnp.expm1(r)


def _hyperbolic(a: Any, r: Any) -> Any:
    return jnp.exp(jnp.abs(a) + r) - jnp.exp(jnp.abs(a))


def _tanh(a: Any, r: Any) -> Any:
    """|cosh z|^2 = sinh^2 Re z + cos^2 Im z."""
    near = jnp.where(r < math.pi / 2, jnp.cos(jnp.minimum(r, math.pi / 2)) ** 2, 0)
    return _over(r, jnp.sinh(jnp.maximum(jnp.abs(a) - r, 0)) ** 2 + near)


def _inverse_cosh(a: Any, r: Any) -> Any:
    """|(1 / cosh)'| = |sinh z| / |cosh z|^2, and |sinh z| is at most |cosh z| + exp(-|Re z|)."""
    away = jnp.maximum(jnp.abs(a) - r, 0)
    near = jnp.where(r < math.pi / 2, jnp.cos(jnp.minimum(r, math.pi / 2)) ** 2, 0)
    least = jnp.sqrt(jnp.sinh(away) ** 2 + near)
    return _over(r * (1 + _over(jnp.exp(-away), least)), least)


def _tan(a: Any, r: Any) -> Any:
    """All coefficients of tan at 0 are positive."""
    near = jnp.abs(a - math.pi * jnp.round(a / math.pi)) + r
    is_inside = near < math.pi / 2
    return jnp.where(is_inside, r / jnp.cos(jnp.where(is_inside, near, 0)) ** 2, jnp.inf)


def _erf(a: Any, r: Any) -> Any:
    """Largest |exp(-z^2)| on the disc."""
    size = jnp.abs(a)
    exponent = jnp.where(size <= 2 * r, r * r - size * size / 2, -((size - r) ** 2))
    return 2 / math.sqrt(math.pi) * r * jnp.exp(exponent)


def _erf_inverse(a: Any, r: Any) -> Any:
    """All coefficients at 0 are positive."""
    edge = jnp.abs(a) + r
    is_inside = edge < 1
    y = lax.erf_inv(jnp.where(is_inside, edge, 0.5) + jnp.zeros(()))
    return jnp.where(is_inside, r * math.sqrt(math.pi) / 2 * jnp.exp(y * y), jnp.inf)


def _logarithm(a: Any, r: Any) -> Any:
    part = _over(r, jnp.abs(a))
    return jnp.where(part < 1, -jnp.log1p(-jnp.where(part < 1, part, 0)), jnp.inf)


def _by_distance(distances: Callable[[Any], tuple[Any, Any]], power: float) -> Callable[[Any, Any], Any]:
    """Function whose slope is a power of the product of the distances from two points."""

    def radius(a: Any, r: Any) -> Any:
        first, second = (d - r for d in distances(a))
        is_inside = (first > 0) & (second > 0)
        product = jnp.where(is_inside, first * second, 1)
        return jnp.where(is_inside, r / product**power, jnp.inf)

    return radius


def _from_units(a: Any) -> tuple[Any, Any]:
    return 1 - a, 1 + a


def _from_beyond_one(a: Any) -> tuple[Any, Any]:
    return a - 1, a + 1


def _from_imaginary_units(a: Any) -> tuple[Any, Any]:
    size = jnp.sqrt(1 + a * a)
    return size, size


def _angle(y: Disc, x: Disc) -> Any:
    """Of atan2: x y' - y x' over x^2 + y^2 = (x + i y) (x - i y)."""
    (a, r), (b, q) = y[:2], x[:2]
    least = jnp.maximum(jnp.hypot(a, b) - r - q, 0) ** 2
    return _over((jnp.abs(b) + q) * r + (jnp.abs(a) + r) * q, least)


def _radius_of_variable_power(a: Disc, b: Disc) -> Any:
    """a^b = exp(b log a)."""
    (x, r), (p, q) = a[:2], b[:2]
    log, part = jnp.log(jnp.where(x > 0, x, 1)), _logarithm(x, r)
    return _exponential(p * log, jnp.abs(p) * part + jnp.abs(log) * q + part * q)


def _of_one(radius: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda disc, *_: radius(disc.centre, disc.radius)


# By the function of the value.
RADII: dict[Callable, Callable[..., Any]] = {
    **dict.fromkeys((jnp.exp, jnp.expm1), _of_one(_exponential)),
    jnp.power: _radius_of_variable_power,
    jnp.arctan2: _angle,
    jnp.exp2: _of_one(lambda a, r: _exponential(a * math.log(2), r * math.log(2))),
    **dict.fromkeys((jnp.sin, jnp.cos), _of_one(_circular)),
    **dict.fromkeys((jnp.sinh, jnp.cosh), _of_one(_hyperbolic)),
    jnp.tanh: _of_one(_tanh),
    lax.logistic: _of_one(lambda a, r: _tanh(a / 2, r / 2) / 2),
    inverse_cosh: _of_one(_inverse_cosh),
    jnp.tan: _of_one(_tan),
    **dict.fromkeys((lax.erf, lax.erfc), _of_one(_erf)),
    lax.erf_inv: _of_one(_erf_inverse),
    jnp.log: _of_one(_logarithm),
    jnp.log1p: _of_one(lambda a, r: _logarithm(1 + a, r)),
    **dict.fromkeys((jnp.arcsin, jnp.arccos), _of_one(_by_distance(_from_units, 0.5))),
    jnp.arctanh: _of_one(_by_distance(_from_units, 1.0)),
    jnp.arccosh: _of_one(_by_distance(_from_beyond_one, 0.5)),
    jnp.arctan: _of_one(_by_distance(_from_imaginary_units, 1.0)),
    jnp.arcsinh: _of_one(_by_distance(_from_imaginary_units, 0.5)),
}


def _least_of_growing(a: Any, r: Any) -> Any:
    """|sinh z|^2 and |cosh z|^2 are sinh^2 Re z and more."""
    return jnp.sinh(jnp.maximum(jnp.abs(a) - r, 0))


# Least sizes, by the function of the value.
_LEAST: dict[Callable, Callable[[Disc], Any]] = {
    jnp.exp: _of_one(lambda a, r: jnp.exp(a - r)),
    jnp.exp2: _of_one(lambda a, r: jnp.exp2(a - r)),
    **dict.fromkeys((jnp.sinh, jnp.cosh), _of_one(_least_of_growing)),
}
