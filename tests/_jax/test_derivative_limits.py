"""Derivatives of motions of very many steps are right, or an error."""

import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._jax import ways
from vijax._jax.both_ways import both_ways

# A light machine with a stop that it never reaches: x = cos(sqrt(k) t), some steps per unit of time.
LONG = 1e5
STOP = vx.Stop(0, 100.0, "upper", 0.7)


def light(stiffness, t1=LONG, stops=(STOP,), **options) -> jax.Array:
    load = vx.Harmonic([0.0], 1.0)
    system = vx.ImpactSystem([1.0], [[0.0]], stiffness * jnp.ones((1, 1)), load, stops)
    options = {"max_events": 1, "flow": vx.TaylorFlow()} | options  # fastest to compile
    return vx.simulate(system, 0.0, t1, [1.0], [0.0], **options).x1[0]


@pytest.mark.thorough
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


@pytest.fixture
def by_many(monkeypatch):
    """Derivatives backwards by any number go backwards through the steps, as else only those by many."""
    monkeypatch.setattr(ways, "MAX_FORWARD_INPUTS", 0)


@pytest.mark.thorough
def test_reverse_derivatives_by_few_numbers_have_no_bound_on_steps():
    slope = jax.jit(jax.grad(lambda k: light(k, 200.0, (), max_reverse_steps=1)))
    assert float(slope(1.0)) == pytest.approx(-np.sin(200.0) * 100.0, rel=1e-11)


@pytest.mark.thorough
@pytest.mark.parametrize("max_reverse_steps", [100, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.usefixtures("by_many")
def test_reverse_derivatives_by_many_numbers_are_right_or_refused(max_reverse_steps):
    logging.disable(logging.CRITICAL)
    # Without a stop it compiles in half the time, where the value is not tested.
    stops = (STOP,) if max_reverse_steps == 1000 else ()
    slope = jax.jit(jax.grad(lambda k: light(k, 200.0, stops, max_reverse_steps=max_reverse_steps)))
    if max_reverse_steps == 1000:
        assert float(slope(1.0)) == pytest.approx(-np.sin(200.0) * 100.0, rel=1e-11)
    else:
        with pytest.raises((RuntimeError, ValueError), match=r"max_reverse_steps_reached: .*jax\.jacfwd"):
            jax.block_until_ready(slope(1.0))
    logging.disable(logging.NOTSET)


@pytest.mark.thorough
@pytest.mark.usefixtures("by_many")
def test_without_throw_reverse_derivatives_of_too_many_steps_are_nan_in_their_lane_alone():
    def end(stiffness, t1):
        return light(stiffness, t1, max_reverse_steps=100, throw=False)

    short, long = jax.vmap(jax.grad(end), (None, 0))(1.0, jnp.array([20.0, 200.0]))
    assert float(short) == pytest.approx(-np.sin(20.0) * 10.0, rel=1e-12)
    assert np.isnan(long)


def test_a_bound_on_reverse_steps_does_not_touch_values_or_forward_derivatives():
    both = jax.jit(
        lambda k: jax.jvp(lambda k: light(k, 200.0, (), max_reverse_steps=1), (k,), (jnp.ones(()),))
    )
    found = both(jnp.asarray(1.0))
    np.testing.assert_allclose(found, [np.cos(200.0), -np.sin(200.0) * 100.0], rtol=1e-11)


# `both_ways`


def plain(x, y, k):
    """A function of two numbers and a count, which has no derivative."""
    return y * jnp.sin(x) + x**3 * y**2, k + 1


def either_way(x, y, k):
    return both_ways(lambda tree: plain(*tree), lambda tree: plain(*tree), (x, y, k))


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
@pytest.mark.parametrize("few", [0, 32])
def test_a_function_of_two_ways_has_the_derivatives_of_the_plain_one(
    derivative, is_compiled, few, monkeypatch
):
    monkeypatch.setattr(ways, "MAX_FORWARD_INPUTS", few)
    x, y, k = jnp.asarray(0.3), jnp.asarray(0.7), jnp.asarray(2)
    ours, theirs = (DERIVATIVES[derivative](_first(f)) for f in (either_way, plain))
    found = (jax.jit(ours) if is_compiled else ours)(x, y, k)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(jax.jit(theirs)(x, y, k)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)


@pytest.mark.usefixtures("by_many")
def test_each_way_is_gone_where_it_is_asked_for():
    """Forward gives twice the derivative, reverse three times: this shows which function is used."""
    function = lambda x: both_ways(lambda x: 2.0 * x, lambda x: 3.0 * x, x)  # noqa: E731
    x = jnp.asarray(1.0)
    assert function(x) == 2.0
    assert jax.jacfwd(function)(x) == 2.0
    assert jax.grad(function)(x) == 3.0
    assert jax.jit(jax.value_and_grad(function))(x) == (2.0, 3.0)
    assert jax.jit(jax.linearize(function, x)[1])(x) == 2.0


def test_backwards_by_few_numbers_is_forwards_by_each():
    function = lambda x: both_ways(lambda x: 2.0 * x, lambda x: 3.0 * x, x)  # noqa: E731
    np.testing.assert_array_equal(
        jax.jacrev(function)(jnp.ones(ways.MAX_FORWARD_INPUTS)), 2 * np.eye(ways.MAX_FORWARD_INPUTS)
    )
    np.testing.assert_array_equal(
        jax.jacrev(function)(jnp.ones(ways.MAX_FORWARD_INPUTS + 1)), 3 * np.eye(ways.MAX_FORWARD_INPUTS + 1)
    )


def root(x, y):
    """A function with infinite derivative at x = 0, and NaN below."""
    return both_ways(lambda xy: xy[1] * jnp.sqrt(xy[0]), lambda xy: xy[1] * jnp.sqrt(xy[0]), (x, y))


@pytest.mark.parametrize("is_compiled", [False, True])
@pytest.mark.parametrize("few", [0, 32])
def test_a_lane_that_a_sum_leaves_out_spoils_no_derivative_by_what_the_lanes_share(
    is_compiled, few, monkeypatch
):
    monkeypatch.setattr(ways, "MAX_FORWARD_INPUTS", few)
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
