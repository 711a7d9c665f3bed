"""Quantities of cycles that graze: at the ends of branches of several periods, where a run would leave the cycle."""

import numpy as np
import pytest
import xarray as xr
from test_repeated_grazing import machine

import vijax as vx

pytestmark = pytest.mark.slow

FREQUENCY = "forcing.frequency"
NAMES = ["max_position", "min_position", "rms_velocity", "impulse"]
# Of a cycle of several periods beside the same of one: roundings that a grazing has turned into their square roots.
ROOTED = 1e-6
# Of quantities of a cycle that grazes without a speed, relative: the impact there has that of a rounding's square root.
TOUCHED = 1e-7


def followed(orbit: vx.PeriodicOrbit, bounds: tuple[float, float]) -> vx.Branch:
    names = {name: name for name in NAMES} | {"end": lambda sol: np.asarray(sol.x1)}
    return vx.continuation(orbit, FREQUENCY, bounds, progress=False, quantities=names)


def turned(scale: float, side: int) -> vx.ImpactSystem:
    """The machine of two masses with lengths and forces scaled, or its mirror image."""
    one = machine(1.56872)
    load = vx.Harmonic(side * scale * np.asarray(one.forcing.amplitude), 1.56872)
    sides = ("upper", "lower")[::side]
    stops = [
        vx.Stop(0, side * scale * 0.70028, sides[0], 0.456959),
        vx.Stop(1, side * scale * -0.5631, sides[1], 0.785713),
    ]
    return vx.ImpactSystem(one.mass, one.damping, one.stiffness, load, stops)


@pytest.mark.parametrize(("scale", "side"), [(1.0, 1), (1e-6, 1), (1e3, -1)])
def test_the_end_of_a_branch_of_four_periods_has_the_quantities_of_the_cycle_of_one(scale, side):
    """Three of the four periods graze: what the first makes of a rounding error, the others make large."""
    bounds, unit = (1.5685, 1.5705), side * scale
    x0, v0 = unit * np.array([[-0.476161, -0.46606], [0.909469, -0.459481]])
    branch = followed(vx.periodic_orbit(turned(scale, side), x0, v0, 4), bounds)
    k = -branch.ends.index("gr")
    end, orbit = branch.points.isel(point=k), branch.orbit(k)
    of_one = followed(vx.periodic_orbit(orbit.system, orbit.x0, orbit.v0), bounds)
    one: xr.Dataset = of_one.points.isel(point=int(np.abs(of_one.values - float(end[FREQUENCY])).argmin()))
    for name in ("max_position", "min_position", "rms_velocity", "end"):
        np.testing.assert_allclose(end[name], one[name], rtol=0, atol=ROOTED * scale)
    np.testing.assert_allclose(end.impulse, np.tile(one.impulse, (4, 1)), rtol=0, atol=ROOTED * scale)
    touched = (
        [end.max_position[0], end.min_position[1]][::1]
        if side > 0
        else [end.min_position[0], end.max_position[1]]
    )
    np.testing.assert_allclose(touched, unit * np.array([0.70028, -0.5631]), rtol=TOUCHED)


def test_a_branch_that_ends_without_an_impact_ends_with_the_linear_motion():
    """An undamped mass, whose free vibration repeats with the load: closed form."""
    mass, stiffness, amplitude, mean, position, phase = (
        1.40212,
        12.9182,
        0.375594,
        0.400537,
        0.134654,
        0.891603,
    )
    load = vx.Harmonic([amplitude], 2.6, [phase], mean=[mean])
    system = vx.ImpactSystem([mass], [[0.0]], [[stiffness]], load, [vx.Stop(0, position, "upper", 0.331778)])
    branch = followed(vx.periodic_orbit(system, [0.06191097], [-0.07580786], 3), (2.1, 2.7))
    end = branch.points.isel(point=-branch.ends.index("gr"))
    frequency, natural = float(end[FREQUENCY]), np.sqrt(stiffness / mass)
    size = amplitude / (stiffness - mass * frequency**2)
    t = np.linspace(0, 6 * np.pi / frequency, 2_000_001)
    free = end.x0.values[0] - mean / stiffness - size * np.cos(phase)
    speed = (end.v0.values[0] + size * frequency * np.sin(phase)) / natural
    forced = mean / stiffness + size * np.cos(frequency * t + phase)
    x = forced + free * np.cos(natural * t) + speed * np.sin(natural * t)
    np.testing.assert_allclose([end.max_position[0], x.max()], position, rtol=TOUCHED)
    np.testing.assert_allclose(end.min_position[0], x.min(), rtol=TOUCHED)
    rms = np.sqrt((size * frequency) ** 2 / 2 + (np.hypot(free, speed) * natural) ** 2 / 2)
    np.testing.assert_allclose(end.rms_velocity[0], rms, rtol=TOUCHED)
    np.testing.assert_allclose(end.impulse, 0, atol=TOUCHED)
