"""Keys of programs, and which results depend on which arguments."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._jax.jaxprs import key_of_jaxpr, reached_outputs


def traced(function):
    return jax.make_jaxpr(function)(1.0, 2.0)


def test_a_function_written_again_has_the_key_of_the_first():
    first = traced(lambda a, b: jnp.where(a > 0, a * np.arange(3.0), b))
    again = traced(lambda x, y: jnp.where(x > 0, x * np.arange(3.0), y))
    assert key_of_jaxpr(first) == key_of_jaxpr(again)
    assert hash(key_of_jaxpr(first)) == hash(key_of_jaxpr(again))


@pytest.mark.parametrize(
    "other",
    [
        lambda a, b: jnp.where(a > 0, a * np.array([0.0, 1.0, 2.0 + 1e-15]), b),
        lambda a, b: jnp.where(a > 1e-300, a * np.arange(3.0), b),
        lambda a, b: jnp.where(a > 0, b * np.arange(3.0), b),
        lambda a, b: jnp.where(a > 0, b, a * np.arange(3.0)),
        lambda a, b: jnp.where(a >= 0, a * np.arange(3.0), b),
    ],
    ids=["array", "literal", "argument", "order", "primitive"],
)
def test_a_function_that_computes_something_else_has_another_key(other):
    first = traced(lambda a, b: jnp.where(a > 0, a * np.arange(3.0), b))
    assert key_of_jaxpr(first) != key_of_jaxpr(traced(other))


def test_results_are_reached_by_their_arguments_alone():
    inner = jax.jit(lambda a, b: (a * a, b + 1, jnp.ones(2)))

    def function(a, b):
        square, after, ones = inner(a, b)
        return square, after, ones * 3, jnp.eye(2), a + b, jax.lax.fori_loop(0, 3, lambda _, c: c * a, b)

    program = traced(function).jaxpr
    assert reached_outputs(program, [True, False]) == [True, False, False, False, True, True]
    assert reached_outputs(program, [False, True]) == [False, True, False, False, True, True]
    assert reached_outputs(program, [False, False]) == [False] * 6
