"""Responses of modes to polynomial loads from rest, against matrix exponentials at high precision."""

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from vijax._flow.mode_series import increments_at_any_time
from vijax._flow.polynomial_response import LONGEST_STEP_AND_TERMS, from_rest, from_rest_at_any_time

# A few roundings.
ROUNDING = 4e-15


def exact(w2: float, a: float, t: float) -> list[float]:
    """r_(-2), ..., r_3 after a time, by the exponential of the augmented matrix at 120 digits."""
    with mpmath.workdps(120):
        matrix = mpmath.zeros(6)
        matrix[0, 1], matrix[1, 0], matrix[1, 1], matrix[1, 2] = 1, -mpmath.mpf(w2), -2 * mpmath.mpf(a), 1
        for k in range(2, 5):
            matrix[k, k + 1] = 1
        e = mpmath.expm(matrix * mpmath.mpf(t))
        return [float(e[1, 1]), float(e[0, 1]), *(float(e[0, 2 + j]) for j in range(4))]


@pytest.mark.parametrize("w2", [1.0, 400.0])
@pytest.mark.parametrize("damping", [0.0, 0.05, 1.0, 3.0])
@pytest.mark.parametrize("share", [1e-9, 1e-3, 0.3, 1.0])
@pytest.mark.parametrize("orders", [2, 4])
def test_a_step_is_exact_relative_to_itself(w2: float, damping: float, share: float, orders: int):
    w = np.sqrt(w2)
    a = damping * w
    step = share * LONGEST_STEP_AND_TERMS["float64"][0] / (a + np.sqrt(a * a + w2))
    found = from_rest(jnp.array([w2]), jnp.array([a]), jnp.asarray(step), orders).responses
    expected = exact(w2, a, step)[: orders + 2]
    # The first, a slope, may pass through zero.
    np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(np.ravel(found[1:]), expected[1:], rtol=ROUNDING)


@pytest.mark.parametrize("damping", [0.0, 0.05, 1.0, 3.0])
@pytest.mark.parametrize("time", [1e-6, 0.3, 1.1, 7.0, 300.0, -0.2, -2.0])
def test_any_time_is_exact_relative_to_the_largest_response(damping: float, time: float):
    w2, a, t = jnp.array([1.0]), jnp.array([damping]), jnp.asarray(time)
    found = from_rest_at_any_time(w2, a, t, 4, increments_at_any_time(w2, a, t)).responses
    expected = exact(1.0, damping, time)
    growth = np.exp(max(0.0, -time) * 2 * (damping + 1))
    for one, other, order in zip(found, expected, range(-2, 4), strict=True):
        size = max(abs(other), abs(time) ** max(order, 0) * (1 if abs(time) > 1 else 0), 1e-300)
        size = size if order > -2 else 1.0
        assert abs(float(one[0]) - other) < 40 * ROUNDING * growth * size
