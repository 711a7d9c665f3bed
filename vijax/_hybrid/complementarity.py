"""Linear complementarity: w = q + G p with w >= 0, p >= 0 and w . p = 0.

Pivots find the set of positive p, one at a time: each exchanges the first entry with a wrong sign. For a positive
definite G they end at the unique solution (K. G. Murty, Linear Algebra Appl. 7 (1974)). A semi-definite G, with
dependent rows, is first treated as definite; then dependent rows are removed from the set of positive p, with no p
turning negative. p and w follow from this set, exactly and differentiably. The sizes are those of contacts closed at
one instant: small.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import matvec
from .._jax.concrete import stop_gradients
from .._jax.xla import is_any
from .._machine.small_matrices import diagonal, inverse_among

# Maximum number of pivots: the number of subsets of six contacts.
_PIVOTS = 64


def solve_complementarity(
    matrix: Float[Array, "contacts contacts ..."],
    q: Float[Array, "contacts ..."],
    allowed: Bool[Array, "contacts ..."],
) -> tuple[Bool[Array, "contacts ..."], Float[Array, "contacts ..."], Float[Array, "contacts ..."]]:
    """Solve the complementarity problem among the allowed contacts.

    Args:
        matrix: G, symmetric positive semi-definite.
        q: the value of w without p.
        allowed: the contacts that may have p > 0; the others have p = 0.

    Returns:
        Flags of the contacts that carry p, with independent rows; p; and w, exactly zero where it is zero to rounding.
    """
    noise = 16 * len(matrix) * float(jnp.finfo(matrix.dtype).eps)
    alone = allowed & (q <= 0)  # a single closed contact carries p unless it opens with p = 0
    members, closed = jax.lax.cond(
        is_any(jnp.sum(allowed, axis=0) > 1),
        lambda: _active_set(*stop_gradients((matrix, q)), allowed, noise),
        lambda: (alone, alone),
    )
    p = -matvec(inverse_among(matrix, members), q)
    w = q + matvec(matrix, p)
    # Rounding errors of w open no contact.
    is_zero = closed | (allowed & (w <= noise * (jnp.abs(q) + matvec(jnp.abs(matrix), p))))
    return members, p, jnp.where(is_zero, 0, w)


def _active_set(matrix: Array, q: Array, allowed: Array, noise: float) -> tuple[Array, Array]:
    """Flags of contacts that carry p, with independent rows, and of those with w = 0, among several allowed ones."""
    known = _regularised(matrix, allowed)

    def wrong(members: Array) -> Array:
        # With a tolerance of rounding: a contact that shares no inertia with the others has p = 0, not a negative p.
        inverse = inverse_among(known, members)
        p, size_of_p = -matvec(inverse, q), matvec(jnp.abs(inverse), jnp.abs(q))
        w, size = q + matvec(known, p), jnp.abs(q) + matvec(jnp.abs(known), size_of_p)
        return allowed & (jnp.where(members, p, w) < -noise * jnp.where(members, size_of_p, size))

    def goes_on(carry: tuple) -> Array:
        return is_any(jnp.any(carry[1])) & (carry[2] < _PIVOTS)

    def pivot(carry: tuple) -> tuple:
        members, _, count = carry
        bad = wrong(members)
        return members ^ (bad & (jnp.cumsum(bad, axis=0) == 1)), bad, count + 1

    closed, _, _ = jax.lax.while_loop(goes_on, pivot, (allowed, allowed, jnp.array(0)))
    return _independent_rows(matrix, -matvec(inverse_among(known, closed), q), closed), closed


def _independent_rows(matrix: Array, p: Array, members: Array) -> Array:
    """Subset of `members` with independent rows and the same total effect, with no negative p.

    The p of a dependent row is transferred to the rows it depends on until it, or one of theirs, reaches zero.
    """

    def spare(members: Array, inverse: Array) -> Array:
        is_spare = members & (diagonal(inverse) == 0)
        return is_spare & (jnp.cumsum(is_spare, axis=0) == 1)

    def goes_on(carry: tuple) -> Array:
        return is_any(jnp.any(spare(carry[0], inverse_among(matrix, carry[0])), axis=0))

    def hand_over(carry: tuple) -> tuple:
        members, p = carry
        inverse = inverse_among(matrix, members)
        one = spare(members, inverse)
        gain = matvec(inverse, jnp.sum(matrix * one[None], axis=1)) - one
        falls = members & (gain < 0)
        lasts = jnp.where(falls, jnp.maximum(p, 0) / jnp.where(falls, -gain, 1), jnp.inf)
        shortest = jnp.min(lasts, axis=0)
        gone = falls & (lasts == shortest)
        gone = gone & (jnp.cumsum(gone, axis=0) == 1)
        moved = p + jnp.where(shortest < jnp.inf, shortest, 0) * gain
        return members & ~gone, jnp.where(gone, 0, moved)

    return jax.lax.while_loop(goes_on, hand_over, (members, p))[0]


def _regularised(matrix: Array, allowed: Array) -> Array:
    """Matrix with a slightly larger diagonal (compliance of each contact) where allowed rows are dependent.

    This decides between dependent contacts too: a faster wall takes over a mass that rests on another one. The
    increase is sqrt(eps), since the inverse loses as many digits.
    """
    size = len(matrix)
    little = 1 + np.eye(size) * float(jnp.finfo(matrix.dtype).eps) ** 0.5
    yielding = matrix * jnp.asarray(little.reshape(size, size, *[1] * (matrix.ndim - 2)), matrix.dtype)
    is_singular = jnp.any(allowed & (diagonal(inverse_among(matrix, allowed)) == 0), axis=0)
    return jnp.where(is_singular, yielding, matrix)
