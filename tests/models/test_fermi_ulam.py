"""A ball between a fixed wall and a smoothly moving one, without losses: no start is accelerated without bound.

Impacts at the moving wall define an area-preserving twist map of the angle of the wall and the speed of the ball. So
no orbit crosses a curve around the cylinder that maps onto itself, from below or from above (J. K. Moser, Nachr.
Akad. Wiss. Goettingen II (1962) 1-20; M. A. Lieberman and A. J. Lichtenberg, Physical Review A 5 (1972) 1852-1866).
Here two such curves are found as the orbits of single balls, to as many digits as their Fourier series give.
"""

import numpy as np
import pytest
from helpers import log_of
from model_roundings import EXACT

import vijax as vx

W, A, D = 1.0, 0.01, 1.0
# Near a speed v the map is the standard map with K = 4 a d W^2 / v^2: time of flight 2 d / v, change of speed
# 2 a W sin(b). Its last curve breaks at K = 0.9716 (J. M. Greene, J. Mathematical Physics 20 (1979) 1183-1201).
BORDER = 2 * W * np.sqrt(A * D / 0.971635)
# Starts on a curve just above the border and on one far above it, and others: below the first, and between both.
FIRST, SECOND = 1.175 * BORDER, 3.3 * BORDER
BELOW = np.linspace(0.05, 1.0, 40) * BORDER
BETWEEN = np.linspace(1.3, 3.1, 22) * BORDER
HARMONICS = 80
# Residual of the first curve with that many harmonics, in units of its speed (measured: 5e-11).
ON_CURVE = 1e-9
# Error of the speed of the wall at times of 2e4, which are rounded to 4e-12.
OF_WALL = 1e-11 * A * W**2


@pytest.fixture(scope="module")
def swept():
    """Sweep with thousands of impacts from each start in the middle of the walls."""
    system = vx.models.ball_between_walls(W, A, position=D)
    starts = np.concatenate([[FIRST, SECOND], BELOW, BETWEEN])
    return vx.sweep(
        system,
        {"v0[0]": starts},
        x0=[D / 2],
        transient=0,
        record=3000,
        max_impacts=12_600,
        progress=False,
    )


def at_the_moving_wall(point) -> tuple[np.ndarray, np.ndarray]:
    """Angle of the wall and incoming speed of the ball."""
    is_there = point.impact_stop.values == 1
    return point.impact_phase.values[is_there], -point.impact_velocity.values[is_there]


def waves(angle: np.ndarray) -> np.ndarray:
    steps = np.outer(angle, np.arange(1, HARMONICS + 1))
    return np.concatenate([np.ones((len(angle), 1)), np.cos(steps), np.sin(steps)], axis=1)


def curve_through(angle: np.ndarray, speed: np.ndarray):
    """Speed as a function of the angle, a curve that contains all impacts."""
    series = np.linalg.lstsq(waves(angle), speed, rcond=None)[0]
    np.testing.assert_allclose(waves(angle) @ series, speed, rtol=ON_CURVE)
    # All around, with gaps shorter than the shortest wave.
    assert np.diff(np.sort(angle)).max() < np.pi / HARMONICS
    return lambda angle: waves(angle) @ series


@pytest.mark.slow
def test_a_ball_between_walls_never_passes_an_invariant_curve(swept):
    assert (swept.result == 0).all()
    first, second = (curve_through(*at_the_moving_wall(swept.isel({"v0[0]": k}))) for k in (0, 1))
    fastest = []
    for k in range(len(BELOW)):
        angle, speed = at_the_moving_wall(swept.isel({"v0[0]": 2 + k}))
        assert (speed < first(angle)).all()
        fastest.append(speed.max())
    # Chaos fills the region below the curve: slow balls are accelerated up to the border of the standard map.
    assert 0.95 < max(fastest) / BORDER < 1.05
    assert np.median(fastest / BELOW) > 1.3
    for k in range(len(BETWEEN)):
        angle, speed = at_the_moving_wall(swept.isel({"v0[0]": 2 + len(BELOW) + k}))
        assert (first(angle) < speed).all()
        assert (speed < second(angle)).all()


@pytest.mark.slow
def test_each_of_many_impacts_of_a_ball_between_walls_turns_its_relative_velocity_round(swept):
    speed, relative = swept.impact_velocity.values, swept.impact_relative_velocity.values
    wall, number = speed - relative, np.isfinite(speed).sum(axis=1)
    assert number.min() > 500
    assert number.sum() > 100_000
    is_moving = swept.impact_stop.values == 1
    moved = -A * W * np.sin(swept.impact_phase.values)
    np.testing.assert_allclose(wall[is_moving], moved[is_moving], rtol=0, atol=OF_WALL)
    assert (wall[swept.impact_stop.values == 0] == 0).all()
    # Between two impacts the ball flies freely.
    after, next_before = (wall - relative)[:, :-1], speed[:, 1:]
    is_pair = np.isfinite(next_before)
    np.testing.assert_allclose(after[is_pair], next_before[is_pair], rtol=0, atol=2 * OF_WALL)


def test_a_ball_on_a_table_may_be_accelerated_for_ever():
    """Without losses, hit by the table at one angle b in each flight: n periods, then n + 1, n + 2, ...

    The table moves up by g T / 4 at the impacts, which lengthens flights of 2 v / g by a period T.
    """
    w, g, n, turns = 2.0, 1.0, 1, 20
    period = 2 * np.pi / w
    rise = g * period / 4
    a = 1.1 * rise / w
    # Of the two such angles, the one at which the table is slower for a late ball, cos(b) > 0.
    angle = -np.arcsin(rise / (a * w))
    table = vx.models.ball_on_table(w, a, phase=angle, restitution=1.0, gravity=g)
    start = n * g * period / 2
    numbers = n + np.arange(turns)
    times = np.cumsum(numbers) * period
    # Just after the impact: the start is on the table.
    sol = vx.simulate(table, 0.0, times[-1] + 0.1, [a * np.cos(angle)], [start])
    events = log_of(sol)
    assert [event.kind for event in events] == ["impact"] * turns
    # The rounding of the start stays small, and grows with the number of impacts.
    np.testing.assert_allclose([event.t for event in events], times, rtol=turns * EXACT)
    after = np.asarray(sol.events.velocity_plus)[:turns]
    np.testing.assert_allclose(after, (numbers + 1) * g * period / 2, rtol=turns * EXACT)
