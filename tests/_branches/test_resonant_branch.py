"""A branch through, and one that ends at, the resonance of an undamped machine."""

import numpy as np
import pytest

import vijax as vx

FREQUENCY, LOAD, STOP, RESTITUTION = "forcing.frequency", 0.5, 0.5, 0.7


def machine(frequency: float) -> vx.ImpactSystem:
    """One mass with resonance at 1."""
    stop = vx.Stop(0, STOP, "upper", RESTITUTION)
    return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], vx.Harmonic([LOAD], frequency), [stop])


def at_resonance(t: float, x: float, v: float, since: float) -> tuple[float, float]:
    """Motion of x'' + x = LOAD cos t from x, v at time `since`, in closed form."""
    particular = lambda t: np.array([LOAD / 2 * t * np.sin(t), LOAD / 2 * (np.sin(t) + t * np.cos(t))])  # noqa: E731
    a, b = np.array([x, v]) - particular(since)
    c, s = np.cos(t - since), np.sin(t - since)
    x, v = np.array([a * c + b * s, b * c - a * s]) + particular(t)
    return x, v


@pytest.mark.slow
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


# Without damping, all motions that miss the stop are periodic where W divides 1.


@pytest.mark.thorough
@pytest.mark.parametrize("x0", [0.1, 1.3333], ids=["far from its first guess", "the guess itself"])
def test_an_orbit_all_of_whose_neighbours_repeat_is_refused_as_not_isolated(x0):
    orbit = vx.periodic_orbit(vx.models.impact_oscillator(0.5, position=3.0), [x0], [0.1])
    assert np.abs(orbit.multipliers - 1).max() < 1e-14
    for path, bounds in ((FREQUENCY, (0.4, 0.6)), ("forcing.amplitude[0]", (0.9, 1.1))):
        with pytest.raises(
            ValueError, match=r"Orbit 0 is not isolated: .* Add damping, or begin at a frequency off"
        ):
            vx.continuation(orbit, path, bounds, progress=False)


@pytest.mark.slow
def test_with_damping_or_beside_the_resonance_the_same_orbit_has_a_branch():
    damped = vx.models.impact_oscillator(0.5, position=3.0, damping_ratio=0.01)
    beside = vx.models.impact_oscillator(0.52, position=3.0)
    for system in (damped, beside):
        orbit = vx.periodic_orbit(system, [0.1], [0.1])
        branch = vx.continuation(orbit, FREQUENCY, (0.45, 0.55), progress=False)
        assert branch.ends == ("bounds", "bounds")


@pytest.mark.slow
def test_of_a_sweep_orbits_that_are_not_isolated_are_left_out_with_a_warning():
    system = vx.models.impact_oscillator(0.5, position=3.0)
    ds = vx.sweep(system, {FREQUENCY: [0.49, 0.5]}, x0=[0.1], transient=0, record=50, progress=False)
    orbits = vx.periodic_orbits(ds, progress=False)
    assert orbits.converged.values.tolist() == [False, True]
    with pytest.warns(UserWarning, match=r"Left out 1 orbits .* or not isolated"):
        assert vx.branches(orbits, (0.45, 0.55), progress=False) == []
