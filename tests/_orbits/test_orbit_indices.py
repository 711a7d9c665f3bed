"""Orbits are found completely: the indices of all periodic points add up to 1."""

import numpy as np
import pytest

import vijax as vx

# Starts along a position and a velocity, and the distance at which a point is the same.
GRID, SAME = 32, 1e-7


def machine(rng: np.random.Generator) -> tuple[vx.ImpactSystem, tuple[np.ndarray, np.ndarray]]:
    """A random machine of one mass and one stop, and starts over the region in which its motions settle."""
    w, c = rng.uniform(0.5, 3.0), rng.uniform(0.02, 0.3)
    stop = vx.Stop(0, rng.uniform(-0.3, 1.0), "upper", rng.uniform(0.3, 0.9))
    size = min(1.5 / abs(1 - w * w + 1j * c * w) + 1, 6.0)
    position = float(stop.position)
    x = position - np.linspace(0, 1, GRID) ** 1.5 * (size + max(position, 0) + 0.5)
    v = np.linspace(-1, 1, GRID) * max(1.0, w) * size
    starts = np.repeat(x, GRID)[:, None], np.tile(v, GRID)[:, None]
    return vx.ImpactSystem([1.0], [[c]], [[1.0]], vx.Harmonic([1.0], w), [stop]), starts


def index(orbit: vx.PeriodicOrbit, num_periods: int) -> int:
    """Sum of sign det(1 - M) over the points of an orbit that the map of so many periods, a prime or 1, has."""
    again = vx.stroboscopic_map(orbit.system, orbit.x0, orbit.v0)
    away = np.abs(np.concatenate([again[0] - orbit.x0, again[1] - orbit.v0])).max()
    points = 1 if away < SAME else num_periods
    return points * int(np.sign(np.prod(1 - np.asarray(orbit.multipliers)).real))


@pytest.mark.slow
def test_indices_of_all_periodic_points_add_up_to_one():
    """Lefschetz: the map of n periods is continuous and takes a disc into itself. Of a quarter of the starts one is missing."""
    rng, most = np.random.default_rng(0), 0
    for _ in range(6):
        system, starts = machine(rng)
        for n in (1, 2, 3):
            orbits = vx.find_periodic_orbits(system, starts, n, progress=False)
            assert sum(index(orbit, n) for orbit in orbits) == 1, (system, n)
            most = max(most, len(orbits))
    assert most > 1
