"""Bounces that other contacts or friction of the same masses disturb before they are over.

In units in which speeds are small numbers, bounces are as light as in others: the motion is the same.
"""

import numpy as np
import pytest

import vijax as vx


def beside_friction(mass, length, time):
    """A mass bounces on a wall while friction binds it to another, and lets go, between any two bounces."""
    force, rate = mass * length / time**2, mass / time
    load = vx.Harmonic(
        force * np.array([0.723, 1.584]),
        1.8068 / time,
        [2.4568, 4.5968],
        mean=force * np.array([-0.2606, 0.1123]),
    )
    stops = [
        vx.Stop(0, -0.0889 * length, "lower", 0.8394),
        vx.Stop(0, 0.4334 * length, "upper", 0.4682),
        vx.Contact({1: 1.0, 0: -1.0}, 0.3146 * length, 0.8362),
    ]
    return vx.ImpactSystem(
        mass * np.array([0.8929, 8.1707]),
        rate * np.array([[1.257, -0.775], [-0.775, 1.4982]]),
        rate / time * np.array([[1.2825, -0.0373], [-0.0373, 2.2479]]),
        load,
        stops,
        friction=[vx.Friction({1: 1.0, 0: -1.0}, 1.5818 * force)],
    )


def between_masses(mass, length, time):
    """A light mass bounces between a heavy one and a wall that moves."""
    force = mass * length / time**2
    load = vx.Harmonic(
        force * np.array([1.2811, 0.7309, 0.5026]),
        0.4236 / time,
        [4.5043, 2.7068, 5.2434],
        mean=force * np.array([0.0, -0.1771, 0.5978]),
    )
    stops = [
        vx.Stop(2, -0.7601 * length, "lower", 0.2356, motion=vx.Harmonic([0.119 * length], 0.4236 / time)),
        vx.Contact({1: 1.0, 2: -1.0}, 0.417 * length, 0.5948),
        vx.Contact({2: 1.0, 1: -1.0}, 0.7042 * length, 0.5948),
    ]
    stiffness = mass / time**2 * np.diag([0.5129, 1.6459, 0.0])
    return vx.ImpactSystem(mass * np.array([4.5004, 5.4324, 0.853]), np.zeros((3, 3)), stiffness, load, stops)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "v0", "end"),
    [(beside_friction, [0.6095, 0.5062], 8.0), (between_masses, [-0.3148, -1.7119, 0.5126], 6.0)],
)
def test_the_motion_does_not_depend_on_the_units(machine, v0, end):
    x0, (length, time) = np.zeros(len(v0)), (2.0**-7, 2.0**3)
    own = vx.simulate(machine(1.0, 1.0, 1.0), 0.0, end, x0, v0, max_events=1024)
    speed = length / time
    other = vx.simulate(
        machine(2.0**5, length, time), 0.0, end * time, x0, speed * np.array(v0), max_events=1024
    )
    assert int(own.num_events) > 30
    np.testing.assert_allclose(other.x1 / length, own.x1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.v1 / speed, own.v1, rtol=0, atol=1e-12)
