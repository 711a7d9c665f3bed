"""Bounds of series of time alone, for complex times.

A pulse that is still far shows in no coefficient now. What is bounded by M on a disc of radius R has coefficients below M / R^k,
so a bound on a disc much larger than the step shows that the polynomial misses nothing. Disc arithmetic: a series has a centre, its
value, and a radius, which bounds how far its values on the disc are from it.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from .._jax.arrays import Scalar
from .operations import (
    Chosen,
    Fixed,
    Integral,
    InverseIntegral,
    Linear,
    Operand,
    Operation,
    Product,
    Quotient,
    Square,
    SquareRoot,
    chosen,
    is_known,
)
from .plan import Plan
from .powers import ClosingPower, CubeRoot, Power
from .series import series_of

Disc = tuple[Any, Any]


def has_time_bound(plan: Plan) -> bool:
    """True if the force has series of time alone that are neither polynomials nor harmonic."""
    return bool(_wild(plan))


def time_bound(plan: Plan, force: Any, t: Any, radius: Any, *, like: Array, modes: Any = ()) -> Scalar:
    """Bound how far series of time alone are from their values at t, for complex times within a radius of t.

    It is the largest over all terms of the force, each without its constant factors, relative to its own value where this is
    larger than one: an amplitude is no scale of the function. Terms that are polynomials, harmonic, or products of such are not
    among them: their coefficients tell all. Infinite, or NaN, where a singularity may be on the disc.
    """
    wild = _wild(plan)
    empty = jnp.zeros_like(like)
    values = series_of(plan, force, t, like=like, modes=modes).extend(empty, empty)
    needed = _needed(plan, wild)
    discs: dict[int, Disc] = {0: (t, radius)}

    def of(operand: Operand) -> Disc:
        if is_known(operand):
            return float(operand), 0.0
        return discs[operand] if operand in discs else (values.coefficient(operand, 0), 0.0)

    for operation in plan.operations:
        if operation.out in needed:
            centre = values.coefficient(operation.out, 0)
            discs[operation.out] = centre, _radius(operation, of, centre)
    most = jnp.zeros(like.shape[1:], like.dtype)
    for series in wild:
        centre, own = discs[series]
        most = jnp.maximum(most, own / jnp.maximum(jnp.abs(centre), 1))
    return most


def _needed(plan: Plan, series: Iterable[int]) -> set[int]:
    needed = set(series)
    fixed = {operation.out for operation in plan.operations if isinstance(operation, Fixed)}
    for operation in reversed(plan.operations):
        if operation.out in needed:
            own = operation.of if isinstance(operation, Integral) else operation.sources
            needed.update(a for a in own if not is_known(a))
    return needed - fixed


def _wild(plan: Plan) -> list[int]:
    """Terms of time alone that the motion reads, and that are not tame."""
    first = 1 + plan.num_numbers
    moving = set(range(first, first + 2 * plan.num_masses))
    timed, linear, tame = {0}, {0}, {0}
    read: dict[int, None] = {}
    for operation in plan.operations:
        own = [a for a in operation.sources if not is_known(a)]
        if any(a in moving for a in own):
            moving.add(operation.out)
            read.update(dict.fromkeys(a for a in own if a in timed))
        elif any(a in timed for a in own):
            timed.add(operation.out)
            of_time = [a for a in own if a in timed]
            is_sum = isinstance(operation, Linear) or (isinstance(operation, Product) and len(of_time) == 1)
            if is_sum and all(a in linear for a in of_time):
                linear.add(operation.out)
            if isinstance(operation, Integral):
                is_tame = operation.value in (jnp.sin, jnp.cos) and all(a in linear for a in of_time)
            else:
                is_polynomial = isinstance(operation, Linear | Product | Square | Chosen)
                is_tame = is_polynomial and all(a in tame for a in of_time)
            if is_tame:
                tame.add(operation.out)
    read.update(dict.fromkeys(f for f in plan.forces if not is_known(f) and f in timed))
    return _terms(plan, [s for s in read if s not in tame], tame)


def _terms(plan: Plan, series: Sequence[int], tame: set[int]) -> list[int]:
    """Terms of sums that are not tame, without factors that do not change."""
    by_out = {operation.out: operation for operation in plan.operations}
    first = 1 + plan.num_numbers
    given = {*range(1, first), *(switch.mode for switch in plan.switches)}
    is_fixed = lambda a: is_known(a) or a in given or isinstance(by_out.get(a), Fixed)  # noqa: E731
    found: dict[int, None] = {}
    waiting = list(series)
    while waiting:
        s = waiting.pop()
        operation = by_out.get(s)
        own = [] if operation is None else [a for a in operation.sources if not is_fixed(a)]
        if isinstance(operation, Linear) or (isinstance(operation, Product) and len(own) == 1):
            waiting.extend(a for a in own if a not in tame)
        else:
            found[s] = None
    return list(found)


def _radius(operation: Operation, of: Callable[[Operand], Disc], value: Any) -> Any:
    """Radius of the disc of a series whose value at the centre is known."""
    discs = [of(a) for a in operation.sources]
    for kind, radius in _BY_KIND.items():
        if isinstance(operation, kind):
            return radius(operation, of, value, *discs)
    raise NotImplementedError(f"The operation {type(operation).__name__} has no discs.")


def _of_sum(operation: Any, of: Any, value: Any, *discs: Disc) -> Any:
    return sum(abs(c) * r for c, (_, r) in zip(operation.factors, discs, strict=True))


def _of_product(operation: Any, of: Any, value: Any, one: Disc, other: Disc) -> Any:
    (a, r), (b, q) = one, other
    return jnp.abs(a) * q + jnp.abs(b) * r + r * q


def _of_quotient(operation: Any, of: Any, value: Any, one: Disc, other: Disc) -> Any:
    (_, r), (b, q) = one, other
    return _over(r + jnp.abs(value) * q, jnp.abs(b) - q)


def _of_power(operation: Any, of: Any, value: Any, disc: Disc) -> Any:
    return _radius_of_power(disc[0], disc[1], of(operation.args[1])[0])


def _of_choice(operation: Any, of: Any, value: Any, *discs: Disc) -> Any:
    return chosen(of(operation.args[0])[0], [r for _, r in discs])


def _of_integral(operation: Any, of: Any, value: Any, *discs: Disc) -> Any:
    return RADII[operation.value](*map(of, operation.of))


_BY_KIND: dict[type, Callable[..., Any]] = {
    Linear: _of_sum,
    Product: _of_product,
    Square: lambda operation, of, value, disc: (2 * jnp.abs(disc[0]) + disc[1]) * disc[1],
    Quotient: _of_quotient,
    SquareRoot: lambda operation, of, value, disc: _radius_of_power(disc[0], disc[1], 0.5),
    CubeRoot: lambda operation, of, value, disc: _radius_of_power(disc[0], disc[1], 1 / 3),
    ClosingPower: lambda operation, of, value, disc: _radius_of_power(disc[0], disc[1], operation.exponent),
    Power: _of_power,
    Chosen: _of_choice,
    Integral: _of_integral,
    InverseIntegral: lambda operation, of, value, disc: RADII[operation.value](disc),
}


def _over(a: Any, b: Any) -> Any:
    """A / b, infinite where b is not positive."""
    return jnp.where(b > 0, a / jnp.where(b > 0, b, 1), jnp.inf)


def _radius_of_power(a: Any, r: Any, p: Any) -> Any:
    """By the mean value theorem; infinite where the disc reaches zero."""
    size = jnp.abs(a)
    edge = jnp.where(p > 1, size + r, size - r)
    is_inside = (size > r) | ((size == 0) & (r == 0))
    slope = jnp.abs(p) * jnp.power(jnp.where(edge > 0, edge, 1), p - 1)
    return jnp.where(r == 0, 0, jnp.where(is_inside, slope * r, jnp.inf))


def _exponential(a: Any, r: Any) -> Any:
    # One exponential: a product of two would be 0 times infinity.
    return jnp.exp(a + r) - jnp.exp(a)


def _circular(a: Any, r: Any) -> Any:
    return jnp.expm1(r)


def _hyperbolic(a: Any, r: Any) -> Any:
    return jnp.exp(jnp.abs(a) + r) - jnp.exp(jnp.abs(a))


def _tanh(a: Any, r: Any) -> Any:
    """|cosh z|^2 = sinh^2 Re z + cos^2 Im z."""
    slope = jnp.sinh(jnp.maximum(jnp.abs(a) - r, 0)) ** 2 + jnp.cos(jnp.minimum(r, math.pi / 2)) ** 2
    return jnp.where(r < 1.5, r / slope, jnp.inf)


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
    """Of atan2: x y' - y x' over the square of the distance."""
    (a, r), (b, q) = y, x
    square = a * a + b * b - (2 * jnp.abs(a) + r) * r - (2 * jnp.abs(b) + q) * q
    return _over((jnp.abs(b) + q) * r + (jnp.abs(a) + r) * q, square)


def _radius_of_variable_power(a: Disc, b: Disc) -> Any:
    """a^b = exp(b log a)."""
    (x, r), (p, q) = a, b
    log, part = jnp.log(jnp.where(x > 0, x, 1)), _logarithm(x, r)
    return _exponential(p * log, jnp.abs(p) * part + jnp.abs(log) * q + part * q)


def _of_one(radius: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda disc, *_: radius(*disc)


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
