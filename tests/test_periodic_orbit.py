"""Periodic orbits: published ones, closed forms, identities, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exact_orbits import Table

import vijax as vx
from vijax._orbits.condensed import Pencil
from vijax._orbits.floquet import floquet_multipliers

# Speeds are known to 13 digits; at a bifurcation an orbit is as far from them as the roots of a rounding.
SPEED, AT_FOLD = 1e-12, 1e-6
# A small multiplier is known as well as the largest one.
ROUNDING = 1e-13


def one_mass(frequency, amplitude, *, damping, restitution, stop=1.0):
    load = vx.Harmonic([amplitude], frequency)
    return vx.ImpactSystem([1.0], [[damping]], [[1.0]], load, [vx.Stop(0, stop, "upper", restitution)])


def orbits_of(system, num_periods, *, seed=0, size=2.0, starts=60):
    rng, stop = np.random.default_rng(seed), float(system.stops[0].position)
    x = stop - size * rng.uniform(0, 1, (starts, 1))
    return vx.find_periodic_orbits(system, num_periods, (x, rng.normal(0, size, (starts, 1))), progress=False)


def speeds(orbits, impacts=1):
    return sorted(float(o.events.velocity_minus[0]) for o in orbits if int(o.num_impacts[0]) == impacts)


# R. Ghosh & D. Simpson, arXiv 2510.16218: one impact in two periods. The other root is an orbit of its own.
@pytest.mark.parametrize(
    ("frequency", "amplitude", "speed", "tolerance"),
    [
        (0.84091, 0.32561956758361, 0.27433182278456, SPEED),
        (0.90, 0.35421999760770, 0.74714667673068, SPEED),
        (0.7995, 0.36218601300675, 0.050393232377, AT_FOLD),
    ],
)
def test_published_orbits_of_one_mass(frequency, amplitude, speed, tolerance):
    found = speeds(orbits_of(one_mass(frequency, amplitude, damping=0.04, restitution=0.9), 2))
    assert min(abs(np.array(found) - speed)) < tolerance


@pytest.mark.parametrize(("amplitude", "speed"), [(1.0, 1.6957329375949), (0.2, 0.29861285205633)])
def test_orbits_of_the_demonstration_of_coco(amplitude, speed):
    found = speeds(orbits_of(one_mass(1.0, amplitude, damping=0.1, restitution=0.8), 1))
    assert min(abs(np.array(found) - speed)) < SPEED


@pytest.mark.parametrize(
    ("stop", "expected"),
    [
        (0.0, [0.6656933528]),
        (0.2, [1.1023656826, 2.1874438808]),
        # At its period doubling the orbit passes through the stop between its impacts.
        (-0.061318624277, []),
        pytest.param(-0.06, [], marks=pytest.mark.thorough),
        (0.4, []),
    ],
)
def test_all_orbits_of_an_undamped_mass_are_found(stop, expected):
    orbits = orbits_of(one_mass(3.7, 1.0, damping=0.0, restitution=0.8, stop=stop), 2)
    np.testing.assert_allclose(speeds(orbits), expected, rtol=0, atol=1e-9)


def test_of_two_orbits_one_is_a_saddle():
    orbits = orbits_of(one_mass(3.7, 1.0, damping=0.0, restitution=0.8, stop=0.2), 2)
    stable = {
        round(float(o.events.velocity_minus[0]), 6): bool(o.is_stable)
        for o in orbits
        if o.num_impacts[0] == 1
    }
    assert stable == {1.102366: False, 2.187444: True}


@pytest.mark.thorough
def test_a_ball_on_a_moving_table_repeats_as_known():
    table = Table(1, 0.8, 9.81, 0.6)
    start = table.later(0.3)
    orbit = vx.periodic_orbit(start.system, start.x * 1.01, start.v * 0.99)
    np.testing.assert_allclose(orbit.x0, start.x, rtol=1e-12)
    np.testing.assert_allclose(orbit.v0, start.v, rtol=1e-12)
    assert float(orbit.events.velocity_minus[0]) == pytest.approx(-table.fall, rel=1e-12)
    np.testing.assert_allclose(np.prod(orbit.multipliers).real, 0.8**2, rtol=1e-12)


def settled(system, periods=100):
    sol = vx.simulate(system, 0.0, periods * float(system.forcing.period), max_events=0, throw=False)
    return sol.x1, sol.v1


def product(system, num_periods, impacts):
    """Volume of a cycle: exp(-tr(M^-1 C) n T) times r^2 for each impact."""
    r = np.array([float(stop.restitution) for stop in system.stops])
    loss = float(jnp.sum(jnp.diag(system.damping) / system.mass) * num_periods * system.forcing.period)
    return np.exp(-loss) * np.prod(r ** (2 * np.asarray(impacts)))


@pytest.mark.thorough
def test_multipliers_of_random_machines_multiply_to_their_loss_of_volume():
    rng, found = np.random.default_rng(1), 0
    for _ in range(24):
        c = rng.uniform(0.02, 0.2)
        stops = [vx.Stop(i, rng.uniform(0.05, 0.5), "upper", rng.uniform(0.3, 0.9)) for i in range(2)]
        load = vx.Harmonic([rng.uniform(0.2, 1.0), rng.uniform(-0.5, 0.5)], rng.uniform(0.7, 2.0))
        system = vx.chain(
            rng.uniform(0.5, 2, 2), c * rng.uniform(0.5, 2, 2), rng.uniform(0.5, 2, 2), load, stops
        )
        orbit = vx.periodic_orbit(system, *settled(system), rng.integers(1, 3), throw=False)
        if not orbit.is_admissible or orbit.multipliers[-1] == 0:
            continue
        found += 1
        expected = product(system, orbit.num_periods, orbit.num_impacts)
        np.testing.assert_allclose(np.prod(orbit.multipliers).real, expected, rtol=1e-10, atol=ROUNDING)
        assert float(orbit.residual) < 1e-13 * max(1.0, float(abs(orbit.multipliers[0])))
    assert found >= 8


@pytest.fixture(scope="module")
def sticking():
    system = vx.models.wagg_bishop_b(0.25)
    return vx.periodic_orbit(system, *settled(system))


def test_an_orbit_that_sticks_has_two_multipliers_of_zero(sticking):
    assert bool(sticking.is_admissible)
    assert float(sticking.residual) < 1e-13
    np.testing.assert_array_equal(sticking.multipliers[2:], 0)
    np.testing.assert_allclose(abs(sticking.multipliers[:2]), 0.1408, atol=1e-4)
    kinds = np.asarray(sticking.events.kind)
    assert (kinds == vx.RELEASE).sum() == (kinds == vx.STICK).sum() == 2


def test_an_orbit_that_sticks_is_found_from_afar(sticking):
    rng = np.random.default_rng(0)
    for _ in range(8):
        x, v = (a * (1 + 0.05 * rng.normal(size=2)) for a in (sticking.x0, sticking.v0))
        orbit = vx.periodic_orbit(sticking.system, np.minimum(x, [9.0, 0.1]), v)
        np.testing.assert_allclose(orbit.x0, sticking.x0, rtol=0, atol=1e-12)
        np.testing.assert_allclose(orbit.v0, sticking.v0, rtol=0, atol=1e-12)


def test_its_log_is_that_of_a_run(sticking):
    log, run = sticking.events, sticking.solution().events
    for name in ("kind", "stop"):
        np.testing.assert_array_equal(getattr(log, name), getattr(run, name))
    for name in ("t", "velocity_minus", "velocity_plus", "impulse"):
        np.testing.assert_allclose(getattr(log, name), getattr(run, name), rtol=0, atol=1e-10)


def test_from_another_phase_it_is_the_same_orbit(sticking):
    system, angle = sticking.system, 2.0
    x, v = sticking.solution().evaluate(angle / system.forcing.frequency)
    orbit = vx.periodic_orbit(system, x, v, phase=angle)
    np.testing.assert_allclose(orbit.x0, x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(orbit.v0, v, rtol=0, atol=1e-12)
    np.testing.assert_allclose(orbit.multipliers[:2], sticking.multipliers[:2], rtol=1e-10)


def test_a_mirrored_machine_has_the_mirrored_orbit(sticking):
    old = sticking.system
    sides = {"upper": "lower", "lower": "upper"}
    stops = [vx.Stop(s.mass, -s.position, sides[s.side], s.restitution) for s in old.stops]
    load = vx.Harmonic(-old.forcing.amplitude, old.forcing.frequency, old.forcing.phase)
    mirrored = vx.ImpactSystem(old.mass, old.damping, old.stiffness, load, stops)
    orbit = vx.periodic_orbit(mirrored, -sticking.x0, -sticking.v0)
    np.testing.assert_allclose(orbit.x0, -sticking.x0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(orbit.multipliers, sticking.multipliers, rtol=1e-9, atol=1e-12)


def test_over_two_periods_its_multipliers_are_squared():
    system = vx.models.wagg_bishop_a(0.8)
    start = settled(system)
    once, twice = (vx.periodic_orbit(system, *start, n) for n in (1, 2))
    np.testing.assert_allclose(
        np.sort_complex(twice.multipliers), np.sort_complex(once.multipliers**2), rtol=1e-10
    )
    np.testing.assert_array_equal(twice.num_impacts, 2 * once.num_impacts)


def test_series_and_modes_find_the_same_orbit():
    system = vx.models.wagg_bishop_a(0.8)
    start = settled(system)
    modes, series = (vx.periodic_orbit(system, *start, flow=flow) for flow in (None, vx.TaylorFlow()))
    np.testing.assert_allclose(series.x0, modes.x0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(series.multipliers, modes.multipliers, rtol=1e-10)


def test_without_impacts_it_is_the_response_to_the_load():
    system = one_mass(0.5, 0.3, damping=0.1, restitution=0.8)
    orbit = vx.periodic_orbit(system, [0.3], [0.1])
    response = 0.3 / (1 - 0.25 + 0.05j)
    np.testing.assert_allclose([orbit.x0[0], orbit.v0[0]], [response.real, -0.5 * response.imag], rtol=1e-14)
    assert int(orbit.num_impacts[0]) == 0


def test_a_mass_that_is_held_for_ever_has_multipliers_of_zero():
    # The second mass is pressed to its stop; the first swings between the wall and it: x'' + 0.2 x' + 2 x = cos(t) + 0.1.
    load = vx.Harmonic([1.0, 0.0], 1.0, mean=[0.0, 9.0])
    stops = [vx.Stop(0, -5.0, "lower", 0.5), vx.Stop(1, 0.1, "upper", 0.5)]
    system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, stops)
    orbit = vx.periodic_orbit(system, *settled(system))
    assert int(orbit.num_impacts[0]) == 0
    np.testing.assert_array_equal(orbit.multipliers[2:], 0)
    np.testing.assert_allclose(abs(orbit.multipliers[:2]), np.exp(-0.1 * 2 * np.pi), rtol=1e-12)


def test_what_is_not_found_is_told():
    system = one_mass(3.7, 1.0, damping=0.0, restitution=0.8, stop=-0.06)
    with pytest.raises(vx.SimulationError, match=r"not_converged|left_the_stops"):
        vx.periodic_orbit(system, [-1.0], [0.5], 2)
    orbit = vx.periodic_orbit(system, [-1.0], [0.5], 2, throw=False)
    assert not orbit.is_admissible
    assert orbit.result != vx.ORBIT_RESULTS.successful


def test_bad_arguments_are_told():
    system = vx.models.wagg_bishop_a(0.8)
    with pytest.raises(ValueError, match="beyond a stop"):
        vx.periodic_orbit(system, [5.0, 0.0], [0.0, 0.0])
    with pytest.raises(ValueError, match="`x0` must have shape"):
        vx.periodic_orbit(system, [0.0], [0.0, 0.0])
    with pytest.raises(ValueError, match="`num_periods` must be a whole number"):
        vx.periodic_orbit(system, [0.0, 0.0], [0.0, 0.0], 0)
    with pytest.raises(ValueError, match="no frequency"):
        vx.periodic_orbit(vx.models.wagg_bishop_a(0.0), [0.0, 0.0], [0.0, 0.0])
    with pytest.raises(ValueError, match="`starts` must be"):
        vx.find_periodic_orbits(system, 1, np.zeros((3, 3)), progress=False)


def test_more_events_than_there_is_room_for_are_told(sticking):
    orbit = vx.periodic_orbit(sticking.system, sticking.x0, sticking.v0, 4, throw=False)
    assert orbit.result == vx.ORBIT_RESULTS.max_events_reached


def test_it_is_printed_in_five_lines_and_labelled(sticking):
    lines = repr(sticking).splitlines()
    assert len(lines) == 5
    assert "stable" in lines[-1]
    ds = sticking.to_xarray()
    np.testing.assert_array_equal(ds.num_impacts, sticking.num_impacts)
    assert ds.sizes["event"] == int((np.asarray(sticking.events.kind) >= 0).sum())
    assert bool(ds.is_stable)
    assert ds.result.attrs["flag_meanings"].split()[int(ds.result)] == "successful"


def test_at_grazing_a_multiplier_is_infinite_and_the_others_are_not():
    end = jnp.array([[0.5, 0.2], [0.1, -0.3]])
    start = jnp.array([[1.0, 0.0], [2.0, 0.0]])
    found = floquet_multipliers(Pencil(end, start), jnp.array(0))
    assert np.isinf(found[0].real)
    # det(Z - mu N) = 0 is linear in mu.
    np.testing.assert_allclose(found[1], 0.17 / 0.7, rtol=1e-13)


@pytest.mark.thorough
def test_derivatives_are_those_of_differences():
    start = settled(vx.models.wagg_bishop_a(0.8))

    def told(frequency):
        orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(frequency), *start)
        return jnp.concatenate(
            [orbit.x0, orbit.v0, orbit.events.velocity_minus[:2], abs(orbit.multipliers[:1])]
        )

    h = 1e-4
    shifted = [told(0.8 + k * h) for k in (-2, -1, 1, 2)]
    difference = (shifted[0] - 8 * shifted[1] + 8 * shifted[2] - shifted[3]) / (12 * h)
    forward, reverse = jax.jacfwd(told)(0.8), jax.jacrev(told)(0.8)
    np.testing.assert_allclose(forward, difference, rtol=0, atol=1e-9)
    np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-12)
    batch = jax.jit(jax.vmap(told))(jnp.array([0.79, 0.8]))
    np.testing.assert_allclose(batch[1], told(0.8), rtol=0, atol=1e-12)
