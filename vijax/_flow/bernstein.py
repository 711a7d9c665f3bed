"""First point of [0, 1] where a polynomial may fall below zero, by its Bernstein coefficients.

A polynomial lies between the smallest and the largest of its Bernstein coefficients: if all are positive, it has no
zero. Otherwise it still lies above every line below all of its control points. Such a line through the first control
point proves it positive up to the zero of the line. The test is repeated from there on a shorter interval, where the
coefficients lie closer to the polynomial. The search moves from the left, never passes a zero, and converges to the
first zero, if simple, as fast as Newton's method.
"""

from functools import cache
from itertools import pairwise
from math import comb

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jax.arrays import Scalar, add_up, smallest
from .._jax.xla import compute_once

# Accuracy of the first zero: an interval in doubt that is no wider counts as the zero.
_CLOSE = 1e-7
# Bound on the tests; the interval proved until then is returned.
_MOST_TURNS = 40


@cache
def nodes(degree: int) -> np.ndarray:
    """Chebyshev points of the second kind on [0, 1], both ends included, (degree + 1,)."""
    return (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2


@cache
def from_nodes(degree: int) -> np.ndarray:
    """Matrix from values at the nodes to Bernstein coefficients."""
    k, x = np.arange(degree + 1), nodes(degree)[:, None]
    return np.linalg.inv(np.array([comb(degree, i) for i in k]) * x**k * (1 - x) ** (degree - k))


@cache
def slopes_at_nodes(degree: int) -> np.ndarray:
    """Matrix from values at the nodes to derivatives there."""
    powers = np.polynomial.chebyshev.chebvander(2 * nodes(degree) - 1, degree)
    slopes = np.polynomial.chebyshev.chebder(np.eye(degree + 1))  # of each polynomial, by columns
    return 2 * np.polynomial.chebyshev.chebval(2 * nodes(degree) - 1, slopes).T @ np.linalg.inv(powers)


def bernstein(values: Float[Array, " nodes"]) -> list[Scalar]:
    """Bernstein coefficients of the polynomial through values at the nodes.

    Written as sums: a library's matrix product would split the surrounding kernel.
    """
    rows = [values[j] for j in range(len(values))]
    return [
        add_up([float(weight) * row for weight, row in zip(line, rows, strict=True)])
        for line in from_nodes(len(rows) - 1)
    ]


def derivative_coefficients(coefficients: list[Scalar]) -> list[Scalar]:
    """Bernstein coefficients of the derivative, at the same degree."""
    n, rise = len(coefficients) - 1, [b - a for a, b in pairwise(coefficients)]
    inner = [k * rise[k - 1] + (n - k) * rise[k] for k in range(1, n)]
    return [n * rise[0], *inner, n * rise[-1]]


def divided(coefficients: list[Scalar], start: Scalar) -> list[Scalar]:
    """Bernstein coefficients, at the same degree, of p(t) / t for a polynomial with p(0) = 0 and p'(0) = `start`."""
    n = len(coefficients) - 1
    later = [a + (n - k) / (k + 1) * b for k, (a, b) in enumerate(pairwise(coefficients))][1:]
    return [start, *later, coefficients[-1]]


def first_crossing(coefficients: list[Scalar]) -> Scalar:
    """Part of [0, 1] on which a polynomial is proved not negative: up to its first zero, or all of it.

    A negative first coefficient counts as zero.
    """
    first = [jnp.maximum(coefficients[0], 0), *coefficients[1:]]
    degree = len(first) - 1

    def is_open(carry):
        left, _, is_found, turns = carry
        return (left < 1) & ~is_found & (turns < _MOST_TURNS)

    def look(carry):
        left, width, _, turns = carry
        part = compute_once(_between, first, left, width)
        height = jnp.maximum(part[0], 0)
        steepest = smallest([(part[k] - height) * (degree / k) for k in range(1, degree + 1)])
        flattest = -degree * smallest([a - b for a, b in pairwise(part)])
        is_free = smallest(part[1:]) > 0
        to_line = width * jnp.minimum(height / jnp.where(steepest < 0, -steepest, 1), 1)
        is_found = ~is_free & ((width <= _CLOSE) | ((flattest < 0) & (width * height <= -_CLOSE * flattest)))
        step = jnp.where(is_found, 0, jnp.where(is_free, width, to_line))
        left = jnp.minimum(left + step, 1)
        width = jnp.where(is_free, 4 * width, jnp.maximum(2 * step, width / 32))
        return left, jnp.minimum(width, 1 - left), is_found, turns + 1

    left = jnp.where(smallest(first[1:]) > 0, jnp.ones_like(first[0]), 0)
    return jax.lax.while_loop(is_open, look, (left, 1 - left, jnp.array(False), 0))[0]


def _between(coefficients: list[Scalar], left: Scalar, width: Scalar) -> list[Scalar]:
    """Bernstein coefficients on [left, left + width] (de Casteljau, from either end)."""
    right = left + width
    low = compute_once(_begin, coefficients, right)
    cut = left / jnp.where(right > 0, right, 1)
    return compute_once(_begin, low[::-1], 1 - cut)[::-1]


def _begin(coefficients: list[Scalar], end: Scalar) -> list[Scalar]:
    """Bernstein coefficients on [0, end]."""
    rows, begun = coefficients, []
    while rows:
        begun.append(rows[0])
        rows = [a + end * (b - a) for a, b in pairwise(rows)]
    return begun
