"""Steps proved free of events.

Every stop has one event function of time, positive while nothing happens: the gap of a free mass, or the contact force
of a held one. Its first Taylor coefficients at the present instant are exact and the remainder is bounded, so on [0, U]

    h(u) >= a0 + a1 u + a2 u^2 - rest u^3 - later u^4 >= a0 + a1 u - (rest U + later U^2 - a2) u^2,

and no event happens before the smallest positive root of the right-hand side. Far from a stop the step is of the
order of 1/rate. Near one it becomes a Newton step from the safe side that also uses the curvature. So stepping and
root finding are the same code, and no lane of a batch waits for the root search of another. Any U gives a valid step:
two are tried and the longer one is kept.

After a contact some leading coefficients vanish exactly (`State.contact`). They are divided out before the bound is
formed, so no tolerance decides whether a mass that leaves its stop is hit again.

A positive a2 is used (the parabola may have no root at all): it carries a step past a near miss. The second trial U is
where the remainder takes it away, so a gap that grows as t^4 from nothing lets each step be as long as all before it. The root of the
parabola misses the event by the third-order term alone, so a step that is short against the motion,
rate * u <= eps^(1/3), ends on the event to rounding.
"""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from .._jax.arrays import Flag, Scalar

_Bound = TypeVar("_Bound")


class Bound(eqx.Module):
    """Lower bound of an event function on [0, limit]: h(u) >= a0 + a1 u + a2 u^2 - rest u^3 - later u^4."""

    a0: Scalar
    a1: Scalar
    a2: Scalar
    rest: Scalar
    later: Scalar | float = 0.0


def divided_bound(gap: tuple[Scalar, ...], rest: Scalar, order: Int[Array, "..."]) -> Bound:
    """Bound g0 + g1 u + g2 u^2 + g3 u^3 -+ rest u^4, divided by u^order, for order 0 to 3."""
    g0, g1, g2, g3 = gap
    zero = jnp.zeros_like(rest)
    bounds = (
        (jnp.maximum(g0, 0), g1, g2, jnp.maximum(-g3, 0)),
        (g1, g2, g3, rest),
        (g2, g3, -rest, zero),
        (g3, -rest, zero, zero),
    )
    chosen = bounds[0]
    for p in (1, 2, 3):
        chosen = either(order == p, bounds[p], chosen)
    return Bound(*chosen, jnp.where(order == 0, rest, zero))


def divided_bound_of_two(h: tuple[Scalar, ...], rest: Scalar, order: Int[Array, "..."]) -> Bound:
    """Bound h0 + h1 u + h2 u^2 -+ rest u^3, divided by u^order, for order 0 to 2."""
    h0, h1, h2 = h
    zero = jnp.zeros_like(rest)
    chosen = Bound(jnp.maximum(h0, 0), h1, h2, rest, zero)
    chosen = either(order == 1, Bound(h1, h2, -rest, zero, zero), chosen)
    return either(order == 2, Bound(h2, -rest, zero, zero, zero), chosen)


def either(condition: Flag, a: _Bound, b: _Bound) -> _Bound:
    """Select elementwise between two bounds."""
    return jax.tree.map(lambda new, old: jnp.where(condition, new, old), a, b)


def lost_fall(dtype: jnp.dtype) -> float:
    """Fall whose products underflow, so that its root is lost: a mass at rest before its stop would seem to meet it.

    The changes of a speed by it within a short step underflow too, and such steps would never end.
    """
    return float(jnp.finfo(dtype).tiny / jnp.finfo(dtype).eps)


def safe_step(bound: Bound, limit: Scalar, short: Scalar) -> tuple[Scalar, Flag]:
    """Longest step proved free of an event, and whether it ends on a root of the bound.

    Args:
        bound: bound of an event function that is not negative now.
        limit: longest step allowed.
        short: step so short that a bound which falls by its first or second coefficient is as good as the function; the second
            trial is then no shorter.

    Returns:
        The step, and True if the lower bound crosses zero there with a slope.
    """
    a1, a2, twice_a0 = bound.a1, bound.a2, bound.a0 + bound.a0
    tiny = jnp.finfo(jnp.result_type(a1)).tiny
    no_fall, falls = lost_fall(jnp.result_type(a1)), a1 < 0
    rises = ~falls

    def within(trial: Scalar) -> tuple[Scalar, Scalar]:
        """Root of the bound up to a trial, or the trial; and its slope at the root."""
        fall = (bound.rest + bound.later * trial) * trial - a2
        twice = fall + fall
        under_root = a1 * a1 + twice * twice_a0
        root = jnp.sqrt(jnp.abs(under_root))  # not read where it is negative
        # Form of the root without cancellation; one division, as divisions are slow.
        over, under = jnp.where(falls, twice_a0, a1 + root), jnp.where(falls, root - a1, twice)
        never = (under_root < 0) | (rises & (fall <= no_fall))
        return jnp.where(never, trial, jnp.minimum(over / jnp.maximum(under, tiny), trial)), root

    first, _ = within(limit)
    # A bound that rises shows no event before its remainder takes the second coefficient away; one that falls first may pass
    # zero closely, which the shorter trial shows. That is no shorter than a step is taken unproved: else such a step could pass
    # zero twice. One that falls by its remainder alone shows no event either: a mass leaving with a jerk would seem to return.
    rise = jnp.maximum(a2, 0)
    least = rise / jnp.maximum(bound.rest + jnp.sqrt(bound.later * rise), tiny)
    least = jnp.where(falls | (8 * bound.rest * short < -a2), short, least)
    # The second step is never shorter than the first: its bound is tighter.
    is_later = first > 0
    trial = jnp.where(is_later, jnp.minimum(limit, jnp.maximum(1.5 * first, least)), limit)
    step, root = within(trial)
    # One that falls from zero crosses it, even where the square of its slope underflows.
    return step, (step < trial) & ((root > 0) | (falls & ~is_later))
