"""Bounds of series of time alone."""

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from force_series import bound
from jax import lax
from jax.scipy.special import erf

from vijax._series.plan import plan_force
from vijax._series.time_bound import has_time_bound, time_bound

FUNCTIONS = {
    "gaussian": (lambda t: jnp.exp(-(((t - 3) / 0.5) ** 2)), lambda t: mpmath.exp(-(((t - 3) / 0.5) ** 2))),
    "chirp": (lambda t: jnp.sin(t * t), lambda t: mpmath.sin(t * t)),
    "cosh": (lambda t: jnp.cosh(t * t), lambda t: mpmath.cosh(t * t)),
    "expm1": (lambda t: jnp.expm1(-t * t), lambda t: mpmath.expm1(-t * t)),
    "tanh": (lambda t: jnp.tanh(4 * t - 5), lambda t: mpmath.tanh(4 * t - 5)),
    "logistic": (lambda t: lax.logistic(4 * t - 5), lambda t: 1 / (1 + mpmath.exp(5 - 4 * t))),
    "tan": (lambda t: jnp.tan(t / 3), lambda t: mpmath.tan(t / 3)),
    "erf": (lambda t: erf(3 * t - 4), lambda t: mpmath.erf(3 * t - 4)),
    "log": (lambda t: jnp.log(1 + t), lambda t: mpmath.log(1 + t)),
    "log1p": (jnp.log1p, mpmath.log1p),
    "sqrt": (lambda t: jnp.sqrt(1 + t * t), lambda t: mpmath.sqrt(1 + t * t)),
    "power": (lambda t: (1 + t * t) ** -1.3, lambda t: (1 + t * t) ** -1.3),
    "rational": (lambda t: 1 / (1 + (t - 2) ** 2), lambda t: 1 / (1 + (t - 2) ** 2)),
    "atan": (lambda t: jnp.arctan(t - 1), lambda t: mpmath.atan(t - 1)),
    "asinh": (lambda t: jnp.arcsinh(t - 1), lambda t: mpmath.asinh(t - 1)),
    "asin": (lambda t: jnp.arcsin(t / 5), lambda t: mpmath.asin(t / 5)),
    "atanh": (lambda t: jnp.arctanh(t / 5), lambda t: mpmath.atanh(t / 5)),
    "acosh": (lambda t: jnp.arccosh(t + 2), lambda t: mpmath.acosh(t + 2)),
    "erfinv": (lambda t: lax.erf_inv(t / 5), lambda t: mpmath.erfinv(t / 5)),
    "angle": (lambda t: jnp.arctan2(t, 1 + t), lambda t: mpmath.atan(t / (1 + t))),
    "variable power": (lambda t: (1 + t) ** t, lambda t: (1 + t) ** t),
    "product": (lambda t: jnp.exp(-t * t) * jnp.sin(t), lambda t: mpmath.exp(-t * t) * mpmath.sin(t)),
}


def radius_of(function, t, radius):
    force = bound(lambda t, x, v, a: function(t) - x)
    plan = plan_force(force, 1)
    assert has_time_bound(plan)
    return float(time_bound(plan, force, jnp.float64(t), jnp.float64(radius), like=jnp.zeros(1)))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_bound_holds_on_the_disc(name):
    function, exact = FUNCTIONS[name]
    for t in (0.3, 1.0, 2.7):
        found = [radius_of(function, t, radius) for radius in (0.02, 0.1, 0.25)]
        assert np.isfinite(found[0])
        assert found == sorted(found)
        for radius, size in zip((0.02, 0.1, 0.25), found, strict=True):
            if name == "erfinv":  # real numbers only in mpmath; all coefficients at 0 are positive
                farthest = abs(exact(t + radius) - exact(t))
            else:
                edge = (t + radius * mpmath.expjpi(2 * k / 40) for k in range(40))
                farthest = max(abs(exact(z) - exact(mpmath.mpf(t))) for z in edge)
            assert size * max(1, abs(exact(mpmath.mpf(t)))) >= farthest * (1 - 1e-9)


def test_a_pulse_that_is_far_does_not_disturb():
    pulse = lambda t: 100 * jnp.exp(-(((t - 30) / 0.05) ** 2)) + jnp.cos(3 * t)  # noqa: E731
    assert radius_of(pulse, 20.0, 1.0) == 0
    assert radius_of(pulse, 29.9, 0.1) > 1


def test_singularities_on_the_disc_have_no_bound():
    assert radius_of(lambda t: 1 / t + jnp.log(t), 0.3, 0.4) == np.inf
    assert radius_of(jnp.tan, 1.4, 0.2) == np.inf


@pytest.mark.parametrize(
    "force",
    [
        lambda t, x, v, a: jnp.cos(3 * t + 1) * x + t * t * jnp.sin(a * t),
        lambda t, x, v, a: jnp.exp(-((x - t) ** 2)),
        lambda t, x, v, a: jnp.exp(a) * jnp.cos(t) ** 2 - x,
        lambda t, x, v, a: (
            jnp.where(t > 3, jnp.sin(t), 0.0) - x - jnp.interp(t, np.arange(3.0), np.arange(3.0))
        ),
    ],
)
def test_harmonics_polynomials_and_functions_of_the_motion_need_no_bound(force):
    assert not has_time_bound(plan_force(bound(force, 1, 1.3), 1))
