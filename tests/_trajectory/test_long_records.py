"""Derivatives of motions under records of thousands of samples."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

TIMES = np.linspace(0.0, 40.0, 2001)


def end(values: jax.Array, start: float = 0.0) -> jax.Array:
    load = vx.Tabulated(TIMES, values)
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.3, "upper", 0.7)])
    return vx.simulate(machine, 0.0, 40.0, x0=jnp.reshape(start, 1)).x1[0]


@pytest.mark.slow
def test_the_end_under_a_long_record_has_derivatives():
    # Constants of its kernels ended the process.
    values, h = jnp.cos(TIMES)[:, None], 1e-6
    slopes = jax.jit(jax.grad(end))(values)
    for change in (jnp.sin(TIMES)[:, None], jnp.exp(-TIMES)[:, None]):
        difference = (end(values + h * change) - end(values - h * change)) / (2 * h)
        np.testing.assert_allclose(jnp.sum(slopes * change), difference, rtol=1e-6)
    difference = (end(values, h) - end(values, -h)) / (2 * h)
    np.testing.assert_allclose(jax.jacfwd(lambda s: end(values, s))(0.0), difference, rtol=1e-6)
