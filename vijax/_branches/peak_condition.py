"""The condition by which a cycle is a peak: a quantity of it is stationary along the branch, see `defining_systems.py`."""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Reals, Scalar
from .._jax.xla import compile_quickly
from .._orbits.cycle import Problem, Unknowns, residual
from .._orbits.rigid_modes import closing_pin
from .defining_systems import AbstractCondition, DefiningSystem, TrialCycle
from .extremes import extreme_values
from .parameter_family import ExtendedCycle


class AtPeak(AbstractCondition):
    """Condition that a sum of extremes of the cycle is stationary along the branch, see `extremes.py`.

    Attributes:
        own: times of the extremes since the beginnings of their flights, in forcing periods, (terms,).
        signs: with which they are added, (terms,).
        coordinate: number of their coordinate.
        flights: their flights, (terms,).
        sides: of these, (terms,).
        weights: that choose the tangent, (unknowns,).
    """

    own: Reals
    signs: Reals
    coordinate: Reals
    flights: Reals
    sides: Reals
    weights: Reals

    def begun(self, cycle):
        matrix = jax.jacfwd(_of_cycle(cycle))(_one_parameter(cycle))
        return replace(self, weights=jnp.linalg.svd(matrix)[2][-1])

    def values(self, cycle, own):
        y, along = _one_parameter(cycle), jnp.zeros_like(self.weights).at[-1].set(1)
        matrix = jnp.vstack([jax.jacfwd(_of_cycle(cycle))(y), self.weights[None]])
        tangent = jnp.linalg.solve(matrix, along)
        slope = jax.jvp(lambda y: self._of(cycle, y, own)[0], (y,), (tangent,))[1]
        _, rates, ends = self._of(cycle, y, own)
        return jnp.append(jnp.where(self.sides == 0, rates, own - ends), slope)

    def height(self, cycle: TrialCycle, own: Float[Array, " own"]) -> Scalar:
        """The quantity, in space."""
        return self._of(cycle, _one_parameter(cycle), own)[0] * self._scale(cycle)

    def _scale(self, cycle: TrialCycle) -> Scalar:
        return jnp.asarray(cycle.family.scale)[self.coordinate]

    def _of(self, cycle: TrialCycle, y: Array, own: Array) -> tuple[Scalar, Array, Array]:
        """The scaled quantity, the rates of its terms by time, and the ends of their flights."""
        problem, unknowns = _at(cycle, y)
        values, rates, ends = extreme_values(problem, unknowns, self.flights, own, self.sides)
        read = lambda a: a[:, self.coordinate] / self._scale(cycle)  # noqa: E731
        return jnp.sum(self.signs * read(values)), read(rates), ends


def _one_parameter(cycle: TrialCycle) -> Float[Array, " free"]:
    """Unknowns of a cycle with the first parameter alone."""
    place = cycle.place
    return jnp.concatenate([place.z, place.flights, jnp.ravel(place.p)[:1]])


def _at(cycle: TrialCycle, y: Float[Array, " free"]) -> tuple[Problem, Unknowns]:
    """Equations and cycle at some unknowns, a second parameter as it is."""
    size, p = len(cycle.place.z), cycle.place.p
    place = ExtendedCycle(y[:size], y[size:-1], y[-1] if p.ndim == 0 else p.at[0].set(y[-1]))
    return cycle.family.problem(cycle.problem.sequence, place.p), cycle.family.unknowns(place)


def _of_cycle(cycle: TrialCycle) -> Callable[[Array], Array]:
    """Scaled residuals as a function of the unknowns, with the shifts that nothing feels kept as they are."""

    def residuals(y: Array) -> Array:
        problem, unknowns = _at(cycle, y)
        found, pin = residual(problem, unknowns), closing_pin(problem.shifts)
        closing = found.closing / cycle.family.scale - pin @ (y[: len(pin)] - cycle.place.z)
        return jnp.concatenate([closing, found.events])

    return residuals


@compile_quickly
def height_of(defining: DefiningSystem, y: Float[Array, " unknowns"]) -> Scalar:
    """The quantity of a peak at the unknowns of its defining system."""
    place, own = defining.place(y)
    assert isinstance(defining.condition, AtPeak)
    return defining.condition.height(defining.cycle(place), own)
