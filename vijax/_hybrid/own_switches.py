"""Derivatives of switches at one instant: each has a time of its own.

As with impacts, see `own_times.py`: a step ends at the root of one guard, whose derivatives its time carries. Friction of another mass
that turns then, or a compliant contact that closes or opens, does so a little later or earlier in a motion beside, by a delay d, and until
then its force is the old one. Where that jumps by f, velocities change by M^-1 A^T f d. Elements that come to rest need none of this:
their sliding velocities end at zero, whenever they do. Nor do contacts that open where their force is zero, it does not jump.

Where the velocity at which one element turns depends on the force of another, the derivatives are those of one of the orders.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import matvec
from .._machine.kinds import COMPLIANT, FRICTION
from .._machine.machine import Machine
from .._machine.state import State
from .friction_limits import sliding_velocity
from .just_after import accelerations_towards, forces_of_elements


@eqx.filter_custom_jvp
def switched_at_own_times(
    machine: Machine, before: State, after: State, struck: Bool[Array, "contacts ..."]
) -> Float[Array, "n ..."]:
    """Velocities after the switches of an instant, with derivatives as if each had its own time.

    `struck` are flags of elements whose speed the impacts of this instant change: they switch with these.
    """
    del machine, before, struck
    return after.v


@switched_at_own_times.def_jvp
def _switched_at_own_times_jvp(primals, tangents):
    return switched_at_own_times(*primals), eqx.filter_jvp(_delayed, primals, tangents)[1]


def _delayed(
    machine: Machine, before: State, after: State, struck: Bool[Array, "contacts ..."]
) -> Float[Array, "n ..."]:
    """Velocities after the switches of an instant, each delayed by the zero that is left of its guard."""
    contacts = machine.contacts
    turns = contacts.are(FRICTION) & (before.mode.direction * after.mode.direction < 0)
    passes = contacts.are(COMPLIANT) & (before.mode.closed != after.mode.closed)
    own, now = machine.in_mode(before), machine.in_mode(after)
    speed = sliding_velocity(machine, before)
    guard = jnp.where(turns, -speed, jnp.where(passes, before.gap, 0))
    rate = jnp.where(turns, accelerations_towards(own, before), speed)
    is_late = ~struck & (turns | passes) & (rate != 0)
    delay = jnp.where(is_late, guard, 0) / jax.lax.stop_gradient(jnp.where(is_late, rate, 1))
    normal = contacts.laws.normal
    if normal is not None:  # friction begins with the force of its contact
        begins = contacts.are_tied & (before.mode.direction == 0) & (after.mode.direction != 0)
        delay = jnp.where(begins, delay[np.array(normal)], delay)
    jump = jax.lax.stop_gradient(forces_of_elements(now, after) - forces_of_elements(own, before))
    gain = matvec(now.hold(after.held).mobility, contacts.back(jump * delay))
    return after.v + gain
