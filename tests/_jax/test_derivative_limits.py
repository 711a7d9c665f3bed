"""Derivatives of motions of very many steps are right, or an error."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._jax.differentiable import with_derivatives

pytestmark = pytest.mark.thorough

# A light machine with a stop that it never reaches: x = cos(sqrt(k) t), some steps per unit of time.
LONG = 1e5
STOP = vx.Stop(0, 100.0, "upper", 0.7)


def light(stiffness, t1=LONG, stops=(STOP,), **options) -> jax.Array:
    load = vx.Harmonic([0.0], 1.0)
    system = vx.ImpactSystem([1.0], [[0.0]], stiffness * jnp.ones((1, 1)), load, stops)
    options = {"max_events": 1, "flow": vx.TaylorFlow()} | options  # fastest to compile
    return vx.simulate(system, 0.0, t1, [1.0], [0.0], **options).x1[0]


@pytest.mark.slow
def test_forward_derivatives_have_no_bound_on_steps():
    sol = vx.simulate(
        vx.ImpactSystem([1.0], [[0.0]], [[1.0]], vx.Harmonic([0.0], 1.0), [STOP]),
        0.0,
        LONG,
        [1.0],
        [0.0],
    )
    assert sol.num_steps > 65_536
    value, slope = jax.jvp(light, (jnp.asarray(1.0),), (jnp.asarray(1.0),))
    # Rounding errors of 1e-16 per step.
    assert float(value) == pytest.approx(np.cos(LONG), abs=1e-9)
    assert float(slope) == pytest.approx(-np.sin(LONG) * LONG / 2, rel=1e-9)


@pytest.mark.slow
def test_reverse_derivatives_have_no_bound_on_steps():
    slope = jax.jit(jax.grad(lambda k: light(k, 200.0, ())))
    assert float(slope(1.0)) == pytest.approx(-np.sin(200.0) * 100.0, rel=1e-11)


def test_a_bound_on_reverse_steps_has_no_effect_and_warns():
    def both(k):
        with pytest.warns(DeprecationWarning, match="`max_reverse_steps` has no effect"):
            return light(k, 20.0, (), max_reverse_steps=1)

    found = jax.jit(jax.grad(both))(1.0)
    np.testing.assert_allclose(found, -np.sin(20.0) * 10.0, rtol=1e-12)


@pytest.mark.slow
def test_derivatives_of_more_flights_than_are_recorded_at_once():
    """A ball of restitution 1 that bounces a few hundred times: its period grows with its height."""

    def height(h, end):
        ball = vx.models.bouncing_ball(1.0, gravity=10.0)
        return vx.simulate(ball, 0.0, end, h[None], jnp.zeros(1), max_events=4, throw=False).x1[0]

    # x = v s - g s^2 / 2 with v = sqrt(2 g h) and the time s = t - (2 k - 1) T since the last of k impacts, T = sqrt(2 h / g).
    h, g, num_impacts = 5.0, 10.0, 300
    fall, speed = np.sqrt(2 * h / g), np.sqrt(2 * g * h)
    since = fall / 2
    end = (2 * num_impacts - 1) * fall + since
    expected = g / speed * since - (speed - g * since) * (2 * num_impacts - 1) * fall / (2 * h)
    for derivative in (jax.jacfwd, jax.grad):
        assert float(derivative(height)(jnp.asarray(h), end)) == pytest.approx(expected, rel=1e-9)


# `with_derivatives`


def plain(x, y, k):
    """A function of two numbers and a count, which has no derivative."""
    return y * jnp.sin(x) + x**3 * y**2, k + 1


def plain_of_many(tree, size):
    full = jax.tree.map(lambda a: jnp.broadcast_to(a, (*a.shape[:-1], size)), tree)
    return jax.vmap(lambda tree: plain(*tree), in_axes=-1)(full)


def own(has_many: bool):
    """The same function with derivatives of its own, and with functions of a batch if `has_many`."""
    of_many = {
        "many": plain_of_many,
        "smooth_many": lambda tree, wanted, size: plain_of_many(tree, size),
    }

    def function(x, y, k):
        return with_derivatives(
            _plain_of_tree,
            (x, y, k),
            smooth=lambda tree, wanted: plain(*tree),
            **(of_many if has_many else {}),
        )

    return function


def _plain_of_tree(tree):
    return plain(*tree)


def _first(function):
    return lambda x, y, k: function(x, y, k)[0]


DERIVATIVES = {
    "forward": lambda f: jax.jacfwd(f, (0, 1)),
    "reverse": lambda f: jax.jacrev(f, (0, 1)),
    "forward of forward": lambda f: jax.jacfwd(jax.jacfwd(f, 1), (0, 1)),
    "forward of reverse": lambda f: jax.jacfwd(jax.jacrev(f, 1), (0, 1)),
    "reverse of forward": lambda f: jax.jacrev(jax.jacfwd(f, 1), (0, 1)),
    "reverse of reverse": lambda f: jax.jacrev(jax.jacrev(f, (0, 1)), 0),
    "third": lambda f: jax.grad(jax.jacfwd(jax.grad(f, 1), 0), 0),
    "under checkpoint": lambda f: jax.grad(jax.checkpoint(f), (0, 1)),
    "hessian": lambda f: jax.hessian(f, (0, 1)),
    "of one lane each": lambda f: (
        lambda x, y, k: jax.vmap(jax.grad(f), (0, None, None))(x * jnp.ones(3), y, k)
    ),
    "of all lanes": lambda f: (
        lambda x, y, k: jax.jacrev(
            lambda x, y: jax.vmap(f, (0, None, None))(x * jnp.arange(3.0), y, k), (0, 1)
        )(x, y)
    ),
    "hessian of all lanes": lambda f: (
        lambda x, y, k: jax.hessian(
            lambda x, y: jax.vmap(jax.grad(f, 1), (None, 0, None))(x, y * jnp.arange(3.0), k).sum(), (0, 1)
        )(x, y)
    ),
}


@pytest.mark.parametrize("derivative", DERIVATIVES)
@pytest.mark.parametrize("is_compiled", [False, True])
@pytest.mark.parametrize("has_many", [False, True])
def test_a_function_has_the_derivatives_of_the_plain_one(derivative, is_compiled, has_many):
    x, y, k = jnp.asarray(0.3), jnp.asarray(0.7), jnp.asarray(2)
    ours, theirs = (DERIVATIVES[derivative](_first(f)) for f in (own(has_many), plain))
    found = (jax.jit(ours) if is_compiled else ours)(x, y, k)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(jax.jit(theirs)(x, y, k)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)


def test_values_are_those_of_one_function_and_derivatives_of_the_other():
    """Derivatives are three times as large: this shows which function is used."""
    function = lambda x: with_derivatives(lambda x: 2.0 * x, x, smooth=lambda x, _: 3.0 * x)  # noqa: E731
    x = jnp.asarray(1.0)
    assert function(x) == 2.0
    assert jax.jacfwd(function)(x) == 3.0
    assert jax.jit(jax.value_and_grad(function))(x) == (2.0, 3.0)
    assert jax.jit(jax.linearize(function, x)[1])(x) == 3.0


def test_derivatives_that_are_not_used_are_not_computed():
    seen = []

    def smooth(tree, wanted):
        seen.append(wanted)
        return tree, jnp.sin(tree)

    function = lambda x: with_derivatives(lambda x: (x, jnp.sin(x)), x, smooth=smooth)  # noqa: E731
    assert jax.jit(jax.jacfwd(lambda x: function(x)[1]))(0.3) == pytest.approx(np.cos(0.3))
    assert seen[-1] == (False, True)


def root(x, y):
    """A function with infinite derivative at x = 0, and NaN below."""
    return with_derivatives(lambda xy: xy[1] * jnp.sqrt(xy[0]), (x, y))


@pytest.mark.parametrize("is_compiled", [False, True])
def test_a_lane_that_a_sum_leaves_out_spoils_no_derivative_by_what_the_lanes_share(is_compiled):
    x, y = jnp.array([[4.0, 0.0], [-1.0, 9.0]]), jnp.asarray(1.0)

    def total(x, y):
        found = jax.vmap(jax.vmap(root, (0, None)), (0, None))(x - y, y)
        return jnp.where(x > 1, found, 0).sum()

    slopes = jax.grad(total, (0, 1))
    by_x, by_y = (jax.jit(slopes) if is_compiled else slopes)(x, y)
    of_lanes = 1 / (2 * np.sqrt([3.0, 8.0]))
    np.testing.assert_allclose(by_x, [[of_lanes[0], 0], [0, of_lanes[1]]], rtol=1e-14)
    np.testing.assert_allclose(by_y, np.sqrt([3.0, 8.0]).sum() - of_lanes.sum(), rtol=1e-14)


def test_of_nan_all_derivatives_are_nan():
    by_x, by_y = jax.vmap(jax.grad(lambda x, y: jnp.sqrt(-1.0) * root(x, y), (0, 1)), (0, None))(
        jnp.array([0.0, 4.0]), 0.0
    )
    assert np.isnan([*by_x, *by_y]).all()
