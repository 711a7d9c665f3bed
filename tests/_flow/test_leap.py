"""State of a mode after any time in one step: against 40 digits, from the shortest times to the longest."""

import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

import vijax as vx
from vijax._flow.mode_series import increments_at_any_time

EPS = 2.3e-16
# Damping ratios: none, light, nearly critical from both sides, critical, heavy.
RATIOS = (0.0, 0.01, 1 - 1e-9, 1.0, 1 + 1e-9, 1.01, 3.9)
TIMES = (1e-12, 1e-6, 1e-2, 0.4, 3.0, 60.0, 1e4)
FREQUENCIES = (0.3, 1.0, 40.0)


def exact(w: float, a: float, t: float) -> list[mpf]:
    """e (c + a s) - 1, e s, e (c - a s) - 1; e = exp(-a t), c = cos(sqrt(b) t), s = sin(sqrt(b) t) / sqrt(b)."""
    w, a, t = mpf(w), mpf(a), mpf(t)
    root = mpmath.sqrt(mpmath.mpc(w * w - a * a))
    arc = mpmath.sin(root * t) / root if root != 0 else t
    values = mpmath.cos(root * t) + a * arc, arc, mpmath.cos(root * t) - a * arc
    grow, reach, slow = (mpmath.re(mpmath.exp(-a * t) * value) for value in values)
    return [grow - 1, reach, slow - 1]


@pytest.mark.parametrize("ratio", RATIOS)
def test_a_mode_is_known_at_any_time_to_rounding(ratio):
    points = list(itertools.product(FREQUENCIES, TIMES))
    w, t = (jnp.asarray(column) for column in zip(*points, strict=True))
    found = np.array(increments_at_any_time(w * w, ratio * w, t))
    for k, (w_k, t_k) in enumerate(points):
        with mp.workdps(60):
            expected = exact(w_k, float(np.float64(ratio) * w_k), t_k)
            # At short times relative to the change; at long times limited by the rounding of the phase.
            change, reach = min(1.0, w_k * t_k * (w_k * t_k + 4 * ratio)), min(t_k, 1 / w_k)
            allowed = [20 * EPS * (1 + w_k * t_k) * size for size in (change, reach, change)]
            errors = [
                abs(mpf(float(value)) - true) for value, true in zip(found[:, k], expected, strict=True)
            ]
        assert all(error <= bound for error, bound in zip(errors, allowed, strict=True)), (w_k, t_k)


@jax.jit
def total(w2, a, t) -> jax.Array:
    return sum(increments_at_any_time(w2, a, t))


slopes = jax.jit(jax.grad(total, (0, 1, 2)))


@pytest.mark.parametrize("ratio", RATIOS)
def test_its_derivatives_are_finite_and_those_of_differences(ratio):
    at = jnp.asarray(1.3), jnp.asarray(ratio * 1.3**0.5), jnp.asarray(2.0)
    for k, slope in enumerate(slopes(*at)):
        h = 1e-5
        shifted = [total(*(x + sign * h * (j == k) for j, x in enumerate(at))) for sign in (1, -1)]
        np.testing.assert_allclose(slope, (shifted[0] - shifted[1]) / (2 * h), rtol=1e-6, atol=1e-6)


def test_a_free_mass_is_where_its_vibration_takes_it_after_a_long_time():
    system = vx.ImpactSystem(
        [1.0], [[0.0]], [[1.0]], vx.Harmonic([0.0], 0.5), [vx.Stop(0, 5.0, "upper", 0.7)]
    )
    sol = vx.simulate(system, 0.0, 1e5, [1.0], [0.0])
    t = np.array([1.0, 1e3, 99_999.0])
    x, v = sol.evaluate(t)
    np.testing.assert_allclose(x[:, 0], np.cos(t), rtol=0, atol=1e-10)
    np.testing.assert_allclose(v[:, 0], -np.sin(t), rtol=0, atol=1e-10)
