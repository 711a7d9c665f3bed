"""Periodic orbits of two masses: identities, and refused arguments."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._orbits.condensation import Pencil
from vijax._orbits.floquet import floquet_multipliers

# The absolute error of a small multiplier is that of the largest one.
ROUNDING = 1e-13


def settled(system, periods=100):
    sol = vx.simulate(system, 0.0, periods * float(system.forcing.period), max_events=0, throw=False)
    return sol.x1, sol.v1


def product(system, num_periods, impacts):
    """Factor by which a cycle contracts a volume: exp(-tr(M^-1 C) n T) times r^2 for each impact."""
    r = np.array([float(stop.restitution) for stop in system.stops])
    loss = float(jnp.sum(jnp.diag(system.damping) / system.mass) * num_periods * system.forcing.period)
    return np.exp(-loss) * np.prod(r ** (2 * np.asarray(impacts)))


@pytest.mark.slow
@pytest.mark.parametrize("is_proportional", [True, False])
def test_multipliers_of_random_machines_multiply_to_their_loss_of_volume(is_proportional):
    rng, found = np.random.default_rng(1), 0
    for _ in range(24):
        c, k = rng.uniform(0.02, 0.2), rng.uniform(0.5, 2, 2)
        stops = [vx.Stop(i, rng.uniform(0.05, 0.5), "upper", rng.uniform(0.3, 0.9)) for i in range(2)]
        load = vx.Harmonic([rng.uniform(0.2, 1.0), rng.uniform(-0.5, 0.5)], rng.uniform(0.7, 2.0))
        dampings = c * (k if is_proportional else rng.uniform(0.5, 2, 2))
        system = vx.chain(rng.uniform(0.5, 2, 2), dampings, k, load, stops)
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


@pytest.mark.thorough
def test_an_orbit_that_sticks_has_two_multipliers_of_zero(sticking):
    assert bool(sticking.is_admissible)
    assert float(sticking.residual) < 1e-13
    np.testing.assert_array_equal(sticking.multipliers[2:], 0)
    np.testing.assert_allclose(abs(sticking.multipliers[:2]), 0.1408, atol=1e-4)
    kinds = np.asarray(sticking.events.kind)
    assert (kinds == vx.RELEASE).sum() == (kinds == vx.STICK).sum() == 2


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_series_and_modes_find_the_same_orbit():
    system = vx.models.wagg_bishop_a(0.8)
    start = settled(system)
    modes, series = (vx.periodic_orbit(system, *start, flow=flow) for flow in (None, vx.TaylorFlow()))
    np.testing.assert_allclose(series.x0, modes.x0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(series.multipliers, modes.multipliers, rtol=1e-10)


def test_a_mass_that_is_held_for_ever_has_multipliers_of_zero():
    # The second mass is pressed on its stop; the first swings between wall and it: x'' + 0.2 x' + 2 x = cos(t) + 0.1.
    load = vx.Harmonic([1.0, 0.0], 1.0, mean=[0.0, 9.0])
    stops = [vx.Stop(0, -5.0, "lower", 0.5), vx.Stop(1, 0.1, "upper", 0.5)]
    system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, stops)
    orbit = vx.periodic_orbit(system, *settled(system))
    assert int(orbit.num_impacts[0]) == 0
    np.testing.assert_array_equal(orbit.multipliers[2:], 0)
    np.testing.assert_allclose(abs(orbit.multipliers[:2]), np.exp(-0.1 * 2 * np.pi), rtol=1e-12)


def test_bad_arguments_are_told():
    system = vx.models.wagg_bishop_a(0.8)
    with pytest.raises(ValueError, match="beyond a stop"):
        vx.periodic_orbit(system, [5.0, 0.0], [0.0, 0.0])
    with pytest.raises(ValueError, match="`x0` must have shape"):
        vx.periodic_orbit(system, [0.0], [0.0, 0.0])
    with pytest.raises(ValueError, match="`num_periods` must be a whole number"):
        vx.periodic_orbit(system, [0.0, 0.0], [0.0, 0.0], 0)
    with pytest.raises(ValueError, match="`starts` must be"):
        vx.find_periodic_orbits(system, np.zeros((3, 3)), 1, progress=False)


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


@pytest.mark.parametrize("speed", [0.0, 1e-15, -1e-15])
def test_at_grazing_a_multiplier_is_infinite_and_the_others_are_not(speed):
    """Where an impact is located as a grazing, its speed is a rounding of either sign."""
    end = jnp.array([[0.5, 0.2], [0.1, -0.3]])
    start = jnp.array([[1.0, 0.0], [2.0, speed]])
    found = floquet_multipliers(Pencil(end, start), jnp.array(0), jnp.zeros((len(end) // 2, len(end) // 2)))
    assert np.isinf(found[0].real)
    # det(Z - mu N) = 0 is linear in mu.
    np.testing.assert_allclose(found[1], 0.17 / 0.7, rtol=1e-13)


@pytest.mark.slow
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
    # Forward derivatives of a batch in one program, reverse ones of one orbit in another.
    batch, slopes = jax.jit(jax.vmap(lambda w: jax.jvp(told, (w,), (1.0,))))(jnp.array([0.79, 0.8]))
    np.testing.assert_allclose(slopes[1], difference, rtol=0, atol=1e-9)
    np.testing.assert_allclose(jax.jacrev(told)(0.8), slopes[1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(batch[1], told(0.8), rtol=0, atol=1e-12)
