"""Impacts in turn at one instant, infinitely many where a force pulls a mass off a plastic stop against which another drives it."""

import numpy as np
import pytest
from contact_scenes import gaps_at, random_machine

import vijax as vx

# Masses, restitution between them, place of the stop, force that pulls off it, start, and the end.
MASS, RESTITUTION, PLACE, FORCE = np.array([2.0, 1.0]), 0.3, 0.1, -1.0
X0, V0, END = np.array([-0.3, 0.0]), np.array([1.0, 0.9]), 1.0
# Units of mass, length and time, which alter all digits.
UNITS = [(1.0, 1.0, 1.0), (3.0, 1 / 7, 1 / 3), (10.0, 1.0, 1.0), (1.0, 0.1, 1.0), (1.0, 1.0, 10.0)]


def time_of_rest() -> float:
    """When both masses have come to rest at the stop: the flights one by one, of which each takes the square of the last."""
    gap, room, (u, w), t = X0[1] - X0[0], PLACE - X0[1], V0, 0.0
    while u > 1e-14:
        rate, root = u - w, np.sqrt((u - w) ** 2 + 2 * gap)
        to_contact = 2 * gap / (rate + root) if rate > 0 else root - rate
        to_stop = 2 * room / (w + np.sqrt(w**2 - 2 * room)) if w > 0 and w**2 >= 2 * room else np.inf
        step = min(to_contact, to_stop)
        gap, room, w, t = gap - rate * step - step**2 / 2, room - w * step + step**2 / 2, w - step, t + step
        if to_stop < to_contact:
            room, w = 0.0, 0.0
        else:
            gap, impulse = 0.0, (1 + RESTITUTION) * (u - w) / (1 / MASS).sum()
            u, w = u - impulse / MASS[0], w + impulse / MASS[1]
    return t


@pytest.mark.thorough
@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("rubs", [False, True])
def test_both_masses_come_to_rest_at_the_stop_in_any_units(units, rubs):
    mass, length, time = units
    force = mass * length / time**2
    load = vx.Harmonic([0.0, 0.0], 1 / time, mean=[0.0, FORCE * force])
    stops = [vx.Stop(1, PLACE * length, "upper", 0.0), vx.Contact({0: 1.0, 1: -1.0}, 0.0, RESTITUTION)]
    # Friction too weak to matter takes the way of machines whose forces switch.
    friction = [vx.Friction(0, 1e-14 * force)] if rubs else []
    system = vx.ImpactSystem(MASS * mass, np.zeros((2, 2)), np.zeros((2, 2)), load, stops, friction=friction)
    sol = vx.simulate(system, 0.0, END * time, X0 * length, V0 * length / time)
    since = END - time_of_rest()
    rate = FORCE / MASS.sum()
    np.testing.assert_allclose(sol.x1 / length, PLACE + rate * since**2 / 2, rtol=1e-11)
    np.testing.assert_allclose(sol.v1 * time / length, rate * since, rtol=1e-11)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [18, 56])
def test_a_plastic_contact_that_was_just_left_is_met_again(seed):
    """Two plastic contacts that share a mass are hit in turn, each after a flight shorter than the digits of time."""
    system = random_machine(seed, 3, 4, has_full_mass=False)
    sol = vx.simulate(system, 0.0, 20.0, max_events=1024)
    assert gaps_at(sol, system, np.linspace(0.0, 20.0, 512)).min() > -1e-14
