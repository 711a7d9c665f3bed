"""Crossings of a position by a mass: closed forms, the trajectory itself, derivatives, multipliers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

import vijax as vx


def test_a_ball_in_flight_passes_a_height_when_it_should():
    """x = v s - g s^2 / 2 over a table at 0: up at the smaller root, down at the larger, again after a bounce."""
    gravity, speed, height = 10.0, 6.0, 1.0
    ball = vx.models.bouncing_ball(0.9, gravity=gravity)
    root = np.sqrt(speed**2 - 2 * gravity * height)
    up = vx.next_crossing(ball, 0.0, [0.0], [speed], 0, height, t1=9.0)
    assert float(up[0]) == pytest.approx((speed - root) / gravity, rel=1e-14)
    assert float(up[1][0]) == height
    assert float(up[2][0]) == pytest.approx(root, rel=1e-14)
    down = vx.next_crossing(ball, *up, 0, height, "down", t1=9.0)
    assert float(down[0]) == pytest.approx((speed + root) / gravity, rel=1e-14)
    again = vx.next_crossing(ball, *up, 0, height, t1=9.0)
    later = np.sqrt((0.9 * speed) ** 2 - 2 * gravity * height)
    expected = 2 * speed / gravity + (0.9 * speed - later) / gravity
    assert float(again[0]) == pytest.approx(expected, rel=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("direction", ["up", "down"])
def test_all_passages_of_a_trajectory_are_found(direction):
    system, place = vx.models.wagg_bishop_b(1.7), 0.02
    sol = vx.simulate(system, 0.0, 40.0, v0=[0.0, 0.05], max_events=512)
    t = np.linspace(0.0, 40.0, 40_001)
    x = np.asarray(sol.evaluate(t)[0])[:, 1] - place
    passes = (x[:-1] < 0) & (x[1:] >= 0) if direction == "up" else (x[:-1] >= 0) & (x[1:] < 0)
    before = t[:-1][passes]
    at, found = (0.0, jnp.zeros(2), jnp.array([0.0, 0.05])), []
    for _ in before:
        at = vx.next_crossing(system, *at, 1, place, direction)
        found.append(float(at[0]))
        np.testing.assert_allclose(sol.evaluate(at[0])[1], at[2], atol=1e-11)
    assert (abs(np.array(found) - before - 5e-4) <= 5.1e-4).all()


@pytest.mark.slow
def test_its_derivatives_are_differences_and_hold_the_multipliers():
    system = vx.models.wagg_bishop_a(0.8)
    end = vx.simulate(system, 0.0, 100 * float(system.forcing.period), max_events=1024)
    orbit = vx.periodic_orbit(system, end.x1, end.v1)

    def of(y):
        t, x, v = vx.next_crossing(system, y[0], y[1:3], y[3:], 1, 0.05)
        return jnp.concatenate([t[None], x, v])

    first = of(jnp.concatenate([jnp.zeros(1), orbit.x0, orbit.v0]))
    jacobian = jax.jacfwd(of)(first)
    again = of(first)
    assert float(again[0] - first[0]) == pytest.approx(float(orbit.period), rel=1e-12)
    np.testing.assert_allclose(again[1:], first[1:], atol=1e-11)
    assert (jacobian[2] == 0).all()  # the position of the mass is fixed by the section
    eigenvalues = np.sort_complex(np.linalg.eigvals(np.asarray(jacobian)))
    expected = np.sort_complex(np.append(np.asarray(orbit.multipliers), 0))
    np.testing.assert_allclose(eigenvalues, expected, atol=1e-9)
    np.testing.assert_allclose(jax.jacrev(of)(first), jacobian, atol=1e-12)


@pytest.mark.slow
def test_contacts_and_stops_that_move_are_gone_through_too():
    for system, mass in ((vx.models.impact_damper(0.7), 1), (vx.models.ball_on_table(60.0, 0.004), 0)):
        period = float(system.forcing.period)
        n = system.num_masses
        x0 = jnp.zeros(n) if n > 1 else jnp.array([0.01])
        sol = vx.simulate(system, 0.0, 5 * period, x0, max_events=2048)
        t = np.linspace(0.0, 5 * period, 20_001)
        x = np.asarray(sol.evaluate(t)[0])[:, mass]
        place = float(np.median(x))
        first = t[1:][(x[:-1] > place) & (x[1:] <= place)][0]
        found = vx.next_crossing(system, 0.0, x0, jnp.zeros(n), mass, place, "down")
        assert abs(float(found[0]) - first) <= 2 * t[1]
        np.testing.assert_allclose(sol.evaluate(found[0])[1], found[2], atol=1e-9)


@pytest.mark.slow
def test_in_a_batch_what_is_not_passed_is_nan():
    system = vx.models.wagg_bishop_a(0.8)

    def of(place):
        return vx.next_crossing(system, 0.0, [0.0, 0.0], [0.0, 0.0], 1, place, t1=60.0, throw=False)

    t, x, v = jax.vmap(of)(jnp.array([0.05, -9.0, -0.05]))
    assert np.isfinite(t).tolist() == [True, False, True]
    assert np.isfinite(x).all(axis=1).tolist() == np.isfinite(v).all(axis=1).tolist() == [True, False, True]
    assert float(t[0]) == float(vx.next_crossing(system, 0.0, [0.0, 0.0], [0.0, 0.0], 1, 0.05)[0])


def test_bad_input_is_refused_in_a_sentence():
    system = vx.models.wagg_bishop_a(0.8)
    start = 0.0, [0.0, 0.0], [0.0, 0.0]
    with pytest.raises(ValueError, match="`mass` must lie in 0 to 1, but is 2"):
        vx.next_crossing(system, *start, 2, 0.0)
    with pytest.raises(ValueError, match='`direction` must be "up" or "down"'):
        vx.next_crossing(system, *start, 1, 0.0, "left")
    with pytest.raises(vx.SimulationError, match="does not pass the place"):
        vx.next_crossing(system, *start, 1, 9.0, t1=20.0)


def by_force_and_speed(y):
    """Time at which a mass that friction slows passes 1."""
    sliding = vx.ImpactSystem(
        [1.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 1.0), friction=[vx.Friction(0, y[0])]
    )
    return vx.next_crossing(sliding, 0.0, [0.0], y[1:], 0, 1.0, t1=9.0)[0]


@pytest.mark.slow
def test_friction_slows_a_mass_on_its_way_to_a_place():
    """x = v t - f t^2 / 2, from 0."""
    f, v = 0.3, 1.2
    root = np.sqrt(v**2 - 2 * f)
    t = (v - root) / f
    at = jnp.array([f, v])
    assert float(by_force_and_speed(at)) == pytest.approx(t, rel=1e-14)
    expected = [t**2 / 2 / root, -t / root]
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derivative(by_force_and_speed)(at), expected, rtol=1e-13)


@pytest.mark.thorough
def test_friction_may_hold_a_mass_before_a_place():
    with pytest.raises(RuntimeError, match="does not pass the place"):
        by_force_and_speed(jnp.array([0.8, 1.2]))


@pytest.mark.thorough
def test_a_place_within_a_compliant_stop_is_passed_both_ways():
    """Behind the stop at .2 the mass is on a spring: x = .2 + v / w sin w s, with the time s since the contact."""
    stiffness, speed, place = 9.0, 1.5, 0.5
    w = np.sqrt(stiffness)
    stop = vx.CompliantStop(0, 0.2, "upper", stiffness, 0.0)
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 1.0), [stop])
    up = vx.next_crossing(system, 0.0, [0.0], [speed], 0, place, t1=9.0)
    down = vx.next_crossing(system, *up, 0, place, "down", t1=9.0)
    first, since = 0.2 / speed, np.arcsin((place - 0.2) * w / speed) / w
    assert float(up[0]) == pytest.approx(first + since, rel=1e-14)
    assert float(down[0]) == pytest.approx(first + np.pi / w - since, rel=1e-14)
    assert float(down[2][0]) == pytest.approx(-float(up[2][0]), rel=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mass", "place", "direction"), [(0, 0.1, "up"), (1, 0.35, "down"), (0, -0.4, "down")]
)
def test_passages_of_a_machine_of_all_kinds_are_those_of_its_motion(mass, place, direction):
    limits = [vx.Stop(0, 0.3, "upper", 0.7), vx.CompliantStop(1, 0.3, "upper", 20.0, 0.1)]
    chain = vx.chain([1.0, 1.2], [0.05] * 2, [1.0] * 2, vx.Harmonic([1.0, 0.0], 0.9), limits)
    matrices = chain.mass, chain.damping, chain.stiffness, chain.forcing
    system = vx.ImpactSystem(*matrices, chain.stops, friction=[vx.Friction(0, 0.1)])
    start, t = ([0.1, 0.0], [0.3, 0.2]), np.linspace(0.0, 60.0, 20_001)
    sol = vx.simulate(system, 0.0, 60.0, *start)
    beyond = np.asarray(sol.evaluate(t)[0])[:, mass] - place
    is_passed = (
        (beyond[:-1] < 0) & (beyond[1:] >= 0) if direction == "up" else (beyond[:-1] > 0) & (beyond[1:] <= 0)
    )
    first = np.flatnonzero(is_passed)[0]
    expected = scipy.optimize.brentq(
        lambda s: float(sol.evaluate(s)[0][mass] - place), *t[first : first + 2], xtol=1e-15
    )
    found = vx.next_crossing(system, 0.0, *start, mass, place, direction, t1=60.0)
    assert float(found[0]) == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(found[2], sol.evaluate(expected)[1], atol=1e-11)
