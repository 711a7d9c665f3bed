"""Series of motions and of the derivatives of forces, against derivatives of derivatives by JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from force_series import bound, by_loop, entries, first_modes, motion, nested
from jax.scipy.special import erf

from vijax._series.plan import plan_force

ORDER = 4
ROUNDING = 100 * np.finfo(float).eps


def duffing(t, x, v, a):
    return -a[0] * v - a[1] * x - a[2] * x**3 + jnp.cos(a[0] * t)


def chain(t, x, v, a):
    z = jnp.concatenate([jnp.zeros(1), x])
    stretch = z[1:] - z[:-1]
    pull = a[0] * stretch + a[1] * stretch**3
    return jnp.concatenate([pull[1:], jnp.zeros(1)]) - pull - 0.1 * v * jnp.abs(v)


def pendulums(t, x, v, a):
    return -jnp.sin(x) * jnp.exp(-v) + a[0] * jnp.tanh(x[::-1] - x) / (1 + x**2)


def functions(t, x, v, a):
    u, w = x[0] + a[1] * v[0], x[1] - v[1] * x[0]
    first = jnp.sqrt(2 + u) * erf(w) + jnp.log(3 + w) ** 2 + jnp.arctan2(u, 1 + w) + jnp.cbrt(u - 3)
    second = (
        jnp.power(2 + u, 1.3 + w) + jnp.arcsinh(u) * jnp.cosh(w) - jnp.tan(u * w) + jax.nn.sigmoid(w) ** 2
    )
    return jnp.stack([first, second])


def gradient(t, x, v, a):
    return -jax.grad(
        lambda x: a[0] * jnp.sum(jnp.cos(x)) + jnp.sum(jnp.maximum(x - 0.2, 0) ** 3) + x[0] * x[1]
    )(x)


def pieces(t, x, v, a):
    table = jnp.interp(x, jnp.array([-1.0, 0.1, 0.3, 1.0]), jnp.array([0.0, a[0], 0.7, 2.0]))
    return -table - jnp.clip(v, -0.3, 0.3) * x - jnp.where((x > 0.2) & (v > 0), x**2, 0.5 * x)


def matrices(t, x, v, a):
    stiffness = jnp.array([[2.0, -1.0], [-1.0, 2.0]]) * a[0]
    _, rows = jax.lax.scan(lambda total, row: (total + row @ x**2, total), a[1], stiffness)
    return -stiffness @ x - jnp.linalg.norm(x + 1) * v + rows * jnp.prod(x)


FORCES = [
    duffing,
    chain,
    pendulums,
    pieces,
    *(pytest.param(force, marks=pytest.mark.thorough) for force in (functions, gradient, matrices)),
]


@pytest.mark.slow
@pytest.mark.parametrize("force", FORCES)
def test_the_motion_and_the_jacobian_have_the_series_of_nested_derivatives(force):
    n, args = 2, np.array([0.7, 1.1, 0.4])
    force = bound(force, n, args)
    plan = plan_force(force, n, jacobian=True)
    matrix = lambda t, x, v: jnp.stack(jax.jacfwd(force, (1, 2))(t, x, v))  # noqa: E731
    positions, matrices = (nested(force, of, ORDER) for of in (lambda t, x, v: x, matrix))
    for seed in range(2):
        rng = np.random.default_rng(seed)
        t, x, v = jnp.float64(rng.uniform(0, 3)), *map(jnp.asarray, rng.uniform(-0.6, 0.6, (2, n)))
        modes = first_modes(plan, force, t, x, v)
        xs, _, series = motion(plan, force, t, x, v, ORDER, modes)
        np.testing.assert_allclose(xs[:ORDER], positions(t, x, v), rtol=0, atol=ROUNDING * _size(xs))
        found = np.array([entries(series, k, n) for k in range(ORDER)])
        np.testing.assert_allclose(found, matrices(t, x, v), rtol=0, atol=10 * ROUNDING * _size(found))


@pytest.mark.parametrize("order", [2, 5, 11, 16])
@pytest.mark.parametrize(
    "force", [duffing, chain, pieces, pytest.param(functions, marks=pytest.mark.thorough)]
)
def test_the_loop_has_the_coefficients_that_are_written_out(force, order):
    force = bound(force, 2, np.array([0.7, 1.1, 0.4]))
    plan = plan_force(force, 2, jacobian=True)
    rng = np.random.default_rng(order)
    t, x, v = jnp.float64(rng.uniform(0, 3)), *map(jnp.asarray, rng.uniform(-0.6, 0.6, (2, 2)))
    modes = first_modes(plan, force, t, x, v)
    xs, _, series = motion(plan, force, t, x, v, order, modes)
    found, entries = by_loop(plan, force, t, x, v, order, modes)
    np.testing.assert_allclose(found, xs[:order], rtol=2 * ROUNDING, atol=0.2 * ROUNDING)
    for k in range(1, order):
        for name, wanted in (("x", series.by_x(k)), ("v", series.by_v(k))):
            assert {at for at in wanted if np.any(wanted[at] != 0)} <= set(entries[name])
            for at, values in entries[name].items():
                np.testing.assert_allclose(
                    values[k - 1], wanted.get(at, 0), rtol=20 * ROUNDING, atol=20 * ROUNDING
                )


def _size(arrays):
    return max(1.0, float(np.max(np.abs(np.array(arrays)))))


def test_entries_that_are_zero_are_known():
    plan = plan_force(bound(lambda t, x, v, a: jnp.array([x[1] ** 2, v[0]]), 2), 2, jacobian=True)
    assert list(plan.by_x) == [(0, 1)]
    assert list(plan.by_v) == [(1, 0)]


def test_the_jacobian_must_be_asked_for():
    force = bound(lambda t, x, v, a: -(x**3))
    _, _, series = motion(plan_force(force, 1), force, 0.0, jnp.ones(1), jnp.ones(1), 2)
    with pytest.raises(ValueError, match="jacobian=True"):
        series.by_x(0)


@pytest.mark.thorough
def test_coefficients_have_the_derivatives_by_numbers_of_the_force():
    force = bound(duffing, 1, np.array([0.3, 1.1, 0.4]))
    plan = plan_force(force, 1)
    x, v = jnp.array([0.3]), jnp.array([-0.2])
    last = lambda force, x: motion(plan, force, jnp.float64(0.2), x, v, 4)[0][-1][0]  # noqa: E731
    reference = lambda force, x: nested(force, lambda t, x, v: x, 5)(jnp.float64(0.2), x, v)[-1][0]  # noqa: E731
    wanted = jax.tree.leaves(jax.jacfwd(reference, (0, 1))(force, x))
    for derivative in (jax.jacfwd, jax.jacrev):
        found = jax.tree.leaves(derivative(last, (0, 1))(force, x))
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12)


def test_long_programs_need_no_deep_recursion():
    def force(t, x, v, a):
        total, _ = jax.lax.scan(lambda s, _: (s + 0.01 * jnp.sin(s), None), x, None, length=400)
        return -total

    plan = plan_force(bound(force), 1, jacobian=True)
    assert len(plan.operations) > 1000
