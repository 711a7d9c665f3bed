"""Tables: pieces that are polynomials, of which the mode of a switch says which is in force."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .algebra import Operand
from .builder import Builder
from .choices import mode_of
from .operations import chosen


def table(
    build: Builder, x: Operand, *numbers: Operand, size: int, ends: tuple[bool, bool], **_: Any
) -> Operand:
    """Piecewise linear function through given points, constant beyond the ends unless extrapolated."""
    knots, values = numbers[:size], numbers[size:]
    if build.is_fixed(x):
        return build.compute(lambda x, *n: _interp(x, n, size, ends), (x, *numbers), ("table", size, ends))
    mode = mode_of(build, x, knots)
    slopes = [_rise(build, knots, values, k) for k in range(size - 1)]
    zero = np.float64(0)
    # Pieces by the number of knots below: slope, and the point that they pass through.
    rise = [slopes[0] if ends[0] else zero, *slopes, slopes[-1] if ends[1] else zero]
    at = [0, *range(size)]
    pick = lambda cases: build.choose(mode, cases)  # noqa: E731
    start, level = pick([knots[k] for k in at]), pick([values[k] for k in at])
    return build.linear([(1, level), (1, build.multiply(pick(rise), build.linear([(1, x), (-1, start)])))])


def _rise(build: Builder, knots: tuple, values: tuple, k: int) -> Operand:
    """Slope between two points; zero for a jump."""

    def slope(a: Any, b: Any, c: Any, d: Any) -> Any:
        is_jump = jnp.equal(a, b)
        return jnp.where(is_jump, 0.0, (d - c) / jnp.where(is_jump, 1.0, b - a))

    return build.compute(slope, (knots[k], knots[k + 1], values[k], values[k + 1]), "rise")


def _interp(x: Any, numbers: Any, size: int, ends: tuple[bool, bool]) -> Any:
    """`jnp.interp` of numbers, lanes last."""
    knots, values = numbers[:size], numbers[size:]
    place = sum(jnp.greater_equal(x, k).astype(int) for k in knots)
    slopes = [
        jnp.where(jnp.equal(a, b), 0.0, (d - c) / jnp.where(jnp.equal(a, b), 1.0, b - a))
        for a, b, c, d in zip(knots[:-1], knots[1:], values[:-1], values[1:], strict=True)
    ]
    rise = [slopes[0] if ends[0] else 0.0, *slopes, slopes[-1] if ends[1] else 0.0]
    at = [0, *range(size)]
    start, level = chosen(place, [knots[k] for k in at]), chosen(place, [values[k] for k in at])
    return level + chosen(place, rise) * (x - start)
