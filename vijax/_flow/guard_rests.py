"""Remainders of guards whose contacts share inertia, by the Taylor coefficients of the guards themselves.

A guard is a difference of motions: the force between two bodies, or the gap. Where they go together the difference is far
smaller than its terms, and may be zero for ever: two equal pendula in touch, friction that is exactly at its bound. Bounds
of the terms, added up, would then allow only steps as short as if the guard were about to fall by as much. So each
coefficient of the guard is formed first, and the absolute value taken of that.

A guard is zero for ever, until the mode changes, if as many of its derivatives vanish as the motion has states (Cayley and
Hamilton). In numbers all coefficients that count within a step are then rounding errors of their terms. Such a guard
`vanishes`: it has no event.
"""

from functools import reduce

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._hybrid.guards import guards_of_steps, select_active
from .._hybrid.limits import Limit
from .._jax.arrays import Scalar
from .._machine.contacts import Held
from .._machine.derivatives import sizes_of_force
from .._machine.machine import Machine
from .._machine.state import State
from .._machine.switching import SwitchingContacts
from .interface import Expansion

# Rounding errors of a coefficient of a guard, relative to its terms, in units of the last place.
_ROUNDINGS = 32


class GuardRests(eqx.Module):
    """Bounds of what follows the known Taylor coefficients of guards on a step, (guards,).

    Attributes:
        third: bound of the third coefficient and all that follow.
        fourth: of the fourth and all that follow.
        vanishes: flags of guards that are zero all along.
    """

    third: Float[Array, "guards ..."]
    fourth: Float[Array, "guards ..."]
    vanishes: Bool[Array, "guards ..."]


def guard_rests(machine: Machine, state: State, motion: Expansion, hold: Held, limit: Scalar) -> GuardRests:
    """Bound the remainders of all guards of steps."""
    if motion.series is None:
        return _by_masses(machine, state, motion, hold, limit)
    series, sizes, num = motion.series, _sizes(machine, state, motion), len(motion.series[2])

    def coefficients(guard: Limit) -> Array:
        known = jnp.asarray(guard.series(machine, state, hold, series))
        return jnp.concatenate([known, jnp.zeros((num - len(known), *known.shape[1:]), known.dtype)])

    def terms(guard: Limit) -> Array:
        # `rest` is linear: of sizes at the unit of time it gives that of the coefficient that follows the known ones.
        return guard.rest(machine, sizes, hold) * machine.timescale**guard.order

    own = jnp.abs(select_active(machine, state, coefficients, guards_of_steps, axis=1))
    size = select_active(machine, state, terms, guards_of_steps)

    def add(sums: tuple[Array, Array], coefficient: Array) -> tuple[tuple[Array, Array], None]:
        """Horner's scheme for the sum at the end of the step, and for the largest term at the unit of time."""
        total, largest = sums
        return (total * limit + coefficient, jnp.maximum(largest * machine.timescale, coefficient)), None

    zero = jnp.zeros_like(own[0] * limit)
    after_third, _ = jax.lax.scan(add, (zero, zero), own[4:], reverse=True)
    after_second, _ = add(after_third, own[3])
    _, largest = reduce(lambda sums, k: add(sums, own[k])[0], (2, 1, 0), after_second)
    vanishes = largest <= _ROUNDINGS * float(jnp.finfo(own.dtype).eps) * size
    return GuardRests(after_second[0], after_third[0], vanishes)


def _by_masses(machine: Machine, state: State, motion: Expansion, hold: Held, limit: Scalar) -> GuardRests:
    """Bounds by those of the motion of the masses, each guard only from its first unknown coefficient."""
    x_rest, force_rest = motion.rest(machine, limit)
    third = jnp.abs(motion.now.jerk) * (1 / 6) + 4 * x_rest * limit
    rests = x_rest, force_rest, third, motion.velocity_rest(machine, limit)
    rest = select_active(machine, state, lambda guard: guard.rest(machine, rests, hold), guards_of_steps)
    return GuardRests(rest, rest, jnp.zeros(rest.shape, bool))


def _sizes(machine: Machine, state: State, motion: Expansion) -> tuple[Array, ...]:
    """Sizes of the terms of positions, forces, third derivatives and velocities, as `Limit.rest` takes them."""
    time, rate = machine.timescale, machine.rate
    x, v, a = (jnp.abs(part) for part in (state.x, state.v, motion.now.acceleration))
    contacts = machine.contacts
    # The constant forces of elements are part of the mean load, where they may cancel.
    load = contacts.size_of_load(state.mode) if isinstance(contacts, SwitchingContacts) else jnp.zeros_like(x)
    force = sizes_of_force(machine, load, x + time * (v + time * a), v + time * a)
    moved = contacts.inverse_mass_size(force)
    way = time * (v + time * moved)
    return way * rate**4, force * rate**3, way * rate**3, way * rate**5
