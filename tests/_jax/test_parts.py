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


def _branching(x, unread, factor):
    """Parts inside of choices and loops; of some nothing is read but a count."""

    def turn(k, now):
        x, count = now
        shared = as_part(lambda a, b: (a * jnp.exp(-a * b), jnp.sum(unread) + k, a > 0.5), x, factor)
        beside = as_part(lambda a, b: (jnp.tanh(a) * b, a), x, factor)
        x = jax.lax.cond(x[0] > 0.2, lambda: as_part(lambda a: jnp.sin(a) * shared[0], x), lambda: beside[0])
        return jnp.where(shared[2], x, x + beside[1]), count + shared[1]

    x, count = jax.lax.fori_loop(0, 3, turn, (x, jnp.array(0)))
    return x + jax.lax.stop_gradient(count)


def _in_parts(x, factor):
    return in_parts(_branching, x, jnp.arange(3), factor)


ALONE = {
    "jacobian": jax.jacfwd,
    "by a shared number": lambda f: jax.jacfwd(f, 1),
    "forwards twice": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "forwards of reverse": jax.hessian,
}
BATCHES = {
    "batch": lambda f: jax.vmap(f, (0, None)),
    "batch of Jacobians": lambda f: jax.vmap(jax.jacfwd(f), (0, None)),
    "Jacobian of a batch": lambda f: jax.jacfwd(jax.vmap(f, (0, None))),
}


@pytest.mark.parametrize("name", [*ALONE, *BATCHES])
def test_parts_have_the_derivatives_and_batches_of_what_is_in_them(name):
    start = START if name in ALONE else jnp.stack([START, 2 * START, -START])
    of, factor = (ALONE | BATCHES)[name], jnp.array(0.7)
    right = jax.jit(of(lambda x, factor: _branching(x, jnp.arange(3), factor)))(start, factor)
    np.testing.assert_allclose(jax.jit(of(_in_parts))(start, factor), right, rtol=1e-13, atol=1e-15)


def test_parts_are_differentiable_in_reverse():
    loss = lambda f: jax.grad(lambda x, factor: jnp.sum(f(x, factor) ** 2), (0, 1))  # noqa: E731
    found = jax.jit(loss(_in_parts))(START, jnp.array(0.7))
    right = jax.jit(loss(lambda x, factor: _branching(x, jnp.arange(3), factor)))(START, jnp.array(0.7))
    for a, b in zip(found, right, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-15)
