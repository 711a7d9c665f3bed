"""Steps under a `force` of several bodies: walls between them, derivatives through walls, pulses on machines at rest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from helpers import end_of

import vijax as vx

pytestmark = pytest.mark.thorough

# Error of steps with the default tolerances over some dozen of them, relative to the size of the motion.
ACCURACY = 3e-9
# The same behind the repeated impacts of a light body between two heavy ones.
AMPLIFIED = 2e-7
HERTZ = 1e7
GRAVITY, STIFFNESS, END = 9.81, 1e6, 1.6


def beads(masses) -> vx.ImpactSystem:
    """Free beads in a row that push each other apart by Hertz's law where they overlap."""

    def contacts(t, x, v, args):
        push = HERTZ * jnp.maximum(x[:-1] - x[1:], 0) ** 1.5
        return jnp.append(-push, 0.0) + jnp.append(0.0, push)

    zero = np.zeros((len(masses), len(masses)))
    return vx.ImpactSystem(masses, zero, zero, None, [], force=contacts)


@pytest.mark.slow
def test_three_bodies_that_meet_by_stiff_forces_move_as_a_dense_reference_has_them():
    """Shots of several speeds and gaps, as a batch: gaps of some speeds are closed while another pair is in touch."""
    masses = np.array([1.0, 0.3, 2.0])
    speeds, gaps = np.array([0.4, 1.0, 3.0, 9.0]), np.array([1e-3, 1e-2, 0.1, 0.3])
    starts = np.stack([-0.1 - gaps, 0 * gaps, gaps], axis=1)
    shots = np.stack([speeds, 0 * speeds, -0.2 * speeds], axis=1)
    machine = beads(masses)
    ends = jax.jit(jax.vmap(lambda x, v: vx.simulate(machine, 0.0, 1.0, x, v)))(starts, shots)

    def rates(t, y):
        push = HERTZ * np.maximum(y[:2] - y[1:3], 0) ** 1.5
        return np.concatenate([y[3:], np.array([-push[0], push[0] - push[1], push[1]]) / masses])

    for k in range(len(speeds)):
        start = np.concatenate([starts[k], shots[k]])
        run = scipy.integrate.solve_ivp(
            rates, (0, 1), start, method="DOP853", rtol=1e-13, atol=1e-15, max_step=5e-4
        )
        np.testing.assert_allclose(ends.x1[k], run.y[:3, -1], rtol=0, atol=AMPLIFIED * speeds[k])
        np.testing.assert_allclose(ends.v1[k], run.y[3:, -1], rtol=0, atol=AMPLIFIED * speeds[k])
    momentum, energy = masses @ np.asarray(ends.v1).T, masses @ np.asarray(ends.v1).T ** 2 / 2
    np.testing.assert_allclose(momentum, masses @ shots.T, rtol=ACCURACY)
    np.testing.assert_allclose(energy, masses @ shots.T**2 / 2, rtol=ACCURACY)


def bounced(height):
    """Position and velocity at the end of a fall on a linear wall of unit mass, thrown back once: closed form."""
    root, fall = jnp.sqrt(STIFFNESS), jnp.sqrt(2 * height / GRAVITY)
    speed, rest = GRAVITY * fall, GRAVITY / STIFFNESS
    # In the wall the depth is rest + a sin(root t) - rest cos(root t), and leaves it with the speed of before.
    contact = (jnp.pi + 2 * jnp.arctan2(rest, speed / root)) / root
    flight = END - fall - contact
    return jnp.stack([-speed * flight + GRAVITY * flight**2 / 2, -speed + GRAVITY * flight])


@pytest.mark.slow
@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_derivatives_through_a_stiff_wall_are_those_of_the_closed_form(derivative):
    load = vx.Harmonic([0.0], 1.0, mean=[GRAVITY])
    machine = vx.ImpactSystem(
        [1.0], [[0.0]], [[0.0]], load, [], force=lambda t, x, v, args: -STIFFNESS * jnp.maximum(x, 0.0)
    )
    heights = jnp.array([2.0, 3.0, 4.5])
    end = lambda height: end_of(machine, END)(jnp.stack([-height, 0.0 * height]))  # noqa: E731
    np.testing.assert_allclose(jax.vmap(end)(heights), jax.vmap(bounced)(heights), rtol=0, atol=1e-7)
    found, right = (jax.vmap(derivative(function))(heights) for function in (end, bounced))
    np.testing.assert_allclose(found, right, rtol=1e-6)


def test_a_chain_at_rest_feels_a_pulse_whenever_it_comes():
    """Three masses, of which the middle one is pushed: the response to the momentum of the pulse, over a sweep of its time."""
    masses, width = np.array([1.0, 0.5, 2.0]), 0.01
    stiffness = np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.5]])
    damping = 0.1 * stiffness

    def pulse(t, x, v, args):
        return jnp.array([0.0, 50.0, 0.0]) * jnp.exp(-(((t - args["at"]) / width) ** 2)) + 0 * x

    load = vx.Harmonic(np.zeros(3), 2 * np.pi / 20)
    machine = vx.ImpactSystem(masses, damping, stiffness, load, [], force=pulse)
    times = np.array([2.0, 17.3, 19.5])
    data = vx.sweep(machine, {"args.at": times}, args={"at": 2.0}, transient=0, record=1 + 1, progress=False)
    inverse = np.diag(1 / masses)
    flow = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stiffness, -inverse @ damping]])
    momentum = 50 * np.sqrt(np.pi) * width * (inverse @ np.array([0.0, 1.0, 0.0]))
    second = flow @ flow * width**2 / 4  # of the second moment of the pulse
    push = np.concatenate([np.zeros(3), momentum])
    for k, at in enumerate(times):
        right = scipy.linalg.expm(flow * (40 - at)) @ (push + second @ push)
        np.testing.assert_allclose(data.x[k], right[:3], rtol=0, atol=1e-8)
        np.testing.assert_allclose(data.v[k], right[3:], rtol=0, atol=1e-8)
