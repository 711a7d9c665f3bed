"""Orbits of a sweep, in one batch."""

from concurrent.futures import ThreadPoolExecutor

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import named, points

import vijax as vx
from vijax._orbits import search_workers

pytestmark = pytest.mark.thorough

SWEPT = {"forcing.frequency": np.linspace(0.7, 1.0, 40)}


@pytest.fixture(scope="module")
def swept():
    return vx.sweep(vx.models.wagg_bishop_a(1.0), SWEPT, transient=200, record=12, progress=False)


@pytest.fixture(scope="module")
def orbits(swept):
    return vx.periodic_orbits(swept, progress=False)


@pytest.mark.slow
def test_every_periodic_point_becomes_an_orbit(swept, orbits):
    kinds = vx.classify(swept)
    is_periodic = kinds.num_periods.values > 0
    assert is_periodic.sum() > 20
    np.testing.assert_array_equal(orbits.converged, is_periodic)
    np.testing.assert_array_equal(orbits.num_periods, kinds.num_periods)
    np.testing.assert_array_equal(
        orbits.num_impacts.values[is_periodic], kinds.num_impacts.values[is_periodic]
    )
    assert float(orbits.residual.max()) < 1e-13


def test_they_are_those_of_single_searches(swept, orbits):
    for k in np.flatnonzero(orbits.converged)[::9]:
        one, point = orbits.isel({"forcing.frequency": k}), swept.isel({"forcing.frequency": k})
        orbit = vx.periodic_orbit(vx.system_of(point), point.x.values, point.v.values, int(one.num_periods))
        np.testing.assert_allclose(one.x0, orbit.x0, rtol=0, atol=1e-13)
        np.testing.assert_allclose(one.v0, orbit.v0, rtol=0, atol=1e-13)
        np.testing.assert_allclose(abs(one.multipliers), abs(orbit.multipliers), rtol=0, atol=1e-11)
        assert bool(one.is_stable) == bool(orbit.is_stable)


def test_their_multipliers_multiply_to_the_loss_of_volume(swept, orbits):
    found = orbits.isel({"forcing.frequency": orbits.converged.values})
    # Case (a): M = 1, C = 0.1 K with trace 0.3, r = 0.7.
    periods = 2 * np.pi * found.num_periods / found["forcing.frequency"]
    expected = np.exp(-0.3 * periods) * 0.7 ** (2 * found.num_impacts.sum("stop"))
    np.testing.assert_allclose(found.multipliers.prod("multiplier").real, expected, rtol=0, atol=1e-14)


def test_workers_find_the_same_bit_for_bit(swept, orbits, monkeypatch):
    monkeypatch.setattr(search_workers, "_IN_TASK", 1)
    with ThreadPoolExecutor(2) as executor:
        again = vx.periodic_orbits(swept, executor=executor, progress=False)
    xr.testing.assert_identical(again, orbits)


def test_few_are_searched_for_one_by_one_and_are_those_of_the_batch(swept, orbits):
    few = slice(20, 25)
    found = vx.periodic_orbits(swept.isel({"forcing.frequency": few}), progress=False)
    one = orbits.isel({"forcing.frequency": few})
    assert one.converged.any()
    for name in ("converged", "is_stable", "num_periods", "num_impacts"):
        np.testing.assert_array_equal(found[name], one[name])
    np.testing.assert_allclose(found.x0, one.x0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(abs(found.multipliers), abs(one.multipliers), rtol=0, atol=1e-11)
    with ThreadPoolExecutor(2) as executor:
        again = vx.periodic_orbits(swept.isel({"forcing.frequency": few}), executor=executor, progress=False)
    xr.testing.assert_identical(again, found)


def test_what_gives_no_tasks_is_refused(swept):
    with pytest.raises(ValueError, match="Argument `executor` must be"):
        vx.periodic_orbits(swept, executor="workers", progress=False)


def test_what_settles_is_stable(orbits):
    assert bool(orbits.is_stable.where(orbits.converged, True).all())


def test_they_are_marked_in_a_bifurcation_diagram(swept, orbits):
    ax = vx.plot.bifurcation(swept, 1, orbits=orbits)
    (proxy,) = named(ax, "stable orbit")
    (marked,) = (
        line for line in ax.lines if line.get_markersize() == proxy.get_markersize() and line is not proxy
    )
    is_on_one = ((swept.impact_stop == 1) & orbits.converged).values
    at, velocity = (a.values for a in xr.broadcast(swept["forcing.frequency"], swept.impact_velocity))
    assert is_on_one.sum() > 100
    assert points(marked) == set(zip(at[is_on_one].tolist(), velocity[is_on_one].tolist(), strict=True))
    plt.close(ax.figure)


@pytest.mark.slow
def test_chattering_motions_become_orbits():
    sweep = vx.sweep(
        vx.models.wagg_bishop_b(1.0),
        {"forcing.frequency": np.linspace(0.2, 0.5, 24)},
        transient=200,
        progress=False,
    )
    kinds, orbits = vx.classify(sweep), vx.periodic_orbits(sweep, progress=False)
    is_periodic = kinds.num_periods.values > 0
    assert np.isinf(kinds.num_impacts.values).any()
    np.testing.assert_array_equal(orbits.converged, is_periodic)


@pytest.mark.slow
def test_a_mass_on_a_cubic_spring_has_an_orbit():
    system = vx.models.duffing_oscillator(1.2, 0.5, position=0.4, damping=0.1)
    sol = vx.simulate(system, 0.0, 60 * float(system.forcing.period), max_events=0, throw=False)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
    t = float(orbit.period)
    again = vx.simulate(system, 0.0, t, orbit.x0, orbit.v0)
    np.testing.assert_allclose([again.x1, again.v1], [orbit.x0, orbit.v0], rtol=0, atol=1e-9)
    expected = np.exp(-0.1 * t) * 0.8 ** (2 * int(orbit.num_impacts[0]))
    np.testing.assert_allclose(np.prod(orbit.multipliers).real, expected, rtol=1e-6)
