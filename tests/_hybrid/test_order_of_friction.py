"""Which of several friction elements slips does not depend on their order in the list, also where each could slip alone."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

NUM_MACHINES, NUM_BLOCKS = 128, 4


def stack(numbers: dict, order: range) -> vx.ImpactSystem:
    """Blocks of which each rubs on the one below, static friction up to twice the sliding one."""
    friction = [
        vx.Friction({k: 1.0, k - 1: -1.0} if k else 0, numbers["force"][k], numbers["static"][k])
        for k in order
    ]
    load = vx.Harmonic(numbers["load"], 0.7, mean=numbers["mean"])
    nothing = jnp.zeros((NUM_BLOCKS, NUM_BLOCKS))
    return vx.ImpactSystem(numbers["mass"], nothing, nothing, load, [], friction=friction)


@partial(jax.jit, static_argnums=1)
@partial(jax.vmap, in_axes=(0, None))
def run(numbers: dict, order: range) -> tuple:
    """Friction that sticks just after the start at rest, and the state some time later."""
    rest = jnp.zeros(NUM_BLOCKS)
    system = stack(numbers, order)
    begins = vx.simulate(system, 0.0, 1e-6, rest, rest, throw=False).sticking1
    sol = vx.simulate(system, 0.0, 3.0, rest, rest, throw=False)
    back = jnp.argsort(jnp.array(order))
    return begins[back], sol.x1, sol.v1


def drawn() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    shape = (NUM_MACHINES, NUM_BLOCKS)
    force = rng.uniform(0.1, 0.5, shape)
    return {
        "force": force,
        "static": force * rng.uniform(1.0, 2.0, shape),
        "load": rng.uniform(-0.5, 0.5, shape),
        "mean": rng.uniform(-0.5, 0.5, shape),
        "mass": rng.uniform(0.5, 2.0, shape),
    }


@pytest.mark.thorough
def test_stacked_blocks_slip_alike_with_their_friction_listed_in_reverse():
    numbers = drawn()
    given, other = (run(numbers, order) for order in (range(NUM_BLOCKS), range(NUM_BLOCKS - 1, -1, -1)))
    sticks = np.sum(given[0], axis=1)
    assert np.sum((sticks > 0) & (sticks < NUM_BLOCKS)) > NUM_MACHINES / 4
    np.testing.assert_array_equal(given[0], other[0])
    for a, b in zip(given[1:], other[1:], strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-11)
