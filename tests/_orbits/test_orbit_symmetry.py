"""Symmetries of orbits, and their mirror images."""

import jax
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough


def between_stops(frequency, lower=-0.5):
    """A mass between two stops: if these are equal its motion is symmetric at 2, and has lost the symmetry at 1.5."""
    stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, lower, "lower", 0.8)]
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], frequency), stops)


def settled(machine, phase=0.0, num_periods=1):
    end = 300 * machine.forcing.period + phase / machine.forcing.frequency
    sol = vx.simulate(machine, 0.0, end, [0.1], [0.0], max_events=8, throw=False)
    return vx.periodic_orbit(machine, sol.x1, sol.v1, num_periods, phase=phase)


@pytest.mark.parametrize("phase", [0.0, 1.0])
@pytest.mark.parametrize("num_periods", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_an_orbit_is_its_own_image_or_one_of_two(phase, num_periods):
    symmetric, other = (settled(between_stops(w), phase, num_periods) for w in (2.0, 1.5))
    (mirror,) = symmetric.symmetries()
    assert mirror.shift * 2 == 1
    assert other.symmetries() == ()
    same = symmetric.mirrored()
    np.testing.assert_allclose(same.x0, symmetric.x0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(same.v0, symmetric.v0, rtol=0, atol=1e-13)
    image = other.mirrored()
    assert abs(float(image.x0[0] - other.x0[0])) > 0.01
    np.testing.assert_allclose(image.multipliers, other.multipliers, rtol=0, atol=1e-11)
    assert image.phase == other.phase
    assert image.num_impacts.tolist() == other.num_impacts.tolist()[::-1]
    back = image.mirrored()
    np.testing.assert_allclose(back.x0, other.x0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(back.v0, other.v0, rtol=0, atol=1e-13)


def test_the_image_is_the_motion_half_a_period_later_turned_around():
    orbit = settled(between_stops(1.5))
    image, half = orbit.mirrored(), orbit.system.forcing.period / 2
    sol = vx.simulate(orbit.system, 0.0, half, orbit.x0, orbit.v0, max_events=8)
    np.testing.assert_allclose(image.x0, -sol.x1, rtol=0, atol=1e-13)
    np.testing.assert_allclose(image.v0, -sol.v1, rtol=0, atol=1e-13)


def test_without_a_symmetry_there_is_no_image():
    orbit = settled(between_stops(2.0, lower=-0.6))
    assert orbit.symmetries() == ()
    with pytest.raises(ValueError, match="no symmetry"):
        orbit.mirrored()


def test_symmetries_are_those_of_one_known_orbit():
    orbit = settled(between_stops(2.0))
    with pytest.raises(ValueError, match=r"outside of `jax.jit`"):
        jax.jit(lambda orbit: orbit.mirrored().x0)(orbit)
