"""Parts of a loop as kernels of their own give the same numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._jax.xla import as_part, compute_once, in_parts, of_parts

START = jnp.linspace(0.0, 1.0, 5)


def _grown(x, unread, factor):
    """Results of which one is an argument and one a constant; an argument that nothing reads."""
    return x * factor + jnp.sin(x), unread, jnp.zeros(3), compute_once(lambda a: a + 1, x)


def _loop(x, unread, factor):
    def turn(k, now):
        x, unread, _, beside = compute_once(_grown, now[0], now[1], factor)
        return as_part(lambda a, b: a + b * factor, x, beside), unread

    return jax.lax.fori_loop(0, 4, turn, (x, unread))


def test_a_loop_in_parts_gives_the_same_bits():
    unread, factor = jnp.arange(3), jnp.array(0.5)
    whole = jax.jit(_loop)(START, unread, factor)
    parts = jax.jit(lambda *a: in_parts(_loop, *a))(START, unread, factor)
    for a, b in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(a, b)


def test_calls_inside_of_a_function_of_parts_are_the_kernels():
    def turn(x):
        return of_parts(lambda a: compute_once(jnp.sin, a) + compute_once(jnp.cos, a), x)

    parts = jax.jit(lambda x: in_parts(turn, x)).lower(START).compile().as_text()
    assert sum(" call(" in line and "small_call" in line for line in parts.splitlines()) == 2
    assert "small_call" not in jax.jit(turn).lower(START).compile().as_text()
    np.testing.assert_array_equal(jax.jit(turn)(START), jax.jit(lambda x: in_parts(turn, x))(START))


def test_parts_end_with_the_call_even_if_it_fails():
    def fails(x):
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        in_parts(fails, START)
    # Outside of `in_parts` a part is no kernel: static results are allowed, as of any function.
    assert as_part(lambda x: (x, "name"), START)[1] == "name"
