"""Resets of stops that share no inertia, at events and at the start.

All impacts of an instant are applied first, and sticking and release are decided afterwards: one impact can release
a mass (through the dampers) that another impact of the same instant presses again.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Flag, Scalar
from .._jax.xla import compute_once, is_any
from .._machine.derivatives import derivatives, rates
from .._machine.first_state import moving_with, state_before_contact
from .._machine.machine import Machine
from .._machine.state import State
from .._system.checks import is_touching
from .law import rebound
from .own_times import at_own_times, at_rest_on_stops
from .sticking import chatter_is_complete, chatter_time, is_light, is_pressed, usual_speeds
from .transition import Instant


def first_state(
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """State at t0. A mass on its stop moves in (the first step hits it), moves out, or rests, pressed or pulled.

    Only a mass that is held stays on its stop: the others move with the start that the derivatives vary.
    """
    x, v = given = machine.relative_to_stops(phase, x, v)
    reach, speed = _rounding_sizes(machine, t0)
    touching = is_touching(machine.contacts.gaps(x, phase), reach)
    x = machine.contacts.with_closed_gaps(x, touching, phase)
    state = state_before_contact(machine, phase, x, v, jnp.zeros(touching.shape, bool))
    is_still = is_touching(machine.contacts.along(v), speed + usual_speeds(machine, state))
    v = machine.contacts.with_zero_approach(v, touching & is_still, phase)
    state = eqx.tree_at(lambda s: (s.v, s.gap), state, (v, jnp.where(touching, 0, state.gap)))
    inward = machine.contacts.along(v)
    leaving, at_rest = touching & (inward < 0), touching & (inward == 0)
    contact = jnp.where(leaving, jnp.int8(1), state.contact)
    if not machine.can_stick:
        return moving_with(machine, eqx.tree_at(lambda s: s.contact, state, contact), *given)
    now = derivatives(machine, state, machine.contacts.hold(at_rest))
    force, *later = map(machine.contacts.along, (now.force, now.force_rate, now.force_curvature))
    held = at_rest & is_pressed(force, tuple(later))
    contact = jnp.where(at_rest & ~held, jnp.where(force < 0, jnp.int8(2), jnp.int8(3)), contact)
    return moving_with(machine, eqx.tree_at(lambda s: (s.held, s.contact), state, (held, contact)), *given)


def resolve(
    machine: Machine, state: State, is_event: Bool[Array, "stops ..."], jumps: Flag | None = None
) -> tuple[State, Instant]:
    """Apply the impacts of this instant, then stick and release masses; the load may jump, see `past_knots`."""
    v_minus = machine.contacts.along(state.v)
    hit = is_event & ~state.held & (v_minus > 0)
    none, zeros = jnp.zeros_like(hit), jnp.zeros_like(state.gap)
    x, v = rebound(machine, state, hit)
    after = x, v, zeros, v_minus, machine.contacts.along(v)
    x, v, closed, v_minus, v_plus = at_own_times(machine, state, hit, *after)
    # The gap of a hit stop is zero; that on the other side of the mass is recomputed.
    afresh = machine.contacts.sharing_mass(hit)
    gap = jnp.where(hit, closed, jnp.where(afresh, machine.contacts.gaps(x, state.phase), state.gap))
    contact = jnp.where(hit, jnp.int8(1), state.contact)
    after = eqx.tree_at(lambda s: (s.x, s.v, s.gap, s.contact), state, (x, v, gap, contact))
    arrived = jnp.zeros_like(state.time, bool)
    instant = Instant(hit, none, none, v_minus, v_plus, zeros, arrived, state.time)
    if not machine.can_stick:
        return after, instant
    is_doubtful = state.held | (state.contact >= 2) | (hit & is_light(instant.velocity_plus))
    return jax.lax.cond(
        is_any(is_doubtful),
        lambda: _stick_and_release(machine, after, instant, is_event, jumps),
        lambda: (after, instant),
    )


def _stick_and_release(
    machine: Machine,
    state: State,
    instant: Instant,
    is_event: Bool[Array, "stops ..."],
    jumps: Flag | None,
) -> tuple[State, Instant]:
    """Stick and release masses, after all impacts of this instant."""
    let_go = is_event & state.held
    state = eqx.tree_at(lambda s: s.held, state, state.held & ~let_go)
    approach, approach_rate = compute_once(_approach, machine, state)
    speed = jnp.abs(instant.velocity_plus)
    chatter = compute_once(chatter_time, speed, approach, machine.contacts.light_restitution)
    is_complete = compute_once(chatter_is_complete, speed, approach, approach_rate, chatter, machine.rate)
    stuck = instant.hit & is_complete
    is_jump = jnp.any(instant.hit, axis=0)
    is_jump = is_jump if jumps is None else is_jump | jumps
    thrown = state.held & (approach < 0) & is_jump
    # Released at this instant, and pressed again before the mass leaves.
    pressed_again = ~state.held & (state.contact >= 2) & (approach > 0) & is_jump
    pulled = instant.hit & ~stuck & (speed == 0)
    contact = jnp.where(stuck | pressed_again, jnp.int8(0), state.contact)
    contact = jnp.where(let_go | pulled, jnp.int8(3), contact)
    contact = jnp.where(thrown | (pulled & (approach < 0)), jnp.int8(2), contact)

    v = machine.contacts.with_zero_approach(state.v, stuck, state.phase)
    x, gap = at_rest_on_stops(machine, state.phase, stuck, state.x, state.gap)
    held = (state.held & ~thrown) | stuck | pressed_again
    names = lambda s: (s.x, s.v, s.gap, s.held, s.contact)  # noqa: E731
    after = eqx.tree_at(names, state, (x, v, gap, held, contact))
    instant = eqx.tree_at(
        lambda i: (i.stuck, i.released, i.chatter),
        instant,
        (stuck | pressed_again, let_go | thrown, jnp.where(stuck, chatter, 0)),
    )
    return after, instant


def _approach(machine: Machine, state: State) -> tuple[Float[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Acceleration of every mass towards its stops with no mass held, and its rate."""
    hold = machine.hold(state.held)
    now, pull = rates(machine, state, hold), machine.contacts.pull
    return pull(now.force, hold, state.phase), pull(now.force_rate, hold, state.phase)


def _rounding_sizes(
    machine: Machine, t0: Scalar | float
) -> tuple[Float[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Magnitudes of the terms subtracted to form gaps and relative velocities; they set the rounding errors."""
    position = machine.contacts.position
    if machine.frame is None:
        return position, jnp.zeros_like(position)
    travel, speed = (machine.contacts.size(a) for a in machine.frame.extent(t0))
    return jnp.abs(position) + travel, speed
