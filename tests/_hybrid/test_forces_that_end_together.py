"""Forces that end at one instant, and forces that are zero all along: what holds does not hang on rounding."""

import numpy as np
import pytest

import vijax as vx

# Units of mass, length and time that alter every digit.
UNITS = [
    (1.0, 1.0, 1.0),
    (20.455513, 0.433308, 1.578973),
    (2.35377, 0.109746, 22.883691),
    (3.0, 1 / 7, 1 / 3),
    *np.exp(np.random.default_rng(1).uniform(-9.0, 9.0, (12, 3))).tolist(),
]


@pytest.mark.thorough
@pytest.mark.parametrize("units", UNITS)
def test_a_contact_without_a_force_holds_beside_friction_that_sticks(units):
    mass, length, time = units
    force = mass * length / time**2
    m, unit = mass * np.array([1.0, 1.0, 0.5]), np.diag([1.0, 1.0, 0.5])
    stops = [vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.7), vx.Contact({1: 1.0, 2: -1.0}, 0.0, 0.7)]
    friction = [vx.Friction({0: 1.0, 1: -1.0}, 0.3 * force, 0.36 * force), vx.Friction(1, 0.3 * force)]
    k, c = unit * mass / time**2, 0.1 * unit * mass / time
    system = vx.ImpactSystem(m, c, k, None, stops, friction=friction)
    sol = vx.simulate(system, 0.0, 3.0 * time, np.zeros(3), np.array([-0.5, 0.0, 0.0]) * length / time)
    assert np.asarray(sol.events.kind[: sol.num_events]).tolist() == [vx.STICK]
    assert sol.stuck1.tolist() == [False, True]


@pytest.mark.parametrize(("side", "phase"), [("lower", np.pi / 2), ("upper", -np.pi / 2)])
@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_a_load_that_grows_from_zero_presses_a_mass_into_a_stop(side, phase, damping):
    """The cosine of a right angle is 6e-17: at first it pulls, or presses."""

    def end(stop, load):
        system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [stop])
        sol = vx.simulate(system, 0.0, 2.0, [0.0], [0.0])
        return np.append(sol.x1, sol.v1)

    found = end(vx.CompliantStop(0, 0.0, side, 50.0, damping), vx.Harmonic([0.4], 1.3, [phase]))
    # The spring of the stop beside the other one, with its damper.
    system = vx.ImpactSystem([1.0], [[damping]], [[51.0]], vx.Harmonic([0.4], 1.3, [phase]))
    sol = vx.simulate(system, 0.0, 2.0, [0.0], [0.0])
    np.testing.assert_allclose(found, np.append(sol.x1, sol.v1), rtol=1e-11, atol=1e-15)


@pytest.mark.thorough
@pytest.mark.parametrize("num", [2, 17, 33, 65])
def test_two_bodies_that_a_stop_and_a_load_move_alike_stay_one(num):
    """Where the soft stop lets go, the contact has no force from then on: both end at one instant, whichever is found first."""
    load = vx.Harmonic([0.15, 0.15], 1.3, [np.pi / 2, np.pi / 2])
    stops = [
        vx.Stop(1, 0.7, "upper", 1.0),
        vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.0),
        vx.CompliantStop(0, 0.0, "lower", 10.0, 0.2),
    ]
    pair = vx.ImpactSystem([0.5, 0.5], np.zeros((2, 2)), np.zeros((2, 2)), load, stops)
    one = vx.ImpactSystem(
        [1.0],
        [[0.0]],
        [[0.0]],
        vx.Harmonic([0.3], 1.3, [np.pi / 2]),
        [vx.Stop(0, 0.7, "upper", 1.0), vx.CompliantStop(0, 0.0, "lower", 10.0, 0.2)],
    )
    ts = np.linspace(0.0, 57.99863360473, num)
    sol = vx.simulate(pair, 0.0, ts[-1], [0.3, 0.3], [-0.5, -0.5], ts=ts)
    alone = vx.simulate(one, 0.0, ts[-1], [0.3], [-0.5], ts=ts)
    kinds = np.asarray(sol.events.kind[: sol.num_events])
    assert vx.RELEASE not in kinds
    np.testing.assert_allclose(sol.xs, np.tile(alone.xs, 2), rtol=0, atol=1e-9)
