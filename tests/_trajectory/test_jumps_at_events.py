"""Loads that jump at the very instant of an impact, a stick or a release."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

ROUNDING = 1e-13
# The end of the chatter of an impact at speed 1 under a load of 1 with restitution 1/2 is at 1 + 2.
PRESSED = [1.0, 1.0, 1.0, 0.0, 0.0]


def steps(values: list[float]) -> vx.Tabulated:
    """A load with a value from each of 0, 1, 2 and 3 on."""
    return vx.Tabulated([0.0, 1.0, 2.0, 3.0, 10.0], np.array(values)[:, None], "previous")


@pytest.mark.parametrize(
    ("values", "restitution", "start", "end", "expected"),
    [
        ([1, -1, -1, -1, 0], 0.5, 0.0, 2.0, -0.5),  # held, then pulled
        ([1, 0, -1, -1, 0], 0.5, 0.0, 3.0, -0.5),  # touches without a force for a while
        ([1, -1, -1, -1, 0], 0.5, -0.5, 2.0, -1.0),  # hits at 1
        ([1, 1, 1, 1, 0], 0.5, -0.5, 1.5, -0.125),
        ([1, 2, 2, 2, 0], 0.0, -0.5, 2.0, 0.0),  # plastic: is held from 1 on
        ([1, -1, -1, -1, 0], 0.0, -0.5, 2.0, -0.5),
        (PRESSED, 0.5, -0.5, 4.0, 0.0),  # a chatter that ends at a jump
    ],
)
def test_a_stop(values, restitution, start, end, expected):
    stop = vx.Stop(0, 0.0, "upper", restitution)
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], steps(values), [stop])
    sol = vx.simulate(system, 0.0, end, [start])
    np.testing.assert_allclose(sol.x1, expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(
    ("values", "static", "speed", "end", "expected"),
    [
        ([0.5, 1, 0, 0, 0], 0.6, 0.0, 2.0, 0.2),  # breaks free at 1
        ([0.5, 1, 0, 0, 0], 0.6, 0.0, 3.0, 0.2 + 0.4**2 / 1.2),
        ([0.6, 0.6, 0.7, 0, 0], 0.6, 0.0, 3.0, 0.05),  # at its bound until 2
        ([1, 0.6, 0.6, 0.6, 0], 0.6, 0.0, 3.0, 0.2 + 0.8),  # slides on at constant speed
        ([0, 0.6, 0, 0, 0], 0.6, 0.6, 2.0, 0.3),  # comes to rest at 1
        ([0, 0.7, 0, 0, 0], 0.6, 0.6, 2.0, 0.35),
        ([0, -0.7, 0, 0, 0], 0.6, 0.6, 2.0, 0.25),
        ([0, 0.7, 0, 0, 0], 0.7, 0.6, 2.0, 0.3),
        ([0, 0.8, 0, 0, 0], 0.7, 0.6, 2.0, 0.4),
    ],
)
def test_dry_friction(values, static, speed, end, expected):
    friction = [vx.Friction(0, 0.6, static)]
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], steps(values), friction=friction)
    sol = vx.simulate(system, 0.0, end, [0.0], [speed])
    np.testing.assert_allclose(sol.x1, expected, rtol=0, atol=ROUNDING)
