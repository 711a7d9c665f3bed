"""Crossings of a position by a mass: closed forms, the trajectory itself, derivatives, multipliers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

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
