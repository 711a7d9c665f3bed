"""One step of one trajectory: the longest that is proved free of events, or up to the next one.

`begin` makes the first state and `advance`, a flight and its outcome, is all that moves a trajectory. The loops of
`simulate` and `sweep`, which call them, know nothing of contacts; these know nothing of logs. A step goes through

    fly (`_flow`) -> impacts -> who sticks, who is let go

An instant may hold several events: all its impacts are applied first, and only then is it decided
who sticks and who is let go, because one impact can release a mass (through the dampers)
that another impact of the same instant presses again.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._contact.law import rebound
from .._contact.start import first_state
from .._contact.sticking import chatter_is_complete, chatter_time, is_light
from .._flow.exact_step import fly
from .._flow.interface import AbstractFlow, Flight
from .._machine.derivatives import rates
from .._machine.machine import Machine
from .._machine.state import State, remembering
from .._types import Flag, Scalar, not_negative
from .._xla import compute_once, is_any


class Instant(eqx.Module):
    """What happened at the end of a step.

    Attributes:
        hit: impacts, (stops,).
        stuck: masses that came to rest on their stop, (stops,).
        released: masses that were let go, (stops,).
        velocity_minus: velocity of each stop's mass before, (stops,).
        velocity_plus: and after, before it sticks, (stops,).
        chatter: how long after this instant the skipped bounces of the stuck end, (stops,).
        arrived: whether the step ended at the target time.
        time: local time of the instant.
    """

    hit: Bool[Array, "stops ..."]
    stuck: Bool[Array, "stops ..."]
    released: Bool[Array, "stops ..."]
    velocity_minus: Float[Array, "stops ..."]
    velocity_plus: Float[Array, "stops ..."]
    chatter: Float[Array, "stops ..."]
    arrived: Flag
    time: Scalar


def begin(
    flow: AbstractFlow,
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """The state of a trajectory before its first step."""
    first = first_state(machine, phase, x, v, t0)
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
    after, instant = compute_once(_resolve, machine, flight.end, flight.is_event)
    # Not by `is_event`: a mass that has just left may seem to come back at once, by rounding, for ever.
    happened = instant.hit | instant.stuck | instant.released
    arrived = flight.is_last & ~jnp.any(happened, axis=0)
    return after, eqx.tree_at(lambda i: i.arrived, instant, arrived)


def _resolve(machine: Machine, state: State, is_event: Bool[Array, "stops ..."]) -> tuple[State, Instant]:
    """Apply the impacts of this instant, then decide who sticks and who is let go."""
    v_minus = machine.contacts.along(state.v)
    hit = is_event & ~state.held & (v_minus > 0)
    x, v = rebound(machine, state.x, state.v, hit)
    # The gap on the other side of a mass that was hit is measured afresh, its own is zero.
    afresh = machine.contacts.sharing(hit)
    gap = jnp.where(hit, 0, jnp.where(afresh, machine.contacts.gaps(x), state.gap))
    contact = jnp.where(hit, jnp.int8(1), state.contact)
    after = eqx.tree_at(lambda s: (s.x, s.v, s.gap, s.contact), state, (x, v, gap, contact))
    none, zeros = jnp.zeros_like(hit), jnp.zeros_like(gap)
    arrived = jnp.zeros_like(state.time, bool)
    instant = Instant(hit, none, none, v_minus, machine.contacts.along(v), zeros, arrived, state.time)
    if not machine.can_stick:
        return after, instant
    is_doubtful = state.held | (state.contact >= 2) | (hit & is_light(instant.velocity_plus))
    return jax.lax.cond(
        is_any(is_doubtful),
        lambda: _stick_and_release(machine, after, instant, is_event),
        lambda: (after, instant),
    )


def _stick_and_release(
    machine: Machine, state: State, instant: Instant, is_event: Bool[Array, "stops ..."]
) -> tuple[State, Instant]:
    """Decide, after all impacts of this instant, which masses come to rest on a stop and which leave one."""
    let_go = is_event & state.held
    state = eqx.tree_at(lambda s: s.held, state, state.held & ~let_go)
    approach, approach_rate = compute_once(_approach, machine, state)
    speed = jnp.abs(instant.velocity_plus)
    chatter = compute_once(chatter_time, speed, approach, machine.contacts.restitution)
    is_complete = compute_once(chatter_is_complete, speed, approach, approach_rate, chatter, machine.rate)
    stuck = instant.hit & is_complete
    is_jump = jnp.any(instant.hit, axis=0)
    thrown = state.held & (approach < 0) & is_jump
    # Let go at this very instant, and pressed again before it could leave.
    pressed_again = ~state.held & (state.contact >= 2) & (approach > 0) & is_jump
    pulled = instant.hit & ~stuck & (speed == 0)
    contact = jnp.where(stuck | pressed_again, jnp.int8(0), state.contact)
    contact = jnp.where(let_go | pulled, jnp.int8(3), contact)
    contact = jnp.where(thrown | (pulled & (approach < 0)), jnp.int8(2), contact)

    v = machine.contacts.held_still(state.v, stuck)
    held = (state.held & ~thrown) | stuck | pressed_again
    after = eqx.tree_at(lambda s: (s.v, s.held, s.contact), state, (v, held, contact))
    instant = eqx.tree_at(
        lambda i: (i.stuck, i.released, i.chatter),
        instant,
        (stuck | pressed_again, let_go | thrown, jnp.where(stuck, chatter, 0)),
    )
    return after, instant


def _approach(machine: Machine, state: State) -> tuple[Float[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Acceleration of every mass towards its stops if no mass were held, and its rate."""
    now = rates(machine, state, machine.held_masses(state.held))
    return machine.contacts.along(machine.pull(now.force)), machine.contacts.along(
        machine.pull(now.force_rate)
    )
