"""First place on [0, 1] where a polynomial may fall below zero, by its Bernstein coefficients.

A polynomial lies between the smallest and the largest of its Bernstein coefficients: if all are positive, it
has no zero. If not, it still lies above every line below all of its control points: such a line through the
first point proves it positive up to the zero of the line. From there the test is repeated on a shorter
interval, where the coefficients lie closer to the polynomial: the search walks from the left, never
over a zero, and closes in on the first zero, if simple, as fast as Newton's method.
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

# Accuracy of the first zero, and least length of intervals in doubt.
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


def bernstein(values: Float[Array, " nodes"]) -> list[Scalar]:
    """Bernstein coefficients of the polynomial through values at the nodes.

    By sums, for a library's product would split the kernel that this is part of.
    """
    rows = [values[j] for j in range(len(values))]
    return [
        add_up([float(weight) * row for weight, row in zip(line, rows, strict=True)])
        for line in from_nodes(len(rows) - 1)
    ]


def derivative_coefficients(coefficients: list[Scalar]) -> list[Scalar]:
    """Coefficients of the derivative, of the same degree."""
    n, rise = len(coefficients) - 1, [b - a for a, b in pairwise(coefficients)]
    inner = [k * rise[k - 1] + (n - k) * rise[k] for k in range(1, n)]
    return [n * rise[0], *inner, n * rise[-1]]


def divided(coefficients: list[Scalar], start: Scalar) -> list[Scalar]:
    """Coefficients, of the same degree, of a polynomial that is 0 at 0, divided by time: `start` at 0."""
    n = len(coefficients) - 1
    later = [a + (n - k) / (k + 1) * b for k, (a, b) in enumerate(pairwise(coefficients))][1:]
    return [start, *later, coefficients[-1]]


def first_crossing(coefficients: list[Scalar]) -> Scalar:
    """Part of [0, 1] on which a polynomial is proved not to be negative: up to its first zero, or all.

    The first coefficient counts as zero where it is negative.
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
