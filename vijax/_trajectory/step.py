"""One step of one trajectory: the longest proved free of events, or up to the next event.

`initial_state` makes the first state; `advance`, a flight and its outcome, takes every step. The loops of `simulate`
and `sweep` call them and need no knowledge of contacts; these functions need none of logs. A step consists of

    fly (`_flow`) -> impacts -> sticks and releases (`_hybrid`)
"""

from collections.abc import Callable
from types import ModuleType

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._flow.exact_step import fly, simultaneity_tolerance
from .._flow.interface import AbstractFlow, Flight
from .._hybrid.resets import resets_of
from .._hybrid.transition import Instant
from .._jax.arrays import Scalar, clip_to_zero, smallest
from .._jax.xla import as_part, of_parts
from .._machine.machine import Machine
from .._machine.state import State, with_memory


def initial_state(
    flow: AbstractFlow,
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """State of a trajectory before its first step."""
    law = resets_of(machine)
    first = law.first_state(machine, phase, x, v, t0)
    return with_memory(first, flow.memory(first.time))


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
        machine: the machine as arrays.
        state: state of the trajectory.
        target: local time at which to stop.
        resolution: times closer than this are one instant.

    Returns:
        State after the step, and the transition there.
    """
    return outcome(machine, flight_to(flow, machine, state, target, resolution))


def flight_to(
    flow: AbstractFlow, machine: Machine, state: State, target: Scalar, resolution: Scalar
) -> Flight:
    """First half of `advance`: the flight, before the transition at its end."""
    remaining = clip_to_zero((target - state.time) - state.time_low)
    if machine.tables is not None:
        return _flight_to_knot(flow, machine, state, remaining, resolution)
    return as_part(fly, flow, machine, state, remaining, resolution)


def _flight_to_knot(
    flow: AbstractFlow, machine: Machine, state: State, remaining: Scalar, resolution: Scalar
) -> Flight:
    """`flight_to`, which ends at the next knot of the load if that comes first.

    Knots within rounding of the end are passed there, so that no period ends just before one. Where an event happens at a
    knot, it happens first, and the knot is passed by a step of no length.
    """
    until = machine.until_knots(state)
    nearest = clip_to_zero(smallest(until))
    is_first = nearest < remaining
    target = jnp.where(is_first, nearest, remaining)
    flight = as_part(fly, flow, machine, state, target, resolution)
    rounding = resolution + simultaneity_tolerance(machine)
    at_knots = flight.is_last[None] & (until <= (target + rounding)[None])
    waits = jnp.any(at_knots, axis=0) & jnp.any(flight.is_event, axis=0) & (flight.duration > rounding)
    return eqx.tree_at(
        lambda f: (f.at_knots, f.at_goal),
        flight,
        (at_knots & ~waits[None], flight.is_last & ~is_first & ~waits),
        is_leaf=lambda leaf: leaf is None,
    )


def outcome(
    machine: Machine, flight: Flight, call: Callable[..., tuple[State, Instant]] = of_parts
) -> tuple[State, Instant]:
    """Second half of `advance`: the state after the step, and the transition there; `call` calls the law of impacts."""
    law = resets_of(machine)
    if machine.tables is not None:
        return _outcome_at_knot(machine, flight, law, call)
    after, instant = call(law.resolve, machine, flight.end, flight.is_event)
    # Not by `is_event`: by rounding, a mass that has just left may seem to return at once, in every step anew.
    arrived = flight.is_last & ~instant.happened
    return after, eqx.tree_at(lambda i: i.arrived, instant, arrived)


def _outcome_at_knot(
    machine: Machine, flight: Flight, law: ModuleType, call: Callable[..., tuple[State, Instant]]
) -> tuple[State, Instant]:
    """`outcome` of a flight that may end at knots of the load: what holds is decided by the load after them."""
    assert flight.at_knots is not None
    assert flight.at_goal is not None
    end, jumps = machine.past_knots(flight.end, flight.at_knots)
    after, instant = call(law.resolve, machine, end, flight.is_event, jumps)
    return after, eqx.tree_at(lambda i: i.arrived, instant, flight.at_goal & ~instant.happened)
