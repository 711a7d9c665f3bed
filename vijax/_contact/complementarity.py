"""Linear complementarity: w = q + G p with w >= 0, p >= 0 and w . p = 0.

Which entries of p are positive is decided by pivots, one at a time, the first that is wrong first. For a positive
definite G that ends at the one solution (K. G. Murty, Linear Algebra Appl. 7 (1974)). A semi-definite one, of rows that depend
on each other, is decided as if it were definite. What belongs to this set is
then computed from it, exactly and differentiably. Sizes are those of contacts closed at one instant: few.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._machine.rows import inverse_among
from .._types import constant, matvec
from .._xla import is_any

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
        The set where w = 0, p, and w, which is exactly zero on the set.
    """
    known, q_known = constant((_yielding(matrix), q))
    noise = 16 * len(matrix) * jnp.finfo(matrix.dtype).eps

    def wrong(members: Array) -> Array:
        # To rounding: a contact that shares nothing with the others gets no impulse, and not a negative one.
        inverse = inverse_among(known, members)
        p, size_of_p = -matvec(inverse, q_known), matvec(jnp.abs(inverse), jnp.abs(q_known))
        w, size = q_known + matvec(known, p), jnp.abs(q_known) + matvec(jnp.abs(known), size_of_p)
        return allowed & jnp.where(members, p < -noise * size_of_p, w < -noise * size)

    def goes_on(carry: tuple) -> Array:
        return is_any(jnp.any(carry[1])) & (carry[2] < _PIVOTS)

    def pivot(carry: tuple) -> tuple:
        members, _, count = carry
        bad = wrong(members)
        return members ^ (bad & (jnp.cumsum(bad, axis=0) == 1)), bad, count + 1

    members, _, _ = jax.lax.while_loop(goes_on, pivot, (allowed, allowed, jnp.array(0)))
    p = -matvec(inverse_among(matrix, members), q)
    return members, p, jnp.where(members, 0, q + matvec(matrix, p))


def _yielding(matrix: Float[Array, "contacts contacts ..."]) -> Float[Array, "contacts contacts ..."]:
    """The matrix with a little more compliance of each contact by itself.

    So that of rows that depend on each other it is decided as well which bear a force: a mass that rests on one wall is
    taken over by another that is faster.
    """
    size = len(matrix)
    little = np.eye(size) * (1 + 1024 * size * float(jnp.finfo(matrix.dtype).eps)) + (1 - np.eye(size))
    return matrix * jnp.asarray(little.reshape(size, size, *[1] * (matrix.ndim - 2)), matrix.dtype)
