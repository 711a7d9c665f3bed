"""Interface between the engine and the smooth motion between events."""

import abc
from collections.abc import Callable
from functools import partial
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .._jax.arrays import Flag, Scalar
from .._machine.contacts import Held
from .._machine.derivatives import Derivatives
from .._machine.machine import Machine
from .._machine.state import State

# Change of the forcing phase over a step or a flight.
PhaseChange = Float[Array, "2 harmonics ..."]
# Displacement and gain of velocity over a flight.
FlightMotion = tuple[Float[Array, "n ..."], Float[Array, "n ..."]]
# Displacement, velocities at the end, and change of the phase over a step.
StepMotion = tuple[Float[Array, "n ..."], Float[Array, "n ..."], PhaseChange]


class Expansion(eqx.Module):
    """Expansion of the motion about one instant, with some masses held.

    Attributes:
        now: derivatives at the instant.
        limit: longest step for which the expansion is valid.
    """

    now: eqx.AbstractVar[Derivatives]
    limit: eqx.AbstractVar[Scalar]

    @property
    def series(self) -> tuple[Array, ...] | None:
        """Taylor coefficients of positions, forces and phase that sum the motion up to `limit`, if it has them."""
        return None

    @abc.abstractmethod
    def rest(self, machine: Machine, limit: Scalar) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Bound |x''''| / 24 and |force'''| / 6 on [0, limit], both (n,)."""

    @abc.abstractmethod
    def velocity_rest(self, machine: Machine, limit: Scalar) -> Float[Array, "n ..."]:
        """Bound |v^(4)| / 24 on [0, limit], (n,)."""

    @abc.abstractmethod
    def move(self, machine: Machine, state: State, step: Scalar) -> StepMotion:
        """Displacement x(step) - x(0), velocity v(step), and change of the forcing phase over `step`."""


class Flight(eqx.Module):
    """One step up to a target time or an event.

    Attributes:
        end: state at its end, before the transition there.
        duration: its duration.
        is_event: flags of the stops with an event at the end, (stops,).
        is_last: True where it ended at the target time, or would have without an event.
        at_knots: flags of the loads by tables that have a knot at its end, (streams,); None if there are none.
        at_goal: `is_last` for the goal of the loop, where a knot may have come first; None likewise.
        delays: times from its end to the events there, (guards,), zeros with the derivatives of times of their own; None if none
            are asked for.
    """

    end: State
    duration: Scalar
    is_event: Bool[Array, "stops ..."]
    is_last: Flag
    at_knots: Bool[Array, "streams ..."] | None = None
    at_goal: Flag | None = None
    delays: Float[Array, "guards ..."] | None = None


class AbstractFlow(eqx.Module):
    """Smooth motion between events: all that the loops use of it.

    To add one, write

    - `fly`: one step towards a target time, proved free of events, or up to the first event;
    - `propagate`: the smooth motion over a duration of `fly`, differentiable forward and reverse, as increments
      accurate relative to themselves however short the duration: a light bounce depends on these digits;
    - `coast`: one step of the smooth motion that ignores the stops.

    A motion with exact derivatives and bounds ahead extends `ExpandingFlow`, which finds its events, and writes
    `expand` alone. The bounds of its `Expansion` must hold: no impact is searched for where `rest` excludes one. A
    motion by approximate steps with a polynomial inside extends `SteppingFlow` and writes `attempt` and `step_by`. A
    flow keeps its memory between steps in `State.memory`, which `memory` initialises. The class variables mean:

    - `is_linear`: the motion is affine in positions and velocities;
    - `fits_one_kernel`: steps are arithmetic, comparisons and selections alone, which fit `in_one_kernel`;
    - `has_flow_map`: the prepared flow has an exact `flow_map`; an approximate one serves branches, but no search,
      because it differs from `fly` in the last bits;
    - `flow_map_reaches_far`: `flow_map` loses no digits over any span.
    """

    is_linear: ClassVar[bool] = False
    has_flow_map: ClassVar[bool] = False
    flow_map_reaches_far: ClassVar[bool] = False
    fits_one_kernel: ClassVar[bool] = False

    @abc.abstractmethod
    def fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        """Fly towards the target time, up to the first event if one comes before it.

        Args:
            machine: the machine as arrays.
            state: state of the trajectory.
            remaining: time left to the target.
            resolution: times closer than this are one instant.
        """

    @abc.abstractmethod
    def propagate(self, machine: Machine, state: State, hold: Held, step: Scalar) -> StepMotion:
        """Displacement x(step) - x(0), velocity v(step), and change of the forcing phase over `step`."""

    def inside(self, machine: Machine, state: State, hold: Held) -> Callable[[Scalar], StepMotion]:
        """`propagate` as a function of the duration alone, for many durations of one step."""
        return partial(self.propagate, machine, state, hold)

    @abc.abstractmethod
    def coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        """State after one step of at most `remaining` that ignores the stops, and the length of the step."""

    def flow_map(
        self, machine: Machine, state: State, hold: Held, span: Scalar, change: PhaseChange
    ) -> FlightMotion:
        """Follow the smooth motion over a whole flight, ignoring the stops; backwards for a negative span.

        With `has_flow_map`: one evaluation, differentiable forward and reverse by all arguments, accurate relative to
        itself however short the flight; a long one may lose as many digits as its phase has before the decimal point,
        unless `flow_map_reaches_far`. Without: to the accuracy of its steps, differentiable forward only.

        Args:
            machine: the machine as arrays.
            state: start of the flight.
            hold: contacts that hold, see `Machine.hold`.
            span: duration of the flight.
            change: change of the forcing phase over the flight.

        Returns:
            Displacement and gain of velocity.
        """
        raise NotImplementedError(f"{type(self).__name__} goes step by step.")

    def prepare(self, machine: Machine) -> "AbstractFlow":
        """Precompute what all steps share."""
        del machine
        return self

    def compact(self) -> "AbstractFlow":
        """The same motion, in a program that is compiled faster and runs longer, if there is one."""
        return self

    def memory(self, like: Scalar) -> PyTree:
        """Initial `State.memory`; every array has the shape and type of `like`."""
        del like

    def num_rejected(self, memory: PyTree) -> Int[Array, "..."]:
        """Number of steps rejected so far as not accurate enough."""
        del memory
        return jnp.array(0)
