"""Derivatives where several elements switch at one instant: each has a time of its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

START, SPAN = np.array([0.0, 1.0]), 9.0
# The elements of so many masses.
KINDS = {
    "friction that turns": lambda n: {"friction": [vx.Friction(i, 0.5) for i in range(n)]},
    "a stop with preload that closes and opens": lambda n: {
        "stops": [vx.CompliantStop(i, 0.3, "upper", 20.0, 1.0, preload=0.5) for i in range(n)]
    },
    "a slider that an impact stops": lambda n: {
        "stops": [vx.Stop(i, 0.8, "upper", 0.6) for i in range(n)],
        "hysteresis": [vx.Jenkins(i, 1.0, 0.3) for i in range(n)],
    },
    "a slider at its limit where its mass hits": lambda n: {
        "stops": [vx.Stop(i, 0.1, "upper", 0.3) for i in range(n)],
        "hysteresis": [vx.Jenkins(i, 1.0, 0.3) for i in range(n)],
    },
}


def equal_masses(count, **parts):
    """Masses that do not touch and move alike."""
    one = np.eye(count)
    load = vx.Harmonic([2.0] * count, 1.3, phase=[0.3] * count, mean=[0.2] * count)
    return vx.ImpactSystem([1.0] * count, 0.1 * one, one, load, **parts)


def end(system):
    n = system.num_masses

    def run(start):
        sol = vx.simulate(system, 0.0, SPAN, start[:n], start[n:])
        return jnp.concatenate([sol.x1, sol.v1])

    return jax.jit(jax.jacfwd(run))


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_masses_that_do_not_touch_have_the_derivatives_of_each_alone(name):
    one = np.asarray(end(equal_masses(1, **KINDS[name](1)))(START))
    both = np.asarray(end(equal_masses(2, **KINDS[name](2)))(np.repeat(START, 2)))
    np.testing.assert_allclose(both, np.kron(one, np.eye(2)), atol=1e-11)


@pytest.mark.slow
def test_stops_that_close_and_open_at_one_instant_have_their_own_derivatives_in_the_log():
    name, count = "a stop with preload that closes and opens", 4

    def logged(system, count):
        def run(start):
            n = system.num_masses
            events = vx.simulate(system, 0.0, SPAN, start[:n], start[n:]).events
            return jnp.stack([events.t[:count], events.velocity_minus[:count], events.velocity_plus[:count]])

        return np.asarray(jax.jacfwd(run)(np.repeat(START, system.num_masses)))

    one, both = (logged(equal_masses(n, **KINDS[name](n)), n * count) for n in (1, 2))
    wanted = np.einsum("qes,ij->qeisj", one, np.eye(2)).reshape(both.shape)
    assert np.isfinite(one).all()
    np.testing.assert_allclose(both, wanted, atol=1e-11)


@pytest.mark.slow
def test_friction_that_turns_as_a_slider_stops_has_the_derivative_by_the_velocity_of_its_belt():
    def turned(belt):
        joint, rubbing = vx.Jenkins(0, 1.0, 0.2), vx.Friction(0, 0.5, velocity=belt)
        sol = vx.simulate(equal_masses(1, friction=[rubbing], hysteresis=[joint]), 0.0, SPAN, [0.0], [1.0])
        return jnp.concatenate([sol.x1, sol.v1])

    step = 1e-4
    difference = (turned(step) - turned(-step)) / (2 * step)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(turned))(0.0), difference, atol=1e-6)


@pytest.mark.slow
def test_friction_that_turns_as_another_mass_hits_its_stop_has_its_own_derivatives():
    rubbing = equal_masses(1, friction=[vx.Friction(0, 0.5)])
    turn = vx.simulate(rubbing, 0.0, SPAN, [0.0], [1.0]).events.t[0]
    place = vx.simulate(equal_masses(1), 0.0, turn, [-0.2], [0.6]).x1[0]
    hitting = equal_masses(1, stops=[vx.Stop(0, place, "upper", 0.6)])
    both = equal_masses(2, stops=[vx.Stop(1, place, "upper", 0.6)], friction=[vx.Friction(0, 0.5)])
    wanted = np.zeros((4, 4))
    wanted[::2, ::2], wanted[1::2, 1::2] = end(rubbing)(START), end(hitting)(np.array([-0.2, 0.6]))
    np.testing.assert_allclose(end(both)(np.array([0.0, -0.2, 1.0, 0.6])), wanted, atol=1e-11)
