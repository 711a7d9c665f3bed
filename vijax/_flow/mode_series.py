"""Power series of the motion of modes over short steps, and closed forms for any time.

The series vectorise, which library sines do not, and give increments to full relative accuracy.
"""

from math import factorial

import jax.numpy as jnp
from jaxtyping import Array

from .._jax.arrays import Scalar
from .._jax.xla import compute_once

# Longest step, times the rate of the motion, and number of terms of the power series.
LONGEST_STEP_AND_TERMS = {"float64": (3.0, 11), "float32": (1.0, 6)}


def faded(a: Array, fade: Array, wave: Array, arc: Array) -> tuple[Array, Array, Array]:
    """exp(-a t) (c + a s) - 1, exp(-a t) s and exp(-a t) (c - a s) - 1 from exp(-a t) - 1, c - 1 and s."""
    return fade + (1 + fade) * (wave + a * arc), (1 + fade) * arc, fade + (1 + fade) * (wave - a * arc)


def factors(w2: Array, a: Array, speed: Array, step: Scalar) -> tuple[Array, ...]:
    """Factors exp(-a t) - 1, c - 1 and s of every mode; cos - 1 and sin of every harmonic."""
    terms = LONGEST_STEP_AND_TERMS[str(step.dtype)][1]
    wave, arc = cosine_and_sine((w2 - a * a) * step * step, terms)
    turn, slide = cosine_and_sine(speed * speed * step * step, terms)
    fade = _expm1(-a * step, terms)
    return fade, wave, arc * step, turn, slide * speed * step


def increments_at_any_time(w2: Array, a: Array, time: Scalar) -> tuple[Array, Array, Array]:
    """exp(-a t) (c + a s) - 1, exp(-a t) s and exp(-a t) (c - a s) - 1 at any time, short or long.

    Three formulas: for w^2 - a^2 far above zero; far below, where the faster of two exponentials is small;
    and close to zero, where the other two would divide by a small difference.
    """
    b = w2 - a * a
    y2 = b * time * time
    terms = LONGEST_STEP_AND_TERMS[str(time.dtype)][1]
    is_slow, is_wave = jnp.abs(y2) < 1, b > 0
    near, near_arc = cosine_and_sine(jnp.where(is_slow, y2, 0), terms)
    root = jnp.sqrt(jnp.where(is_slow, 1, jnp.abs(b)))
    angle = root * time
    wave = jnp.where(is_slow, near, -2 * jnp.sin(angle / 2) ** 2)
    arc = jnp.where(is_slow, near_arc * time, jnp.sin(angle) / root)
    grow, reach, slow = faded(a, jnp.expm1(-a * time), wave, arc)
    # Decay rates a - root and a + root; the first as w^2 / (a + root), without cancellation.
    slower, faster = jnp.exp(-w2 / (a + root) * time), jnp.exp(-(a + root) * time)
    is_over, skew = ~is_wave & ~is_slow, a / root
    grow = jnp.where(is_over, ((1 + skew) * slower + (1 - skew) * faster) / 2 - 1, grow)
    reach = jnp.where(is_over, (slower - faster) / (2 * root), reach)
    slow = jnp.where(is_over, ((1 - skew) * slower + (1 + skew) * faster) / 2 - 1, slow)
    return grow, reach, slow


def cosine_and_sine(z: Array, terms: int) -> tuple[Array, Array]:
    """Series of cos(y) - 1 and sin(y) / y in z = y^2, which may be negative: summed at y / 2 and doubled once."""
    wave, arc = compute_once(_series_of_cosine_and_sine, z / 4, terms)
    return 2 * wave * (2 + wave), arc * (1 + wave)


def _series_of_cosine_and_sine(z: Array, terms: int) -> tuple[Array, Array]:
    cosine = [(-1) ** k / factorial(2 * k) for k in range(1, terms)]
    sine = [(-1) ** k / factorial(2 * k + 1) for k in range(terms)]
    return z * _polynomial(cosine, z), _polynomial(sine, z)


def _expm1(y: Array, terms: int) -> Array:
    """exp(y) - 1 for |y| up to the bound of `LONGEST_STEP_AND_TERMS`: series at y / 8, doubled three times."""
    part = y / 8
    value = part * _polynomial([1 / factorial(k) for k in range(1, terms + 3)], part)
    for _ in range(3):
        value = value * (2 + value)
    return value


def _polynomial(coefficients: list[float], z: Array) -> Array:
    total = jnp.full_like(z, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * z + c
    return total
