"""Stroboscopic maps and their monodromy matrices: products of flights and saltations, and orbits in closed form."""

from typing import NamedTuple

import equinox as eqx
import jax
import mpmath
import numpy as np
import pytest
import scipy.linalg
from helpers import relative_errors
from periodic_orbits import ORBITS, periodic_orbit
from problems import first_order_matrix

import vijax as vx

# Roundings of some hundred steps, 1e-15, magnified a hundred times.
ROUNDING = 1e-12
# Printed with six decimals.
SIX_DECIMALS = 1e-6


def flight_matrix(system: vx.ImpactSystem, span: float) -> np.ndarray:
    """The derivative of the state by an earlier one, no impact between."""
    n = system.num_masses
    inverse = 1 / np.asarray(system.mass)[:, None]
    lower = np.hstack([-inverse * system.stiffness, -inverse * system.damping])
    upper = np.hstack([np.zeros((n, n)), np.eye(n)])
    return scipy.linalg.expm(span * np.vstack([upper, lower]))


@pytest.mark.thorough
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
    """A closed-form orbit, looked at half way between its impacts."""

    system: vx.ImpactSystem
    x: jax.Array
    v: jax.Array
    monodromy: np.ndarray


def seen_in_flight(name: str) -> SeenInFlight:
    """Start half way to the first impact: the load is shifted, the matrix is of one cycle from there."""
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


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_multipliers_are_those_published(name):
    seen = seen_in_flight(name)
    ours = vx.monodromy_matrix(seen.system, seen.x, seen.v, ORBITS[name].periods)
    # A double multiplier splits by the root of a rounding.
    multipliers = np.sort_complex(np.linalg.eigvals(np.asarray(ours)))
    np.testing.assert_allclose(multipliers, PUBLISHED[name], rtol=0, atol=5 * SIX_DECIMALS)


def test_the_stroboscopic_map_is_the_motion_over_whole_periods():
    system = vx.models.wagg_bishop_b(1.4)
    x, v = vx.stroboscopic_map(system, [0.1, 0.0], [0.0, -0.2], 3)
    sol = vx.simulate(system, 0.0, 3 * system.forcing.period, [0.1, 0.0], [0.0, -0.2])
    assert int(sol.num_events) > 2
    np.testing.assert_array_equal(x, sol.x1)
    np.testing.assert_array_equal(v, sol.v1)
