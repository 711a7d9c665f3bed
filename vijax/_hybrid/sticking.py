"""Conditions for sticking, chatter completion and release.

A mass at rest on its stop is held while the contact force is positive; that force is the total of all other forces on
the mass, counted towards the stop (Wagg & Bishop 2004, Sec. 2.3).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Scalar, rounding_step
from .._jax.concrete import concrete
from .._machine.machine import Machine
from .._machine.state import State
from .._system.contact import AbstractRigidLimit
from .._system.system import ImpactSystem

# Share of a light velocity that is negligible.
_LIGHTER = 1e6


def can_any_stick(system: ImpactSystem, x0: Array | np.ndarray, v0: Array | np.ndarray) -> bool:
    """Test whether any stop might hold its mass: r < 1, or the mass starts at rest on it.

    Traced values give True. Lanes may stand last.
    """
    if system.friction or system.hysteresis:
        return True  # friction sticks
    for stop in system.stops:
        if not isinstance(stop, AbstractRigidLimit) or stop.motion is not None:
            return True  # the start time decides whether the mass rests on it
        r, position, x, v = (concrete(a) for a in (stop.light_restitution, stop.position, x0, v0))
        if r is None or (r < 1).any():
            return True
        if position is None or x is None or v is None:
            return True
        along, coefficients = concrete(stop.along(x)), [concrete(a) for a in stop.coefficients.values()]
        if any(a is None for a in coefficients) or along is None:
            return True
        is_close = np.abs(along - stop.sign * position) <= 1e-3 * np.abs(position)
        if (is_close & (concrete(stop.along(v)) == 0)).any():
            return True
    return False


def is_rounding(speed: Array, size: Array) -> Bool[Array, "contacts ..."]:
    """Flags of speeds that are rounding errors of the velocities they are differences of."""
    return jnp.abs(speed) <= 64 * float(jnp.finfo(size.dtype).eps) * size


def usual_speeds(machine: Machine, state: State) -> Float[Array, "stops ..."]:
    """Speeds towards each stop that the forces give to masses within a radian of the fastest motion, 0 if none can stick.

    Where masses rest, their velocities are rounding errors of these. With a user's `force` 0 too: one more call of it
    takes time to compile.
    """
    contacts = machine.contacts
    if not machine.can_stick or machine.extra is not None:
        return jnp.zeros_like(state.gap)
    return contacts.size(jnp.abs(contacts.inverse_mass_times(machine.total_force(state)))) / machine.rate


def chatter_time(
    speed: Float[Array, "stops ..."],
    approach: Float[Array, "stops ..."],
    restitution: Float[Array, "stops ..."],
) -> Float[Array, "stops ..."]:
    """Duration of bounces that begin with `speed` against the acceleration `approach`.

    Each bounce takes 2 v / a and the speeds form a geometric series: T = 2 v / (a (1 - r)). Infinite where the mass is
    not pressed, or r = 1.
    """
    loss = approach * (1 - restitution)
    return jnp.where(loss > 0, 2 * speed / jnp.where(loss > 0, loss, 1), jnp.where(speed > 0, jnp.inf, 0))


def chatter_is_complete(
    speed: Float[Array, "stops ..."],
    approach: Float[Array, "stops ..."],
    approach_rate: Float[Array, "stops ..."],
    duration: Float[Array, "stops ..."],
    rate: Scalar,
) -> Bool[Array, "stops ..."]:
    """Test whether the bounces after an impact may be replaced by sticking at once.

    The remaining bounces move the other masses by O(v^3) only. They are skipped where they are light (v below 1e-6,
    and short against the motion: the change is then below rounding) and sure to end, with a pressing force that stays
    positive meanwhile. Otherwise the mass bounces on, and an incomplete chatter is followed to its end.
    """
    is_short = 2 * speed * rate <= 2 * _light(speed) * approach
    presses_on = approach + 2 * jnp.minimum(approach_rate, 0) * duration > 0
    return is_light(speed) & is_short & (approach > 0) & presses_on & jnp.isfinite(duration)


def is_disturbed(
    machine: Machine,
    state: State,
    hit: Bool[Array, "stops ..."],
    completed: Bool[Array, "stops ..."],
    duration: Float[Array, "stops ..."],
) -> Bool[Array, "..."]:
    """Test whether another contact of the same masses is met before the bounces of completed ones are over.

    What they leave out is then of the order of their speed, and they are followed on until that is negligible.
    """
    contacts = machine.contacts
    time = jnp.max(jnp.where(completed, duration, 0), axis=0, initial=0.0)
    pull = contacts.free_pull(machine.total_force(state), state.phase)
    way = time * (machine.approach(state) + time * jnp.maximum(pull, 0) / 2)
    is_linked = jnp.any((contacts.compliance != 0) & completed[None], axis=1)
    is_open = contacts.is_rigid & ~hit & ~state.held & ~state.is_kept_closed
    return jnp.any(is_open & is_linked & (way > state.gap), axis=0)


def is_light(velocity: Float[Array, "stops ..."]) -> Bool[Array, "stops ..."]:
    """Test whether an impact that leaves this velocity may be the last before sticking."""
    return jnp.abs(velocity) <= _light(velocity)


def is_nearly_hit(machine: Machine, state: State) -> Bool[Array, "stops ..."]:
    """Flags of open contacts whose gap and speed are as light as the bounces of others."""
    contacts, approach = machine.contacts, machine.approach(state)
    is_open = contacts.is_rigid & ~state.held & ~state.is_kept_closed
    is_small = is_light(approach) & is_light(state.gap)
    # In any unit: against what the forces do within a radian of the fastest motion.
    pull = contacts.size(jnp.abs(contacts.inverse_mass_times(machine.total_force(state))))
    rate, most = machine.rate, _light(approach) * pull
    return is_open & is_small & (jnp.abs(approach) * rate <= most) & (state.gap * rate * rate <= most)


def is_negligible(
    machine: Machine, state: State, velocity: Float[Array, "stops ..."]
) -> Bool[Array, "stops ..."]:
    """Test whether an impact that leaves this velocity may be the last whatever else happens."""
    contacts = machine.contacts
    pull = contacts.size(jnp.abs(contacts.inverse_mass_times(machine.total_force(state))))
    return is_light(_LIGHTER * velocity) & is_light(_LIGHTER * velocity * machine.rate / pull)


def _light(velocity: Array) -> float:
    return rounding_step(velocity.dtype) / 6


def is_pressed(
    force: Float[Array, "stops ..."], derivatives: tuple[Float[Array, "stops ..."], ...]
) -> Bool[Array, "stops ..."]:
    """Test whether a mass at rest on its stop is held: the first derivative of the force that is not zero is positive.

    A contact force that stays zero holds nothing. As the guard of a held mass it would bound every step, though it ends
    nothing; the gap of the mass, which rests either way, bounds none.
    """
    pressed = jnp.zeros(force.shape, bool)
    for value in (*derivatives[::-1], force):
        pressed = jnp.where(value == 0, pressed, value > 0)
    return pressed
