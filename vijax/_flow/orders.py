"""Polynomials whose coefficients stand in an array, orders first: few operations, for programs of one trajectory.

Coefficients in lists are summed by Horner's scheme, two operations for each order, which a batch of trajectories takes faster.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Scalar, append_axes
from .._jax.xla import compute_once
from .series import derivative, horner

# Coefficients order by order: a list, or an array with the orders first.
Orders = list[Array] | Array


def as_array(c: Orders) -> Array:
    """Coefficients as an array."""
    return jnp.stack(c) if isinstance(c, list) else c


def value_of(c: Orders, u: Scalar) -> Array:
    """Value of a polynomial at u."""
    return horner(c, u) if isinstance(c, list) else compute_once(_by_halves, c, u)


def slope_of(c: Orders) -> Orders:
    """Coefficients of the derivative of a polynomial."""
    if isinstance(c, list):
        return derivative(c)
    return c[1:] * append_axes(jnp.arange(1, len(c), dtype=c.dtype), c)


def _by_halves(c: Float[Array, "orders ..."], u: Scalar) -> Array:
    """Value by Estrin's scheme: a polynomial in u of neighbouring coefficients is one of half as many in u^2."""
    most = jnp.finfo(c.dtype).max  # zero times infinity would be no number
    size = 1 << (len(c) - 1).bit_length()
    c = jnp.pad(c, [(0, size - len(c)), *[(0, 0)] * (c.ndim - 1)])
    while len(c) > 1:
        c = c[::2] + u * c[1::2]
        u = jnp.minimum(u * u, most)
    return c[0]
