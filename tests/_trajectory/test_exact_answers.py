"""Machines with motions in closed form, and numbers published by others."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from helpers import log_of
from periodic_orbits import ORBITS, periodic_orbit
from problems import (
    Problem,
    elastic_bounces,
    flown_by_matrix_exponentials,
    free_responses,
    siconos_chatter,
    sticking_orbit,
    three_masses,
)

import vijax as vx

# Entries against matrix exponentials: 40 digits, minus those that 600 time units of damping cost.
ENTRY = 1e-30
# The phase of a load is rounded to a double, so the orbit closes only to rounding.
ENTRY_ROUNDED = 1e-15
# The engine against entries: rounding of 1e-16 at each of some hundred steps, of the largest value.
EXACT = 2e-14
# Error of long motions: one rounding per step and unit of phase, always of the same sign.
EPSILON = float(np.finfo(float).eps)
# A mass without a spring keeps a rounding of its velocity: additional error per unit of time.
RIGID = EXACT
# The bounces under 1e-6 that end a chatter are summed for a constant acceleration: error of second order in 1e-6.
CHATTER_END = 1e-12
# Error of a heavily damped mass over 56 000 steps.
MANY_STEPS = 1e-12
# Siconos drifts by a few roundings each bounce, up to 4e-12 at the 51st: the exact values given with it are used.
SICONOS = 1e-13
# Digits as printed.
PRINTED_10 = 1e-10
PRINTED_12 = 2e-12

_FREE = [*free_responses(), three_masses()]
_BOUNCING = [siconos_chatter().problem, sticking_orbit().problem, elastic_bounces()]


def _named(problems: list[Problem]) -> list:
    return [pytest.param(problem, id=problem.name) for problem in problems]


def _simulate(problem: Problem, t1: float, ts: list[float] | None = None) -> vx.Solution:
    t0, x0, v0 = problem.start
    return vx.simulate(
        problem.system,
        float(t0),
        t1,
        np.array([float(x) for x in x0]),
        np.array([float(v) for v in v0]),
        ts=None if ts is None else np.array(ts),
    )


# The entries themselves


@pytest.mark.parametrize("problem", _named(_FREE + _BOUNCING))
def test_entries_agree_with_matrix_exponentials(problem):
    assert flown_by_matrix_exponentials(problem) < ENTRY


@pytest.mark.parametrize("name", ORBITS)
def test_orbits_agree_with_matrix_exponentials(name):
    assert flown_by_matrix_exponentials(periodic_orbit(name).problem) < ENTRY_ROUNDED


def test_orbits_have_the_published_speeds_and_stops():
    for name, published in ORBITS.items():
        orbit = periodic_orbit(name)
        stop = float(orbit.problem.system.stops[0].position)
        assert stop == pytest.approx(published.position, abs=PRINTED_12), name
        if published.speed is not None:
            assert float(orbit.speed) == pytest.approx(published.speed, abs=PRINTED_10), name


def test_multipliers_are_one_at_folds_and_minus_one_at_period_doublings():
    for name in ORBITS:
        m = periodic_orbit(name).monodromy
        trace, determinant = m[0, 0] + m[1, 1], mpmath.det(m)
        if name.startswith("fold"):
            assert abs(1 - trace + determinant) < PRINTED_12, name
        if name.startswith("period_doubling"):
            assert abs(1 + trace + determinant) < 100 * PRINTED_12, name


@pytest.mark.parametrize(
    ("name", "multipliers"),
    [
        ("two_periods_focus", (0.442517 - 0.666468j, 0.442517 + 0.666468j)),
        ("two_periods_saddle", (0.396194, 1.61537)),
        ("subharmonic_4", (0.4, 0.4)),
    ],
)
def test_orbits_have_the_published_multipliers(name, multipliers):
    m = periodic_orbit(name).monodromy
    assert float(m[0, 0] + m[1, 1]) == pytest.approx(sum(multipliers).real, abs=1e-5)
    assert float(mpmath.det(m)) == pytest.approx((multipliers[0] * multipliers[1]).real, abs=1e-5)


@pytest.mark.parametrize(
    ("bounce", "time", "speed_after"),
    [
        (1, 4.966983943888618e-03, 284.6329077952886),
        (2, 1.490088290077536e-02, 256.1696170157613),
        (3, 2.483470526778414e-02, 230.5526553141809),
        (11, 0.1043012781143508, 99.24535829118193),
        (51, 0.5004989195222563, 1.466934023382779),
        (101, 0.854976287920075, 7.560248200484509e-03),
    ],
)
def test_the_chatter_of_siconos_is_as_published(bounce, time, speed_after):
    impact = siconos_chatter().problem.impacts[bounce - 1]
    assert float(impact.t) == pytest.approx(time, rel=SICONOS)
    assert float(-0.9 * impact.velocity) == pytest.approx(speed_after, rel=SICONOS)
    assert float(siconos_chatter().end) == pytest.approx(0.87027960771579745676, rel=SICONOS)


def test_the_sticking_orbit_is_as_published():
    orbit = sticking_orbit()
    second, third = orbit.problem.impacts[1:3]
    assert float(second.t) == pytest.approx(11 * np.pi / 3, rel=1e-15)
    assert float(second.velocity) == pytest.approx(1, rel=1e-15)
    assert float(third.t) == pytest.approx(12.50435709259846, rel=1e-15)
    assert float(third.velocity) == pytest.approx(0.5223735943245902, rel=1e-15)
    assert float(orbit.end) == pytest.approx(13.56250555231557, rel=1e-15)


# The engine


@pytest.mark.parametrize("problem", _named(_FREE))
def test_free_motion_is_exact_in_every_regime_of_damping_and_load(problem):
    times = [float(state.t) for state in problem.states]
    solution = _simulate(problem, times[-1], times)
    scale = max(1.0, *(abs(float(a)) for state in problem.states for a in (*state.x, *state.v)))
    tolerance = MANY_STEPS if problem.name == "heavily_damped" else (EXACT + EPSILON * times[-1]) * scale
    if not np.asarray(problem.system.stiffness).any():
        tolerance += RIGID * scale * times[-1]
    x = np.array([[float(a) for a in state.x] for state in problem.states])
    v = np.array([[float(a) for a in state.v] for state in problem.states])
    np.testing.assert_allclose(solution.xs, x, rtol=0, atol=tolerance)
    np.testing.assert_allclose(solution.vs, v, rtol=0, atol=tolerance)
    assert int(solution.num_events) == 0


def test_a_heavily_damped_mass_creeps_home_without_overflow():
    problem = next(p for p in free_responses() if p.name == "heavily_damped")
    times = [float(state.t) for state in problem.states]
    last = float(problem.states[-1].x[0])
    assert last == pytest.approx(0.013764, rel=1e-3)
    assert float(_simulate(problem, times[-1], times).x1[0]) == pytest.approx(last, rel=MANY_STEPS)


def test_elastic_bounces_come_at_equal_times_with_equal_speeds():
    problem = elastic_bounces()
    solution = _simulate(problem, float(problem.states[0].t))
    _assert_impacts(solution, problem)
    assert int(solution.num_events) == len(problem.impacts)
    assert float(solution.x1[0]) == pytest.approx(-1, abs=EXACT)
    assert float(solution.v1[0]) == pytest.approx(0, abs=EXACT * len(problem.impacts))


def test_elastic_stops_keep_the_energy_of_an_undamped_machine():
    stops = [vx.Stop(0, 0.25, "upper", 1.0), vx.Stop(1, -0.5, "lower", 1.0)]
    load = vx.Harmonic([0.0, 0.0], 0.0)
    system = vx.chain([1.0, 2.0], [0.0, 0.0], [1.0, 3.0], load, stops)
    ts = np.linspace(0.0, 300.0, 301)
    solution = vx.simulate(system, 0.0, 300.0, np.array([-1.0, 1.0]), np.array([0.5, 0.0]), ts=ts)
    mass, stiffness = np.asarray(system.mass), np.asarray(system.stiffness)
    x, v = np.asarray(solution.xs), np.asarray(solution.vs)
    energy = (mass * v**2).sum(axis=1) / 2 + np.einsum("ti,ij,tj->t", x, stiffness, x) / 2
    np.testing.assert_allclose(energy, energy[0], rtol=EPSILON * int(solution.num_steps))
    assert int(solution.num_steps) < 5000
    assert int(solution.num_events) > 100
    assert np.ptp(v[:, 0]) > 1


def test_a_weight_on_a_floor_chatters_to_rest_as_siconos_computes_it():
    problem, end = siconos_chatter()
    solution = _simulate(problem, 1.0)
    _assert_impacts(solution, problem)
    *impacts, stick = log_of(solution)
    assert {event.kind for event in impacts} == {"impact"}
    assert stick.kind == "stick"
    assert stick.t == pytest.approx(float(end), rel=EXACT)
    assert bool(solution.stuck1[0])
    assert (float(solution.x1[0]), float(solution.v1[0])) == (0.0, 0.0)


def test_a_weight_at_rest_on_a_floor_presses_with_its_weight():
    force = _simulate(siconos_chatter().problem, 1.0).contact_force(np.array([0.5, 0.9, 1.0]))
    np.testing.assert_allclose(force[:, 0], [0.0, 9.81e-3, 9.81e-3], rtol=1e-15)


def test_the_sticking_orbit_releases_bounces_chatters_and_holds_on_time():
    orbit = sticking_orbit()
    turns = 2
    t1 = float(orbit.release + turns * orbit.period)
    # The mass sticks from 0 on, where the contact force is 1; the last release falls on the end itself.
    events = log_of(vx.simulate(orbit.problem.system, 0.0, t1 + 0.1, np.zeros(1), np.zeros(1)))
    releases = [event.t for event in events if event.kind == "release"]
    sticks = [event.t for event in events if event.kind == "stick"]
    period = float(orbit.period)
    np.testing.assert_allclose(releases, np.pi + period * np.arange(turns + 1), rtol=EXACT)
    np.testing.assert_allclose(sticks, float(orbit.end) + period * np.arange(turns), rtol=CHATTER_END)
    for turn in range(turns):
        low, high = releases[turn : turn + 2]
        impacts = [event for event in events if event.kind == "impact" and low < event.t < high]
        assert len(impacts) > 15
        exact = orbit.problem.impacts[: len(impacts)]
        times = [float(impact.t) + turn * period for impact in exact]
        np.testing.assert_allclose([event.t for event in impacts], times, rtol=EXACT)
        speeds = [float(impact.velocity) for impact in exact]
        np.testing.assert_allclose([event.velocity for event in impacts], speeds, rtol=0, atol=EXACT)


@pytest.mark.parametrize("name", ORBITS)
def test_a_start_on_a_closed_form_orbit_repeats_it(name):
    problem, span, speed, _ = periodic_orbit(name)
    turns = len(problem.impacts)
    solution = _simulate(problem, float((turns + 0.5) * span))
    _assert_impacts(solution, problem)
    assert int(solution.num_events) == turns
    middles = (np.arange(turns + 1) + 0.5) * float(span)
    x, v = solution.evaluate(np.minimum(middles, solution.t1))
    np.testing.assert_allclose(x[:, 0], x[0, 0], rtol=0, atol=EXACT * float(speed + 1))
    np.testing.assert_allclose(v[:, 0], v[0, 0], rtol=0, atol=EXACT * float(speed + 1))


def _assert_impacts(solution: vx.Solution, problem: Problem) -> None:
    """Check that the first impacts of a solution are those of the entry."""
    found = [event for event in log_of(solution) if event.kind == "impact"][: len(problem.impacts)]
    assert [event.stop for event in found] == [impact.stop for impact in problem.impacts]
    times = [float(impact.t) for impact in problem.impacts]
    velocities = np.array([float(impact.velocity) for impact in problem.impacts])
    np.testing.assert_allclose([event.t for event in found], times, rtol=EXACT)
    atol = EXACT * max(1.0, np.abs(velocities).max())
    np.testing.assert_allclose([event.velocity for event in found], velocities, rtol=0, atol=atol)


@pytest.mark.slow
def test_a_span_that_ends_in_the_instant_of_a_release_comes_to_its_end():
    system, span = sticking_orbit().problem.system, 5 * 4 * np.pi
    starts = np.pi + np.arange(-200, 201) * np.spacing(np.pi) / 2
    run = lambda t0: vx.simulate(system, t0, t0 + span, throw=False, max_steps=5000, max_events=0)  # noqa: E731
    sol = jax.vmap(run)(jnp.asarray(starts))
    assert int(sol.num_steps.max()) < 2000
    np.testing.assert_allclose(sol.x1, 0.0, rtol=0, atol=CHATTER_END)
