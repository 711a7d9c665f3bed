"""Motions that keep a symmetry, as motions of a smaller machine.

A motion with x = S x at all times for some symmetries S of a machine stays in a subspace, x = B y. There several stops are touched
at one instant, which are one stop of the smaller machine: it has a simple grazing where the whole has many. Neighbouring motions
leave the subspace, so multipliers are those of the whole machine, from the derivatives of a run over a period.
"""

from typing import NamedTuple

import jax
import numpy as np
import scipy.linalg
from jaxtyping import Array, Complex, Float

from .._jax.arrays import Reals
from .._jax.xla import compile_quickly
from .._orbits.autonomous import with_unit
from .._orbits.maps import monodromy_matrix
from .._system.compliant import AbstractCompliantLimit, CompliantContact
from .._system.contact import Contact
from .._system.parts import AnyStop
from .._system.system import ImpactSystem, mass_matrix
from .tolerances import ROUNDED


class Subspace(NamedTuple):
    """A machine that moves as another one does in a subspace.

    Attributes:
        system: the machine.
        basis: B, orthonormal, (n, m).
        stops: for each stop of the whole machine the one that it is a part of, or -1 if no motion comes near it.
    """

    system: ImpactSystem
    basis: np.ndarray
    stops: np.ndarray

    def counts(self, num_impacts: np.ndarray) -> np.ndarray:
        """Impacts at the stops of the whole machine, (points, stops)."""
        return np.where(self.stops < 0, 0, num_impacts[:, self.stops])

    def states(self, y: np.ndarray) -> np.ndarray:
        """Positions or velocities of the whole machine, (points, n)."""
        return y @ self.basis.T


def symmetric_subspace(system: ImpactSystem, shape: np.ndarray) -> Subspace | None:
    """The motions that have all symmetries of a shape; None where none of them touches several stops at once.

    Args:
        system: a machine without load, losses and friction.
        shape: positions, (n,).
    """
    kept = [s.matrix for s in system.symmetries() if not s.offset.any() and _is_kept(s.matrix, shape)]
    if not kept:
        return None
    basis = scipy.linalg.null_space(np.concatenate([matrix - np.eye(len(shape)) for matrix in kept]))
    laws = np.array([_law(stop, basis) for stop in system.stops]).reshape(len(system.stops), -1)
    size = np.abs(laws).max(axis=0, initial=0) + np.finfo(float).tiny
    parts: list[list[int]] = []
    for j in np.flatnonzero((np.abs(laws[:, 2:]) > ROUNDED).any(axis=1)):
        alike = [part for part in parts if (np.abs(laws[part[0]] - laws[j]) < ROUNDED * size).all()]
        if alike:
            alike[0].append(int(j))
        else:
            parts.append([int(j)])
    if all(len(part) == 1 for part in parts):
        return None
    stops = np.full(len(laws), -1)
    for k, part in enumerate(parts):
        stops[part] = k
    limits = [_limit(laws[part[0]], len(part)) for part in parts]
    of_basis = [basis.T @ np.asarray(a) @ basis for a in (mass_matrix(system.mass), system.stiffness)]
    mass, stiffness = ((a + a.T) / 2 for a in of_basis)
    return Subspace(ImpactSystem(mass, np.zeros_like(mass), stiffness, stops=limits), basis, stops)


def multipliers_of_whole(
    system: ImpactSystem, period: np.ndarray, x: np.ndarray, v: np.ndarray
) -> Complex[np.ndarray, "points state"]:
    """Multipliers of periodic motions whose impacts may happen at one instant, the largest first; NaN at a grazing.

    Args:
        system: the machine, which no load drives.
        period: their periods, (points,).
        x: positions on them, (points, n).
        v: velocities there, (points, n).
    """
    matrices = np.array(_returns(system, period, x, v))
    is_known = np.isfinite(matrices).all(axis=(1, 2))
    matrices[~is_known] = 0
    found = np.linalg.eigvals(matrices).astype(complex)
    found[~is_known] = np.nan
    return np.take_along_axis(found, np.argsort(-np.abs(found), axis=1, kind="stable"), axis=1)


@compile_quickly
def _returns(system: ImpactSystem, period: Reals, x: Reals, v: Reals) -> Float[Array, "points state state"]:
    def of_one(period: Array, x: Array, v: Array) -> Array:
        return monodromy_matrix(with_unit(system, period), x, v, throw=False)

    return jax.vmap(of_one)(period, x, v)


def _is_kept(matrix: np.ndarray, shape: np.ndarray) -> bool:
    return bool(np.abs(matrix @ shape - shape).max() < ROUNDED * np.abs(shape).max())


def _law(stop: AnyStop, basis: np.ndarray) -> np.ndarray:
    """Stiffness of a stop, -1 of a rigid one, its gap at rest, and its row in a basis."""
    stiffness = float(stop.stiffness) if isinstance(stop, AbstractCompliantLimit) else -1.0
    gap = float(stop.gap(np.zeros(len(basis)), np.zeros(())))
    return np.array([stiffness, gap, *(float(stop.along(column)) for column in basis.T)])


def _limit(law: np.ndarray, count: int) -> Contact | CompliantContact:
    """One stop in place of some of a law that are touched at once."""
    stiffness, gap, *row = map(float, law)
    coefficients = {k: a for k, a in enumerate(row) if a}
    if stiffness < 0:
        return Contact(coefficients, gap, 1.0)
    return CompliantContact(coefficients, gap, count * stiffness)
