"""Bounds of forces along motions, against their values for complex times."""

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from force_series import bound, motion

from vijax._series.motion_bound import has_motion_bound, motion_bound
from vijax._series.plan import plan_force

# Force of x and v, and the same of complex numbers.
FORCES = {
    "gaussian": (lambda x, v: jnp.exp(-((x / 0.3) ** 2)), lambda x, v: mpmath.exp(-((x / 0.3) ** 2))),
    "lorentzian": (lambda x, v: 1 / (1 + (x / 0.3) ** 2), lambda x, v: 1 / (1 + (x / 0.3) ** 2)),
    "magnet": (lambda x, v: 3 / (2 - x) ** 2, lambda x, v: 3 / (2 - x) ** 2),
    "power": (lambda x, v: 3 * (x - 2) ** -3, lambda x, v: 3 * (x - 2) ** -3),
    "tanh": (lambda x, v: jnp.tanh(v / 0.2) * x, lambda x, v: mpmath.tanh(v / 0.2) * x),
    "inverse cosh": (lambda x, v: 1 / jnp.cosh(x / 0.2) ** 2, lambda x, v: 1 / mpmath.cosh(x / 0.2) ** 2),
    "quotient of exp": (
        lambda x, v: 1 / (2 - 5 * jnp.exp(6 * x)),
        lambda x, v: 1 / (2 - 5 * mpmath.exp(6 * x)),
    ),
    "angle": (lambda x, v: jnp.arctan2(x, 1 + v), lambda x, v: mpmath.atan(x / (1 + v))),
    "root": (lambda x, v: jnp.sqrt(0.2 + x * x), lambda x, v: mpmath.sqrt(0.2 + x * x)),
    "high power": (lambda x, v: x**11, lambda x, v: x**11),
}
ORDER = 12


def bound_of(function, x, v, radius, step):
    own = bound(lambda t, x, v, a: function(x, v) - 7 * x**3)
    plan = plan_force(own, 1)
    assert has_motion_bound(plan)
    _, _, series = motion(plan, own, jnp.float64(0), jnp.array([x]), jnp.array([v]), ORDER)
    reach = jnp.array([abs(v) * radius]), jnp.array([0.5 * radius])
    return float(motion_bound(plan, series, jnp.float64(radius), *reach, jnp.float64(step))[0][0])


@pytest.mark.parametrize("name", FORCES)
def test_the_bound_holds_on_the_disc_without_polynomials_of_low_degree(name):
    function, exact = FORCES[name]
    for x, v in ((-1.1, 0.9), (-0.2, -1.3), (0.0, 0.4)):
        found = [bound_of(function, x, v, radius, radius / 3) for radius in (0.02, 0.08, 0.3)]
        assert np.isfinite(found[0])
        for radius, size in zip((0.02, 0.08, 0.3), found, strict=True):
            edge = [radius * mpmath.expjpi(2 * k / 32) for k in range(32)]
            here = exact(mpmath.mpf(x), mpmath.mpf(v))
            farthest = max(abs(exact(x + v * z, v + 0.5 * z) - here) for z in edge)
            assert not size < float(farthest) * (1 - 1e-9)


def test_forces_that_are_far_do_not_disturb():
    narrow = lambda x, v: jnp.exp(-((x / 1e-3) ** 2)) + 1 / jnp.cosh(x / 1e-3)  # noqa: E731
    assert bound_of(narrow, -1.0, 1.0, 0.35, 0.1) < 1e-200
    assert not bound_of(narrow, -1.0, 1.0, 1.1, 0.1) < 1e200


@pytest.mark.parametrize(
    "force",
    [
        lambda t, x, v, a: -(x**3) + x * v**2 + jnp.cos(3 * t) * x,
        lambda t, x, v, a: x**7 + jnp.exp(-((t - 3) ** 2)) * x,
        lambda t, x, v, a: jnp.where(x > 0.3, -1e9 * x, 0.0) * jnp.exp(a),
    ],
)
def test_polynomials_of_low_degree_need_no_bound(force):
    assert not has_motion_bound(plan_force(bound(force, 1, 1.3), 1))
