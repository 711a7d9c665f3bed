"""Linear complementarity: w = q + G p with w >= 0, p >= 0 and w . p = 0.

Which entries of p are positive is decided by pivots, one at a time, the first that is wrong first. For a positive
definite G that ends at the one solution (K. G. Murty, Linear Algebra Appl. 7 (1974)). A semi-definite one, of rows that depend
on each other, is decided as if it were definite; of those that then bear, as many are let off as depend on others,
such that no p turns negative. What belongs to this set is
then computed from it, exactly and differentiably. Sizes are those of contacts closed at one instant: few.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import matvec, stop_gradients
from .._jax.xla import is_any
from .._machine.small_matrices import diagonal, inverse_among

# The most pivots; as many as there are sets of six contacts.
_PIVOTS = 64


def complementary(
    matrix: Float[Array, "contacts contacts ..."],
    q: Float[Array, "contacts ..."],
    allowed: Bool[Array, "contacts ..."],
) -> tuple[Bool[Array, "contacts ..."], Float[Array, "contacts ..."], Float[Array, "contacts ..."]]:
    """Solve the problem among the allowed contacts.

    Args:
        matrix: G, symmetric positive semi-definite.
        q: the value of w without p.
        allowed: the contacts concerned; the others have p = 0.

    Returns:
        Which bear p, no row depending on those of others that do; p; and w, exactly zero where it is so to rounding.
    """
    noise = 16 * len(matrix) * float(jnp.finfo(matrix.dtype).eps)
    alone = allowed & (q <= 0)  # where no other is closed, a contact bears unless it opens by itself
    members, closed = jax.lax.cond(
        is_any(jnp.sum(allowed, axis=0) > 1),
        lambda: _of_several(*stop_gradients((matrix, q)), allowed, noise),
        lambda: (alone, alone),
    )
    p = -matvec(inverse_among(matrix, members), q)
    w = q + matvec(matrix, p)
    # What is rounding opens nothing.
    is_zero = closed | (allowed & (w <= noise * (jnp.abs(q) + matvec(jnp.abs(matrix), p))))
    return members, p, jnp.where(is_zero, 0, w)


def _of_several(matrix: Array, q: Array, allowed: Array, noise: float) -> tuple[Array, Array]:
    """Which of several contacts bear, of these rows no one depending on others, and where w = 0."""
    known = _decidable(matrix, allowed)

    def wrong(members: Array) -> Array:
        # To rounding: a contact that shares nothing with the others gets no impulse, and not a negative one.
        inverse = inverse_among(known, members)
        p, size_of_p = -matvec(inverse, q), matvec(jnp.abs(inverse), jnp.abs(q))
        w, size = q + matvec(known, p), jnp.abs(q) + matvec(jnp.abs(known), size_of_p)
        return allowed & jnp.where(members, p < -noise * size_of_p, w < -noise * size)

    def goes_on(carry: tuple) -> Array:
        return is_any(jnp.any(carry[1])) & (carry[2] < _PIVOTS)

    def pivot(carry: tuple) -> tuple:
        members, _, count = carry
        bad = wrong(members)
        return members ^ (bad & (jnp.cumsum(bad, axis=0) == 1)), bad, count + 1

    closed, _, _ = jax.lax.while_loop(goes_on, pivot, (allowed, allowed, jnp.array(0)))
    return _independent(matrix, -matvec(inverse_among(known, closed), q), closed), closed


def _independent(matrix: Array, p: Array, members: Array) -> Array:
    """Members of which no row depends on others, that bear the same without any p negative.

    The p of a row that depends on others is handed over to these, until it or one of theirs is gone, whichever is first.
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


def _decidable(matrix: Array, allowed: Array) -> Array:
    """The matrix; where rows of it depend on each other with a little more compliance of each contact by itself.

    So that of these it is decided as well which bear a force: a mass that rests on one wall is taken over by another that
    is faster. By the root of a rounding: as much is lost in the inverse.
    """
    size = len(matrix)
    little = 1 + np.eye(size) * float(jnp.finfo(matrix.dtype).eps) ** 0.5
    yielding = matrix * jnp.asarray(little.reshape(size, size, *[1] * (matrix.ndim - 2)), matrix.dtype)
    is_singular = jnp.any(allowed & (diagonal(inverse_among(matrix, allowed)) == 0), axis=0)
    return jnp.where(is_singular, yielding, matrix)
