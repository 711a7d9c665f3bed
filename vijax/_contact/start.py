"""A start on a stop: moving in, moving out, at rest and pressed, at rest and pulled."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._machine.derivatives import derivatives
from .._machine.machine import Machine, resting_state
from .._machine.state import State
from .._system.checks import is_touching
from .._types import Scalar
from .sticking import is_pressed


def first_state(
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """The state at t0. A mass that moves into its stop is hit by the first step."""
    x, v = machine.seen_from_stops(phase, x, v)
    reach, speed = _sizes(machine, t0)
    touching = is_touching(machine.contacts.gaps(x), reach)
    x = machine.contacts.placed(x, touching)
    v = machine.contacts.held_still(v, touching & is_touching(machine.contacts.along(v), speed))
    state = resting_state(machine, phase, x, v, jnp.zeros(touching.shape, bool))
    state = eqx.tree_at(lambda s: s.gap, state, jnp.where(touching, 0, state.gap))
    inward = machine.contacts.along(v)
    leaving, at_rest = touching & (inward < 0), touching & (inward == 0)
    contact = jnp.where(leaving, jnp.int8(1), state.contact)
    if not machine.can_stick:
        return eqx.tree_at(lambda s: s.contact, state, contact)
    now = derivatives(machine, state, machine.contacts.masses_of(at_rest))
    force, *later = map(machine.contacts.along, (now.force, now.force_rate, now.force_curvature))
    held = at_rest & is_pressed(force, tuple(later))
    contact = jnp.where(at_rest & ~held, jnp.where(force < 0, jnp.int8(2), jnp.int8(3)), contact)
    return eqx.tree_at(lambda s: (s.held, s.contact), state, (held, contact))


def _sizes(
    machine: Machine, t0: Scalar | float
) -> tuple[Float[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Magnitudes of the terms subtracted to form gaps and relative velocities; they set the rounding errors."""
    position = machine.contacts.position
    if machine.frame is None:
        return position, jnp.zeros_like(position)
    travel, speed = (machine.contacts.size(a) for a in machine.frame.extent(t0))
    return jnp.abs(position) + travel, speed
