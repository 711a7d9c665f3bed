"""Functions that fit into a kernel are told by their jaxpr: with anything else in a kernel the process would end."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._jax.arithmetic import is_arithmetic

MATRIX = np.array([[0.1, 0.2, 0.0], [0.0, 0.1, 0.3], [0.2, 0.0, 0.1]])
# Steps of a solver begin elsewhere after a rounding.
STEPS = 1e-9


class Spring(eqx.Module):
    stiffness: jax.Array

    def __call__(self, x):
        return -self.stiffness * x**3


FITS = {
    "powers": lambda x: -0.3 * x**3,
    "choices": lambda x: jax.lax.cond(x[0] > 0, lambda x: -x, lambda x: -2 * x, x),
    "pieces": lambda x: jnp.where(x > 0, 0.0, x) * jnp.exp(-x),
    "one place": lambda x: jnp.zeros(3).at[0].set(-(x[0] ** 3)),
    "sums": lambda x: x * jnp.sum(x**2) + jnp.linalg.norm(x),
    "loops": lambda x: jax.lax.fori_loop(0, 3, lambda _, y: jnp.sin(y), x),
    "gradients": jax.grad(lambda x: jnp.sum(x**4)),
    "modules": Spring(jnp.array(0.3)),
}
FITS_NOT = {
    "products of matrices": lambda x: jnp.asarray(MATRIX) @ x,
    "sorting": jnp.sort,
    "linear algebra": lambda x: jnp.linalg.solve(jnp.eye(3) + MATRIX, x),
    "unknown places": lambda x: jnp.zeros(3).at[jnp.argmax(x)].set(1.0),
    "many places": lambda x: jnp.zeros(3).at[jnp.array([0, 1, 0])].add(x),
    "calls of Python": lambda x: jax.pure_callback(np.sin, x, x),
    "inside of a choice": lambda x: jax.lax.cond(x[0] > 0, jnp.sort, lambda x: x, x),
}


@pytest.mark.parametrize("name", FITS)
def test_arithmetic_fits(name):
    assert is_arithmetic(FITS[name], jnp.ones(3))


@pytest.mark.parametrize("name", FITS_NOT)
def test_nothing_else_fits(name):
    assert not is_arithmetic(FITS_NOT[name], jnp.ones(3))


def test_functions_without_a_hash_are_told_too():
    class Listed(eqx.Module):
        places: list = eqx.field(static=True)

        def __call__(self, x):
            return -sum(x[k] for k in self.places) * x

    assert is_arithmetic(Listed([0, 1]), jnp.ones(3))


def end(force):
    machine = vx.ImpactSystem(
        np.ones(3), 0.1 * np.eye(3), np.eye(3), vx.Harmonic([0.5, 0, 0], 0.8), [vx.Stop(0, 0.3)], force=force
    )
    assert machine.force is not None
    solution = vx.simulate(machine, 0.0, 20.0)
    ds = vx.sweep(machine, {"forcing.frequency": [0.8, 0.9]}, transient=1, record=1, progress=False)
    return np.concatenate([solution.x1, solution.v1, ds.x.values.ravel()])


@pytest.mark.slow
def test_in_a_kernel_and_outside_the_motion_is_the_same():
    inside = end(lambda t, x, v, args: -sum(jnp.asarray(MATRIX)[:, j] * jnp.tanh(x[j]) for j in range(3)))
    outside = end(lambda t, x, v, args: -jnp.asarray(MATRIX) @ jnp.tanh(x))
    np.testing.assert_allclose(inside, outside, rtol=0, atol=STEPS)
