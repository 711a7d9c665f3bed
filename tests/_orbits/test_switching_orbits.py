"""Periodic orbits of machines with dry friction and compliant stops, by figures of independent computations."""

import jax
import numpy as np
import pytest
from helpers import ROUNDING

import vijax as vx

# The figures below come from computations in 30 digits (mpmath); they are printed to 12 digits or more.
PRINTED = 2e-12
# Central differences with steps of 1e-5.
DIFFERENCES = 1e-8


def rubbing(
    frequency: float, force: float | jax.Array = 1.0, static: float | None = None, stops: tuple = ()
) -> vx.ImpactSystem:
    """J. P. den Hartog, Trans. ASME 53 (1931): x'' + 0.1 x' + x = 1.5 cos wt - F sgn x'."""
    load = vx.Harmonic(amplitude=[1.5], frequency=frequency)
    friction = vx.Friction(0, force, static=static)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, list(stops), friction=[friction])


def cushioned(frequency: float) -> vx.ImpactSystem:
    """J. Ing, E. Pavlovskaia & M. Wiercigroch, Nonlinear Dyn. 46 (2006): a shaken mass and a soft stop."""
    load = vx.Harmonic(amplitude=[0.7 * frequency**2], frequency=frequency, phase=[-np.pi / 2])
    stop = vx.CompliantStop(0, 1.26, "upper", 5.0)
    return vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, [stop])


def capsule(force: float | jax.Array = 0.6) -> vx.ImpactSystem:
    """A mass in a capsule that rubs on the ground."""
    joined = np.array([[1.0, -1.0], [-1.0, 1.0]])
    load = vx.Harmonic(amplitude=[1.2, 0.0], frequency=1.05)
    cushion = vx.CompliantContact({0: 1.0, 1: -1.0}, 0.05, 15.0)
    return vx.ImpactSystem(
        [1.0, 2.5], 0.1 * joined, joined, load, [cushion], friction=[vx.Friction(1, force)]
    )


def settled(system: vx.ImpactSystem, periods: int) -> vx.PeriodicOrbit:
    sol = vx.simulate(system, 0.0, periods * system.forcing.period, throw=False)
    x0 = sol.x1 - sol.x1[-1] if system.num_masses > 1 else sol.x1
    return vx.periodic_orbit(system, x0, sol.v1)


def turning_points(orbit: vx.PeriodicOrbit) -> np.ndarray:
    """Positions of the mass at its events."""
    times = np.asarray(orbit.events.t)[np.asarray(orbit.events.kind) >= 0]
    ends = [vx.simulate(orbit.system, 0.0, t, orbit.x0, orbit.v0).x1[0] for t in times]
    return np.array(ends)


def kinds(orbit: vx.PeriodicOrbit) -> list[int]:
    kind = np.asarray(orbit.events.kind)
    return kind[kind >= 0].tolist()


@pytest.mark.slow
def test_a_motion_that_turns_without_sticks_has_the_amplitude_and_the_multipliers_of_den_hartog():
    orbit = settled(rubbing(0.8), 30)
    assert kinds(orbit) == [vx.TURN, vx.TURN]
    np.testing.assert_allclose(np.abs(turning_points(orbit)), 2.145852589884217, rtol=PRINTED)
    np.testing.assert_allclose(orbit.multipliers, [0.2502568051573, 0.0365532703531], rtol=PRINTED)


@pytest.mark.slow
def test_a_motion_with_two_sticks_a_period_has_exactly_one_multiplier_zero():
    orbit = settled(rubbing(0.6), 30)
    assert kinds(orbit) == [vx.STICK, vx.SLIP] * 2
    np.testing.assert_allclose(np.abs(turning_points(orbit)), 1.814126571521, rtol=PRINTED)
    times = np.asarray(orbit.events.t)[:4]
    np.testing.assert_allclose(times[2] - times[1], 4.509431030497, rtol=PRINTED)
    assert orbit.multipliers[0] != 0
    assert orbit.multipliers[1] == 0
    # From the derivative of the motion, step by step.
    monodromy = vx.monodromy_matrix(orbit.system, orbit.x0, orbit.v0)
    np.testing.assert_allclose(orbit.multipliers[0], np.trace(monodromy), rtol=100 * ROUNDING)


@pytest.mark.slow
def test_derivatives_of_an_orbit_with_sticks_agree_with_differences():
    orbit = settled(rubbing(0.6), 30)

    def of(force):
        found = vx.periodic_orbit(rubbing(0.6, force, 1.1), orbit.x0, orbit.v0)
        return (found.x0, found.multipliers.real[:1], found.events.t[:4])

    step = 1e-5
    found = jax.jacfwd(of)(1.0)
    above, below = of(1.0 + step), of(1.0 - step)
    for exact, high, low in zip(found, above, below, strict=True):
        np.testing.assert_allclose(exact, (high - low) / (2 * step), atol=DIFFERENCES)


