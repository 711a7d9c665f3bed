"""A pair of gears against contact forces and flights of their flanks in closed form."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import log_of
from model_roundings import EXACT, ORBIT

import vijax as vx

GEARS = {"torque": 0.7, "position": 0.1, "inertias": [2.0, 1.5], "radii": [1.2, 0.8], "restitution": 0.5}


def in_mesh(amplitude: float, t: float) -> vx.Solution:
    """Motion that starts with the driving flanks in contact."""
    system = vx.models.gear_pair(1.3, amplitude, **GEARS)
    return vx.simulate(system, 0.0, t, x0=[0.1 / 1.2, 0.0])


def test_teeth_press_with_the_mean_torque_and_their_share_of_the_rest():
    first, second = 2.0 / 1.2**2, 1.5 / 0.8**2
    amplitude = 0.999 * 0.7 * (first + second) / second
    sol = in_mesh(amplitude, 20.0)
    assert int(sol.num_events) == 0
    t = np.linspace(0.0, 20.0, 50)
    share = second / (first + second)
    expected = (0.7 + amplitude * share * np.cos(1.3 * t)) / 1.2
    np.testing.assert_allclose(sol.contact_force(t)[:, 0], expected, rtol=0, atol=EXACT)


def test_teeth_part_where_the_torque_no_longer_presses_them():
    first, second = 2.0 / 1.2**2, 1.5 / 0.8**2
    amplitude = 1.2 * 0.7 * (first + second) / second
    sol = in_mesh(amplitude, 4.0)
    release, impact, *_ = log_of(sol)
    assert (release.kind, release.stop) == ("release", 0)
    assert release.t == pytest.approx(np.arccos(-1 / 1.2) / 1.3, rel=EXACT)
    # From there the distance of the flanks is that of a ball from a table.
    gravity = 0.7 / 1.2 * (1 / first + 1 / second)
    strength, w, t = amplitude / 1.2 / first, 1.3, impact.t - release.t
    angle = w * release.t
    speed = strength / w * (np.sin(angle + w * t) - np.sin(angle)) + gravity * t
    gone = strength / w**2 * (np.cos(angle) - np.cos(angle + w * t)) - strength / w * np.sin(angle) * t
    assert gone + gravity * t**2 / 2 == pytest.approx(0, abs=EXACT)
    assert impact.velocity == pytest.approx(speed, rel=10 * EXACT)
    assert (impact.kind, impact.stop) == ("impact", 0)


# Rounding at an angle of 5 over 12 impacts, 1e-14, magnified by 1 / (1 - 0.88), and by 30 in the multipliers.
TURNED = 1e-11
ROTATING = {"torque": 0.15, "damping": 0.2, "position": 0.3, "restitution": 0.9}


@pytest.fixture(scope="module")
def rattling() -> vx.PeriodicOrbit:
    """Gears that hammer on both flanks, rotated by an arbitrary angle."""
    system = vx.models.gear_pair(1.0, 1.0, **ROTATING)
    sol = vx.simulate(system, 0.0, 40 * system.forcing.period, x0=[5.1, 5.0])
    return vx.periodic_orbit(system, sol.x1, sol.v1, 2)


@pytest.mark.slow
def test_gears_rattle_as_a_ball_between_walls_that_feels_their_relative_force(rattling):
    forcing = vx.Harmonic([1.0], 1.0, mean=[0.3])
    walls = [vx.Stop(position=0.3, restitution=0.9), vx.Stop(position=-0.3, side="lower", restitution=0.9)]
    ball = vx.ImpactSystem([1.0], [[0.2]], [[0.0]], forcing, walls)
    y, u = (a[0] - a[1] for a in (rattling.x0, rattling.v0))
    alone = vx.periodic_orbit(ball, y[None], u[None], 2)
    drag = np.exp(-0.2 * 4 * np.pi)
    expected = np.sort_complex(np.append(alone.multipliers, [1.0, drag]))
    np.testing.assert_allclose(
        np.sort_complex(np.asarray(rattling.multipliers)), expected, rtol=0, atol=TURNED
    )
    np.testing.assert_array_equal(rattling.num_impacts, alone.num_impacts)
    assert rattling.num_impacts.min() > 0
    assert float(alone.x0[0]) == pytest.approx(float(y), abs=ORBIT)
    assert float(alone.v0[0]) == pytest.approx(float(u), abs=ORBIT)


@pytest.mark.slow
def test_gears_turned_by_an_angle_have_the_same_orbit_once(rattling):
    angles = np.array([0.0, 0.7, -3.0])[:, None]
    starts = np.asarray(rattling.x0) + angles, np.asarray(rattling.v0) + 0 * angles
    orbits = vx.find_periodic_orbits(rattling.system, starts, 2, progress=False)
    assert len(orbits) == 1
    np.testing.assert_allclose(orbits[0].multipliers, rattling.multipliers, rtol=0, atol=TURNED)


@pytest.mark.slow
def test_gears_with_a_mean_load_in_one_direction_drift():
    system = vx.models.gear_pair(1.0, 1.0, **ROTATING)
    pushed = eqx.tree_at(lambda s: s.forcing.mean, system, jnp.array([0.4, -0.15]))
    orbit = vx.periodic_orbit(pushed, [0.0, 0.0], [0.0, 0.0], 2, throw=False)
    assert orbit.result == vx.ORBIT_RESULTS.drifts
