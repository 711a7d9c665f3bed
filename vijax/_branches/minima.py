"""Minima of gaps and forces between two samples of a motion, on the polynomial through their derivatives."""

from functools import cache
from math import comb, perm
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._jax.arrays import append_axes
from .tolerances import NO_SLOPE

# _AFTER, _BEFORE: nodes near the first and the second sample, much closer there than between: a mass that hardly leaves
# its stop turns back soon after the impact, the sooner the more bounces there were.
_AFTER, _BEFORE = 1e-6 * 2.5 ** np.arange(15), 1 - 1e-3 * 2.5 ** np.arange(7)
_NODES = np.concatenate([[0.0], _AFTER, [0.5, 0.62], _BEFORE[::-1], [1.0]])


class Dip(NamedTuple):
    """Lowest minimum between two samples, of each stop; lanes last if there are any.

    Attributes:
        is_there: True where there is one.
        value: value of the minimum.
        part: its position, from 0 to 1.
        lower: lower bound of the position.
        upper: upper bound of the position.
    """

    is_there: Array
    value: Array
    part: Array
    lower: Array
    upper: Array

    def times(self, since: Array, step: Array) -> Array:
        """Time of the minimum and its two bounds, the second sample being at `since`, (3, stops)."""
        return since - step * (1 - jnp.stack([self.part, self.lower, self.upper]))


def dip(before: list[Array], now: list[Array], step: Array, has_left: Array) -> Dip:
    """Lowest minimum of the polynomial with the values and derivatives of two samples.

    A zero slope at the first sample counts as a turn, because the minimum may lie where the cycle begins or another
    stop is hit. It does not count for a mass that `has_left` its stop there.
    """
    ends = jnp.stack([a * step**order for side in (before, now) for order, a in enumerate(side)])
    values, slopes = (jnp.tensordot(jnp.asarray(m, ends.dtype), ends, 1) for m in _at_nodes(len(before)))
    largest = jnp.max(jnp.abs(ends), axis=0)
    none = NO_SLOPE * jnp.finfo(ends.dtype).eps * largest
    first = jnp.where(has_left, largest + 1, slopes[0] - none)
    slopes = jnp.concatenate([first[None], slopes[1:]])
    turns = (slopes[:-1] < 0) & (slopes[1:] >= 0)
    widths = append_axes(jnp.asarray(np.diff(_NODES), ends.dtype), ends)
    first, last = (jnp.where(turns, widths * a, 0) for a in (slopes[:-1], slopes[1:]))
    share, depth = _minimum(first, last, jnp.diff(values, axis=0))
    lowest = jnp.where(turns, values[:-1] + depth, jnp.inf)
    before_it = jnp.broadcast_to(append_axes(jnp.asarray(_NODES[:-1], ends.dtype), ends), lowest.shape)
    at = jnp.argmin(lowest, axis=0)[None]
    pick = lambda a: jnp.take_along_axis(a, at, axis=0)[0]  # noqa: E731
    begin, width = pick(before_it), pick(jnp.broadcast_to(widths, lowest.shape))
    return Dip(jnp.any(turns, axis=0), pick(lowest), begin + width * pick(share), begin, begin + width)


def _minimum(first: Array, last: Array, rise: Array) -> tuple[Array, Array]:
    """Position and value of the minimum on [0, 1] of a cubic, 0 at 0, with slopes negative at 0, nonnegative at 1."""
    bend, twist = 3 * rise - 2 * first - last, 3 * (first + last - 2 * rise)
    root = bend + jnp.sqrt(jnp.maximum(bend * bend - twist * first, 0))
    at = jnp.where(root > 0, -first / jnp.where(root > 0, root, 1), 0)
    return at, at * (first + at * (bend + at * twist / 3))


@cache
def _at_nodes(num: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from `num` values and derivatives at 0 and at 1 to the polynomial and its slope at `_NODES`.

    By its Bernstein coefficients: those near 0 are sums of the values at 0 alone, those near 1 likewise.
    """
    degree = 2 * num - 1
    coefficients = np.zeros((2 * num, 2 * num))
    for k in range(num):
        for order in range(k + 1):
            share = comb(k, order) / perm(degree, order)
            coefficients[k, order] = share
            coefficients[degree - k, num + order] = (-1) ** order * share
    slopes = degree * np.diff(coefficients, axis=0)
    return _bernstein(degree) @ coefficients, _bernstein(degree - 1) @ slopes


def _bernstein(degree: int) -> np.ndarray:
    """Bernstein polynomials of a degree at `_NODES`, (nodes, degree + 1)."""
    x = _NODES[:, None]
    powers = np.arange(degree + 1)
    return np.array([comb(degree, k) for k in powers]) * x**powers * (1 - x) ** (degree - powers)
