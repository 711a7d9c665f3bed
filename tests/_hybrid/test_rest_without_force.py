"""Masses that come to rest on a stop where no force acts: nothing is left of their velocity, in any unit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# Units of mass, length and time that alter every digit.
UNITS = [(1.0, 1.0, 1.0), (3.0, 1 / 7, 1 / 3), (1e-2, 1e5, 1e-1), (1e4, 1e-5, 1e-3), (1.0, 1.0, 1e3)]
END = 30.0


def machine(units, more=(), friction=(), *, cubic=0.0, restitution=0.0) -> vx.ImpactSystem:
    """Two masses on springs of their own; mass 0 on a stop at 0, where its spring is slack, and a contact never met."""
    mass, length, time = units
    m, k = mass * np.array([0.6, 0.93]), mass / time**2 * np.diag([0.3, 2.0])
    stops = [
        vx.Stop(0, 0.0, "lower", restitution),
        vx.Contact({0: 1.0, 1: -1.0}, 40.0 * length, 0.5),
        *more,
    ]
    force = None
    if cubic:
        hardening = cubic * mass / time**2 / length**2
        force = lambda t, x, v, args: -hardening * x**3  # noqa: E731
    return vx.ImpactSystem(m, 0 * k, k, None, stops, force, friction=list(friction))


def run(system, units, v0=-1.456):
    _, length, time = units
    return vx.simulate(
        system, 0.0, END * time, [0.0, 0.0], np.array([v0, 0.3]) * length / time, max_steps=3000, throw=False
    )


def check(sol, units):
    _, length, time = units
    assert sol.result == vx.RESULTS.successful
    assert sol.num_events <= 3
    assert (sol.x1[0], sol.v1[0]) == (0, 0)
    rate = np.sqrt(2.0 / 0.93)
    np.testing.assert_allclose(sol.x1[1] / length, 0.3 / rate * np.sin(rate * END), rtol=1e-11)
    np.testing.assert_allclose(sol.v1[1] / length * time, 0.3 * np.cos(rate * END), rtol=1e-11)


@pytest.mark.parametrize("units", UNITS)
def test_a_mass_stopped_by_a_plastic_stop_stays_there(units):
    check(run(machine(units), units), units)


@pytest.mark.slow
@pytest.mark.parametrize("units", UNITS)
def test_so_it_does_beside_friction_and_compliant_stops(units):
    mass, length, time = units
    friction = [vx.Friction(0, 0.01 * mass * length / time**2)]
    soft = [vx.CompliantStop(1, 3.0 * length, "upper", mass / time**2)]
    check(run(machine(units, soft, friction), units), units)


@pytest.mark.slow
@pytest.mark.parametrize("units", UNITS)
def test_so_it_does_under_a_cubic_spring(units):
    sol = run(machine(units, cubic=0.8), units)
    assert sol.result == vx.RESULTS.successful
    assert sol.num_events <= 3
    assert (sol.x1[0], sol.v1[0]) == (0, 0)


@pytest.mark.slow
def test_so_does_a_batch_of_masses():
    system = machine(UNITS[0])
    ends = jax.vmap(
        lambda v: vx.simulate(system, 0.0, END, jnp.zeros(2), jnp.stack([v, 0.3]), max_steps=3000)
    )
    sol = ends(-jnp.linspace(0.1, 3.0, 50))
    np.testing.assert_array_equal(sol.x1[:, 0], 0)
    assert sol.num_events.max() <= 3


@pytest.mark.slow
def test_a_collision_that_stops_both_bodies_keeps_its_derivatives():
    system = vx.ImpactSystem(
        [1.0, 3.0], np.zeros((2, 2)), np.zeros((2, 2)), None, [vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.0)]
    )

    def end(v):
        return vx.simulate(system, 0.0, 1.0, jnp.array([-0.5, 0.0]), v).v1

    at = jnp.array([3.0, -1.0])
    np.testing.assert_array_equal(end(at), 0)
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jacobian(end)(at), [[0.25, 0.75], [0.25, 0.75]], rtol=1e-14)
