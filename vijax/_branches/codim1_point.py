"""Corrected point of a curve of bifurcations and its properties, compiled."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Reals
from .._jax.xla import jit_quickly
from .._orbits.condensation import condense
from .._orbits.cycle import residual_and_moments
from .._orbits.floquet import floquet_multipliers
from .._orbits.linear_cycle import linearise
from .._orbits.rigid_modes import all_shifts
from .._orbits.search import frame_offset
from .._orbits.sequence import Sequence, num_erased
from .admissibility import margins_of_cycle
from .cycle_derivatives import jacobian
from .defining_systems import DefiningSystem, Plane, solve
from .margin_scan import LeastMargins
from .parameter_family import ExtendedCycle, ParameterFamily


class LinearisedReturn(NamedTuple):
    """Linearised return of the neighbours of a cycle.

    Attributes:
        multipliers: (2 n,).
        fold: determinant that vanishes where a multiplier is 1, whatever the others are.
        independence: least singular value of [Z N], see `condensation.py`, zero where every number is a multiplier.
    """

    multipliers: Reals
    fold: Reals
    independence: Reals


class CycleOnCurve(NamedTuple):
    """A cycle on a curve of bifurcations, its tangent, and its speeds of approach at the impacts, (events,)."""

    place: ExtendedCycle
    tangent: ExtendedCycle
    speeds: Reals


class CurvePoint(NamedTuple):
    """Point of a curve of bifurcations.

    Attributes:
        y: unknowns of its defining system.
        tangent: of the curve, of length 1, in the direction of the weights of the plane.
        place: the cycle and both parameters.
        direction: derivatives of both parameters along the curve, (2,).
        own: unknowns of the condition.
        start: state at the start of the cycle, (2 n,).
        speeds: of approach at the impacts, (events,).
        residual: largest error of the closing, scaled.
        watched: least gaps and contact forces between events.
        num_steps: number of Newton steps.
        is_found: whether Newton's method converged.
    """

    y: Reals
    tangent: Reals
    place: ExtendedCycle
    direction: Reals
    own: Reals
    start: Reals
    speeds: Reals
    residual: Reals
    watched: LeastMargins
    num_steps: Int[Array, ""]
    is_found: Bool[Array, ""]

    @property
    def found(self) -> CycleOnCurve:
        """The cycle, as test functions of a sequence read that of a branch."""
        first = len(self.place.z)
        flights = self.tangent[first : first + len(self.place.flights)]
        return CycleOnCurve(
            self.place, ExtendedCycle(self.tangent[:first], flights, self.direction), self.speeds
        )


@jit_quickly
def correct_in_plane(defining: DefiningSystem, guess: Float[Array, " unknowns"], plane: Plane) -> CurvePoint:
    """Point of a curve in a plane, by Newton's method from a guess."""
    solved = solve(defining, guess, plane)
    defining, y = solved.defining, jnp.where(solved.is_found, solved.y, guess)
    place, own = defining.place(y)
    problem, unknowns = defining.family.problem(defining.sequence, place.p), defining.family.unknowns(place)
    found, begins = residual_and_moments(problem, unknowns)
    tangent = _tangent(solved.matrix)
    return CurvePoint(
        y=y,
        tangent=tangent,
        place=place,
        direction=defining.place(tangent)[0].p,
        own=own,
        start=unknowns.z - frame_offset(problem),
        speeds=found.speed,
        residual=jnp.max(jnp.abs(found.closing / defining.family.scale)),
        watched=margins_of_cycle(problem, unknowns, begins),
        num_steps=solved.num_steps,
        is_found=solved.is_found,
    )


def _tangent(matrix: Float[Array, "unknowns unknowns"]) -> Float[Array, " unknowns"]:
    tangent = jnp.linalg.solve(matrix, jnp.zeros(len(matrix)).at[-1].set(1))
    return tangent / jnp.linalg.norm(tangent)


@jit_quickly
def neighbours(family: ParameterFamily, sequence: Sequence, place: ExtendedCycle) -> LinearisedReturn:
    """Linearised return of the neighbours of a cycle with these events."""
    problem, unknowns = family.problem(sequence, place.p), family.unknowns(place)
    pencil = condense(linearise(problem, unknowns, family.scale)[1]).pencil
    erased = num_erased(sequence, problem.machine.contacts.num_sliders)
    return LinearisedReturn(
        floquet_multipliers(pencil, erased, all_shifts(problem.shifts, problem.drift)),
        jnp.linalg.det(jacobian(family, sequence, place)),
        jnp.linalg.svd(jnp.hstack([pencil.end, pencil.start]), compute_uv=False)[-1],
    )
