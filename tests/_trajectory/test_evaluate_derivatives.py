"""Derivatives of motions at times between events, and of the motion over an orbit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import vijax as vx

# Forward and reverse derivatives are sums of the same terms in another order.
ROUNDING = 1e-10
TIMES = jnp.array([3.0, 11.0, 18.5])


def machine_of(r: Array, force=None, **elements) -> vx.ImpactSystem:
    stops = [vx.Stop(0, 0.5, "upper", r)]
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 0.7), stops, force=force, **elements)


MACHINES = {
    "stops": machine_of,
    "friction": lambda r: machine_of(r, friction=[vx.Friction(0, 0.1)]),
    "force": lambda r: machine_of(r, lambda t, x, v, args: -0.2 * x**3),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_evaluated_states_have_the_same_derivatives_in_reverse(name):
    def states(r: Array, x0: Array, times: Array) -> Array:
        return jnp.stack(vx.simulate(MACHINES[name](r), 0.0, 20.0, x0[None]).evaluate(times))

    at = jnp.array(0.7), jnp.array(0.1), TIMES
    forward, reverse = (take(states, (0, 1, 2))(*at) for take in (jax.jacfwd, jax.jacrev))
    for a, b in zip(forward, reverse, strict=True):
        np.testing.assert_allclose(b, a, rtol=ROUNDING, atol=ROUNDING)
    # The derivative by time of the position is the velocity.
    speeds = states(*at)[1, :, 0]
    np.testing.assert_allclose(jnp.diagonal(reverse[2][0, :, 0]), speeds, rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_evaluated_states_have_derivatives_in_batches_and_under_jit():
    def position(r: Array) -> Array:
        return vx.simulate(machine_of(r), 0.0, 20.0, [0.1]).evaluate(11.0)[0][0]

    rs = jnp.array([0.6, 0.7])
    alone = [jax.jacfwd(position)(r) for r in rs]
    np.testing.assert_allclose(jax.vmap(jax.grad(position))(rs), alone, rtol=ROUNDING)
    np.testing.assert_allclose(jax.jit(jax.grad(position))(rs[0]), alone[0], rtol=ROUNDING)


@pytest.mark.slow
def test_the_motion_over_an_orbit_has_the_same_derivatives_in_reverse():
    def position(frequency: Array) -> Array:
        machine = vx.models.wagg_bishop_a(frequency)
        orbit = vx.periodic_orbit(machine, [0.18, 0.09], [0.33, 0.52]).solution()
        return orbit.x1[0] + orbit.evaluate(2.0)[0][1]

    at = jnp.array(0.8)
    np.testing.assert_allclose(jax.grad(position)(at), jax.jacfwd(position)(at), rtol=ROUNDING)
