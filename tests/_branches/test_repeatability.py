"""Nothing that a process did before decides a result."""

import jax
import numpy as np
import pytest

import vijax as vx
from vijax._branches import batches

pytestmark = pytest.mark.thorough


def orbits_of(num: int) -> list[vx.PeriodicOrbit]:
    """Orbits of one family, beside each other."""
    start = [0.18, 0.09], [0.33, 0.52]
    orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), *start)
    frequencies = np.linspace(0.8, 0.801, num)
    return [
        vx.periodic_orbit(vx.models.wagg_bishop_a(frequency), orbit.x0, orbit.v0) for frequency in frequencies
    ]


def numbers_of(orbits: list[vx.PeriodicOrbit]) -> list[np.ndarray]:
    branches = vx.continuation(orbits, "forcing.frequency", (0.79, 0.81), max_points=8, progress=False)
    return [
        np.asarray(branch.points[name]) for branch in branches for name in ("forcing.frequency", "x0", "v0")
    ]


@pytest.mark.slow
def test_branches_have_the_same_bits_before_and_after_larger_batches(monkeypatch):
    """Larger batches are compiled in another form, which differs in the last bits."""
    monkeypatch.setattr(batches, "_WORTH_IT", 12)
    monkeypatch.setattr(batches, "_CHEAPER", 4)
    orbits = orbits_of(12)
    first, again = numbers_of(orbits[:8]), numbers_of(orbits[:8])
    numbers_of(orbits)
    afterwards = numbers_of(orbits[:8])
    for a, b, c in zip(first, again, afterwards, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)


def test_a_sweep_and_a_trajectory_have_the_same_bits_whatever_was_computed_before():
    machine = vx.models.wagg_bishop_a(0.8)

    def numbers() -> list[np.ndarray]:
        data = vx.sweep(machine, {"forcing.frequency": np.linspace(0.7, 0.9, 5)}, record=3, progress=False)
        end = vx.simulate(machine, 0.0, 50.0)
        return [
            data.x.values,
            data.v.values,
            data.impact_velocity.values,
            np.asarray(end.x1),
            np.asarray(end.v1),
        ]

    first = numbers()
    jax.jacfwd(lambda t: vx.simulate(machine, 0.0, t).x1)(50.0)
    vx.sweep(machine, {"forcing.frequency": np.linspace(0.7, 0.9, 300)}, record=3, progress=False)
    for a, b in zip(first, numbers(), strict=True):
        np.testing.assert_array_equal(a, b)
