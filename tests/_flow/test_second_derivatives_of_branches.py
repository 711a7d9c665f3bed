"""Second derivatives of motions whose force has corners: against differences of the first ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from combinations import Choice

import vijax as vx


@pytest.mark.slow
def test_second_derivatives_count_that_a_corner_comes_at_another_time():
    load = vx.Harmonic([0.5], 2.2)
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, force=Choice(0.5, 0.0))

    def end(start):
        sol = vx.simulate(machine, 0.0, 4.0, start[:1], start[1:])
        return jnp.concatenate([sol.x1, sol.v1])

    start, step, first = jnp.array([-0.2, 0.7]), 1e-5, jax.jit(jax.jacfwd(end))
    differences = [(first(start + step * e) - first(start - step * e)) / (2 * step) for e in np.eye(2)]
    found = jax.jacfwd(jax.jacfwd(end))(start)
    np.testing.assert_allclose(found, np.stack(differences, axis=-1), rtol=0, atol=1e-9)
