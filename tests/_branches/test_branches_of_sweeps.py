"""Branches of many orbits at once, and all branches of a sweep."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

AMPLITUDE, FREQUENCY = "forcing.amplitude[0]", "forcing.frequency"


@pytest.mark.slow
def test_of_many_orbits_what_is_none_is_left_out():
    swept = {AMPLITUDE: [0.34, 0.36, 0.38]}
    stop = vx.Stop(0, 1.0, "upper", 0.9)
    system = vx.ImpactSystem([1.0], [[0.04]], [[1.0]], vx.Harmonic([0.36], 0.84091), [stop])
    ds = vx.sweep(system, swept, x0=[0.43], v0=[0.15], transient=400, progress=False)
    orbits = vx.periodic_orbits(ds, progress=False)
    orbits["x0"][{AMPLITUDE: 1}] -= 0.3
    with pytest.raises(ValueError, match="Orbit 1 is no periodic orbit of its machine"):
        vx.continuation(orbits, AMPLITUDE, (0.3, 0.4), progress=False)
    with pytest.warns(UserWarning, match="Left out 1 orbits"):
        (branch,) = vx.branches(orbits, depth=0, progress=False)
    assert branch.values[[0, -1]] == pytest.approx([0.34, 0.38])
    # Within a budget of points a branch ends where it is spent.
    with pytest.warns(UserWarning, match="Left out 2 orbits that lie on no branch found"):
        (short,) = vx.branches(orbits, depth=0, max_points=2, progress=False)
    assert "max_points" in short.ends
    assert len(short) < len(branch)


@pytest.mark.slow
def test_all_branches_of_a_sweep_are_found_once():
    swept = {FREQUENCY: np.linspace(0.7, 1.2, 24)}
    ds = vx.sweep(vx.models.wagg_bishop_a(1.0), swept, transient=200, carry="both", progress=False)
    (branch,) = vx.branches(ds, progress=False)
    assert branch.values.min() == pytest.approx(0.7)
    assert {point.kind for point in branch.bifurcations} >= {"double_impact", "fold", "gr"}
    orbits = vx.periodic_orbits(ds, progress=False).sel(direction="up").isel({FREQUENCY: slice(0, 3)})
    for one in vx.continuation(orbits, FREQUENCY, (0.7, 0.8), progress=False):
        assert one.values.min() == pytest.approx(0.7)
        assert one.values.max() == pytest.approx(0.8)


@pytest.mark.slow
def test_an_orbit_at_a_bound_begins_no_second_branch():
    system = vx.models.impact_oscillator(1.0, 1.0, position=1.0, restitution=0.8, damping_ratio=0.05)
    ds = vx.sweep(system, {AMPLITUDE: np.linspace(0.2, 1.0, 5)}, transient=300, record=10, progress=False)
    (branch,) = vx.branches(ds, bounds=(0.05, 1.0), progress=False)
    assert branch.ends == ("bounds", "bounds")
    np.testing.assert_allclose([branch.values.min(), branch.values.max()], [0.05, 1.0], rtol=1e-15)