@pytest.mark.slow
def test_an_orbit_with_friction_and_a_rigid_stop_has_its_impact_speed_and_one_short_stick():
    stop = vx.Stop(0, 1.0, "upper", 0.7)
    orbit = settled(rubbing(0.9, 0.3, stops=(stop,)), 100)
    log, kind = orbit.events, np.asarray(orbit.events.kind)
    np.testing.assert_allclose(log.velocity_minus[kind == vx.IMPACT], [2.347354871360382], rtol=PRINTED)
    assert np.count_nonzero(kind == vx.STICK) == 1
    assert int(orbit.num_impacts.sum()) == 1
    monodromy = vx.monodromy_matrix(orbit.system, orbit.x0, orbit.v0)
    np.testing.assert_allclose(orbit.multipliers[0], np.trace(monodromy), rtol=100 * ROUNDING)


@pytest.mark.slow
def test_an_orbit_on_a_compliant_stop_has_its_contact_time_speed_and_multipliers():
    orbit = settled(cushioned(0.85), 400)
    assert kinds(orbit) == [vx.CLOSE, vx.OPEN]
    closing, opening = np.asarray(orbit.events.t)[:2]
    np.testing.assert_allclose(opening - closing, 0.9036391573887, rtol=PRINTED)
    np.testing.assert_allclose(orbit.events.velocity_minus[0], 0.6246389664526, rtol=PRINTED)
    pair = -0.76106093 + 0.53231163j
    np.testing.assert_allclose(sorted(orbit.multipliers, key=np.imag), [pair.conjugate(), pair], rtol=1e-8)
    # Without impacts and with a damper alone, areas of the phase plane shrink by exp(-c T).
    shrinks = np.exp(-0.02 * orbit.period)
    np.testing.assert_allclose(np.prod(orbit.multipliers).real, shrinks, rtol=10 * ROUNDING)


@pytest.mark.slow
def test_a_capsule_robot_repeats_up_to_its_progression():
    orbit = settled(capsule(), 200)
    end_x, end_v = vx.stroboscopic_map(orbit.system, orbit.x0, orbit.v0)
    assert abs(orbit.progression[0]) > 1e-3
    np.testing.assert_allclose(end_x - orbit.x0, orbit.progression, atol=100 * ROUNDING)
    np.testing.assert_allclose(end_v, orbit.v0, atol=100 * ROUNDING)
    assert orbit.progression[0] == orbit.progression[1]
    assert orbit.multipliers[0] == 1  # a capsule elsewhere moves as this one
    of = lambda force: vx.periodic_orbit(capsule(force), orbit.x0, orbit.v0).progression[0]  # noqa: E731
    step = 1e-5
    difference = (of(0.6 + step) - of(0.6 - step)) / (2 * step)
    np.testing.assert_allclose(jax.jacfwd(of)(0.6), difference, atol=DIFFERENCES)


@pytest.mark.slow
def test_orbits_with_and_without_contact_are_found_side_by_side():
    load = vx.Harmonic(amplitude=[0.7 * 0.85**2], frequency=0.81, phase=[-np.pi / 2])
    system = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, [vx.CompliantStop(0, 1.26, "upper", 5.0)])
    starts = np.random.default_rng(0).uniform(-1.2, 1.2, (24, 2))
    orbits = vx.find_periodic_orbits(system, starts, 1, progress=False)
    for orbit in orbits:
        end = np.concatenate(vx.stroboscopic_map(system, orbit.x0, orbit.v0))
        np.testing.assert_allclose(end, np.concatenate([orbit.x0, orbit.v0]), atol=1e-9)
    assert orbits


@pytest.mark.slow
@pytest.mark.parametrize(
    "resists",
    [{"friction": lambda i: vx.Friction(i, 0.4)}, {"hysteresis": lambda i: vx.Jenkins(i, 1.0, 0.3)}],
    ids=["friction", "Jenkins elements"],
)
def test_equal_masses_that_hit_in_step_have_the_multipliers_of_each_twice(resists):
    """Each impact turns the friction of its own mass, or stops its slider."""

    def multipliers(n):
        load = vx.Harmonic([2.0] * n, 1.3, phase=[0.3] * n, mean=[0.2] * n)
        stops = [vx.Stop(i, 0.8, "upper", 0.6) for i in range(n)]
        more = {name: [element(i) for i in range(n)] for name, element in resists.items()}
        system = vx.ImpactSystem([1.0] * n, 0.2 * np.eye(n), np.eye(n), load, stops, **more)
        sol = vx.simulate(system, 0.0, 60 * load.period, [0.1] * n, [0.2] * n)
        # Rounded, so that pairs of complex conjugates have one order.
        return np.sort_complex(np.round(vx.periodic_orbit(system, sol.x1, sol.v1).multipliers, 8))

    np.testing.assert_allclose(multipliers(2), np.repeat(multipliers(1), 2), atol=1e-7)
