"""Calls with directives to the compiler: traced once, with the results of the plain function."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._jax.xla import compute_once, in_one_kernel

traced = []


def scaled(x, factor, empty, name):
    """A function that encloses nothing; `factor` and `name` are static."""
    traced.append((factor, name))
    return {"x": factor * x + jnp.sum(empty), "is_flag": jnp.asarray(factor is True), "y": x}


@pytest.mark.parametrize("call", [compute_once, in_one_kernel])
def test_a_function_is_traced_once_for_each_kind_of_arguments(call):
    traced.clear()
    jax.clear_caches()

    @jax.jit
    def whole(x):
        once, again = (call(scaled, x + k, 2, jnp.zeros((0, 3)), "same") for k in (0, 1))
        flag, other = call(scaled, x, True, jnp.zeros(0), "same"), call(scaled, x, 1, jnp.zeros(0), "other")
        return once, again, flag, other

    x = np.arange(3.0)
    once, again, flag, other = whole(x)
    assert traced == [(2, "same"), (True, "same"), (1, "other")]
    np.testing.assert_array_equal(once["x"], 2 * x)
    np.testing.assert_array_equal(again["x"], 2 * (x + 1))
    np.testing.assert_array_equal(flag["x"], x)
    np.testing.assert_array_equal(other["x"], x)
    assert bool(flag["is_flag"])
    assert not bool(other["is_flag"])


def test_one_and_true_are_different_arguments():
    x = jnp.arange(2.0)
    flags = [bool(compute_once(scaled, x, value, x[:0], "equal")["is_flag"]) for value in (1, True, 1)]
    assert flags == [False, True, False]


def test_what_a_function_encloses_is_its_own():
    found = [float(compute_once(lambda x, k=k: k * x, jnp.asarray(2.0))) for k in (1, 2, 3)]
    assert found == [2, 4, 6]

    def enclosing(number):
        return compute_once(lambda x: number * x, jnp.asarray(2.0))

    assert [float(enclosing(k)) for k in (1.0, 2.0)] == [2, 4]
    np.testing.assert_array_equal(jax.vmap(enclosing)(jnp.arange(3.0)), [0, 2, 4])


def test_derivatives_pass_through_calls_of_one_trace():
    def twice(x):
        return sum(jnp.sum(compute_once(scaled, x * k, 3, x[:0], "sum")["x"] ** 2) for k in (1.0, 2.0))

    x = jnp.arange(1.0, 4.0)
    np.testing.assert_allclose(jax.grad(twice)(x), 2 * 9 * (1 + 4) * x, rtol=1e-15)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(twice))(x), 2 * 9 * (1 + 4) * x, rtol=1e-15)


def test_no_tracer_is_kept():
    with jax.checking_leaks():
        jax.jit(lambda x: compute_once(scaled, x, 5, x[:0], "leaks")["x"])(jnp.arange(3.0))
