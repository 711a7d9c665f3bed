"""What the engine asks of a motion between events."""

import abc

import equinox as eqx
from jaxtyping import Array, Bool, Float

from .._machine import Machine, State
from .._types import Scalar
from .._xla import compute_once


class Derivatives(eqx.Module):
    """The motion at one instant, exactly. Every field is (n,).

    Attributes:
        acceleration: second derivative of the position of every mass; zero where held.
        jerk: third derivative, likewise.
        force: force on every mass without that of the stops: mass times acceleration where free,
            what presses on the stop where held.
        force_rate: its first derivative.
        force_curvature: its second derivative.
    """

    acceleration: Float[Array, "n ..."]
    jerk: Float[Array, "n ..."]
    force: Float[Array, "n ..."]
    force_rate: Float[Array, "n ..."]
    force_curvature: Float[Array, "n ..."]


class Expansion(eqx.Module):
    """The motion from one instant on, with some masses held: the present, bounds, the future.

    Attributes:
        now: derivatives at the instant.
        limit: the longest step this expansion is good for.
    """

    now: eqx.AbstractVar[Derivatives]
    limit: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def rest(self, machine: Machine, limit: Scalar) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Bound |x''''| / 24 and |force'''| / 6 on [0, limit], both (n,)."""

    @abc.abstractmethod
    def move(
        self, machine: Machine, state: State, step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Go `step` ahead: the displacement x(step) - x(0), v(step), and the forcing phase there."""


class AbstractFlow(eqx.Module):
    """A motion between events.

    To add one: write `expand`, and an `Expansion` that keeps its promises. `rest` must be a bound,
    for no impact is ever looked for where it says that there is none. `move` returns
    the displacement as an increment, exact relative to itself however short the step, and is
    differentiable. The engine never asks for more; the other methods are there to save time.
    """

    @abc.abstractmethod
    def expand(self, machine: Machine, state: State, is_held: Bool[Array, "n ..."]) -> Expansion:
        """Expand the motion at `state` with the masses `is_held` at rest."""

    def prepare(self, machine: Machine) -> "AbstractFlow":
        """Compute, before the first step, what all steps need."""
        del machine
        return self

    def propagate(
        self, machine: Machine, state: State, is_held: Bool[Array, "n ..."], step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Expand and move at once. Derivatives are taken through this."""
        motion = compute_once(self.expand, machine, state, is_held)
        return compute_once(motion.move, machine, state, step)
