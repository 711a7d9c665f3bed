"""Series in the root of time, for contacts that close by a power."""

import jax.numpy as jnp
import numpy as np
import pytest
from force_series import bound
from numpy.polynomial import polynomial

from vijax._series.plan import plan_force
from vijax._series.series import series_of

ORDER = 26


def rooted(force, x, v, *, fresh, mode=1.0, order=ORDER):
    """Coefficients of a motion of a unit mass in w, time = w^2."""
    plan = plan_force(force, 1)
    modes, flags = [jnp.float64(mode)] * plan.num_switches, [jnp.array(fresh)] * plan.num_switches
    series = series_of(plan, force, jnp.float64(0.4), like=jnp.zeros(1), modes=modes, fresh=flags)
    xs, vs = [jnp.array([x]), jnp.zeros(1)], [jnp.array([v]), jnp.zeros(1)]
    for k in range(order):
        xs.append(2 * vs[k] / (k + 2))
        series = series.extend(xs[k], vs[k])
        vs.append(2 * series.force(k) / (k + 2))
    return (np.array(c)[:order, 0] for c in (xs, vs))


CONTACTS = {
    "hertz": (lambda t, x, v, a: -x - 0.2 * v - 6 * jnp.maximum(x - 0.3, 0.0) ** 1.5 + jnp.cos(t), 0.3, 0.5),
    "hertz in numbers": (lambda t, x, v, a: 1.0 - (a * jnp.maximum(x - a, 0.0)) ** 2.5, 0.7, 0.5),
    "at rest": (lambda t, x, v, a: 1.0 + 0 * x - 6 * jnp.maximum(x - 0.3, 0.0) ** 1.5, 0.3, 0.0),
    "with losses": (lambda t, x, v, a: -x - 5 * jnp.maximum(x - 0.3, 0.0) ** 1.5 * (1 + 0.3 * v), 0.3, 0.4),
    "both sides": (lambda t, x, v, a: jnp.cos(t) - 4 * jnp.sign(x) * jnp.abs(x) ** 1.5 - x, 0.0, 0.8),
}


@pytest.mark.parametrize("name", CONTACTS)
def test_the_series_solves_the_equation_of_motion_after_the_contact_has_closed(name):
    function, x, v = CONTACTS[name]
    force = bound(function, 1, 0.7)
    xs, vs = rooted(force, x, v, fresh=True)
    for w in (0.02, 0.06, 0.1):
        at, speed = polynomial.polyval(w, xs), polynomial.polyval(w, vs)
        acceleration = float(force(jnp.float64(0.4 + w * w), jnp.array([at]), jnp.array([speed]))[0])
        np.testing.assert_allclose(polynomial.polyval(w, polynomial.polyder(xs)), 2 * w * speed, atol=1e-13)
        np.testing.assert_allclose(
            polynomial.polyval(w, polynomial.polyder(vs)), 2 * w * acceleration, atol=1e-13
        )


def test_a_contact_that_opens_leaves_no_force():
    force = bound(CONTACTS["at rest"][0])
    xs, _ = rooted(force, 0.3, -0.5, fresh=True, mode=0.0)
    np.testing.assert_allclose(xs[:5], [0.3, 0, -0.5, 0, 0.5], atol=1e-16)
    np.testing.assert_array_equal(xs[5:], 0)


def test_a_closed_contact_has_the_series_of_time_in_its_root():
    force = bound(CONTACTS["hertz"][0])
    plan = plan_force(force, 1)
    assert plan.is_singular
    xs, _ = rooted(force, 0.5, 0.2, fresh=False)
    series = series_of(plan, force, jnp.float64(0.4), like=jnp.zeros(1), modes=[jnp.float64(1)])
    x, v = [jnp.array([0.5])], [jnp.array([0.2])]
    for k in range(8):
        series = series.extend(x[k], v[k])
        x.append(v[k] / (k + 1))
        v.append(series.force(k) / (k + 1))
    np.testing.assert_allclose(xs[:16:2], np.array(x)[:8, 0], rtol=1e-12)
    np.testing.assert_array_equal(xs[1::2], 0)


def test_powers_that_do_not_close_are_not_singular():
    assert not plan_force(bound(lambda t, x, v, a: -((2 + x) ** 1.5) - jnp.maximum(x, 0) ** 2), 1).is_singular
