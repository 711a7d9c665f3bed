"""Attractors, basins, tori and manifolds of families."""

import numpy as np
import pytest
from families import rotor

import vijax as vx

FEW = {"transient": 60, "record": 10, "progress": False}


@pytest.fixture(scope="module")
def family():
    return vx.Family(rotor, frequency=0.74, labels={"frequency": "Speed"})


@pytest.mark.slow
def test_attractors_are_those_of_the_machine(family):
    own = vx.attractors(family, 20, **FEW)
    other = vx.attractors(family.system, 20, **FEW)
    for name in ("share", "section_x", "num_impacts"):
        np.testing.assert_array_equal(own[name], other[name])
    assert isinstance(vx.system_of(own), vx.Family)


@pytest.mark.slow
def test_basins_and_their_integrity(family):
    grid = {"x0[0]": np.linspace(-0.5, 0.5, 6), "v0[0]": np.linspace(-0.5, 0.5, 6)}
    own, other = (vx.basins(machine, grid, **FEW) for machine in (family, family.system))
    np.testing.assert_array_equal(own.label, other.label)
    np.testing.assert_array_equal(vx.integrity(own).integrity_factor, vx.integrity(other).integrity_factor)
    covariance = 1e-4 * np.eye(2)
    chances = [vx.tipping_probability(one, covariance, samples=16, progress=False) for one in (own, other)]
    assert chances[0].equals(chances[1])


@pytest.mark.slow
def test_attractors_along_a_value_that_moves_load_and_frequency(family):
    speeds = np.array([0.72, 0.74, 0.76])
    own = vx.follow_attractors(family, "frequency", speeds, 16, **FEW)
    assert own["frequency"].attrs["label"] == "Speed"
    assert vx.plot.shares(own).get_xlabel() == "Speed"
    for k, speed in enumerate(speeds):
        alone = vx.attractors(rotor(speed), 16, bounds=[[-0.5, 0.5], [-0.5, 0.5]], **FEW)
        alike = vx.follow_attractors(
            family, "frequency", [speed], 16, bounds=[[-0.5, 0.5], [-0.5, 0.5]], **FEW
        )
        np.testing.assert_allclose(
            np.sort(alike.share.values.ravel()), np.sort(alone.share.values), err_msg=str(k)
        )
    found = own.where(own.is_found)
    assert np.isfinite(found.share).any("attractor").all()


def pair(frequency=1.65, ratio=0.02):
    load = vx.Harmonic([1.0, 0.0], frequency)
    stops = [vx.Stop(0, 0.11, "upper", 0.8)]
    return vx.chain([1.0, 1.29], [ratio, ratio], [1.0, 1.1], load, stops)


@pytest.mark.slow
def test_a_torus_along_a_value_is_that_along_the_path():
    found = []
    for system, path in ((vx.Family(pair), "frequency"), (pair(), "forcing.frequency")):
        run = vx.simulate(system, 0.0, 500 * system.forcing.period, max_events=1, throw=False)
        orbit = vx.periodic_orbit(system, run.x1, run.v1)
        branch = vx.continuation(orbit, path, (1.5, 1.7), progress=False)
        point = next(one for one in branch.bifurcations if one.kind == "ns")
        found.append((point.value, vx.follow_torus(point, (1.54, 1.6), max_points=2, progress=False)))
    (own, torus), (other, same) = found
    assert own == pytest.approx(other, rel=1e-11)
    np.testing.assert_allclose(torus.rotation_number, same.rotation_number, rtol=1e-9)


@pytest.mark.slow
def test_manifolds_of_an_orbit_of_a_family(family):
    start = vx.simulate(family.at(frequency=0.7), 0.0, 1000.0, max_events=1, throw=False)
    branch = vx.continuation(
        vx.periodic_orbit(family.at(frequency=0.7), start.x1, start.v1),
        "frequency",
        (0.7, 0.85),
        progress=False,
    )
    k = int(np.flatnonzero(~branch.points.is_stable.values)[0]) + 1
    orbit = branch.orbit(k)
    assert isinstance(orbit.system, vx.Family)
    own = vx.manifolds(orbit, progress=False, length=2.0)
    other = vx.manifolds(
        vx.PeriodicOrbit(**{**vars(orbit), "system": orbit.system.system}), progress=False, length=2.0
    )
    assert own.equals(other)


@pytest.mark.thorough
def test_exponents_and_maps_take_a_family(family):
    machine = family.system
    few = {"transient": 5, "num_periods": 20, "progress": False}
    np.testing.assert_array_equal(vx.lyapunov_exponents(family, **few), vx.lyapunov_exponents(machine, **few))
    np.testing.assert_array_equal(
        vx.monodromy_matrix(family, [0.0], [0.1]), vx.monodromy_matrix(machine, [0.0], [0.1])
    )
    at = vx.next_impact(family, 0.0, [0.0], [0.5], stop=0)
    np.testing.assert_array_equal(at[0], vx.next_impact(machine, 0.0, [0.0], [0.5], stop=0)[0])
    crossing = vx.next_crossing(family, 0.0, [0.0], [0.5], mass=0, position=0.2)
    np.testing.assert_array_equal(crossing[0], vx.next_crossing(machine, 0.0, [0.0], [0.5], 0, 0.2)[0])
    region = vx.sticking_region(family, 0)
    assert type(region) is type(vx.sticking_region(machine, 0))
