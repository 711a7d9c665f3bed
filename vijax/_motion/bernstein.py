"""Where a polynomial on [0, 1] may first fall below zero, told by its Bernstein coefficients.

A polynomial lies between the smallest and the largest of its Bernstein coefficients: are all positive, it
has no zero. If not, it still lies above every line below all of its control points, so up to the zero of such
a line through the first it is proved positive. From there the same is asked of a shorter interval,
on which the coefficients lie closer to the polynomial: the search walks from the left, never
over a zero, and closes in on the first one as fast as Newton's method on a simple one.
"""

from functools import cache
from math import comb

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._types import Scalar

# A first zero this near is near enough, and intervals in doubt get no shorter than this.
_CLOSE = 1e-7
_MOST_TURNS = 40


@cache
def nodes(degree: int) -> np.ndarray:
    """Chebyshev's points of the second kind on [0, 1], both ends among them, (degree + 1,)."""
    return (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2


@cache
def from_nodes(degree: int) -> np.ndarray:
    """The matrix from values at the nodes to Bernstein coefficients."""
    k, x = np.arange(degree + 1), nodes(degree)[:, None]
    return np.linalg.inv(np.array([comb(degree, i) for i in k]) * x**k * (1 - x) ** (degree - k))


@cache
def slopes_from_nodes(degree: int) -> np.ndarray:
    """The matrix from values at the nodes to Bernstein coefficients of the derivative, of the same degree."""
    difference = degree * (np.eye(degree + 1, k=1) - np.eye(degree + 1))[:degree]
    k = np.arange(1, degree)[:, None] / degree
    raised = np.zeros((degree + 1, degree))
    raised[0, 0] = raised[-1, -1] = 1
    raised[np.arange(1, degree), np.arange(degree - 1)] = k[:, 0]
    raised[np.arange(1, degree), np.arange(1, degree)] = 1 - k[:, 0]
    return raised @ difference @ from_nodes(degree)


def first_crossing(coefficients: Float[Array, " coefficients"]) -> Scalar:
    """How far a polynomial is proved not to fall below zero: to its first zero, or to 1.

    The first coefficient counts as zero where it is negative.
    """
    first = jnp.maximum(coefficients, jnp.where(jnp.arange(len(coefficients)) == 0, 0, -jnp.inf))
    degree = len(coefficients) - 1

    def is_open(carry):
        left, _, is_found, turns = carry
        return (left < 1) & ~is_found & (turns < _MOST_TURNS)

    def look(carry):
        left, width, _, turns = carry
        part = _between(first, left, width)
        height = jnp.maximum(part[0], 0)
        slopes = degree * (part[1:] - height) / jnp.arange(1, degree + 1, dtype=part.dtype)
        steepest, flattest = jnp.min(slopes), jnp.max(jnp.diff(part)) * degree
        is_free = jnp.min(part[1:]) > 0
        to_line = width * jnp.minimum(height / jnp.where(steepest < 0, -steepest, 1), 1)
        is_found = ~is_free & ((width <= _CLOSE) | ((flattest < 0) & (width * height <= -_CLOSE * flattest)))
        step = jnp.where(is_found, 0, jnp.where(is_free, width, to_line))
        left = jnp.minimum(left + step, 1)
        width = jnp.where(is_free, 4 * width, jnp.maximum(2 * step, width / 32))
        return left, jnp.minimum(width, 1 - left), is_found, turns + 1

    left = jnp.where(jnp.min(first[1:]) > 0, jnp.ones_like(first[0]), 0)
    return jax.lax.while_loop(is_open, look, (left, 1 - left, jnp.array(False), 0))[0]


def _between(
    coefficients: Float[Array, " coefficients"], left: Scalar, width: Scalar
) -> Float[Array, " coefficients"]:
    """Bernstein coefficients on [left, left + width] (de Casteljau, from either end)."""
    right = left + width
    rows, low = coefficients, []
    for _ in range(len(coefficients)):
        low.append(rows[0])
        rows = rows[:-1] + right * jnp.diff(rows)
    cut = left / jnp.where(right > 0, right, 1)
    rows, high = jnp.stack(low), []
    for _ in range(len(coefficients)):
        high.append(rows[-1])
        rows = rows[:-1] + cut * jnp.diff(rows)
    return jnp.stack(high[::-1])
