"""Stroboscopic maps and monodromy matrices: products of flights and saltations, and orbits in closed form."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.linalg
from exact_orbits import exact_orbit
from helpers import relative_errors
from periodic_orbits import ORBITS, periodic_orbit
from problems import first_order_matrix

import vijax as vx

# Roundings of some hundred steps, 1e-15, magnified a hundred times.
ROUNDING = 1e-12
# Printed with six decimals.
SIX_DECIMALS = 1e-6


def flight_matrix(system: vx.ImpactSystem, span: float) -> np.ndarray:
    """Derivative of the state by an earlier one, without impacts between."""
    n = system.num_masses
    inverse = 1 / np.asarray(system.mass)[:, None]
    lower = np.hstack([-inverse * system.stiffness, -inverse * system.damping])
    upper = np.hstack([np.zeros((n, n)), np.eye(n)])
    return scipy.linalg.expm(span * np.vstack([upper, lower]))


@pytest.mark.slow
def test_the_monodromy_matrix_is_a_product_of_flights_and_saltations():
    system, periods = vx.models.wagg_bishop_b(1.4), 3
    end = periods * 2 * np.pi / 1.4
    sol = vx.simulate(system, 0.0, end)
    hits = int(sol.num_events)
    assert (np.asarray(sol.events.kind[:hits]) == vx.IMPACT).all()
    assert {*np.asarray(sol.events.stop[:hits]).tolist()} == {0, 1}
    product, before = np.eye(4), 0.0
    for k in range(hits):
        t, stop = float(sol.events.t[k]), int(sol.events.stop[k])
        x, v = sol.evaluate(t)
        v = v.at[system.stops[stop].mass].set(sol.events.velocity_minus[k])
        flight = flight_matrix(system, t - before)
        product, before = vx.saltation_matrix(system, t, x, v, stop) @ flight @ product, t
    product = flight_matrix(system, end - before) @ product
    ours = vx.monodromy_matrix(system, [0.0, 0.0], [0.0, 0.0], periods)
    np.testing.assert_array_less(relative_errors(np.asarray(ours), product), ROUNDING)
    losses = 0.7 ** (2 * hits) * np.exp(-np.trace(system.damping) * end)
    np.testing.assert_allclose(np.linalg.det(ours), losses, rtol=1e-9)


class SeenInFlight(NamedTuple):
    """A closed-form orbit at half the time between its impacts."""

    system: vx.ImpactSystem
    x: jax.Array
    v: jax.Array
    monodromy: np.ndarray


def seen_in_flight(name: str) -> SeenInFlight:
    """Start half way to the first impact: the phase of the load is shifted, the matrix is of one cycle from there."""
    orbit = periodic_orbit(name)
    system = orbit.problem.system
    half = orbit.period / 2
    (x0,), (v0,) = orbit.problem.start.x, orbit.problem.start.v
    sol = vx.simulate(system, 0.0, float(half), [float(x0)], [float(v0)])
    assert int(sol.num_events) == 0
    shifted = system.forcing.phase + system.forcing.frequency * float(half)
    shifted_system = eqx.tree_at(lambda s: s.forcing.phase, system, shifted)
    forth = mpmath.expm(first_order_matrix(system)[:2, :2] * half)
    back = mpmath.inverse(forth)
    # The entry's own cycle starts just before the impact.
    matrix = np.array((back * orbit.monodromy * forth).tolist(), float)
    return SeenInFlight(shifted_system, sol.x1, sol.v1, matrix)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ORBITS)
def test_the_monodromy_matrix_of_a_known_orbit_is_the_exact_one(name):
    orbit, seen = ORBITS[name], seen_in_flight(name)
    x, v = vx.stroboscopic_map(seen.system, seen.x, seen.v, orbit.periods)
    ours = np.asarray(vx.monodromy_matrix(seen.system, seen.x, seen.v, orbit.periods))
    size = np.abs(seen.monodromy).max()
    np.testing.assert_allclose([*x, *v], [*seen.x, *seen.v], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(ours, seen.monodromy, rtol=0, atol=ROUNDING * size**2)
    span = float(periodic_orbit(name).period)
    expected = orbit.restitution**2 * np.exp(-orbit.damping * span)
    np.testing.assert_allclose(np.linalg.det(ours), expected, rtol=0, atol=ROUNDING * size**2)


PUBLISHED = {
    "two_periods_focus": (0.442517 - 0.666468j, 0.442517 + 0.666468j),
    "two_periods_saddle": (0.396194, 1.61537),
    "subharmonic_4": (0.4, 0.4),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", PUBLISHED)
def test_the_multipliers_are_those_published(name):
    seen = seen_in_flight(name)
    ours = vx.monodromy_matrix(seen.system, seen.x, seen.v, ORBITS[name].periods)
    # Rounding splits a double multiplier by its square root.
    multipliers = np.sort_complex(np.linalg.eigvals(np.asarray(ours)))
    np.testing.assert_allclose(multipliers, PUBLISHED[name], rtol=0, atol=5 * SIX_DECIMALS)


def test_the_stroboscopic_map_is_the_motion_over_whole_periods():
    system = vx.models.wagg_bishop_b(1.4)
    x, v = vx.stroboscopic_map(system, [0.1, 0.0], [0.0, -0.2], 3)
    sol = vx.simulate(system, 0.0, 3 * system.forcing.period, [0.1, 0.0], [0.0, -0.2])
    assert int(sol.num_events) > 2
    np.testing.assert_array_equal(x, sol.x1)
    np.testing.assert_array_equal(v, sol.v1)


# Any phase, and motions that do not reach the end

W, C, A, STOP = 0.8, 0.1, 0.5, vx.Stop(0, 0.3, "upper", 0.7)
MACHINE = vx.chain([1.0], [C], [1.0], vx.Harmonic([A], W), [STOP])


def field(angle: float, y: np.ndarray) -> np.ndarray:
    """Time derivative of the state of that machine at a phase of its load."""
    return np.array([y[1], A * np.cos(angle) - C * y[1] - y[0]])


@pytest.mark.slow
def test_by_the_phase_the_map_changes_by_its_vector_field_at_both_ends():
    start, angle = jnp.array([2.0, 0.1, -0.3]), 2.0

    def mapped(a: jax.Array) -> jax.Array:
        return jnp.concatenate(vx.stroboscopic_map(MACHINE, a[1:2], a[2:], 2, phase=a[0]))

    span = 2 * MACHINE.forcing.period
    sol = vx.simulate(MACHINE, angle / W, angle / W + span, start[1:2], start[2:])
    assert int(sol.num_events) > 1
    end, slopes = np.asarray(mapped(start)), np.asarray(jax.jacfwd(mapped)(start))
    np.testing.assert_allclose(end, np.concatenate([sol.x1, sol.v1]), rtol=0, atol=ROUNDING)
    expected = (field(angle, end) - slopes[:, 1:] @ field(angle, start[1:])) / W
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(slopes[:, 0], expected, rtol=0, atol=ROUNDING)
    matrix = vx.monodromy_matrix(MACHINE, start[1:2], start[2:], 2, phase=angle)
    np.testing.assert_allclose(matrix, slopes[:, 1:], rtol=0, atol=ROUNDING)


@pytest.mark.thorough
def test_the_multipliers_of_an_orbit_are_the_same_at_every_phase():
    orbit = exact_orbit(0.1, 1.0, 1.0, 1.0, 1.0, 0.8, 2 * np.pi, 1)
    assert orbit.speed == pytest.approx(1.6957329375949, rel=1e-13)
    system = vx.chain([1.0], [0.1], [1.0], vx.Harmonic([1.0], 1.0), [vx.Stop(0, 1.0, "upper", 0.8)])
    expected = np.sort_complex(np.linalg.eigvals(orbit.step))
    for share in (0.1, 0.4, 0.9):
        angle, (x, v) = orbit.start(share * 2 * np.pi)
        there = vx.stroboscopic_map(system, [x], [v], phase=angle)
        np.testing.assert_allclose(np.ravel(there), [x, v], rtol=0, atol=ROUNDING)
        matrix = np.asarray(vx.monodromy_matrix(system, [x], [v], phase=angle))
        np.testing.assert_allclose(
            np.sort_complex(np.linalg.eigvals(matrix)), expected, rtol=0, atol=ROUNDING
        )


FLOW = vx.TaylorFlow()  # fastest to compile


@pytest.mark.slow
def test_without_throw_a_motion_that_does_not_get_there_is_nan():
    start = [0.0], [0.0]
    for make in (vx.stroboscopic_map, vx.monodromy_matrix):
        found = jax.tree.leaves(make(MACHINE, *start, 5, flow=FLOW, max_steps=20, throw=False))
        assert all(np.isnan(a).all() for a in found)
        with pytest.raises(vx.SimulationError, match="max_steps_reached: "):
            make(MACHINE, *start, 5, flow=FLOW, max_steps=20)


# One lane takes more steps than allowed, one starts beyond the stop, one at NaN.
STARTS, BOUNDS = jnp.array([0.0, 0.1, 0.5, 0.2, jnp.nan]), jnp.array([1000, 20, 1000, 1000, 1000])
IS_KNOWN = jnp.array([True, False, False, True, False])
SOUND = jnp.where(IS_KNOWN, STARTS, 0.1), jnp.where(IS_KNOWN, BOUNDS, 1000)


def ends(x0, bound, amplitude):
    system = eqx.tree_at(lambda s: s.forcing.amplitude, MACHINE, amplitude[None])
    state = vx.stroboscopic_map(system, x0[None], [0.0], 3, flow=FLOW, max_steps=bound, throw=False)
    return jnp.concatenate(state)


def total(amplitude, starts, bounds):
    """Sum over the lanes that reach the end."""
    found = jax.vmap(ends, (0, 0, None))(starts, bounds, amplitude)
    return jnp.where(IS_KNOWN[:, None], found, 0).sum(), found


@pytest.mark.slow
def test_it_is_so_in_its_lane_alone():
    slopes = jax.jit(lambda *a: (total(*a)[1], jax.jacfwd(lambda p: total(p, *a[1:]))(a[0])))
    found, (of_total, of_lanes) = slopes(jnp.asarray(A), STARTS, BOUNDS)
    expected, (of_sound_total, of_sound_lanes) = slopes(jnp.asarray(A), *SOUND)
    for ours, theirs in ((found, expected), (of_lanes, of_sound_lanes)):
        assert (np.isnan(ours) == ~IS_KNOWN[:, None]).all()
        np.testing.assert_allclose(ours[IS_KNOWN], theirs[IS_KNOWN], rtol=ROUNDING)
    np.testing.assert_allclose(of_total, of_sound_total, rtol=ROUNDING)


@pytest.mark.slow
def test_backwards_it_spoils_no_derivative_of_the_others():
    slopes = jax.jit(jax.grad(lambda *a: total(*a)[0], (0, 1)))
    by_amplitude, by_start = slopes(A, STARTS, BOUNDS)
    expected = slopes(A, *SOUND)
    assert (by_start == 0).tolist() == (~IS_KNOWN).tolist()
    np.testing.assert_allclose(by_amplitude, expected[0], rtol=ROUNDING)
    np.testing.assert_allclose(by_start[IS_KNOWN], expected[1][IS_KNOWN], rtol=ROUNDING)
    of_lanes = jax.vmap(jax.grad(lambda *a: ends(*a).sum(), (0, 2)), (0, 0, None))(STARTS, BOUNDS, A)
    assert all((np.isnan(slope) == ~IS_KNOWN).all() for slope in of_lanes)


@pytest.mark.parametrize("phase", [np.nan, np.array([0.0, 1.0])])
def test_a_phase_is_a_number(phase):
    for make in (vx.stroboscopic_map, vx.monodromy_matrix, vx.periodic_orbit):
        with pytest.raises(ValueError, match="Argument `phase` must be "):
            make(MACHINE, [0.0], [0.0], phase=phase)


# Saltation matrices


def test_at_grazing_the_saltation_matrix_is_its_limit():
    """Row by row: the first mass rebounds at once, the force of its damper on the second changes by (1 + r) c / m."""
    system = vx.models.wagg_bishop_a(0.8)
    grazing, light = (
        np.asarray(vx.saltation_matrix(system, 1.0, [0.3, 0.1], [v, 0.2], 0)) for v in (0.0, 1e-7)
    )
    r, c, acceleration = 0.7, 0.1, 0.3 * np.cos(0.8) - 0.6 + 0.1 + 0.1 * 0.2
    expected = np.diag([-r, 1.0, -r, 1.0])
    expected[2:, 0] = -np.inf, -(1 + r) * c
    np.testing.assert_allclose(grazing, expected, rtol=1e-14)
    assert light[2, 0] == pytest.approx((1 + r) * acceleration / 1e-7, rel=1e-6)
    is_finite = np.isfinite(expected)
    np.testing.assert_allclose(light[is_finite], expected[is_finite], rtol=0, atol=1e-6)


NO_IMPACT = {
    "another stop": ({"stop": 2}, "Argument `stop` must be less than the number of stops, 2"),
    "a stop from behind": ({"stop": -1}, "Argument `stop` must be a whole number, 0 or more"),
    "no number": ({"t": np.nan}, "Argument `t` must be finite"),
}


@pytest.mark.parametrize("name", NO_IMPACT)
def test_what_is_no_impact_has_no_saltation_matrix(name):
    wrong, sentence = NO_IMPACT[name]
    impact = {"t": 1.0, "x": [0.3, 0.1], "v": [0.5, 0.0], "stop": 0} | wrong
    with pytest.raises(ValueError, match=sentence):
        vx.saltation_matrix(vx.models.wagg_bishop_a(0.8), **impact)


def test_in_a_batch_it_is_nan_without_throw():
    system, stops = vx.models.wagg_bishop_a(0.8), jnp.array([0, 0, -1, 1])

    def matrix(velocity, stop, throw):
        v = jnp.stack([velocity, 0.2 + 0 * velocity])
        return vx.saltation_matrix(system, 1.0, [0.3, 0.1], v, stop, throw=throw)

    velocities = jnp.array([0.5, jnp.nan, 0.5, 0.5])
    found = jax.vmap(matrix, (0, 0, None))(velocities, stops, False)
    assert np.isnan(found).any(axis=(1, 2)).tolist() == [False, True, True, False]
    assert np.isnan(found[1:3]).all()
    np.testing.assert_allclose(found[0], matrix(velocities[0], 0, True), rtol=1e-14)
    with pytest.raises(vx.SimulationError, match="`v` must be finite"):
        jax.vmap(matrix, (0, 0, None))(velocities, 0 * stops, True)
    with pytest.raises(vx.SimulationError, match="`stop` must be less than the number of stops, 2"):
        jax.vmap(matrix, (0, 0, None))(velocities[3:], stops[2:3], True)
