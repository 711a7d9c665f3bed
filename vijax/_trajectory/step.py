"""One step of one trajectory: the longest that is proved free of events, or up to the next one.

`initial_state` makes the first state and `advance`, a flight and its outcome, is all that moves a trajectory. The loops of
`simulate` and `sweep`, which call them, know nothing of contacts; these know nothing of logs. A step goes through

    fly (`_flow`) -> impacts -> who sticks, who is let go (`_contact`)
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._flow.exact_step import fly
from .._flow.interface import AbstractFlow, Flight
from .._hybrid import coupled_impacts, diagonal_impacts
from .._hybrid.transition import Instant
from .._jax.arrays import Scalar, not_negative
from .._jax.xla import compute_once
from .._machine.machine import Machine
from .._machine.state import State, remembering


def initial_state(
    flow: AbstractFlow,
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """The state of a trajectory before its first step."""
    law = coupled_impacts if machine.contacts.is_coupled else diagonal_impacts
    first = law.first_state(machine, phase, x, v, t0)
    return remembering(first, flow.memory(first.time))


def advance(
    flow: AbstractFlow,
    machine: Machine,
    state: State,
    target: Scalar,
    resolution: Scalar,
) -> tuple[State, Instant]:
    """Take one step towards the local time `target`, up to the first event if one comes before.

    Args:
        flow: the motion between events.
        machine: the numbers of the machine.
        state: where the trajectory is.
        target: local time at which to stop.
        resolution: times closer than this are one instant.

    Returns:
        The state after the step, and what happened there.
    """
    return outcome(machine, flight_to(flow, machine, state, target, resolution))


def flight_to(
    flow: AbstractFlow, machine: Machine, state: State, target: Scalar, resolution: Scalar
) -> Flight:
    """The first half of `advance`: the step, before anything happens at its end."""
    remaining = not_negative((target - state.time) - state.time_low)
    return fly(flow, machine, state, remaining, resolution)


def outcome(machine: Machine, flight: Flight) -> tuple[State, Instant]:
    """The second half: the state after the step, and what happened there."""
    law = coupled_impacts if machine.contacts.is_coupled else diagonal_impacts
    after, instant = compute_once(law.resolve, machine, flight.end, flight.is_event)
    # Not by `is_event`: a mass that has just left may seem to come back at once, by rounding, for ever.
    happened = instant.hit | instant.stuck | instant.released
    arrived = flight.is_last & ~jnp.any(happened, axis=0)
    return after, eqx.tree_at(lambda i: i.arrived, instant, arrived)
