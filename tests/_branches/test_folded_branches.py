"""Branches of which mirror images count as one."""

import numpy as np
import pytest
import xarray as xr

import vijax as vx

pytestmark = pytest.mark.slow

PATH = "forcing.frequency"


def between_stops(frequency: float) -> vx.ImpactSystem:
    """A mass whose orbits are asymmetric below the pitchfork at 1.53."""
    stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], frequency), stops)


@pytest.fixture(scope="module")
def orbits() -> xr.Dataset:
    """Orbits on both sides, each with its mirror image: that of half a period later."""
    values, one = np.array([1.48, 1.5]), between_stops(1.5)
    sol = vx.simulate(one, 0.0, 300 * one.forcing.period, [0.1], [0.0], max_events=8, throw=False)
    other = vx.periodic_orbit(one, sol.x1, sol.v1).mirrored()
    starts = (np.asarray(sol.x1), np.asarray(sol.v1)), (np.asarray(other.x0), np.asarray(other.v0))
    parts = []
    for number, (x0, v0) in enumerate(starts):
        swept = {PATH: values + 1e-3 * number}
        ds = vx.sweep(one, swept, x0=x0, v0=v0, transient=300, progress=False)
        parts.append(vx.periodic_orbits(ds, progress=False))
    found = xr.concat(parts, PATH, combine_attrs="override")
    assert isinstance(found, xr.Dataset)
    return found


def test_of_two_branches_of_mirror_images_one_is_followed(orbits):
    both = vx.branches(orbits, (1.46, 1.52), progress=False)
    assert len(both) == 2
    (one,) = vx.branches(orbits, (1.46, 1.52), fold=True, progress=False)
    np.testing.assert_array_equal(one.points.x0, both[0].points.x0)
    # The other one has the images of its orbits, which have the same multipliers.
    image = one.orbit(len(one) // 2).mirrored()
    order = np.argsort(both[1].values)
    x0 = both[1].points.x0.values[order, 0]
    there = np.interp(float(image.system.forcing.frequency), both[1].values[order], x0)
    assert float(image.x0[0]) == pytest.approx(there, abs=1e-3)
    assert abs(float(image.x0[0]) - float(one.points.x0[len(one) // 2, 0])) > 0.01


def test_a_branch_through_the_pitchfork_has_both_halves_all_the_same(orbits):
    (one,) = vx.branches(orbits, (1.46, 1.6), fold=True, progress=False)
    assert one.ends == ("bounds", "bounds")
    assert [point.kind for point in one.bifurcations] == ["pitchfork"]


def test_friction_beside_the_stops_leaves_one_pitchfork_on_both_branches():
    plain = between_stops(1.5)
    system = vx.ImpactSystem(
        plain.mass,
        plain.damping,
        plain.stiffness,
        plain.forcing,
        plain.stops,
        friction=[vx.Friction(0, 0.05)],
    )
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period, [0.1], [0.0], max_events=8, throw=False)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
    assert orbit.symmetries() == ()
    asymmetric = vx.continuation(orbit, PATH, (1.3, 1.8), progress=False)
    # The branch leads to its mirror image, through the same events in turn.
    there, back = ([(point.kind, point.value) for point in asymmetric.bifurcations[::way]] for way in (1, -1))
    assert [kind for kind, _ in there] == [kind for kind, _ in back]
    np.testing.assert_allclose([a for _, a in there], [a for _, a in back], rtol=1e-12)
    (point,) = (p for p in asymmetric.bifurcations if p.kind == "pitchfork")
    (symmetric,) = vx.switch_branch(point)
    assert len(symmetric.symmetries()) == 1
    (same,) = vx.continuation(symmetric, PATH, (1.3, 1.8), progress=False).bifurcations
    assert same.kind == "pitchfork"
    assert same.value == pytest.approx(point.value, rel=1e-12)
