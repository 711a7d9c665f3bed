"""Orbits of one period are found from motions that have settled on doubled ones."""

import numpy as np
import pytest

import vijax as vx


@pytest.mark.parametrize(
    "frequency", [1.1, *(pytest.param(f, marks=pytest.mark.thorough) for f in (1.07, 1.08, 1.12))]
)
def test_the_orbit_beside_a_doubled_one_is_found_from_each_of_its_points(frequency):
    machine = vx.models.impact_oscillator(frequency, position=0.2, damping_ratio=0.05, restitution=0.8)
    times = np.arange(200, 204) * 2 * np.pi / frequency
    settled = vx.simulate(machine, 0.0, times[-1], ts=times)
    orbits = [vx.periodic_orbit(machine, x, v) for x, v in zip(settled.xs, settled.vs, strict=True)]
    assert all(orbit.num_impacts[0] == 1 and not orbit.is_stable for orbit in orbits)
    for orbit in orbits[1:]:
        np.testing.assert_allclose([orbit.x0, orbit.v0], [orbits[0].x0, orbits[0].v0], rtol=1e-9)
