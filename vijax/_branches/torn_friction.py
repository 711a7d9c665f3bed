"""Friction at rest that the event of another element sets free: a damped contact closes, and its force tears it off.

Where a contact closes or opens, or friction elsewhere begins or ceases to slip, forces jump. Friction at rest then slips if
the force behind the event, had it stuck on, is beyond its grip; otherwise it slips a little later. Or its grip gives way just
before the event. No guard between events tells these two limits. (An impact jumps the velocity, which is a guard of the slip
behind it.)
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.limits import IMPACT
from .._machine.kinds import FRICTION
from .._machine.machine import Machine
from .._machine.state import AHEAD, BEHIND, STICKING
from .._orbits.cycle import Moment
from .._orbits.sequence import Sequence

# From the beginning of a flight, its mode and the time since then, in forcing periods, to the values of all guards.
Guards = Callable[[Moment, Array, Array], Float[Array, " guards"]]


def has_friction(machine: Machine) -> bool:
    """True if some friction may be torn off."""
    return FRICTION in machine.contacts.kinds


def torn_at(sequence: Sequence) -> Bool[Array, "events elements"]:
    """Flags of friction that the event of another element, by a jump of forces, sets free."""
    mode = jnp.asarray(sequence.mode)
    of_others = jnp.asarray(sequence.stop)[:, None] != jnp.arange(mode.shape[1])[None]
    jumps = of_others & (sequence.is_event & (sequence.kind != IMPACT))[:, None]
    return jumps & (mode[:-1] == STICKING) & ((mode[1:] == AHEAD) | (mode[1:] == BEHIND))


def excess_of_torn(sequence: Sequence, begins: Moment, guards: Guards) -> Float[Array, "flights elements"]:
    """Force beyond the grip at the beginning of each flight, infinite where no friction was torn off there.

    `begins` are the moments at which the flights begin, see `traverse`. As all of these margins it is a share of twice the
    grip, which is the sum of what its two guards have left.
    """
    mode = jnp.asarray(sequence.mode)
    if len(mode) < 2:
        return jnp.full(mode.shape, jnp.inf)
    torn, later = torn_at(sequence), jax.tree.map(lambda a: a[1:], begins)
    stuck = jnp.where(torn, jnp.asarray(STICKING, mode.dtype), mode[1:])
    held = jax.vmap(lambda begin, mode: guards(begin, mode, 0 * begin.time))(later, stuck)
    ahead, behind = jnp.split(held, 2, axis=1)
    excess = _share(torn, -jnp.where(mode[1:] == AHEAD, ahead, behind), ahead + behind)
    return jnp.concatenate([jnp.full_like(excess[:1], jnp.inf), excess])


def _share(is_torn: Array, force: Array, whole: Array) -> Array:
    return jnp.where(is_torn, force / jnp.where(is_torn & (whole > 0), whole, 1), jnp.inf)


def with_torn(
    excess: Float[Array, "flights elements"], rise: Array, flights: Int[Array, " guards"]
) -> tuple[Float[Array, " guards"], Int[Array, " guards"]]:
    """Least rises and the numbers of their flights, see `LeastMargins`, with those of friction that is torn off."""
    least, at = jnp.min(excess, axis=0), jnp.argmin(excess, axis=0)
    least, at = (
        jnp.concatenate([of_first, of_second]) for of_first, of_second in ((least, least + jnp.inf), (at, at))
    )
    is_lower = least < rise
    return jnp.where(is_lower, least, rise), jnp.where(is_lower, at, flights)


def rises_with_torn(
    excess: Float[Array, "flights elements"], rise: Array, flights: Int[Array, " guards"]
) -> Float[Array, " guards"]:
    """Values that `with_torn` chose, to be differentiated: `rise` are those of others."""
    num = excess.shape[1]
    own = excess[flights[:num], jnp.arange(num)]
    return jnp.concatenate([jnp.where(jnp.isfinite(own), own, rise[:num]), rise[num:]])
