"""Branches, quantities along them, and values of bifurcations of a machine whose base moves by a wave form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import vijax as vx

pytestmark = pytest.mark.slow  # two minutes of compilation

FREQUENCY = "forcing.frequency"
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
    values, step = np.array([peak.value for peak in branch.peaks]), 1e-3
    swept = {FREQUENCY: np.concatenate([values - step, values, values + step])}
    asked = {"transient": 400, "record": 4, "quantities": ["peak_to_peak"], "progress": False}
    behind, here, ahead = vx.sweep(machine(), swept, **asked).peak_to_peak.values[:, 0].reshape(3, -1)
    for k in (0, -1):
        assert ahead[k] - here[k] == pytest.approx(behind[k] - here[k], rel=0.02)


@pytest.mark.parametrize("kind", ["gr", "fold"])
def test_values_of_bifurcations_are_those_of_the_branch_and_have_their_slopes(branch, kind: str):
    point = next(one for one in branch.bifurcations if one.kind == kind)
    value = lambda height: vx.bifurcation_value(point, machine(height=height))  # noqa: E731
    assert float(value(HEIGHT)) == pytest.approx(point.value, abs=1e-12)
    slope, step = float(jax.grad(value)(HEIGHT)), 1e-5
    differences = float(value(HEIGHT + step) - value(HEIGHT - step)) / (2 * step)
    assert slope == pytest.approx(differences, rel=1e-7)
