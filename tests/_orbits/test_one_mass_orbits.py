"""Periodic orbits of one mass: published ones, closed forms, all orbits of a machine, refused arguments."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exact_orbits import Table, exact_orbit
from helpers import CHATTER_END, slow_except
from one_impact import Numbers, clearance, discriminant, speed
from problems import sticking_orbit

import vijax as vx

# Speeds are exact to 13 digits; at a bifurcation the error of an orbit is a square root of a rounding.
SPEED, AT_FOLD = 1e-12, 1e-6
# Closed forms in double precision, at the end of a flight.
CLOSED_FORM = 1e-12
# Event capacity, the same in all files: one program.
ROOM = 32


def one_mass(frequency, amplitude, *, damping, restitution, stop=1.0, stiffness=1.0, phase=0.0):
    load = vx.Harmonic([amplitude], frequency, [phase])
    return vx.ImpactSystem([1.0], [[damping]], [[stiffness]], load, [vx.Stop(0, stop, "upper", restitution)])


def orbits_of(system, num_periods, *, seed=0, size=2.0, starts=60):
    rng, stop = np.random.default_rng(seed), float(system.stops[0].position)
    x = stop - size * rng.uniform(0, 1, (starts, 1))
    guesses = x, rng.normal(0, size, (starts, 1))
    return vx.find_periodic_orbits(system, guesses, num_periods, max_events=ROOM, progress=False)


def speeds(orbits, impacts=1):
    return sorted(float(o.events.velocity_minus[0]) for o in orbits if int(o.num_impacts[0]) == impacts)


# R. Ghosh & D. Simpson, arXiv 2510.16218: one impact in two periods. The other root is a different orbit.
@pytest.mark.slow
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


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("amplitude", "speed"),
    [(1.0, 1.6957329375949), (0.2, 0.29861285205633)],
)
def test_orbits_of_the_demonstration_of_coco(amplitude, speed):
    found = speeds(orbits_of(one_mass(1.0, amplitude, damping=0.1, restitution=0.8), 1))
    assert min(abs(np.array(found) - speed)) < SPEED


@cache
def undamped(stop):
    return orbits_of(one_mass(3.7, 1.0, damping=0.0, restitution=0.8, stop=stop), 2)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("stop", "expected"),
    [
        (0.0, [0.6656933528]),
        (0.2, [1.1023656826, 2.1874438808]),
        # At its period doubling the orbit passes through the stop between its impacts.
        (-0.061318624277, []),
        (-0.06, []),
        (0.4, []),
    ],
)
def test_all_orbits_of_an_undamped_mass_are_found(stop, expected):
    np.testing.assert_allclose(speeds(undamped(stop)), expected, rtol=0, atol=1e-9)


def drawn(n, num):
    """Random machines with orbits of one impact in n periods, and their impact speeds, none near a grazing."""
    rng = np.random.default_rng(n)
    while num:
        r, position = rng.choice([0.1, 0.4, 0.8, 0.95, 1.0]), rng.uniform(-1.5, 1.5)
        numbers, w = Numbers(position, r, rng.choice([0.01, 0.05])), rng.uniform(0.3, 2 * n + 1.5)
        if discriminant(w, numbers, n) < 1e-3:
            continue
        found = [float(speed(w, numbers, n, sign)) for sign in (-1, 1)]
        free = [clearance(w, numbers, n, v) if v > 0 else -1.0 for v in found]
        exact = [v for v, gap in zip(found, free, strict=True) if gap > 0]
        if exact and min(map(abs, free)) > 1e-3:
            num -= 1
            yield numbers, w, exact


@pytest.mark.thorough
@pytest.mark.parametrize("n", slow_except([1], [1, 2, 3, 4]))
def test_all_orbits_of_one_impact_are_found_and_no_others(n):
    for numbers, w, exact in drawn(n, 4):
        found = orbits_of(numbers.machine(w), n, starts=200)
        np.testing.assert_allclose(speeds(found), sorted(exact), rtol=1e-10)


@pytest.mark.thorough
def test_of_two_orbits_one_is_a_saddle():
    stable = {
        round(float(o.events.velocity_minus[0]), 6): bool(o.is_stable)
        for o in undamped(0.2)
        if o.num_impacts[0] == 1
    }
    assert stable == {1.102366: False, 2.187444: True}


# From Budd and Dux (1994), except the first and the last, a damped one in three periods.
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("n", "w", "stop", "r", "damping", "stiffness"),
    [
        (1, 2.4, 0.05, 0.6, 0.1, 1.3),
        (1, 2.8, -0.05, 0.8, 0.0, 1.0),
        (2, 3.7, 0.0, 0.8, 0.0, 1.0),
        (2, 4.0, 0.001, 0.4, 0.0, 1.0),
        (3, 5.9, 0.001, 0.4, 0.05, 1.0),
    ],
)
def test_orbits_of_one_impact_in_n_periods_are_those_in_closed_form(n, w, stop, r, damping, stiffness):
    span = n * 2 * np.pi / w
    exact = exact_orbit(damping, stiffness, 1.0, w, stop, r, span, 1)
    phase, (x, v) = exact.start(0.6 * span)
    system = one_mass(
        w, 1.0, damping=damping, restitution=r, stop=stop, stiffness=stiffness, phase=float(phase)
    )
    orbit = vx.periodic_orbit(system, [x - 0.01], [v + 0.02], n, max_events=ROOM)
    assert_is(orbit, x, v, exact.speed, exact.step)
    assert orbit.num_impacts.tolist() == [1]


@pytest.mark.thorough
@pytest.mark.parametrize("w", [0.8, 1.5])
def test_a_symmetric_orbit_between_two_stops_is_that_in_closed_form(w):
    half = np.pi / w
    exact = exact_orbit(0.2, 1.0, 1.0, w, 0.5, 0.7, half, -1)
    phase, (x, v) = exact.start(half / 3)
    system = vx.models.two_sided_oscillator(
        w, phase=float(phase), position=0.5, restitution=0.7, damping_ratio=0.1
    )
    orbit = vx.periodic_orbit(system, [x + 0.01], [v + 0.02])
    assert_is(orbit, x, v, exact.speed, exact.step @ exact.step)
    assert orbit.num_impacts.tolist() == [1, 1]


def assert_is(orbit, x, v, speed, step):
    """Check the start, the impact speed and the multipliers of an orbit of one mass, the eigenvalues of that matrix."""
    np.testing.assert_allclose([orbit.x0[0], orbit.v0[0]], [x, v], rtol=0, atol=CLOSED_FORM)
    hits = abs(orbit.events.velocity_minus[: int(orbit.num_impacts.sum())])
    np.testing.assert_allclose(hits, speed, rtol=CLOSED_FORM)
    # Two equal multipliers are each exact only to the square root of a rounding.
    found = np.sum(orbit.multipliers), np.prod(orbit.multipliers)
    np.testing.assert_allclose(found, [np.trace(step), np.linalg.det(step)], rtol=0, atol=CLOSED_FORM)


@pytest.mark.thorough
def test_the_orbit_that_sticks_is_that_in_closed_form():
    exact = sticking_orbit()
    orbit = vx.periodic_orbit(exact.problem.system, [0.0], [0.0], max_events=ROOM)
    assert int(orbit.result._value) == 0
    np.testing.assert_array_equal(orbit.multipliers, 0)
    period, log = float(exact.period), orbit.events
    times, kinds = np.asarray(log.t), np.asarray(log.kind)
    np.testing.assert_allclose(times[kinds == vx.RELEASE], float(exact.release), rtol=CLOSED_FORM)
    np.testing.assert_allclose(times[kinds == vx.STICK], float(exact.end) - period, rtol=CLOSED_FORM)
    # The last impacts of a chatter are bounces of an earlier period.
    hits = {
        float(hit.t) % period: float(hit.velocity)
        for hit in exact.problem.impacts
        if hit.velocity > CHATTER_END
    }
    is_hit = (kinds == vx.IMPACT) & (np.asarray(log.velocity_minus) > CHATTER_END)
    np.testing.assert_allclose(times[is_hit], sorted(hits), rtol=0, atol=CLOSED_FORM)
    found = np.asarray(log.velocity_minus)[is_hit]
    np.testing.assert_allclose(found, [hits[t] for t in sorted(hits)], rtol=0, atol=CLOSED_FORM)


@pytest.mark.slow
def test_a_ball_on_a_moving_table_repeats_as_known():
    table = Table(1, 0.8, 9.81, 0.6)
    start = table.later(0.3)
    orbit = vx.periodic_orbit(start.system, start.x * 1.01, start.v * 0.99)
    np.testing.assert_allclose(orbit.x0, start.x, rtol=1e-12)
    np.testing.assert_allclose(orbit.v0, start.v, rtol=1e-12)
    assert float(orbit.events.velocity_minus[0]) == pytest.approx(-table.fall, rel=1e-12)
    np.testing.assert_allclose(np.prod(orbit.multipliers).real, 0.8**2, rtol=1e-12)


@pytest.mark.thorough
def test_without_impacts_it_is_the_response_to_the_load():
    system = one_mass(0.5, 0.3, damping=0.1, restitution=0.8)
    orbit = vx.periodic_orbit(system, [0.3], [0.1], max_events=ROOM)
    response = 0.3 / (1 - 0.25 + 0.05j)
    np.testing.assert_allclose([orbit.x0[0], orbit.v0[0]], [response.real, -0.5 * response.imag], rtol=1e-14)
    assert int(orbit.num_impacts[0]) == 0


@pytest.mark.slow
def test_a_compiled_program_warns_of_an_orbit_that_it_does_not_find():
    """An optimiser sees only the loss, which is then NaN or that of no motion."""

    def loss(stop):
        system = one_mass(3.7, 1.0, damping=0.0, restitution=0.8, stop=stop)
        orbit = vx.periodic_orbit(system, [-1.0], [0.5], 2, max_events=ROOM, throw=False)
        return jnp.abs(orbit.events.velocity_minus[0])

    program = jax.jit(jax.value_and_grad(loss))

    def run(stop):
        jax.block_until_ready(program(stop))
        jax.effects_barrier()

    with pytest.warns(UserWarning, match=r"(not_converged|left_the_stops): .* halve its step") as caught:
        run(-0.06)
    assert caught[0].filename == __file__
    with pytest.warns(UserWarning, match="The start lies beyond a stop"):
        run(-1.5)


def test_periods_before_starts_still_work_with_a_warning():
    system = one_mass(0.5, 0.3, damping=0.1, restitution=0.8)
    how = {"max_events": ROOM, "progress": False}
    (found,) = vx.find_periodic_orbits(system, [[0.3, 0.1]], **how)
    with pytest.warns(DeprecationWarning, match="write find_periodic_orbits"):
        (before,) = vx.find_periodic_orbits(system, 1, [[0.3, 0.1]], **how)  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(before.x0, found.x0)


def test_what_is_not_found_is_told():
    system = one_mass(3.7, 1.0, damping=0.0, restitution=0.8, stop=-0.06)
    with pytest.raises(vx.SimulationError, match=r"not_converged|left_the_stops"):
        vx.periodic_orbit(system, [-1.0], [0.5], 2, max_events=ROOM)
    orbit = vx.periodic_orbit(system, [-1.0], [0.5], 2, max_events=ROOM, throw=False)
    assert not orbit.is_admissible
    assert orbit.result != vx.ORBIT_RESULTS.successful
