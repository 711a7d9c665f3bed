"""Steps of machines whose forces switch: proved free of events, or sure to end close to one.

Every guard h has exact Taylor coefficients h0 to h3 and a bound of what follows,

    |h(u) - h0 - h1 u - h2 u^2 - h3 u^3| <= (q3 + q4 u) u^3,

where q3 stands for h3 itself if that is not known. A lower bound gives a step free of events, as in `safe_step.py`. In
machines that switch several times a period these steps, ever shorter towards an event, are most of the work. So a step goes
right to the estimated zero u of h where it is certain that

- h decreases from the end of the safe step to u + near, by bounds of its derivative: it has one zero there at most;
- that zero is within near / 4 of u.

`land` finds it from there by the Taylor series, forwards or backwards.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._hybrid.friction_limits import is_sticking
from .._hybrid.guards import guards_of_steps, has_one_guard, is_idle, leading_zeros, select_active
from .._hybrid.limits import Limit
from .._jax.arrays import Flag, Scalar, rounding_step, smallest
from .._jax.xla import compute_once
from .._machine.contacts import Held
from .._machine.kinds import FRICTION
from .._machine.machine import Machine
from .._machine.state import State
from .guard_rests import GuardRests
from .interface import Expansion
from .safe_step import Bound, either, lost_fall, safe_step


class Ahead(eqx.Module):
    """Taylor coefficients of guards and bounds of what follows them, see the head of this file."""

    h0: Scalar
    h1: Scalar
    h2: Scalar
    h3: Scalar
    q3: Scalar
    q4: Scalar


def switching_step(
    machine: Machine, state: State, motion: Expansion, hold: Held, limit: Scalar, rests: GuardRests
) -> tuple[Scalar, Flag]:
    """Longest step known to have no event but close to its end, and flags of the guards on whose event it ends."""
    ahead = compute_once(_ahead, machine, state, motion, limit, hold, rests)
    order, idle = leading_zeros(state, machine), is_idle(state, machine) | rests.vanishes
    nearly = rounding_step(state.x.dtype) * machine.timescale
    most = 2 if set(machine.contacts.laws.kinds) == {FRICTION} else 3
    if has_one_guard(machine):
        # At one end of its grip a force has zeros ahead there, none at the other end, if it moves to that.
        order = jnp.where(is_sticking(machine, state) & (ahead.h0 > machine.contacts.laws.grip), 0, order)
        before = _before_other_end(machine, state, ahead, limit, nearly)
        limit = jnp.minimum(limit, smallest(jnp.where(idle, limit, before)))
    steps, is_root = compute_once(_safe_steps, ahead, order, limit, nearly, most)
    dtype = str(state.x.dtype)
    near = select_active(machine, state, lambda guard: near_of(guard, dtype), guards_of_steps)
    near = near * machine.timescale
    zero, is_certain = compute_once(_certain_zero, ahead, steps, near)
    is_certain = is_certain & (order == 0) & ~idle & (zero > steps)
    steps = jnp.where(is_certain, jnp.minimum(zero, limit), jnp.where(idle, limit, steps))
    is_root = ((is_root & ~idle) | is_certain) & (steps < limit)
    step = jnp.minimum(limit, smallest(steps))
    tolerance = 8 * jnp.finfo(machine.rate.dtype).eps * machine.timescale
    return step, is_root & (steps <= step + tolerance)


# Taylor terms by which an event is reached, and the time to it, in time scales of the motion, below which they leave less
# than rounding: 0.01^7 / 7! for velocities and depths; forces have one term fewer.
TERMS = 7
_NEAR = {"float64": (1e-2, 4e-3), "float32": (5e-2, 3e-2)}


def near_of(guard: Limit, dtype: str) -> float:
    """Time to the event below which the series locates it to rounding, in time scales of the motion."""
    of_motion, of_force = _NEAR[dtype]
    return of_force if guard.leading_zeros is None else of_motion


def _ahead(
    machine: Machine, state: State, motion: Expansion, limit: Scalar, hold: Held, rests: GuardRests
) -> Ahead:

    def of(guard: Limit) -> tuple[Array, ...]:
        value, slope, curvature, *bend = guard.derivatives(machine, state, hold, motion.now)
        is_known = jnp.full_like(value, bool(bend), bool)
        return value, slope, curvature * 0.5, bend[0] * (1 / 6) if bend else jnp.zeros_like(value), is_known

    h0, h1, h2, h3, is_known = select_active(machine, state, of, guards_of_steps)
    q3, q4 = jnp.where(is_known, 0, rests.third), jnp.where(is_known, rests.fourth, 0)
    ahead = Ahead(h0, h1, h2, h3, q3, q4)
    like = h0 + 0 * limit
    return jax.tree.map(lambda a: jnp.broadcast_to(a, like.shape), ahead)


def _before_other_end(
    machine: Machine, state: State, ahead: Ahead, limit: Scalar, nearly: Scalar
) -> Float[Array, "contacts ..."]:
    """Steps in which friction that sticks does not reach the other end of its grip, from which its force moves away."""
    value = jnp.maximum(2 * machine.contacts.laws.grip - ahead.h0, 0)
    fall, slope = ahead.q3 * limit + ahead.h2, -ahead.h1
    square = slope * slope + 4 * jnp.maximum(fall, 0) * value
    step = (slope + jnp.sqrt(square)) / jnp.maximum(2 * fall, jnp.finfo(value.dtype).tiny)
    falls = fall > lost_fall(value.dtype)
    return jnp.where(is_sticking(machine, state) & falls, jnp.maximum(step, nearly), limit)


def _safe_steps(
    ahead: Ahead, order: Int[Array, "guards ..."], limit: Scalar, nearly: Scalar, most: int
) -> tuple[Scalar, Flag]:
    """Steps proved free of each event, and whether they end on it to rounding, of guards that vanish to an order."""
    h1, h2, q4 = ahead.h1, ahead.h2, ahead.q4
    zero, third = jnp.zeros_like(h1), ahead.h3 - ahead.q3
    bound = Bound(jnp.maximum(ahead.h0, 0), h1, h2, ahead.q3 + jnp.maximum(-ahead.h3, 0), q4)
    bound = either(order == 1, Bound(h1, h2, third, q4, zero), bound)
    bound = either(order == 2, Bound(h2, third, -q4, zero, zero), bound)
    if most > 2:
        bound = either(order == 3, Bound(third, -q4, zero, zero, zero), bound)
    steps, is_root = safe_step(bound, limit, nearly)
    # A mass that has just left returns later, never at once: a root at zero is a leading coefficient lost in rounding.
    is_root = is_root & (steps <= nearly) & ((order == 0) | (steps > 0))
    # To order 3 only one coefficient is known: a root close by is that of the remainder's bound, where the guard has none.
    is_root = is_root & (order < 3)
    # With a leading coefficient lost in rounding the bound allows no step, although the motion does.
    return jnp.where(is_root, steps, jnp.maximum(steps, jnp.minimum(nearly, limit))), is_root


def _certain_zero(ahead: Ahead, safe: Scalar, near: Scalar) -> tuple[Scalar, Flag]:
    """Estimated zero of every guard, and whether it is certain to have its first zero that close, see the head."""
    h0, h1, h2, h3 = jnp.maximum(ahead.h0, 0), ahead.h1, ahead.h2, ahead.h3
    tiny = jnp.finfo(h0.dtype).tiny
    square = h1 * h1 - 4 * h2 * h0
    root = jnp.sqrt(jnp.maximum(square, 0))
    u = 2 * h0 / jnp.maximum(root - h1, tiny)
    slope = h1 + u * (2 * h2 + u * (3 * h3))
    u = u - (h0 + u * (h1 + u * (h2 + u * h3))) / jnp.minimum(slope, -tiny)
    value = jnp.abs(h0 + u * (h1 + u * (h2 + u * h3)))
    end = u + near
    rate = lambda u: h1 + u * (2 * h2 + u * (3 * h3))  # noqa: E731
    # A parabola that is concave rises above its values at two ends by its curvature times their distance squared over 8.
    bulge = 0.75 * jnp.maximum(-h3, 0) * (end - safe) ** 2
    spread = end * end * (3 * ahead.q3 + 4 * ahead.q4 * end)
    least = -(jnp.maximum(rate(safe), rate(end)) + bulge + spread)
    off = value + end * end * end * (ahead.q3 + ahead.q4 * end)
    curvature = jnp.abs(h2) + 3 * end * (jnp.abs(h3) + ahead.q3 + 2 * ahead.q4 * end)
    is_certain = (u > 0) & (least > 0) & (4 * off < least * near) & (8 * curvature * near < least)
    bend = jnp.abs(h3) + ahead.q3 + 4 * ahead.q4 * end
    return u, is_certain & (1e4 * bend * near * near < 4 * least)
