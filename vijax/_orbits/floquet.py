"""Floquet multipliers: growth factors of an orbit's neighbours over one cycle.

A multiplier mu has neighbours with dz1 = mu dz0, so it is an eigenvalue of the pencil (Z, N) of dz1 = Z c, dz0 = N c.
Where an impact grazes, N is singular and mu infinite; where a mass sticks, Z is singular and mu zero. So neither
matrix is inverted: nu = (mu - s) / (mu + s) maps infinity to 1 and zero to -1, and the nu are the eigenvalues of
(Z + s N)^-1 (Z - s N). Of two s of opposite sign, the one whose Z + s N is farther from singular is taken.
"""

from inspect import signature
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from .condensation import Pencil
from .rigid_modes import deflated

# Not +1 and -1: Z + s N would be singular for the multipliers -1 and +1, which mark bifurcations.
_SHIFTS = 0.87, -1.13
# An impact located as a grazing has a speed of some roundings, and 1 - nu is as large. No other orbit comes near: at the
# distance d from a grazing 1 - nu is of the order of sqrt(d), 1e-8 where d is a rounding. In roundings of 1:
_GRAZING = 64
# Newer releases of JAX differentiate eigenvectors only on request. Second derivatives of multipliers need it; they
# exist where the multipliers are distinct.
_OPTIONS = signature(jax.lax.linalg.eig).parameters
_SECOND_DERIVATIVES: dict[str, Any] = (
    {"enable_eigvec_derivs": True} if "enable_eigvec_derivs" in _OPTIONS else {}
)


def floquet_multipliers(
    pencil: Pencil, num_erased: Int[Array, ""], shifts: Float[Array, "n n"]
) -> Complex[Array, " state"]:
    """The Floquet multipliers, largest magnitude first.

    Args:
        pencil: of the orbit's neighbours.
        num_erased: the most directions of the state that a flight has lost, two for a held mass. The cycle forgets them,
            so as many multipliers are zero; those are set to zero exactly, without rounding errors.
        shifts: projection onto the rigid shifts, see `rigid_modes.py`: each has a multiplier 1.

    Returns:
        (2 n,), infinite where the orbit grazes.
    """
    end, start = deflated(pencil, shifts)
    first, second = (jnp.linalg.slogdet(end + s * start)[1] for s in _SHIFTS)
    shift = jnp.where(first >= second, *_SHIFTS)
    nu = _eigenvalues(jnp.linalg.solve(end + shift * start, end - shift * start))
    is_infinite = jnp.abs(1 - nu) <= _GRAZING * jnp.finfo(start.dtype).eps
    mu = jnp.where(is_infinite, jnp.inf, shift * (1 + nu) / jnp.where(is_infinite, 1, 1 - nu))
    num_shifts = jnp.round(jnp.trace(shifts)).astype(int)
    rank = len(mu) - 1 - jnp.arange(len(mu))
    mu = jnp.where(rank < num_shifts + num_erased, 0, _largest_first(mu))
    return _largest_first(jnp.where(rank < num_shifts, 1, mu))


def with_phase(mu: Complex[Array, " state"]) -> Complex[Array, " state"]:
    """Multipliers of an autonomous cycle from those of its section, where the direction along the cycle has a zero.

    Along the cycle neighbours neither approach nor leave: one multiplier is 1.
    """
    return _largest_first(jnp.where(jnp.arange(len(mu)) == len(mu) - 1, 1, mu))


def _largest_first(mu: Complex[Array, " state"]) -> Complex[Array, " state"]:
    return mu[jnp.argsort(-jnp.abs(jax.lax.stop_gradient(mu)), stable=True)]


@jax.custom_jvp
def _eigenvalues(matrix: Float[Array, "state state"]) -> Complex[Array, " state"]:
    """Eigenvalues. JAX's derivatives need a full set of eigenvectors, which a repeated zero does not have."""
    return jnp.linalg.eigvals(matrix)


@_eigenvalues.defjvp
def _eigenvalues_jvp(primals, tangents):
    (matrix,), (change,) = primals, tangents
    values, left, right = jax.lax.linalg.eig(matrix, compute_left_eigenvectors=True, **_SECOND_DERIVATIVES)
    moved = jnp.sum(left.conj() * (change.astype(right.dtype) @ right), axis=0)
    along = jnp.sum(left.conj() * right, axis=0)
    return values, moved / jnp.where(along == 0, 1, along)
