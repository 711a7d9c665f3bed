"""Steps proved free of events.

Every stop has one event function of time, positive while nothing happens: the gap of a free mass, or the contact force
of a held one. Its first Taylor coefficients at the present instant are exact and the remainder is bounded, so on [0, U]

    h(u) >= a0 + a1 u + a2 u^2 - rest u^3 >= a0 + a1 u - (rest U - a2) u^2,

and no event happens before the smallest positive root of the right-hand side. Far from a stop the step is of the
order of 1/rate. Near one it becomes a Newton step from the safe side that also uses the curvature. So stepping and
root finding are the same code, and no lane of a batch waits for the root search of another. Any U gives a valid step:
two are tried and the longer one is kept.

After a contact some leading coefficients vanish exactly (`State.contact`). They are divided out before the bound is
formed, so no tolerance decides whether a mass that leaves its stop is hit again.

A positive a2 is used (the parabola may have no root at all): it carries a step past a near miss. The root of the
parabola misses the event by the third-order term alone, so a step that is short against the motion,
rate * u <= eps^(1/3), ends on the event to rounding.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from .._jax.arrays import Flag, Scalar


class Bound(eqx.Module):
    """Lower bound of an event function on [0, limit]: h(u) >= a0 + a1 u + a2 u^2 - rest u^3 - later u^4, later None for 0."""

    a0: Scalar
    a1: Scalar
    a2: Scalar
    rest: Scalar
    later: Scalar | None = None


def divided_bound(gap: tuple[Scalar, ...], rest: Scalar, order: Int[Array, "..."], limit: Scalar) -> Bound:
    """Bound g0 + g1 u + g2 u^2 + g3 u^3 -+ rest u^4, divided by u^order, for order 0 to 3."""
    g0, g1, g2, g3 = gap
    zero = jnp.zeros_like(rest)
    bounds = (
        Bound(jnp.maximum(g0, 0), g1, g2, jnp.maximum(-g3, 0) + rest * limit),
        Bound(g1, g2, g3, rest),
        Bound(g2, g3, -rest, zero),
        Bound(g3, -rest, zero, zero),
    )
    chosen = bounds[0]
    for p in (1, 2, 3):
        chosen = either(order == p, bounds[p], chosen)
    return chosen


def divided_bound_of_two(h: tuple[Scalar, ...], rest: Scalar, order: Int[Array, "..."]) -> Bound:
    """Bound h0 + h1 u + h2 u^2 -+ rest u^3, divided by u^order, for order 0 to 2."""
    h0, h1, h2 = h
    zero = jnp.zeros_like(rest)
    chosen = Bound(jnp.maximum(h0, 0), h1, h2, rest)
    chosen = either(order == 1, Bound(h1, h2, -rest, zero), chosen)
    return either(order == 2, Bound(h2, -rest, zero, zero), chosen)


def either(condition: Flag, a: Bound, b: Bound) -> Bound:
    """Select elementwise between two bounds."""
    return jax.tree.map(lambda new, old: jnp.where(condition, new, old), a, b)


def lost_fall(dtype: jnp.dtype) -> float:
    """Fall whose products underflow, so that its root is lost: a mass at rest far from its stop would seem to meet it."""
    return float(jnp.finfo(dtype).tiny) ** 0.97


def safe_step(bound: Bound, limit: Scalar, short: Scalar) -> tuple[Scalar, Flag]:
    """Longest step proved free of an event, and whether it ends on a root of the bound.

    Args:
        bound: bound of an event function that is not negative now.
        limit: longest step allowed.
        short: step so short that a bound which falls by its second coefficient is as good as the function; the second
            trial is then no shorter.

    Returns:
        The step, and True if the lower bound crosses zero there with a slope.
    """
    a0, a1 = bound.a0, bound.a1
    tiny = jnp.finfo(jnp.result_type(a0)).tiny
    no_fall = lost_fall(jnp.result_type(a0))
    trial, step, is_root = limit, limit, jnp.zeros(jnp.shape(limit), bool)
    # A bound that falls by its remainder alone shows no event: a mass leaving with a jerk would seem to return.
    least = jnp.where(8 * bound.rest * short < -bound.a2, short, 0)
    if bound.later is not None:
        # One that rises shows none before its remainder takes the second coefficient away.
        root = jnp.sqrt(bound.rest * bound.rest + 4 * bound.later * jnp.maximum(bound.a2, 0))
        least = jnp.where(bound.a2 > 0, 2 * bound.a2 / jnp.maximum(bound.rest + root, tiny), least)
    for _ in range(2):  # the second step is never shorter than the first: its bound is tighter
        rest = bound.rest if bound.later is None else bound.rest + bound.later * trial
        fall = rest * trial - bound.a2
        under_root = a1 * a1 + 4 * fall * a0
        root = jnp.sqrt(jnp.maximum(under_root, 0))
        # Form of the root without cancellation; one division, as divisions are slow.
        falls = a1 < 0
        over, under = jnp.where(falls, 2 * a0, a1 + root), jnp.where(falls, root - a1, 2 * fall)
        never = (under_root < 0) | (~falls & (fall <= no_fall))
        step = jnp.where(never, trial, jnp.minimum(over / jnp.maximum(under, tiny), trial))
        is_root = ~never & (step < trial) & (root > 0)
        trial = jnp.where(step > 0, jnp.minimum(limit, jnp.maximum(1.5 * step, least)), limit)
    return step, is_root
