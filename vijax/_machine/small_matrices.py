"""Small symmetric matrices over contacts or masses, lanes last."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


def inverse_among(
    matrix: Float[Array, "contacts contacts ..."], members: Bool[Array, "contacts ..."]
) -> Float[Array, "contacts contacts ..."]:
    """Inverse of the block of a symmetric matrix that belongs to the members; zero elsewhere.

    By one sweep per member. A member whose row depends on those before it, to rounding, is left out.

    References:
        J. H. Goodnight, A tutorial on the sweep operator, Am. Stat. 33 (1979).
    """
    size = len(matrix)
    if size in _WRITTEN_OUT:
        return _WRITTEN_OUT[size](matrix, members)
    return _swept(matrix, members, slack_of(matrix) * diagonal(matrix), lambda pivot: pivot)


def inverse_of_block(
    matrix: Float[Array, "contacts contacts ..."],
    members: Bool[Array, "contacts ..."],
    size: Float[Array, "contacts ..."],
) -> Float[Array, "contacts contacts ..."]:
    """`inverse_among` for any square matrix, whose pivots vanish if they are rounding errors of `size`."""
    return _swept(matrix, members, slack_of(matrix) * size, jnp.abs)


def _swept(
    matrix: Array, members: Array, least: Array, size_of: Callable[[Array], Array]
) -> Float[Array, "contacts contacts ..."]:
    size = len(matrix)

    def sweep(a: Array, member: tuple[Any, Array, Array]) -> tuple[Array, Array]:
        here, is_member, least = member
        row = jnp.sum(jnp.where(here[:, None], a, 0), axis=0)
        column = jnp.sum(jnp.where(here[None], a, 0), axis=1)
        pivot = jnp.sum(jnp.where(here, row, 0), axis=0)
        is_member = is_member & (size_of(pivot) > least)
        pivot = jnp.where(is_member, pivot, 1)
        row = jnp.where(here, 1, row) / pivot
        rest = jnp.where(here[None], (-column / pivot)[:, None], a - column[:, None] * row[None])
        return jnp.where(is_member, jnp.where(here[:, None], row[None], rest), a), is_member

    heres = np.eye(size, dtype=bool).reshape(size, size, *[1] * (members.ndim - 1))
    start = matrix + jnp.zeros_like(members, matrix.dtype)[None]
    inverse, inside = jax.lax.scan(sweep, start, (heres, members, least))
    return jnp.where(inside[:, None] & inside[None], inverse, 0)


def _inverse_of_one(
    matrix: Float[Array, "1 1 ..."], members: Bool[Array, "1 ..."]
) -> Float[Array, "1 1 ..."]:
    is_member = members[None] & (matrix > 0)
    return jnp.where(is_member, 1 / jnp.where(is_member, matrix, 1), 0)


def _inverse_of_two(
    matrix: Float[Array, "2 2 ..."], members: Bool[Array, "2 ..."]
) -> Float[Array, "2 2 ..."]:
    """The two sweeps written out: they are most of the program of a machine with two contacts."""
    (first, beside), last = matrix[0], matrix[1, 1]
    has_first = members[0] & (first > 0)
    first = jnp.where(has_first, first, 1)
    share = jnp.where(has_first, beside / first, 0)
    rest = last - beside * share
    has_last = members[1] & (rest > slack_of(matrix) * last)
    rest = jnp.where(has_last, rest, 1)
    both = jnp.where(has_last, -share / rest, 0)
    own = jnp.where(has_first, 1 / first, 0) - share * both, jnp.where(has_last, 1 / rest, 0)
    return jnp.stack([jnp.stack([own[0], both]), jnp.stack([both, own[1]])])


_WRITTEN_OUT = {0: lambda matrix, _: matrix, 1: _inverse_of_one, 2: _inverse_of_two}


def slack_of(matrix: Float[Array, "contacts contacts ..."]) -> float:
    """Rounding error of G, and of its remainder in sweeps, relative to the terms of the sums."""
    return 64 * len(matrix) * float(jnp.finfo(matrix.dtype).eps)


def diagonal(matrix: Float[Array, "contacts contacts ..."]) -> Float[Array, "contacts ..."]:
    """Diagonal of a matrix, lanes last."""
    return jnp.stack([matrix[j, j] for j in range(len(matrix))]) if len(matrix) else matrix[:, 0]
