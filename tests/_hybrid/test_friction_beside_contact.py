"""Friction along the row of a rigid contact, which rests while the contact holds."""

import numpy as np
import pytest

import vijax as vx


@pytest.mark.thorough
def test_an_impact_that_tears_the_contact_open_sets_the_friction_off():
    """Two masses pressed together by 1 hit a wall, part at the speed 3, and turn 3 / (2 + 2 F) later."""
    force = 0.3
    row, nothing = {1: 1.0, 0: -1.0}, np.zeros((2, 2))
    load = vx.Harmonic([0.0, 0.0], 1.0, mean=[-1.0, 1.0])
    stops = [vx.Stop(0, 0.0, "lower", 0.5), vx.Contact(row, 0.0, 0.5)]
    system = vx.ImpactSystem([1.0, 1.0], nothing, nothing, load, stops, friction=[vx.Friction(row, force)])
    away, back = 3 / (2 + 2 * force), 0.3
    sol = vx.simulate(system, 0.0, 0.5 + away + back, [1.0, 1.0], [-2.0, -2.0])
    count = int(sol.num_events)
    np.testing.assert_allclose(sol.events.t[:count], [0.5, 0.5, 0.5, 0.5 + away], rtol=1e-14)
    assert [*sol.events.kind[:count]] == [vx.IMPACT, vx.RELEASE, vx.SLIP, vx.TURN]
    change = (1 + force) * away + (1 - force) * back
    np.testing.assert_allclose(sol.v1, [1 - change, -2 + change], rtol=0, atol=1e-14)
    ways = (away * (away / 2 + back)) * (1 + force) + back**2 / 2 * (1 - force)
    time = away + back
    np.testing.assert_allclose(sol.x1, [time - ways, -2 * time + ways], rtol=0, atol=1e-14)


@pytest.mark.slow
def test_friction_slips_on_a_mass_that_a_moving_stop_carries():
    """A plate at 0.5 + cos t carries the mass: friction turns with it, and is part of the contact force.

    N = P + cos t + F sign(sin t), from the equation of motion of the carried mass; the mass stays if P - F > 1.
    """
    plate = vx.Stop(0, 0.5, "upper", 0.5, vx.Harmonic([1.0], 1.0))
    nothing, load = np.zeros((1, 1)), vx.Harmonic([0.0], 1.0, mean=[1.6])
    system = vx.ImpactSystem([1.0], nothing, nothing, load, [plate], friction=[vx.Friction({0: 1.0}, 0.5)])
    times = np.linspace(0.1, 12.0, 12)
    sol = vx.simulate(system, 0.0, 12.0, [1.5], [0.0], ts=times)
    events = sol.events
    assert events.kind[: int(sol.num_events)].tolist() == [vx.TURN] * 3
    np.testing.assert_allclose(events.t[:3], np.pi * np.arange(1, 4), rtol=1e-14)
    found = [float(sol.contact_force(t)[0]) for t in times]
    np.testing.assert_allclose(found, 1.6 + np.cos(times) + 0.5 * np.sign(np.sin(times)), rtol=1e-13)


@pytest.mark.thorough
def test_a_turn_of_friction_may_release_the_mass_that_a_moving_stop_carries():
    """As before with P - F < 1 < P + F: the contact force jumps below zero where friction turns, at t = pi."""
    plate = vx.Stop(0, 0.5, "upper", 0.5, vx.Harmonic([1.0], 1.0))
    nothing, load = np.zeros((1, 1)), vx.Harmonic([0.0], 1.0, mean=[1.2])
    system = vx.ImpactSystem([1.0], nothing, nothing, load, [plate], friction=[vx.Friction({0: 1.0}, 0.5)])
    sol = vx.simulate(system, 0.0, 4.0, [1.5], [0.0])
    assert sorted(sol.events.kind[:2].tolist()) == [vx.RELEASE, vx.TURN]
    np.testing.assert_allclose(sol.events.t[:2], np.pi, rtol=1e-14)
    # Then it is free: friction acts on the way up with the load.
    time = 4.0 - np.pi
    np.testing.assert_allclose(sol.x1, -0.5 + (1.2 - 0.5) * time**2 / 2, rtol=1e-13)
