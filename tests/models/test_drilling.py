"""The bit of a drill string: stick-slip by the formulas of Kyllingstad and Halsey, and bounces."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.slow

_RUBBING = 1
"""Number of the friction element in the log, after the bottom of the hole."""


def _times(sol: vx.Solution, stop: int, kind: int) -> np.ndarray:
    log = sol.events
    return np.asarray(log.t)[(np.asarray(log.stop) == stop) & (np.asarray(log.kind) == kind)]


def test_a_bit_sticks_and_slips_as_long_and_turns_as_fast_as_published():
    inertia, stiffness, speed, weight, lever, kinetic, static = 374.0, 473.0, 2.0, 4e4, 0.1, 0.2, 0.35
    bit = vx.models.drill_bit(
        speed,
        weight=weight,
        coefficient=kinetic,
        static_coefficient=static,
        lever=lever,
        mass=1e4,
        inertia=inertia,
        stiffness=stiffness,
    )
    sol = vx.simulate(bit, 0.0, 60.0, v0=[0.0, -speed])
    sticks, slips = _times(sol, _RUBBING, vx.STICK), _times(sol, _RUBBING, vx.SLIP)
    excess = (static - kinetic) * weight * lever
    relative = excess / (speed * np.sqrt(stiffness * inertia))
    slip = 2 * np.sqrt(inertia / stiffness) * (np.pi - np.arctan(relative))
    # The first stick begins with the unloaded string.
    np.testing.assert_allclose(slips[0], static * weight * lever / (stiffness * speed), rtol=1e-12)
    np.testing.assert_allclose(sticks - slips[: len(sticks)], slip, rtol=1e-11)
    np.testing.assert_allclose(
        slips[1:] - sticks[: len(slips) - 1], 2 * excess / (stiffness * speed), rtol=1e-11
    )
    _, v = sol.evaluate(slips[0] + slip / 2)
    fastest = speed + np.sqrt(speed**2 + excess**2 / (stiffness * inertia))
    np.testing.assert_allclose(float(v[1]) + speed, fastest, rtol=1e-12)


def test_a_bit_that_is_lifted_by_its_cones_turns_freely_until_it_lands():
    speed, weight, amplitude = 0.5, 1.0, 1.5
    bit = vx.models.drill_bit(
        speed, frequency=3 * speed, amplitude=amplitude, weight=weight, static_coefficient=None
    )
    sol = vx.simulate(bit, 0.0, 8.0, v0=[0.0, 0.3], max_events=64)
    lifted = np.arccos(-weight / amplitude) / (3 * speed)
    np.testing.assert_allclose(_times(sol, 0, vx.RELEASE)[0], lifted, rtol=1e-12)
    landed = _times(sol, 0, vx.IMPACT)[0]
    middle = (lifted + landed) / 2
    assert float(sol.friction_force(middle)[0]) == 0.0
    (x_0, v_0), (x_1, v_1) = sol.evaluate(lifted), sol.evaluate(middle)
    # The string unwinds as a free oscillator of frequency 1.
    turn = middle - lifted
    np.testing.assert_allclose(x_1[1], x_0[1] * np.cos(turn) + v_0[1] * np.sin(turn), atol=1e-13)
    np.testing.assert_allclose(v_1[1], v_0[1] * np.cos(turn) - x_0[1] * np.sin(turn), atol=1e-13)
