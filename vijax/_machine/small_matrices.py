"""Small symmetric matrices over contacts or masses, lanes last."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

# Number of contacts up to which sweeps are unrolled; more are a loop, which compiles faster.
_UNROLLED = 2


def inverse_among(
    matrix: Float[Array, "contacts contacts ..."], members: Bool[Array, "contacts ..."]
) -> Float[Array, "contacts contacts ..."]:
    """Inverse of the block of a symmetric matrix that belongs to the members; zero elsewhere.

    By one sweep per member. A member whose row depends on those before it, to rounding, is left out.

    References:
        J. H. Goodnight, A tutorial on the sweep operator, Am. Stat. 33 (1979).
    """
    size, a = len(matrix), matrix + jnp.zeros_like(members, matrix.dtype)[None]
    slack = slack_of(matrix)

    def sweep(a: Array, k: Array | int) -> tuple[Array, Array]:
        here = (jnp.arange(size) == k).reshape(-1, *[1] * (a.ndim - 2))
        pivot, row, column = a[k, k], a[k], a[:, k]
        is_member = members[k] & (pivot > slack * matrix[k, k])
        pivot = jnp.where(is_member, pivot, 1)
        row = row / pivot
        rest = a - column[:, None] * row[None]
        rest = jnp.where(here[:, None], row[None], jnp.where(here[None], (-column / pivot)[:, None], rest))
        rest = jnp.where(here[:, None] & here[None], 1 / pivot, rest)
        return jnp.where(is_member, rest, a), is_member

    if size <= _UNROLLED:
        swept = []
        for k in range(size):
            a, is_member = sweep(a, k)
            swept.append(is_member)
        inside = jnp.stack(swept) if size else members
    else:
        a, inside = jax.lax.scan(sweep, a, jnp.arange(size))
    return jnp.where(inside[:, None] & inside[None], a, 0)


def slack_of(matrix: Float[Array, "contacts contacts ..."]) -> float:
    """Rounding error of G, and of its remainder in sweeps, relative to the terms of the sums."""
    return 64 * len(matrix) * float(jnp.finfo(matrix.dtype).eps)


def diagonal(matrix: Float[Array, "contacts contacts ..."]) -> Float[Array, "contacts ..."]:
    """Diagonal of a matrix, lanes last."""
    return jnp.stack([matrix[j, j] for j in range(len(matrix))]) if len(matrix) else matrix[:, 0]
