"""The interface between the engine and a motion between events."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .._jax.arrays import Flag, Scalar
from .._machine.contacts import Held
from .._machine.derivatives import Derivatives
from .._machine.machine import Machine
from .._machine.state import State


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
        """Go `step` ahead: the displacement x(step) - x(0), v(step), and the change of the forcing phase."""


class Flight(eqx.Module):
    """Result of a flight: one step up to a time or an event.

    Attributes:
        end: the state at its end, before anything happens there.
        duration: how long it lasted.
        is_event: stops that have an event there, (stops,).
        is_last: whether it ended at the target, or would have but for an event.
    """

    end: State
    duration: Scalar
    is_event: Bool[Array, "stops ..."]
    is_last: Flag


class AbstractFlow(eqx.Module):
    """A motion between events. The loops that it drives know nothing else of it.

    To add one: write

    - `fly`: one step towards a time, proved free of events, or up to the first of them;
    - `propagate`: the smooth motion over a time that `fly` took, differentiable both ways, as an
      increment that is exact relative to itself however short the time: a light bounce lives in it;
    - `coast`: one step of the smooth motion, whatever the stops say.

    Two ways to find events are ready. A motion whose derivatives are known exactly and bounded
    ahead extends `ExpandingFlow` and writes `expand` alone, with an `Expansion` that keeps its
    promises: no impact is ever looked for where `rest` says that there is none. One that takes
    approximate steps with a polynomial inside extends `SteppingFlow` and writes `attempt` and `step_by`. What a flow
    has to remember from step to step, it keeps in `State.memory`, which `memory` begins. A motion that is
    affine in positions and velocities says so by `is_linear`; one whose steps are made of arithmetic,
    comparisons and choices alone, which compile into one kernel (see `in_one_kernel`), by `fits_one_kernel`;
    one that has an exact `flow_map` once it is prepared, by `has_flow_map`, and if that loses no digits however far it goes, by
    `flow_map_reaches_far`. (An approximate one serves branches, but no search: it is not the map that `fly` computes, to the last bit.)
    """

    is_linear: ClassVar[bool] = False
    has_flow_map: ClassVar[bool] = False
    flow_map_reaches_far: ClassVar[bool] = False
    fits_one_kernel: ClassVar[bool] = False

    @abc.abstractmethod
    def fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        """Fly towards a time that lies `remaining` ahead, up to the first event if one comes before.

        Args:
            machine: the numbers of the machine.
            state: where the trajectory is.
            remaining: time to the target.
            resolution: times closer than this are one instant.
        """

    @abc.abstractmethod
    def propagate(
        self, machine: Machine, state: State, hold: Held, step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Go `step` ahead: the displacement x(step) - x(0), v(step), and the change of the forcing phase."""

    @abc.abstractmethod
    def coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        """Take one step towards `remaining`, passing through stops; the state there, and how long it was."""

    def flow_map(
        self,
        machine: Machine,
        state: State,
        hold: Held,
        span: Scalar,
        change: Float[Array, "2 harmonics ..."],
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Go a whole flight ahead, whatever the stops say, or back for a negative span.

        If the motion `has_flow_map`, at once, differentiable both ways by all its arguments, and exact relative to itself however
        short the flight; a long one may lose as many digits as its phase has before the point, unless `flow_map_reaches_far`.
        Otherwise to the accuracy of its steps, differentiable forwards.

        Args:
            machine: the numbers of the machine.
            state: where it begins.
            hold: what is held, see `Machine.hold`.
            span: how far to go.
            change: by how much the phase of the forcing changes on the way.

        Returns:
            Displacement and gain of velocity.
        """
        raise NotImplementedError(f"{type(self).__name__} goes step by step.")

    def prepare(self, machine: Machine) -> "AbstractFlow":
        """Compute, before the first step, what all steps need."""
        del machine
        return self

    def memory(self, like: Scalar) -> PyTree:
        """First `State.memory`, every array in the shape and type of `like`."""
        del like

    def num_rejected(self, memory: PyTree) -> Int[Array, "..."]:
        """Steps so far that were tried and found not accurate enough."""
        del memory
        return jnp.array(0)
