"""Derivatives of functions that are compiled as programs of their own, against those of JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._jax.xla import compile_derivatives_lightly


def plain(matrix, power, label="sum"):
    """Numbers and complex numbers of a matrix, with a loop inside, and a word that stays as it is."""
    total = jax.lax.fori_loop(0, 3, lambda _, a: jnp.sin(a @ matrix), matrix)
    return {"total": jnp.sum(total**power), "turned": jnp.exp((1j - 0.5) * total[0])}, label


compiled = compile_derivatives_lightly(plain)
MATRIX = np.array([[0.3, -0.7], [0.9, 0.2]])


def number(function):
    def of(a):
        found, label = function(a * MATRIX, 2, label="kept")
        assert label == "kept"
        return found["total"] + jnp.abs(found["turned"][0]) + jnp.imag(found["turned"][1])

    return of


DERIVATIVES = {
    "value": lambda f: f,
    "forwards": jax.jacfwd,
    "in reverse": jax.grad,
    "in a batch": lambda f: lambda a: jax.vmap(f)(jnp.stack([a, 2 * a])),
    "of a batch": lambda f: jax.grad(lambda a: jnp.sum(jax.vmap(f)(jnp.stack([a, 2 * a])))),
    "batch of derivatives": lambda f: lambda a: jax.vmap(jax.grad(f))(jnp.stack([a, 2 * a])),
    "under jit": lambda f: jax.jit(jax.grad(f)),
    "pullback under jit": lambda f: lambda a: jax.jit(jax.vjp(f, a)[1])(1.0)[0],
    "map under jit": lambda f: lambda a: jax.jit(jax.linearize(f, a)[1])(1.0),
    "second, forwards": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "second, in reverse last": lambda f: jax.grad(jax.jacfwd(f)),
}


@pytest.mark.parametrize("of", DERIVATIVES)
def test_derivatives_are_those_of_the_function(of):
    expected, found = (DERIVATIVES[of](number(f))(1.1) for f in (plain, compiled))
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_a_matrix_has_the_gradient_of_jax():
    of = lambda f: jax.grad(lambda m: f(m, 2)[0]["total"])(jnp.asarray(MATRIX))  # noqa: E731
    np.testing.assert_allclose(of(compiled), of(plain), rtol=1e-13)
