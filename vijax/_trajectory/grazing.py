"""Grazing: contacts so light, or misses so narrow, that derivatives are infinite or nearly so.

The derivative of the state after an impact by the state before grows like 1 / v with the impact speed v, and a small
change of the machine turns a near miss into an impact. The closest cases of a trajectory and a flag report both. The
light impacts of a chatter, with the mass pressed onto the stop, are not grazing: their number changes, but the motion
depends on it smoothly.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._hybrid.transition import Instant
from .._jax.arrays import Flag, Scalar, smallest
from .._jax.concrete import stop_gradients
from .._jax.xla import is_any
from .._machine.derivatives import rates
from .._machine.kinds import RIGID
from .._machine.machine import Machine
from .._machine.state import State
from .._machine.switching import SwitchingContacts


class Grazing(eqx.Module):
    """Closest approach of a trajectory to grazing.

    Attributes:
        impact_speed: smallest speed of an impact after which the mass is pulled away from its stop; infinite if none.
        clearance: smallest gap at which a mass turned back just before its stop; infinite if none. Only passes close to
            the start or end of a step are measured, which include all narrow ones.
        is_near: whether either is so small against the acceleration a that derivatives are nearly infinite, or
            one-sided: speeds below 1e-5 a / rate, gaps below 1e-10 a / rate^2.
    """

    impact_speed: Scalar
    clearance: Scalar
    is_near: Bool[Array, "..."]


def no_grazing(time: Scalar) -> Grazing:
    """Value before the first step: no grazing."""
    return Grazing(jnp.full_like(time, jnp.inf), jnp.full_like(time, jnp.inf), jnp.zeros(time.shape, bool))


def update_grazing(
    machine: Machine, before: State, after: State, instant: Instant, met: Grazing, live: Flag
) -> Grazing:
    """Update by one step of the live lanes."""
    machine, before, after, instant = stop_gradients((machine, before, after, instant))
    turned = (machine.approach(before) > 0) & (machine.approach(after) <= 0)
    turned = turned & ~instant.hit & ~before.held & ~after.held
    if isinstance(machine.contacts, SwitchingContacts):
        turned = turned & machine.contacts.are(RIGID)
    # Most steps have neither an impact nor a turn.
    return jax.lax.cond(
        is_any(live & jnp.any(turned | instant.hit, axis=0)),
        lambda: jax.tree.map(
            lambda new, old: jnp.where(live, new, old),
            _nearer(machine, before, after, instant, turned, met),
            met,
        ),
        lambda: met,
    )


def _nearer(
    machine: Machine,
    before: State,
    after: State,
    instant: Instant,
    turned: Bool[Array, "stops ..."],
    met: Grazing,
) -> Grazing:
    """Update by a step with an impact, or in which masses `turned` back before their stops."""
    pull, lowest_behind, behind = _lowest(machine, after)
    _, lowest_ahead, ahead = _lowest(machine, before)
    leaves = pull > 0
    scale = jnp.where(leaves, pull, 1) / machine.rate
    speed = jnp.where(instant.hit & leaves, jnp.abs(instant.velocity_minus), jnp.inf)
    # Each cubic is accurate to a small part of the gap if its minimum is near the end of the step where it starts.
    near = 3e-2 / machine.rate
    lowest_behind = jnp.where(turned & (behind <= 0) & (behind > -near), lowest_behind, jnp.inf)
    lowest_ahead = jnp.where(turned & (ahead >= 0) & (ahead < near), lowest_ahead, jnp.inf)
    clearance = jnp.maximum(jnp.minimum(lowest_behind, lowest_ahead), 0)
    is_near = jnp.any((speed < 1e-5 * scale) | (clearance < 1e-10 * scale / machine.rate), axis=0)
    return Grazing(
        jnp.minimum(met.impact_speed, smallest(speed)),
        jnp.minimum(met.clearance, smallest(clearance)),
        met.is_near | is_near,
    )


def _lowest(
    machine: Machine, state: State
) -> tuple[Float[Array, "stops ..."], Float[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Second derivative of every gap, the minimum of its cubic from this state, and the time to the minimum."""
    machine = machine.in_mode(state)
    hold = machine.hold(state.held)
    now, slope = rates(machine, state, hold), -machine.approach(state)
    curvature = -machine.contacts.pull(now.force, hold, state.phase)
    third = -machine.contacts.pull(now.force_rate, hold, machine.phase_rate(state.phase))
    when = -slope / jnp.where(curvature > 0, curvature, 1)
    mean = curvature + third * when / 2
    when = jnp.where((curvature > 0) & (mean > 0), -slope / jnp.where(mean > 0, mean, 1), jnp.inf)
    ahead = jnp.where(jnp.isfinite(when), when, 0)
    return curvature, state.gap + ahead * (slope + ahead * (curvature / 2 + third * ahead / 6)), when
