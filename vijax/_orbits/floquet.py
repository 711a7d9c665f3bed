"""Floquet multipliers: how an orbit's neighbours come nearer, or go away.

A multiplier mu has neighbours with dz1 = mu dz0, so it is an eigenvalue of the pencil (Z, N) of dz1 = Z c, dz0 = N c.
Where an impact grazes, N is singular and mu infinite; where a mass sticks, Z is singular and mu zero. So neither is
inverted: nu = (mu - s) / (mu + s) maps infinity to 1 and zero to -1, and nu are the eigenvalues of
(Z + s N)^-1 (Z - s N). Of two s of unlike sign, the one with Z + s N farther from singular is taken.
"""

from inspect import signature
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from .condensation import Pencil
from .rigid_modes import without_shifts

# No round numbers, as multipliers of -1 and +1 are the ones looked for.
_SHIFTS = 0.87, -1.13
# Newer releases of JAX give derivatives of eigenvectors, here for second derivatives of multipliers, only on
# request: they exist where the multipliers differ from each other.
_OPTIONS = signature(jax.lax.linalg.eig).parameters
_SECOND_DERIVATIVES: dict[str, Any] = (
    {"enable_eigvec_derivs": True} if "enable_eigvec_derivs" in _OPTIONS else {}
)


def floquet_multipliers(
    pencil: Pencil, num_held: Int[Array, ""], shifts: Float[Array, "n n"]
) -> Complex[Array, " state"]:
    """The multipliers, those of the largest magnitude first.

    Args:
        pencil: of the orbit's neighbours.
        num_held: the most masses that are held at once. All that begins with other positions and velocities of them
            ends alike, so twice as many multipliers are zero: what rounding makes of those is put right.
        shifts: the projection onto those that nothing feels, see `rigid_modes.py`: each has a multiplier 1.

    Returns:
        (2 n,), infinite where the orbit grazes.
    """
    end, start = without_shifts(pencil, shifts)
    first, second = (jnp.linalg.slogdet(end + s * start)[1] for s in _SHIFTS)
    shift = jnp.where(first >= second, *_SHIFTS)
    nu = _eigenvalues(jnp.linalg.solve(end + shift * start, end - shift * start))
    eps = jnp.finfo(start.dtype).eps
    is_infinite = jnp.abs(1 - nu) <= 4 * eps
    mu = jnp.where(is_infinite, jnp.inf, shift * (1 + nu) / jnp.where(is_infinite, 1, 1 - nu))
    num_shifts = jnp.round(jnp.trace(shifts)).astype(int)
    rank = len(mu) - 1 - jnp.arange(len(mu))
    mu = jnp.where(rank < num_shifts + 2 * num_held, 0, _largest_first(mu))
    return _largest_first(jnp.where(rank < num_shifts, 1, mu))


def _largest_first(mu: Complex[Array, " state"]) -> Complex[Array, " state"]:
    return mu[jnp.argsort(-jnp.abs(jax.lax.stop_gradient(mu)), stable=True)]


@jax.custom_jvp
def _eigenvalues(matrix: Float[Array, "state state"]) -> Complex[Array, " state"]:
    """Eigenvalues. JAX's derivatives need a full set of eigenvectors, which several zeros do not have."""
    return jnp.linalg.eigvals(matrix)


@_eigenvalues.defjvp
def _eigenvalues_jvp(primals, tangents):
    (matrix,), (change,) = primals, tangents
    values, left, right = jax.lax.linalg.eig(matrix, compute_left_eigenvectors=True, **_SECOND_DERIVATIVES)
    moved = jnp.sum(left.conj() * (change.astype(right.dtype) @ right), axis=0)
    along = jnp.sum(left.conj() * right, axis=0)
    return values, moved / jnp.where(along == 0, 1, along)
