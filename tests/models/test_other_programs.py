"""Examples and verification problems of other programs, against closed forms.

Each entry names where its machine stands. Balls are followed bounce by bounce by the roots of parabolas, chatter to its
geometric limit; the others have a formula of their own.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest

import vijax as vx

# Rounding of a motion over tens of impacts, relative to its size.
ROUNDING = 1e-12


class Ball(NamedTuple):
    """A ball over a floor at 0: gravity, restitution, start, end of the run."""

    gravity: float
    restitution: float
    height: float
    velocity: float
    end: float


BALLS = {
    "Drake, examples/bouncing_ball/test/bouncing_ball_test.cc": Ball(9.81, 1.0, 1.0, 0.0, 10.0),
    "Modelica Reference-FMUs, BouncingBall": Ball(9.81, 0.7, 1.0, 0.0, 3.0),
    "OpenModelica, testsuite, BouncingBall": Ball(9.81, 0.8, 1.0, 0.0, 3.0),
    "NREL SOEP-QSS-Test, mdl/BouncingBall": Ball(9.80665, 0.8, 1.0, 0.0, 3.0),
    "Siconos, BouncingBallED.cpp": Ball(9.81, 0.9, 1.0, 0.0, 8.5),
    "Siconos, BouncingBallED-initialImpact.cpp": Ball(9.81, 0.9, 0.0, -1.0, 8.5),
    "Siconos, BouncingBallTS.cpp": Ball(9.81, 0.9, 1.0, 0.0, 10.0),
    "DifferentialEquations.jl, callback_functions, Bouncing Ball": Ball(9.8, 1.0, 50.0, 0.0, 15.0),
    "Simulink, Simulation of a Bouncing Ball": Ball(9.81, 0.8, 10.0, 15.0, 25.0),
    "MATLAB, ballode": Ball(9.8, 0.9, 0.0, 20.0, 25.0),
    "PETSc, src/ts/tutorials/ex40.c": Ball(9.8, 0.9, 0.0, 20.0, 30.0),
    "SciPy, solve_ivp, cannon": Ball(0.5, 0.0, 0.0, 10.0, 100.0),
}


def bounced(ball: Ball) -> tuple[float, float, list[float]]:
    """Height and velocity at the end, and the times of impacts before it that are faster than the last of a chatter."""
    t, x, v, g, impacts = 0.0, ball.height, ball.velocity, ball.gravity, []
    while True:
        speed = math.sqrt(v * v + 2 * g * x)
        landing = t + (v + speed) / g
        if landing > ball.end:
            s = ball.end - t
            return x + v * s - g * s * s / 2, v - g * s, impacts
        impacts += [landing] if speed > 1e-5 else []
        t, x, v = landing, 0.0, ball.restitution * speed
        if v < 1e-9:
            return 0.0, 0.0, impacts


@pytest.mark.parametrize("source", BALLS)
def test_balls_bounce_as_their_parabolas_say(source):
    ball = BALLS[source]
    system = vx.models.bouncing_ball(gravity=ball.gravity, restitution=ball.restitution)
    sol = vx.simulate(system, 0.0, ball.end, [ball.height], [ball.velocity])
    x, v, impacts = bounced(ball)
    size = max(ball.height, ball.velocity**2 / ball.gravity)
    np.testing.assert_allclose(sol.x1, x, rtol=0, atol=ROUNDING * size)
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=ROUNDING * math.sqrt(size * ball.gravity))
    t = np.asarray(sol.events.t)[np.asarray(sol.events.kind) == vx.IMPACT]
    np.testing.assert_allclose(t[: len(impacts)], impacts, rtol=ROUNDING)


@pytest.mark.thorough
def test_the_tenth_bounce_of_matlab_ends_where_the_geometric_sum_does():
    system = vx.models.bouncing_ball(gravity=9.8, restitution=0.9)
    sol = vx.simulate(system, 0.0, 30.0, [0.0], [20.0])
    np.testing.assert_allclose(sol.events.t[9], 2 * 20 / 9.8 * (1 - 0.9**10) / (1 - 0.9), rtol=ROUNDING)


@pytest.mark.thorough
def test_a_ball_between_floor_and_ceiling():
    """Siconos, BouncingBallED-TwoContacts.cpp."""
    g, r, top, end = 10.0, 0.8, 1.5, 5.0
    load = vx.Harmonic([0.0], 1.0, mean=[-g])
    stops = [vx.Stop(0, 0.0, "lower", r), vx.Stop(0, top, "upper", r)]
    sol = vx.simulate(vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, stops), 0.0, end, [1.0], [10.0])
    t, x, v, num_tops = 0.0, 1.0, 10.0, 0
    while True:
        is_top = v > 0 and x + v * v / (2 * g) > top
        level = top if is_top else 0.0
        speed = math.sqrt(v * v + 2 * g * (x - level))
        landing = t + (v - speed if is_top else v + speed) / g
        if landing > end:
            break
        num_tops += is_top
        t, x, v = landing, level, -r * speed if is_top else r * speed
    s = end - t
    np.testing.assert_allclose(sol.x1, x + v * s - g * s * s / 2, rtol=0, atol=ROUNDING)
    assert np.sum(np.asarray(sol.events.stop) == 1) == num_tops > 1


@pytest.mark.thorough
def test_a_ball_in_a_plane_between_two_walls():
    """DifferentialEquations.jl, VectorContinuousCallback: floor elastic to .9, walls at 0 and 10."""
    g, r, end = 9.8, 0.9, 15.0
    load = vx.Harmonic([0.0, 0.0], 1.0, mean=[-g, 0.0])
    stops = [vx.Stop(0, 0.0, "lower", r), vx.Stop(1, 0.0, "lower", r), vx.Stop(1, 10.0, "upper", r)]
    system = vx.ImpactSystem([1.0, 1.0], np.zeros((2, 2)), np.zeros((2, 2)), load, stops)
    sol = vx.simulate(system, 0.0, end, [50.0, 0.0], [0.0, 2.0])
    height, _, _ = bounced(Ball(g, r, 50.0, 0.0, end))
    # 10 at speed 2, back at speed 1.8, then away from wall 0 at speed 1.62.
    np.testing.assert_allclose(sol.x1, [height, 1.62 * (15.0 - 5.0 - 10 / 1.8)], rtol=0, atol=1e-11)


@pytest.mark.slow
def test_a_column_of_beads_that_falls_in_touch_is_one_bead():
    """Siconos, BeadColumnED_NewtonLaw.cpp, with three beads: radius 5 mm, 7780 kg/m^3, 5 cm above the wall, elastic."""
    radius, density, end = 0.005, 7780.0, 0.5
    mass = 4 / 3 * math.pi * radius**3 * density
    column = vx.models.bead_column(1.0, num_beads=3, diameter=2 * radius, restitution=1.0, mass=mass)
    sol = vx.simulate(column, 0.0, end, 0.05 + 2 * radius * np.arange(3))
    x, v, impacts = bounced(Ball(9.81, 1.0, 0.05, 0.0, end))
    np.testing.assert_allclose(sol.x1, x + 2 * radius * np.arange(3), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=ROUNDING)
    assert len(impacts) == 2


@pytest.mark.thorough
def test_a_small_ball_on_a_large_one_is_thrown():
    """W. G. Harter, Velocity amplification in collision experiments involving superballs, AJP 39 (1971) 656."""
    large, small, g, gap = 1.0, 0.1, 9.81, 1e-3
    column = vx.models.bead_column(1.0, num_beads=2, restitution=1.0, mass=[large, small])
    first = math.sqrt(2 * 1.0 / g)
    sol = vx.simulate(column, 0.0, 1.2 * first, [1.0, 1.0 + gap])
    # Both have the speed g t when the large one turns; they meet as if gravity did not act, at 2 g t.
    meets = first + gap / (2 * g * first)
    falls, rises = -g * meets, g * first - g * (meets - first)
    thrown = ((small - large) * falls + 2 * large * rises) / (large + small)
    left = ((large - small) * rises + 2 * small * falls) / (large + small)
    log = sol.events
    np.testing.assert_allclose(np.asarray(log.t)[:2], [first, meets], rtol=ROUNDING)
    after = 1.2 * first - meets
    np.testing.assert_allclose(sol.v1, [left - g * after, thrown - g * after], rtol=ROUNDING)


@pytest.mark.thorough
def test_free_vibration_with_friction():
    """ANSYS Mechanical APDL Verification Manual, VM73: 10 lb on a spring of 30 lb/in, friction of 1.875 lb, from -1 in."""
    mass, stiffness, force = 10.0 / 386.0, 30.0, 1.875
    system = vx.ImpactSystem([mass], [[0.0]], [[stiffness]], None, friction=[vx.Friction(0, force)])
    ts = [0.09, 0.102, 0.1845]
    sol = vx.simulate(system, 0.0, ts[-1], [-1.0], ts=ts)
    rate, shift = math.sqrt(stiffness / mass), force / stiffness
    turn = math.pi / rate
    exact = [
        -shift - (1 - shift) * math.cos(rate * ts[0]),
        *(shift + (1 - 3 * shift) * math.cos(rate * (t - turn)) for t in ts[1:]),
    ]
    np.testing.assert_allclose(sol.xs[:, 0], exact, rtol=0, atol=ROUNDING)


@pytest.mark.thorough
def test_a_brake_stops_a_mass():
    """Modelica.Mechanics.Translational.Examples.Brake: 1 kg at 1 m/s, a brake of .5 times 2 N from .1 s on."""
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], None, friction=[vx.Friction(0, 1.0)])
    sol = vx.simulate(system, 0.1, 2.0, [0.1], [1.0])
    np.testing.assert_allclose(sol.x1, 0.1 + 0.5, rtol=ROUNDING)
    np.testing.assert_allclose(sol.events.t[0], 1.1, rtol=ROUNDING)


@pytest.mark.slow
def test_a_plastic_bar_under_a_sudden_force():
    """ANSYS Mechanical APDL Verification Manual, VM80: a bar that yields, with a weight at its end, suddenly loaded."""
    stiffness, limit, force, mass = 30e6 * 0.278 / 100.0, 162.9e3 * 0.278, 30e3, 25.9067
    load = vx.Harmonic([0.0], 1.0, mean=[force])
    bar = vx.Jenkins(0, stiffness, limit)
    system = vx.ImpactSystem([mass], [[0.0]], [[0.0]], load, hysteresis=[bar])
    sol = vx.simulate(system, 0.0, 0.3)
    # Energy: the work of the load is that of the spring up to its limit, then of the limit.
    most = limit**2 / (2 * stiffness) / (limit - force)
    turns = np.asarray(sol.events.t)[np.asarray(sol.events.kind) == vx.STICK]
    np.testing.assert_allclose(sol.evaluate(turns[0])[0], most, rtol=ROUNDING)
    # Then it swings about its rest without yielding.
    least = most - 2 * (limit - force) / stiffness
    half = math.pi * math.sqrt(mass / stiffness)
    np.testing.assert_allclose(sol.evaluate(turns[0] + half)[0], least, rtol=ROUNDING)


@pytest.mark.thorough
def test_a_block_falls_on_a_spring():
    """ANSYS Mechanical APDL Verification Manual, VM83: 50 lb from 1 in above a spring of 100 lb/in."""
    weight, height, stiffness = 50.0, 1.0, 100.0
    load = vx.Harmonic([0.0], 1.0, mean=[weight])
    spring = vx.CompliantStop(0, 0.0, "upper", stiffness, 0.0)
    system = vx.ImpactSystem([weight / 386.0], [[0.0]], [[0.0]], load, [spring])
    sol = vx.simulate(system, 0.0, 0.5, [-height])
    meets, leaves = np.asarray(sol.events.t)[:2]
    x, v = sol.evaluate((meets + leaves) / 2)
    deepest = weight / stiffness * (1 + math.sqrt(1 + 2 * height * stiffness / weight))
    np.testing.assert_allclose(x, deepest, rtol=ROUNDING)
    np.testing.assert_allclose(v, 0, rtol=0, atol=1e-10)
