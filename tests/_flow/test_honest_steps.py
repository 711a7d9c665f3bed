"""Steps under a `force` that are not what they seem: into stiff walls, and from rest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from helpers import end_of
from jax import Array

import vijax as vx

pytestmark = pytest.mark.thorough

# Error of steps with the default tolerances over some dozen of them, relative to the size of the motion.
ACCURACY = 3e-9
MASS, WEIGHT = 0.1, 0.981

# Force of a wall, and its potential, by the depth x.
WALLS = {
    "hertz": (lambda x: 1e9 * jnp.maximum(x, 0.0) ** 1.5, lambda x: 4e8 * np.maximum(x, 0.0) ** 2.5),
    "linear": (lambda x: 1e6 * jnp.maximum(x, 0.0), lambda x: 5e5 * np.maximum(x, 0.0) ** 2),
    "exponential": (lambda x: jnp.exp(x / 1e-4), lambda x: 1e-4 * np.exp(x / 1e-4)),
}


def falling(wall) -> vx.ImpactSystem:
    """Mass that falls towards x > 0."""
    load = vx.Harmonic(amplitude=[0.0], frequency=1.0, mean=[WEIGHT])
    return vx.ImpactSystem([MASS], [[0.0]], [[0.0]], load, [], force=lambda t, x, v, args: -wall(x))


@pytest.mark.parametrize("name", WALLS)
def test_a_mass_keeps_its_energy_through_stiff_walls_from_every_height(name):
    wall, potential = WALLS[name]
    machine, heights = falling(wall), np.linspace(0.3, 7, 81)
    end = jax.jit(jax.vmap(lambda height: vx.simulate(machine, 0.0, 3.0, -height[None])))(heights)
    x, v = np.asarray(end.x1[:, 0]), np.asarray(end.v1[:, 0])
    energy = MASS * v**2 / 2 - WEIGHT * x + potential(x)
    np.testing.assert_allclose(energy, WEIGHT * heights + potential(-heights), rtol=ACCURACY)


def test_a_hertz_wall_throws_back_a_mass_as_a_dense_reference_has_it():
    end = vx.simulate(falling(WALLS["hertz"][0]), 0.0, 3.0, [-0.5])
    np.testing.assert_allclose([end.x1[0], end.v1[0]], [-0.31532886, -1.903483], rtol=1e-6)


def test_a_sweep_between_two_stiff_walls_keeps_the_energy_in_every_lane():
    stiffness, half = 1e6, 0.5

    def walls(t, x, v, args):
        return -stiffness * (jnp.maximum(x - half, 0) - jnp.maximum(-half - x, 0))

    machine = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 1.0), [], force=walls)
    speeds = np.linspace(1, 8, 71)
    data = vx.sweep(machine, {"v0[0]": speeds}, transient=1, record=1, progress=False)
    x, v = data.x.values[:, 0], data.v.values[:, 0]
    depth = np.maximum(np.abs(x) - half, 0)
    np.testing.assert_allclose(v**2 + stiffness * depth**2, speeds**2, rtol=1e-7)


def pendulum(t: Array, x: Array, v: Array, args) -> Array:
    return -jnp.sin(x) - 0.1 * v


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_derivatives_at_rest_and_beside_it_are_those_of_the_linear_motion(derivative):
    machine = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 0.5), [], force=pendulum)
    right = scipy.linalg.expm(np.array([[0, 1], [-1, -0.1]]) * 4 * np.pi)
    for size in (0.0, 1e-9):
        found = derivative(end_of(machine, 4 * np.pi))(jnp.array([size, 0.0]))
        np.testing.assert_allclose(found, right, atol=ACCURACY)


def test_multipliers_and_exponents_at_rest_are_those_of_the_linear_motion():
    machine = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 0.5), [], force=pendulum)
    orbit = vx.periodic_orbit(machine, [0.0], [0.0])
    np.testing.assert_allclose(np.abs(orbit.multipliers), np.exp(-0.2 * np.pi), rtol=ACCURACY)
    exponents = vx.lyapunov_exponents(machine, [0.0], [0.0], transient=0, num_periods=50)
    np.testing.assert_allclose(exponents, -0.05, atol=2e-3)


def test_derivatives_at_rest_of_springs_that_change_with_time_are_those_of_hill_equations():
    def springs(t, x, v, args):
        return jnp.array([-(1 + 2 * jnp.cos(7 * t)) * x[0], -x[1] * jnp.sin(3 * t) ** 2 + 0.3 * x[0]])

    machine = vx.ImpactSystem(
        [1.0, 1.0], np.zeros((2, 2)), np.zeros((2, 2)), vx.Harmonic([0.0, 0.0], 1.0), [], force=springs
    )

    def rates(t, y):
        y = y.reshape(4, 4)
        a = np.array([-(1 + 2 * np.cos(7 * t)) * y[0], -y[1] * np.sin(3 * t) ** 2 + 0.3 * y[0]])
        return np.concatenate([y[2:], a]).ravel()

    right = (
        scipy.integrate.solve_ivp(rates, (0, 10), np.eye(4).ravel(), method="DOP853", rtol=1e-13, atol=1e-14)
        .y[:, -1]
        .reshape(4, 4)
    )
    found = jax.jacfwd(end_of(machine, 10.0))(jnp.zeros(4))
    np.testing.assert_allclose(found, right, atol=ACCURACY * np.abs(right).max())


@pytest.mark.parametrize("width", [0.05, 0.02])
def test_a_machine_at_rest_feels_a_pulse_that_comes_late(width):
    def pulse(t, x, v, args):
        return 100 * jnp.exp(-(((t - 30) / width) ** 2)) + 0 * x

    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], None, [], force=pulse)
    end = vx.simulate(machine, 0.0, 60.0, flow=vx.DiffraxFlow())
    # The response to the momentum 100 sqrt(pi) width, spread over the width.
    root = complex(-0.05, np.sqrt(1 - 0.05**2))
    push = 100 * np.sqrt(np.pi) * width * np.exp(-30 * -root + (root * width / 2) ** 2)
    np.testing.assert_allclose(end.x1[0], (push / root.imag).imag, rtol=1e-7)


def test_a_pulse_that_no_step_sees_is_told():
    def pulse(t, x, v, args):
        return jnp.where(jnp.abs(t - 30.0) < 2e-3, 100.0, 0.0) + 0 * x

    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], None, [vx.Stop(0, 1.0, "upper", 0.5)], force=pulse)
    with pytest.warns(UserWarning, match="changes at t = (29.99|30.00)"):
        vx.simulate(machine, 0.0, 40.0, [0.0], [0.0], flow=vx.DiffraxFlow())
    found = vx.simulate(machine, 0.0, 40.0, [0.0], [0.0])
    # The impulse 0.4 at the middle of the pulse, whose width counts in third order.
    root = complex(-0.05, np.sqrt(1 - 0.05**2))
    np.testing.assert_allclose(found.x1[0], 0.4 * (np.exp(10 * root) / root.imag).imag, rtol=1e-4)
