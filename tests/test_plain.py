"""A loop does the same without primitives of our own and without what the compiler is told."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax import _xla

# The same operations in the same order, but for what the compiler fuses.
ROUNDING = 1e-14


class Growth(_xla.AbstractTask):
    """Growth by a factor until 10 is passed."""

    factor: jax.Array

    def is_live(self, carry):
        return carry[0] < 10

    def step(self, carry):
        x, steps = carry
        live = self.is_live(carry)
        return jnp.where(live, x * self.factor, x), steps + live


def grown(factor):
    start = jnp.ones(()), jnp.zeros((), int)
    x, _ = _xla.while_any(
        Growth(factor), start, max_reverse_steps=16, refuse=lambda cut: jnp.where(cut, jnp.nan, 1.0)
    )
    return _xla.compute_once(jnp.sin, x)


@pytest.mark.parametrize("plain", [False, True])
def test_values_and_derivatives_of_a_loop_are_those_of_its_steps(plain, monkeypatch):
    monkeypatch.setattr(_xla, "PLAIN", plain)
    # 1.5 is past 10 after 6 steps, 2 after 4.
    factors, steps = jnp.array([1.5, 2.0]), np.array([6, 4])
    expected = np.cos(factors**steps) * steps * factors ** (steps - 1)
    np.testing.assert_allclose(jax.vmap(grown)(factors), np.sin(factors**steps), rtol=ROUNDING)
    for derivative in (jax.jacfwd, jax.grad):
        np.testing.assert_allclose(jax.vmap(derivative(grown))(factors), expected, rtol=100 * ROUNDING)
