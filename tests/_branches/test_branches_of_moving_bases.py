"""Branches, quantities, curves and values of bifurcations of a machine whose base moves by a wave form, and of its family."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import vijax as vx

pytestmark = pytest.mark.thorough

FREQUENCY, POSITION = "forcing.frequency", "stops[0].position"
PHASES = 2 * np.pi * np.arange(8) / 8
HEIGHT = 0.5
# Samples miss a maximum by the curvature of the motion.
SAMPLED = 1e-6


def machine(frequency=0.8, height=HEIGHT, position=0.3) -> vx.ImpactSystem:
    acceleration = vx.Waveform(PHASES, -height * jnp.cos(jnp.asarray(PHASES)), frequency, "cubic")
    load = vx.base_excitation([1.0], acceleration=acceleration)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, position, "upper", 0.7)])


def settled(system) -> vx.PeriodicOrbit:
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period, max_events=2, throw=False)
    return vx.periodic_orbit(system, sol.x1, sol.v1)


@pytest.fixture(scope="module")
def branch() -> vx.Branch:
    quantities = ["max_absolute_acceleration", "max_acceleration"]
    asked = {"quantities": quantities, "peaks": ["peak_to_peak"], "progress": False}
    return vx.continuation(settled(machine()), FREQUENCY, (0.55, 1.2), **asked)


def test_absolute_accelerations_along_a_branch_are_those_of_its_motions(branch):
    spline = CubicSpline(
        np.append(PHASES, 2 * np.pi), -HEIGHT * np.cos(np.append(PHASES, 0.0)), bc_type="periodic"
    )
    for k in (0, len(branch) // 2, len(branch) - 1):
        orbit = branch.orbit(k)
        sol = vx.simulate(orbit.system, 0.0, float(orbit.period), orbit.x0, orbit.v0, max_events=32)
        t = np.linspace(0.0, float(orbit.period), 20_001)
        own = np.asarray(jax.vmap(sol.acceleration)(jnp.asarray(t)))[:, 0]
        found = np.abs(own + spline(float(orbit.system.forcing.frequency) * t % (2 * np.pi))).max()
        assert float(branch.points.max_absolute_acceleration[k, 0]) == pytest.approx(found, abs=SAMPLED)


def test_peaks_are_stationary(branch):
    assert len(branch.peaks) > 0
    peak = branch.peaks[0]
    size = lambda w: np.ptp(_positions(w, peak.orbit))  # noqa: E731
    here, step = size(peak.value), 1e-3
    ahead, behind = size(peak.value + step) - here, size(peak.value - step) - here
    assert ahead * behind > 0
    assert abs(ahead - behind) < 0.1 * abs(ahead + behind)


def _positions(frequency: float, orbit: vx.PeriodicOrbit) -> np.ndarray:
    system = machine(frequency)
    near = vx.periodic_orbit(system, orbit.x0, orbit.v0, orbit.num_periods)
    ts = np.linspace(0.0, float(near.period), 20_001)
    return np.asarray(vx.simulate(system, 0.0, ts[-1], near.x0, near.v0, ts=ts, max_events=32).xs)[:, 0]


@pytest.mark.parametrize("kind", ["gr", "fold"])
def test_values_and_curves_of_bifurcations_agree(branch, kind: str):
    point = next(one for one in branch.bifurcations if one.kind == kind)
    value = lambda height: vx.bifurcation_value(point, machine(height=height))  # noqa: E731
    assert float(value(HEIGHT)) == pytest.approx(point.value, abs=1e-12)
    slope, step = float(jax.grad(value)(HEIGHT)), 1e-5
    differences = float(value(HEIGHT + step) - value(HEIGHT - step)) / (2 * step)
    assert slope == pytest.approx(differences, rel=1e-7)
    bounds = {FREQUENCY: (0.55, 1.2), POSITION: (0.25, 0.35)}
    curve = vx.bifurcation_curve(point, POSITION, bounds, max_points=8, progress=False)
    there = curve.isel(point=curve.sizes["point"] // 2)
    own = vx.bifurcation_value(point, machine(position=float(there[POSITION])))
    assert float(own) == pytest.approx(float(there[FREQUENCY]), abs=1e-10)


def test_a_branch_along_a_value_of_a_family_is_that_of_its_machines():
    family = vx.Family(machine, frequency=0.8)
    found = vx.continuation(settled(family), "height", (0.4, 0.6), progress=False)
    for k in (0, len(found) - 1):
        x, v = vx.stroboscopic_map(machine(height=found.values[k]), found.points.x0[k], found.points.v0[k])
        np.testing.assert_allclose(x, found.points.x0[k], rtol=0, atol=1e-11)
        np.testing.assert_allclose(v, found.points.v0[k], rtol=0, atol=1e-11)


def test_a_branch_along_one_value_of_the_wave_form_is_that_of_its_machines():
    path = "forcing.values[0][0]"
    found = vx.continuation(settled(machine()), path, (0.45, 0.55), progress=False)
    values = np.array(machine().forcing.values)
    for k in (0, len(found) - 1):
        values[0] = found.values[k]
        load = vx.Waveform(PHASES, values, 0.8, "cubic")
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.3, "upper", 0.7)])
        x, _ = vx.stroboscopic_map(system, found.points.x0[k], found.points.v0[k])
        np.testing.assert_allclose(x, found.points.x0[k], rtol=0, atol=1e-11)
