"""Bounds of the frequencies and decay rates of a machine, by norms of its matrices."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Scalar, matrix_product, over_lanes
from .numbers import MachineNumbers
from .small_matrices import diagonal
from .switching import SwitchingContacts


def rate_with_closed(numbers: MachineNumbers, contacts: SwitchingContacts, rate: Scalar) -> Scalar:
    """Bound on the rate with any compliant contacts closed."""
    stiffness, damping = contacts.matrices_of(jnp.ones_like(contacts.limit, bool))
    names = lambda a: (a.stiffness, a.damping)  # noqa: E731
    closed = eqx.tree_at(names, numbers, (numbers.stiffness + stiffness, numbers.damping + damping))
    has_full_mass = numbers.mass.ndim == numbers.stiffness.ndim
    pairs = [_unit_matrices(one, of_unit_mass(one) if has_full_mass else None) for one in (numbers, closed)]
    w2, d = (_bound_between(*pair) for pair in zip(*pairs, strict=True))
    if contacts.laws.is_tied:
        w2, d = (
            w2 + _of_friction(contacts, contacts.laws.stiffness),
            d + _of_friction(contacts, contacts.laws.damping),
        )
    return jnp.maximum(rate, _rate_of(w2, d))


def _of_friction(contacts: SwitchingContacts, numbers: Array) -> Scalar:
    """Bound of the norm of k mu g^T a of all friction elements of compliant contacts, for unit masses."""
    size = jnp.sqrt(diagonal(contacts.compliance))
    of_contacts = contacts.at_normal(numbers * size)
    return jnp.sum(
        jnp.where(contacts.are_tied, contacts.laws.static_coefficient * size * of_contacts, 0), axis=0
    )


def _bound_between(a: Float[Array, "n n ..."], b: Float[Array, "n n ..."]) -> Scalar:
    """Bound the norm of a + c for every c with 0 <= c <= b - a, symmetric.

    Eigenvalues of the symmetric part lie between those of a and b, the skew part is that of a.
    """
    halves = [(m + jnp.swapaxes(m, 0, 1)) / 2 for m in (a, b)]
    return jnp.maximum(*map(_norm, halves)) + _norm(a - halves[0])


class UnitMass(NamedTuple):
    """M^-1, and damping and stiffness in the coordinates y = L^T x, M = L L^T, of unit masses."""

    inverse_mass: Float[Array, "n n ..."]
    damping: Float[Array, "n n ..."]
    stiffness: Float[Array, "n n ..."]


def of_unit_mass(numbers: MachineNumbers) -> UnitMass:
    def of_one(mass: Array, *others: Array) -> UnitMass:
        back = jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(mass), jnp.eye(len(mass)), lower=True)
        return UnitMass(back.T @ back, *(back @ other @ back.T for other in others))

    matrices = numbers.mass, numbers.damping, numbers.stiffness
    like = numbers.mass[0] + numbers.damping[0] + numbers.stiffness[0]
    return over_lanes(of_one, like, *matrices)


def rate_of_motion(numbers: MachineNumbers, unit: UnitMass | None) -> Scalar:
    """Bound the norm of the first-order matrix of the machine, see `_rate_of`; holding masses can only reduce it."""
    w2, d = map(_norm, _unit_matrices(numbers, unit))
    return _rate_of(w2, d)


def _unit_matrices(numbers: MachineNumbers, unit: UnitMass | None) -> tuple[Array, Array]:
    """Stiffness and damping in coordinates of unit masses."""
    if unit is not None:
        return unit.stiffness, unit.damping
    root = jnp.sqrt(numbers.mass)
    scale = root[:, None] * root[None]
    return numbers.stiffness / scale, numbers.damping / scale


def _rate_of(w2: Scalar, d: Scalar) -> Scalar:
    """Bound the norm of the first-order matrix from the norms w^2 and d of K and C, for unit masses.

    For (w x, x') the matrix is [[0, w], [-K / w, -C]]. The norms of its blocks are at most w, w and d, so its norm is at
    most that of [[0, w], [w, d]], (d + sqrt(d^2 + 4 w^2)) / 2. No symmetry is needed.
    """
    return (d + jnp.sqrt(d * d + 4 * w2)) / 2


def _norm(matrix: Float[Array, "n n ..."]) -> Scalar:
    """Bound the largest singular value of a matrix A: the Frobenius norm of (A^T A)^2, to the 1/4.

    A bound has no derivative: that of a matrix without entries would be NaN.
    """
    matrix = jax.lax.stop_gradient(matrix)
    largest = jnp.max(jnp.abs(matrix), axis=(0, 1))
    unit = matrix / jnp.where(largest > 0, largest, 1.0)
    unit = matrix_product(jnp.swapaxes(unit, 0, 1), unit)
    unit = matrix_product(unit, unit)
    return largest * jnp.sum(unit * unit, axis=(0, 1)) ** 0.125
