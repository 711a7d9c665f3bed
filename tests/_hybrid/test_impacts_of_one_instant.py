"""Bodies in touch that hit each other again and again at one instant come to rest there, and then go as their loads pull them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# All speeds shrink by a factor at each pair of impacts, those of the wall and those between the bodies: 1e-15 of the first
# after 25 to 35 pairs. What follows is the motion from rest, each body with its own load.
_MOST = 80


def _row(load, restitution, between, mass=(1.0, 1.0), length=1.0, time=1.0) -> vx.ImpactSystem:
    """Bodies in touch on a wall, which loads pull away from it and from each other, in units of mass, length and time."""
    n = len(load)
    force = mass[0] * length / time**2
    contacts = [vx.Contact({i: 1, i + 1: -1}, 0.0, between) for i in range(n - 1)]
    none = np.zeros((n, n))
    mean = force * np.array(load)
    stops = [vx.Stop(0, 0.0, "lower", restitution), *contacts]
    return vx.ImpactSystem(list(mass), none, none, vx.Harmonic(0 * mean, 1.0 / time, mean=mean), stops)


@pytest.mark.parametrize(
    ("load", "restitution", "between"),
    [((0.1, 0.3), 0.3, 0.0), ((0.1, 0.11), 0.3, 0.0), ((0.1, 0.3), 0.0, 0.5), ((0.1, 1.0), 0.0, 0.5)],
)
def test_a_body_that_is_thrown_onto_one_at_a_wall(load, restitution, between):
    system = _row(load, restitution, between)
    sol = vx.simulate(system, 0.0, 5.0, [0.0, 0.0], [0.0, -0.5])
    assert int(sol.num_events) < _MOST
    np.testing.assert_allclose(sol.x1, np.array(load) * 12.5, rtol=0, atol=1e-13)
    np.testing.assert_allclose(sol.v1, np.array(load) * 5, rtol=0, atol=1e-14)


def test_units_do_not_matter():
    mass, length, time = 3.0, 1e-6 / 7, 1e3
    system = _row((0.1, 0.3), 0.3, 0.0, (mass, mass), length, time)
    sol = vx.simulate(system, 0.0, 5 * time, [0.0, 0.0], [0.0, -0.5 * length / time])
    assert int(sol.num_events) < _MOST
    np.testing.assert_allclose(np.array(sol.x1) / length, [1.25, 3.75], rtol=0, atol=1e-13)


def test_three_bodies():
    system = _row((0.1, 0.2, 0.3), 0.3, 0.0, (1.0, 1.0, 1.0))
    sol = vx.simulate(system, 0.0, 5.0, np.zeros(3), [0.0, 0.0, -0.5], max_events=1024)
    np.testing.assert_allclose(sol.x1, np.array([0.1, 0.2, 0.3]) * 12.5, rtol=0, atol=1e-13)


@pytest.mark.thorough
def test_beside_friction():
    """A third mass, away from the others, is held by friction."""
    none, load = np.zeros((3, 3)), vx.Harmonic(np.zeros(3), 1.0, mean=[0.1, 0.3, 0.5])
    stops = _row((0.1, 0.3), 0.3, 0.0).stops
    system = vx.ImpactSystem([1.0] * 3, none, none, load, stops, friction=[vx.Friction(2, 1.0)])
    sol = vx.simulate(system, 0.0, 5.0, np.zeros(3), [0.0, -0.5, 0.0])
    assert int(sol.num_events) < _MOST
    np.testing.assert_allclose(sol.x1, [1.25, 3.75, 0.0], rtol=0, atol=1e-13)


@pytest.mark.thorough
def test_derivatives_are_those_of_the_motion_from_rest():
    def end(load):
        system = eqx.tree_at(lambda s: s.forcing.mean, _row((0.1, 0.3), 0.3, 0.0), load)
        return vx.simulate(system, 0.0, 5.0, [0.0, 0.0], [0.0, -0.5]).x1

    np.testing.assert_allclose(jax.jacfwd(end)(jnp.array([0.1, 0.3])), np.eye(2) * 12.5, rtol=0, atol=1e-11)


@pytest.mark.thorough
def test_in_a_batch_beside_motions_that_leave():
    system = _row((0.1, 0.3), 0.3, 0.0)
    starts = jnp.array([[0.0, -0.5], [0.0, 0.5], [0.0, -0.25]])
    ends = jax.vmap(lambda v: vx.simulate(system, 0.0, 5.0, [0.0, 0.0], v).x1)(starts)
    np.testing.assert_allclose(ends, [[1.25, 3.75], [1.25, 6.25], [1.25, 3.75]], rtol=0, atol=1e-13)


def test_masses_that_an_impact_leaves_with_one_speed_hold_where_their_load_begins_to_press():
    """A spring pulls the first of two touching masses, at rest where they get one speed, into the second with a force that begins at zero."""
    spring, none = np.diag([1.0, 0.0, 0.0]), np.zeros((3, 3))
    stops = [vx.Stop(0, -0.1, "lower", 0.5), vx.Contact({0: 1, 1: -1}, 0.0), vx.Contact({1: 1, 2: -1}, 0.0)]
    system = vx.ImpactSystem([1.0, 1.0, 1.0], none, spring, vx.Harmonic(np.zeros(3), 1.0), stops)
    sol = vx.simulate(system, 0.0, 0.5, np.zeros(3), [-0.5, 0.8, -0.5])
    kinds = np.asarray(sol.events.kind)[: int(sol.num_events)].tolist()
    assert kinds == [vx.IMPACT, vx.STICK, vx.IMPACT]
    # Both hang on the spring until the first hits its stop.
    w = np.sqrt(0.5)
    np.testing.assert_allclose(sol.events.t[2], np.arcsin(0.1 * w / 0.5) / w, rtol=1e-14)
    assert bool(sol.stuck1[1])
    np.testing.assert_allclose(sol.x1[2], 0.4, rtol=1e-15)
