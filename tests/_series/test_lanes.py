"""Series of many motions at once."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from force_series import bound

from vijax._lanes.transform import lanes_last
from vijax._machine.extra_force import ExtraForce
from vijax._series.plan import plan_force
from vijax._series.series import series_of

LANES, ORDER = 3, 5


def oscillator(t, x, v, a):
    table = jnp.interp(t, jnp.array([0.0, 1.0, 2.0]), a["table"])
    return -a["c"] * v - x**3 + jnp.tanh(x) * table - a["k"] * jnp.maximum(x - a["gap"], 0.0) ** 1.5


def coefficients(force, t, x, v, modes, *, fence=False):
    plan = plan_force(force, 1, lanes=x.ndim > 1, jacobian=True)
    series = series_of(plan, force, t, like=x, modes=modes, fence=fence)
    xs, vs = [x], [v]
    for k in range(ORDER):
        series = series.extend(xs[k], vs[k])
        xs.append(vs[k] / (k + 1))
        vs.append(series.force(k) / (k + 1))
    return jnp.stack(xs), jnp.stack([series.by_x(k)[0, 0] for k in range(ORDER)])


ARGS = {"c": 0.1, "k": 2.0, "gap": 0.2, "table": jnp.array([1.0, 2.0, -1.0])}
X, V, T = jnp.array([[0.1, 0.5, 0.3]]), jnp.array([[0.4, -0.2, 0.0]]), jnp.array([0.5, 1.5, 2.5])
MODES = jnp.array([[1.0, 2.0, 3.0], [0.0, 1.0, 1.0]])
GAPS = jnp.array([0.2, 0.3, 0.1])


@pytest.mark.parametrize("shared", [True, False])
def test_lanes_have_the_coefficients_that_they_have_alone(shared):
    force = bound(oscillator, 1, ARGS)
    forces = jax.tree.map(lambda a: a[..., None], force)
    if not shared:
        forces.args["gap"] = GAPS
    wanted = []
    for k in range(LANES):
        alone = jax.tree.map(lambda a: a, force)
        if not shared:
            alone.args["gap"] = GAPS[k]
        wanted.append(coefficients(alone, T[k], X[:, k], V[:, k], MODES[:, k]))
    wanted = [jnp.stack(rows, -1) for rows in zip(*wanted, strict=True)]
    for function in (coefficients, partial(coefficients, fence=True), lanes_last(coefficients)):
        found = function(forces, T, X, V, MODES)
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-15)


def test_numbers_that_are_known_are_not_given():
    force = bound(oscillator, 1, ARGS)
    known = jax.tree.map(np.asarray, force)
    assert plan_force(known, 1).num_numbers == 0
    found = coefficients(known, T[0], X[:, 0], V[:, 0], MODES[:, 0])
    wanted = coefficients(force, T[0], X[:, 0], V[:, 0], MODES[:, 0])
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13)


def test_the_force_of_a_machine_counts_its_time_from_the_origin():
    force = ExtraForce(bound(lambda t, x, v, a: jnp.cos(t) + 0 * x), jnp.float64(0.7))
    series = series_of(plan_force(force, 1), force, jnp.float64(0.7), like=jnp.zeros(1))
    series = series.extend(jnp.zeros(1), jnp.zeros(1))
    np.testing.assert_allclose(series.force(0), np.cos(0.7), rtol=1e-15)
