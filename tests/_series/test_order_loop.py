"""Series by a loop over the orders: derivatives, batches, what is kept."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from force_series import bound, by_loop, first_modes, motion

from vijax._series.order_loop import LoopSeries
from vijax._series.plan import plan_force
from vijax._series.series import series_of

T, X, V = jnp.float64(0.7), jnp.array([0.3, -0.5]), jnp.array([-0.2, 0.4])


def springs(t, x, v, a):
    return -a[0] * v - a[1] * x**3 + jnp.cos(a[0] * t) * jnp.sin(x[::-1])


def pieces(t, x, v, a):
    return -jnp.abs(x) * x - jnp.interp(v, jnp.array([-1.0, 0.0, 1.0]), jnp.array([a[0], 0.0, a[1]]))


@pytest.mark.thorough
def test_the_loop_is_differentiable_and_takes_batches():
    force = bound(springs, 2, np.array([0.7, 1.1]))
    plan = plan_force(force, 2)
    loop = lambda x: by_loop(plan, force, T, x, V, 6)[0][-1]  # noqa: E731
    written = lambda x: motion(plan, force, T, x, V, 6)[0][5]  # noqa: E731
    wanted = jax.jacfwd(written)(X)
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derivative(loop)(X), wanted, rtol=1e-12, atol=1e-15)
    many = jnp.stack([X, 2 * X, -X])
    np.testing.assert_allclose(jax.vmap(loop)(many), [written(x) for x in many], rtol=1e-13)


def test_the_loop_keeps_what_is_asked_for():
    force = bound(pieces, 2, np.array([0.7, 1.1]))
    plan = plan_force(force, 2)
    start = series_of(plan, force, T, like=X, modes=first_modes(plan, force, T, X, V)).extend(X, V)
    kept = plan.switches[0].guard
    series = LoopSeries(start, {kept: jnp.array([3.0, 4.0])}, 3)
    assert [float(series.guard(0, k)) for k in (1, 2)] == [3.0, 4.0]
    assert len(series) == 3
    with pytest.raises(KeyError):
        series.coefficient(max(plan.moving), 1)


def test_a_derivative_that_is_time_itself_is_no_zero():
    plan = plan_force(bound(lambda t, x, v, a: t * x), 1, jacobian=True)
    assert plan.by_x == {(0, 0): 0}
    assert plan.moving >= {0, plan.forces[0]}
