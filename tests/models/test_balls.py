"""Balls between walls and columns of beads against closed forms."""

import numpy as np
import pytest
from helpers import log_of
from model_roundings import EXACT, ORBIT

import vijax as vx

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("r", "n", "a"), [(1.0, 1, 0.1), (0.9, 2, 0.02)])
def test_a_ball_between_walls_has_the_exact_orbit_of_one_impact_at_each(r, n, a):
    w, d = 1.5, 1.0
    period, k = 2 * np.pi / w, (1 - r**2) / (2 * np.pi * n * r)
    # Of the two such instants, the one at which the wall accelerates: a ball that comes late is thrown back faster.
    angle = -np.arccos(k * d / (a * np.hypot(1, k))) - np.arctan2(1, k)
    assert a * (k * np.cos(angle) - np.sin(angle)) == pytest.approx(k * d, abs=EXACT)
    flight = d - a * np.cos(angle)
    speed = flight * (1 + 1 / r) / (n * period)
    # At time 0 the ball leaves the moving wall.
    x = [a * np.cos(angle)]
    system = vx.models.ball_between_walls(w, a, phase=angle, position=d, restitution=r)
    turns = 5
    sol = vx.simulate(system, 0.0, (turns + 0.1) * n * period, x, [speed])
    events = log_of(sol)
    assert [(event.kind, event.stop) for event in events] == [("impact", 0), ("impact", 1)] * turns
    starts = n * period * np.arange(turns)
    times = np.stack([starts + flight / speed, starts + n * period], axis=1).ravel()
    np.testing.assert_allclose([event.t for event in events], times, rtol=ORBIT)
    np.testing.assert_allclose([event.velocity for event in events], [speed, -r * speed] * turns, rtol=ORBIT)


# Beads


def reflected(x: np.ndarray, v: np.ndarray, t: float, length: float) -> np.ndarray:
    """Positions of points that fly freely between 0 and a wall and pass through each other."""
    folded = np.mod(x + v * t, 2 * length)
    return np.where(folded > length, 2 * length - folded, folded)


def test_elastic_beads_between_walls_are_points_that_pass_through_each_other_in_order():
    d, height = 0.1, 2.0
    column = vx.models.bead_column(position=height, diameter=d, restitution=1.0, gravity=0.0)
    x, v = np.array([0.2, 0.7, 1.4]), np.array([1.1, -0.7, 0.4])
    ts = np.array([1.0, 3.0, 10.0])
    sol = vx.simulate(column, 0.0, 10.0, x, v, ts=ts)
    sizes = d * np.arange(3)  # height that the beads below take
    for t, found in zip(ts, np.asarray(sol.xs), strict=True):
        expected = np.sort(reflected(x - sizes, v, t, height - 3 * d)) + sizes
        np.testing.assert_allclose(found, expected, rtol=0, atol=ORBIT)
    assert len({event.stop for event in log_of(sol)}) == 4
    assert float((sol.v1**2).sum()) == pytest.approx((v**2).sum(), rel=EXACT)


def test_a_column_that_is_dropped_lies_still_and_each_contact_carries_what_is_above():
    column = vx.models.bead_column(diameter=0.1, restitution=0.5, mass=[3.0, 2.0, 0.5])
    sol = vx.simulate(column, 0.0, 3.0, x0=[0.5, 0.65, 0.8])
    assert np.asarray(sol.stuck1).all()
    np.testing.assert_allclose(sol.x1, [0.0, 0.1, 0.2], rtol=0, atol=EXACT)
    np.testing.assert_allclose(sol.v1, 0.0, rtol=0, atol=EXACT)
    np.testing.assert_allclose(sol.contact_force(3.0), 9.81 * np.array([5.5, 2.5, 0.5]), rtol=EXACT)


def test_a_light_ball_on_a_heavy_one_is_thrown_up():
    heavy, light, r = 4.0, 0.5, 0.9
    stack = vx.models.bead_column(num_beads=2, restitution=r, mass=[heavy, light])
    # The light ball follows at a distance d: they meet just after the heavy one has left the floor.
    h, d = 1.0, 1e-9
    sol = vx.simulate(stack, 0.0, 0.5, x0=[h, h + d])
    floor, meeting, *_ = log_of(sol)
    assert (floor.stop, meeting.stop) == (0, 1)
    speed = np.sqrt(2 * 9.81 * h)
    approach = (1 + r) * speed
    assert meeting.velocity == pytest.approx(approach, rel=EXACT)
    after = -speed + (1 + r) * approach * heavy / (heavy + light)
    # In the time d / approach between the impacts, the light ball fell.
    assert float(sol.evaluate(meeting.t)[1][1]) == pytest.approx(after, rel=10 * d)


def test_a_shaken_column_rides_on_a_floor_slower_than_its_weight():
    w, a = 3.0, 0.5
    column = vx.models.bead_column(w, a, num_beads=2, diameter=0.2, mass=2.0, phase=0.3)
    place, speed = a * np.cos(0.3), -a * w * np.sin(0.3)
    sol = vx.simulate(column, 0.0, 5.0, [place, place + 0.2], [speed, speed])
    assert int(sol.num_events) == 0
    t = np.linspace(0.0, 5.0, 20)
    force = 9.81 - a * w**2 * np.cos(w * t + 0.3)
    np.testing.assert_allclose(sol.contact_force(t), np.outer(force, [4.0, 2.0]), rtol=10 * EXACT)
