"""Friction along the row of a rigid contact, which rests while the contact holds."""

import numpy as np

import vijax as vx


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
