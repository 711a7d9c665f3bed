"""A point of a curve of bifurcations, corrected, and what is known of it; compiled."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Reals
from .._jax.xla import jit_lightly
from .._orbits.condensation import condense
from .._orbits.cycle import linearise, residual
from .._orbits.floquet import floquet_multipliers
from .._orbits.search import away_from_stops
from .._orbits.sequence import Sequence
from .admissibility import LeastMargins, margins_of_cycle
from .defining_systems import Defining, Plane, solve
from .kernels import jacobian
from .parameter_family import ExtendedCycle, Family


class Neighbours(NamedTuple):
    """How the neighbours of a cycle come back.

    Attributes:
        multipliers: (2 n,).
        fold: a determinant that vanishes where a multiplier is 1, whatever the others are.
        independence: the least singular value of all that is known of them: zero where a multiplier can be anything.
    """

    multipliers: Reals
    fold: Reals
    independence: Reals


class OnCurve(NamedTuple):
    """A point of a curve.

    Attributes:
        y: the unknowns of its defining system.
        tangent: of the curve, of length 1, in the direction of the weights that led here.
        place: the cycle and both parameters.
        direction: how both change along the curve, (2,).
        own: unknowns of the condition.
        start: the state where the cycle begins, (2 n,).
        speeds: at the impacts, (events,).
        residual: of the closing.
        watched: what happens between events.
        num_steps: of Newton's method.
        is_found: whether it came to a point.
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
    def found(self) -> "OnCurve":
        """Itself: the tests of a sequence read a cycle as branches have it."""
        return self


@jit_lightly
def located(defining: Defining, guess: Float[Array, " unknowns"], plane: Plane) -> OnCurve:
    """The point of a curve in a plane."""
    solved = solve(defining, guess, plane)
    defining, y = solved.defining, jnp.where(solved.is_found, solved.y, guess)
    place, own = defining.place(y)
    problem, unknowns = defining.family.problem(defining.sequence, place.p), defining.family.unknowns(place)
    found = residual(problem, unknowns)
    tangent = _tangent(solved.matrix)
    return OnCurve(
        y=y,
        tangent=tangent,
        place=place,
        direction=defining.place(tangent)[0].p,
        own=own,
        start=unknowns.z - away_from_stops(problem),
        speeds=found.speed,
        residual=jnp.max(jnp.abs(found.closing / defining.family.scale)),
        watched=margins_of_cycle(problem, unknowns),
        num_steps=solved.num_steps,
        is_found=solved.is_found,
    )


def _tangent(matrix: Float[Array, "unknowns unknowns"]) -> Float[Array, " unknowns"]:
    tangent = jnp.linalg.solve(matrix, jnp.zeros(len(matrix)).at[-1].set(1))
    return tangent / jnp.linalg.norm(tangent)


@jit_lightly
def neighbours(family: Family, sequence: Sequence, place: ExtendedCycle) -> Neighbours:
    """How the neighbours of a cycle come back that has these events."""
    problem, unknowns = family.problem(sequence, place.p), family.unknowns(place)
    pencil = condense(linearise(problem, unknowns, family.scale)[1]).pencil
    return Neighbours(
        floquet_multipliers(pencil, sequence.most_held, problem.shifts),
        jnp.linalg.det(jacobian(family, sequence, place)),
        jnp.linalg.svd(jnp.hstack([pencil.end, pencil.start]), compute_uv=False)[-1],
    )
