"""Response of modes to a load that is a polynomial in time, from rest.

Let r_j be the solution of q'' + 2 a q' + w^2 q = t^j / j! from rest. Then r_j' = r_(j-1), and r_(-1) is the response to an
impulse, so

    r_(j-2) = t^j / j! - 2 a r_(j-1) - w^2 r_j.

The highest and its derivative are summed as power series at half the step, all others follow from them, and a step is
doubled by superposition. Nothing is divided by w^2 and nothing cancels, however short the step. (The steady response, a
polynomial too, was rejected: its coefficients grow with every derivative of the load, and under a record of short
intervals it is far larger than the motion.) The free motion comes with them: exp(-a t) (c + a s) - 1 = -w^2 r_0.
"""

from math import factorial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Scalar, add_up
from .._jax.xla import compute_once

# Longest step, times the rate of the motion, and number of terms of the power series, which are summed at half of it.
LONGEST_STEP_AND_TERMS = {"float64": (1.5, 15), "float32": (0.5, 7)}


# Doublings of a short time, from which on responses follow from the lowest up.
_DOUBLINGS = 6


class FromRest(NamedTuple):
    """Responses r_(-2), r_(-1), r_0, ... after a step, (modes, ...) each."""

    responses: tuple[Array, ...]

    def free(self, w2: Array, a: Array) -> tuple[Array, Array, Array]:
        """Increments of the free motion: exp(-a t) (c + a s) - 1, exp(-a t) s and exp(-a t) (c - a s) - 1."""
        _, impulse, step, *_ = self.responses
        return -w2 * step, impulse, -(2 * a * impulse + w2 * step)

    def forced(self, push: list[Array]) -> tuple[Array, Array]:
        """Displacement and velocity under a load with these derivatives at the beginning of the step."""
        _, *velocities = self.responses
        terms = list(zip(push, velocities[1:], velocities, strict=False))
        return add_up([p * r for p, r, _ in terms]), add_up([p * rate for p, _, rate in terms])


def from_rest(w2: Array, a: Array, step: Scalar, orders: int) -> FromRest:
    """Responses after a step of at most `LONGEST_STEP_AND_TERMS`, to loads of degree below `orders`, 2 or more."""
    half = 0.5 * step

    def doubled(w2: Array, a: Array, half: Scalar) -> tuple[Array, ...]:
        return _doubled(w2, a, half, _summed(w2, a, half, orders))

    return FromRest(compute_once(doubled, w2, a, half))


def from_rest_at_any_time(
    w2: Array, a: Array, time: Scalar, orders: int, free: tuple[Array, Array, Array]
) -> FromRest:
    """Responses after any time, short or long, from the increments of the free motion.

    From the lowest up they are small differences where the time is short, also against the slow decay of a strongly damped
    mode. Up to 2^`_DOUBLINGS` scales of time they come from a short time by doubling.
    """
    scale = jnp.sqrt(w2) + 2 * a
    doublings = jnp.ceil(jnp.log2(jnp.maximum(jax.lax.stop_gradient(jnp.abs(time) * scale), 1))).astype(int)
    is_short = doublings <= _DOUBLINGS
    part = jnp.where(is_short, time * 0.5 ** jnp.minimum(doublings, _DOUBLINGS), 0)

    def double(carry: tuple[Array, tuple[Array, ...]], k: Array) -> tuple[tuple, None]:
        part, found = carry
        goes_on = k < doublings
        further = _doubled(w2, a, part, found)
        found = tuple(jnp.where(goes_on, *pair) for pair in zip(further, found, strict=True))
        return (jnp.where(goes_on, 2 * part, part), found), None

    (_, short), _ = jax.lax.scan(double, (part, _summed(w2, a, part, orders)), jnp.arange(_DOUBLINGS))
    grow, reach, slow = free
    long = [1 + slow, reach, -grow / w2]
    for j in range(1, orders):
        long.append((time**j / factorial(j) - 2 * a * long[-1] - long[-2]) / w2)
    return FromRest(tuple(jnp.where(is_short, *pair) for pair in zip(short, long, strict=True)))


def _doubled(w2: Array, a: Array, half: Scalar, begun: tuple[Array, ...]) -> tuple[Array, ...]:
    """Responses after twice the time `half`, from those after it."""
    impulse, first, own, orders = begun[1], begun[2], begun[2:], len(begun) - 2
    powers = [half**k / factorial(k) for k in range(orders)]
    found = []
    for j in range(orders):
        moved = (1 - w2 * first) * own[j] + impulse * (own[j - 1] if j else impulse)
        found.append(moved + add_up([powers[j - i] * own[i] for i in range(j + 1)]))
    impulse = 2 * half - 2 * a * found[0] - w2 * found[1]
    return 1 - 2 * a * impulse - w2 * found[0], impulse, *found


def _summed(w2: Array, a: Array, time: Scalar, orders: int) -> tuple[Array, ...]:
    """Responses after a short time, by power series."""
    _, num_terms = LONGEST_STEP_AND_TERMS[str(time.dtype)]
    drag, spring, top = -2 * a * time, -w2 * time * time, orders - 1
    before, last = jnp.zeros_like(spring), jnp.full_like(spring, 1 / factorial(top + 2))
    value, rate = last, (top + 2) * last
    for k in range(1, num_terms):
        n = top + 2 + k
        before, last = last, drag * last * (1 / n) + spring * before * (1 / (n * (n - 1)))
        value, rate = value + last, rate + n * last
    found = [value * time ** (top + 2), rate * time ** (top + 1)]  # from the highest down
    for j in range(top, -1, -1):
        found.append(time**j / factorial(j) - 2 * a * found[-1] - w2 * found[-2])
    return tuple(found[::-1])


def bounds_of_load(push: list[Array], limit: Scalar) -> list[Float[Array, "modes ..."]]:
    """Bounds of a load and of its derivatives on a step of at most `limit`."""
    sizes = [jnp.abs(p) for p in push]
    return [
        add_up([size * (limit**k / factorial(k)) for k, size in enumerate(sizes[order:])])
        for order in range(len(sizes))
    ]
