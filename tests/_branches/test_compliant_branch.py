"""Branches of orbits with many closings of a compliant stop."""

import numpy as np
import pytest

import vijax as vx


@pytest.mark.slow
def test_all_events_of_the_orbits_of_a_branch_are_exact():
    """Twenty closings and openings in four periods: Newton's method solves them at once, not one after another."""
    load = vx.Harmonic([[0.871225], [1.17565]], 0.892896, [[5.30112], [5.30629]])
    stop = vx.CompliantStop(0, 0.253453, "upper", stiffness=148.517, damping=0.55985, preload=0.203963)
    system = vx.ImpactSystem([0.389548], [[0.0410219]], [[5.83299]], load, [stop])
    orbit = vx.periodic_orbit(system, [0.188227], [0.257534], 4)
    branch = vx.continuation(orbit, "forcing.frequency", (0.8, 1.0), progress=False)
    rows = [row for row in range(0, len(branch), 5) if branch.points["bifurcation"].values[row] == ""]
    assert len(rows) > 5
    for own in map(branch.orbit, rows):
        sol = own.solution()
        count = int(sol.num_events)
        assert count >= 18
        if (
            np.diff(own.events.t[:count]).min() < 0.02
        ):  # a touch at the end of the branch, where times are not determined
            continue
        np.testing.assert_allclose(sol.events.t[:count], own.events.t[:count], rtol=0, atol=1e-12)
        np.testing.assert_allclose(sol.v1, own.v0, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_an_orbit_of_a_sweep_may_have_a_hundred_contacts():
    """A dataset tells how many impacts an orbit has, but not how often its compliant stops close and open."""
    stop = vx.CompliantStop(0, 0.3, "upper", 20.0, preload=2.0)
    system = vx.ImpactSystem([1.0], [[0.8]], [[1.0]], vx.Harmonic([1.0], 0.2), [stop])
    ds = vx.sweep(system, {"forcing.frequency": [0.2]}, transient=60, progress=False)
    (branch,) = vx.branches(
        vx.periodic_orbits(ds, progress=False), (0.1999, 0.2001), max_points=8, progress=False
    )
    assert np.count_nonzero(branch.points["event_kind"].values[len(branch) // 2] >= 0) > 100
