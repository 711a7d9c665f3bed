"""Branches, quantities along them, curves and values of bifurcations under a wave form and a harmonic load together."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.slow

FREQUENCY, POSITION = "forcing.frequency", "stops[0].position"
QUANTITIES = ("max_acceleration", "min_acceleration", "rms_acceleration")
ROUNDING = 1e-12
# Samples miss a value at an impact by its slope.
SAMPLED = 1e-3


def machine(frequency=0.8, position=0.3):
    knots = np.pi / 2 * np.arange(4)
    wave = vx.Waveform(knots, 0.2 * np.array([[1.0], [0.0], [-1.0], [0.0]]), frequency)
    stops = [vx.Stop(0, position, "upper", 0.7)]
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], wave + vx.Harmonic([0.3], frequency), stops)


@pytest.fixture(scope="module")
def branch():
    system = machine()
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period, max_events=2, throw=False)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
    return vx.continuation(orbit, FREQUENCY, (0.7, 1.2), quantities=QUANTITIES, progress=False)


def test_points_repeat_and_have_the_accelerations_of_their_motion(branch):
    assert len(branch.bifurcations) > 0
    for k in (0, len(branch) // 2, len(branch) - 1):
        point = branch.points.isel(point=k)
        system = machine(float(point[FREQUENCY]))
        end = branch.orbit(k).num_periods * system.forcing.period
        sol = vx.simulate(system, 0.0, end, point.x0.values, point.v0.values, max_events=16)
        np.testing.assert_allclose(sol.x1, point.x0, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(sol.v1, point.v0, rtol=0, atol=ROUNDING)
        t = jnp.linspace(0.0, end, 20_001)
        found = np.asarray(jax.vmap(sol.acceleration)(t))[:, 0]
        own = point.isel(mass=0)
        assert float(own.max_acceleration) >= found.max() - ROUNDING
        assert float(own.min_acceleration) <= found.min() + ROUNDING
        np.testing.assert_allclose(own.max_acceleration, found.max(), atol=SAMPLED)
        np.testing.assert_allclose(own.min_acceleration, found.min(), atol=SAMPLED)
        rms = np.sqrt(np.trapezoid(found**2, t) / end)
        np.testing.assert_allclose(own.rms_acceleration, rms, rtol=SAMPLED)


def test_a_curve_has_the_values_of_its_bifurcation(branch):
    point = branch.bifurcations[0]
    bounds = {FREQUENCY: (0.7, 1.2), POSITION: (0.25, 0.35)}
    curve = vx.bifurcation_curve(point, POSITION, bounds, progress=False)
    for k in (0, curve.sizes["point"] // 2):
        there = curve.isel(point=k)
        value = vx.bifurcation_value(point, machine(position=float(there[POSITION])))
        assert float(value) == pytest.approx(float(there[FREQUENCY]), abs=1e-10)
