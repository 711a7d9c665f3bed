"""What the engine asks of a motion between events."""

import abc

import equinox as eqx
from jaxtyping import Array, Bool, Float

from .._machine import Machine, State
from .._types import Scalar


class Expansion(eqx.Module):
    """The motion from one instant on, with some masses held: exact derivatives, bounds, the future.

    Attributes:
        acceleration: x'' of every mass, (n,); zero where held.
        jerk: x''', likewise.
        force: force on every mass without that of the stops, (n,): m x'' where free, what presses
            on the stop where held.
        force_rate: its first derivative.
        force_curvature: its second derivative.
        limit: the longest step this expansion is good for.
    """

    acceleration: eqx.AbstractVar[Float[Array, "n ..."]]
    jerk: eqx.AbstractVar[Float[Array, "n ..."]]
    force: eqx.AbstractVar[Float[Array, "n ..."]]
    force_rate: eqx.AbstractVar[Float[Array, "n ..."]]
    force_curvature: eqx.AbstractVar[Float[Array, "n ..."]]
    limit: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def rest(self, limit: Scalar) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Bound |x''''| / 24 and |force'''| / 6 on [0, limit], both (n,)."""

    @abc.abstractmethod
    def move(
        self, step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Go `step` ahead: the displacement x(step) - x(0), v(step), and the forcing phase there."""


class AbstractFlow(eqx.Module):
    """A motion between events.

    To add one: write `expand`, and an `Expansion` that keeps its promises. `rest` must be a bound,
    for no impact is ever looked for where it says that there is none. `move` returns
    the displacement as an increment, exact relative to itself however short the step, and is
    differentiable. The engine never asks for more.
    """

    @abc.abstractmethod
    def expand(self, machine: Machine, state: State, is_held: Bool[Array, "n ..."]) -> Expansion:
        """Expand the motion at `state` with the masses `is_held` at rest."""
