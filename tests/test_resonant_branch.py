"""A branch that passes, and ends at, the resonance of a machine without damping."""

import numpy as np
import pytest

import vijax as vx

FREQUENCY, LOAD, STOP, RESTITUTION = "forcing.frequency", 0.5, 0.5, 0.7


def machine(frequency: float) -> vx.ImpactSystem:
    """One mass that would resonate at 1."""
    stop = vx.Stop(0, STOP, "upper", RESTITUTION)
    return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], vx.Harmonic([LOAD], frequency), [stop])


def at_resonance(t: float, x: float, v: float, since: float) -> tuple[float, float]:
    """The motion of x'' + x = LOAD cos t from x, v at `since`, in closed form."""
    particular = lambda t: np.array([LOAD / 2 * t * np.sin(t), LOAD / 2 * (np.sin(t) + t * np.cos(t))])  # noqa: E731
    a, b = np.array([x, v]) - particular(since)
    c, s = np.cos(t - since), np.sin(t - since)
    x, v = np.array([a * c + b * s, b * c - a * s]) + particular(t)
    return x, v


@pytest.mark.thorough
def test_it_ends_at_resonance_with_an_orbit_in_closed_form():
    sol = vx.simulate(machine(1.1), 0.0, 400 * np.pi / 1.1)
    orbit = vx.periodic_orbit(machine(1.1), sol.x1, sol.v1)
    branch = vx.continuation(orbit, FREQUENCY, (1.0, 1.2), progress=False)
    assert branch.ends == ("bounds", "bounds")
    assert branch.values[0] == pytest.approx(1.0, abs=1e-14)
    first = branch.points.isel(point=0)
    impact = 2 * np.pi * float(first.flight[0])
    x, v = at_resonance(impact, float(first.x0[0]), float(first.v0[0]), 0.0)
    assert x == pytest.approx(STOP, abs=1e-14)
    x, v = at_resonance(2 * np.pi, STOP, -RESTITUTION * v, impact)
    np.testing.assert_allclose([x, v], [first.x0[0], first.v0[0]], rtol=0, atol=1e-13)
