"""First zeros of polynomials that are not negative now, found from below: no zero is passed."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._jax.arrays import Scalar
from .series import derivative, horner

_MOST_TURNS = 64
# Shortest step of a polynomial that does not fall, as a share of the whole.
_LEAST = 1e-9


def first_zero(
    polynomials: list[Array], begins_at_zero: Bool[Array, "guards ..."], limit: Scalar
) -> tuple[Array, Bool[Array, "guards ..."]]:
    """Time up to which each polynomial is proved not to vanish, and whether it vanishes there.

    On [0, limit] the second derivative is above minus a bound, so a polynomial stays above a parabola. Its root is a step
    without a zero; near a simple zero these steps converge as Newton's.

    Args:
        polynomials: coefficients, order by order, (guards, ...) each.
        begins_at_zero: flags of polynomials of which the zero at the start does not count.
        limit: end of the search.

    Returns:
        Times, `limit` where there is no zero, and flags.
    """
    zero = jnp.zeros_like(polynomials[0])
    shifted = [*polynomials[1:], zero]
    c = [jnp.where(begins_at_zero, a, b) for a, b in zip(shifted, polynomials, strict=True)]
    limit = jnp.broadcast_to(limit, zero.shape)
    most = horner([k * (k - 1) * jnp.abs(c[k]) for k in range(3, len(c))], limit) * limit - 2 * c[2]
    slope_of, eps = derivative(c), float(jnp.finfo(zero.dtype).eps)

    def look(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        u, is_on, is_zero, turns = carry
        value, slope = jnp.maximum(horner(c, u), 0), horner(slope_of, u)
        square = slope * slope + 2 * most * value
        root = jnp.sqrt(jnp.maximum(square, 0))
        falls = slope < 0
        is_never = (square < 0) | (~falls & (most <= 0))
        over = jnp.where(falls, 2 * value, slope + root)
        under = jnp.where(falls, root - slope, most)
        step = jnp.where(is_never, jnp.inf, over / jnp.where(is_never | (under == 0), 1, under))
        # A zero of higher order has no step of its own; the motion does not wait there.
        step = jnp.where(falls, step, jnp.maximum(step, _LEAST * limit))
        is_met = is_on & falls & (step <= 2 * eps * (u + eps * limit))
        is_over = step >= limit - u
        there = jnp.where(is_met, u + step, jnp.where(is_over, limit, u + step))
        return (
            jnp.where(is_on, there, u),
            is_on & ~is_met & ~is_over & (turns < _MOST_TURNS),
            is_zero | is_met,
            turns + 1,
        )

    start = zero, jnp.ones_like(zero, bool), jnp.zeros_like(zero, bool), jnp.zeros(limit.shape[1:], int)
    u, _, is_zero, _ = jax.lax.while_loop(lambda carry: jnp.any(carry[1]), look, start)
    return u, is_zero
