"""Branches, orbits and equations of elements side by side, which are those of their sum."""

import numpy as np
import pytest

import vijax as vx
from vijax._machine.numbers import numbers_of
from vijax._orbits.side_by_side import summed

STOP = vx.Stop(0, 0.3, "upper", 0.7)
PRESSED = vx.Harmonic([0.3, 0.0], 0.9, mean=[0.0, -1.0])


def oscillator(stops=(), friction=()) -> vx.ImpactSystem:
    load = vx.Harmonic([0.5], 0.9)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, list(stops), friction=list(friction))


def rubbing(*coefficients: float) -> vx.ImpactSystem:
    """A mass that its own friction on a floor holds back, and another one that presses the floor."""
    own = np.diag([1.0, 0.0])
    friction = [vx.Friction(0, coefficient=mu, contact=0) for mu in coefficients]
    floor = vx.Stop(1, 0.0, "lower", restitution=0.0)
    return vx.ImpactSystem([1.0, 1.0], 0.1 * own, own, PRESSED, [floor], friction=friction)


def soft(share: float) -> vx.CompliantStop:
    return vx.CompliantStop(0, 0.3, "upper", share * 20.0, share * 0.4, preload=share * 0.2)


PAIRS = {
    "friction": (
        oscillator([STOP], [vx.Friction(0, 0.15)]),
        oscillator([STOP], [vx.Friction(0, 0.05), vx.Friction(0, 0.1)]),
    ),
    "opposite rows": (
        oscillator([STOP], [vx.Friction(0, 0.15, 0.18)]),
        oscillator([STOP], [vx.Friction({0: -1.0}, 0.05, 0.06), vx.Friction({0: 2.0}, 0.05, 0.06)]),
    ),
    "three": (
        oscillator([STOP], [vx.Friction(0, 0.15)]),
        oscillator([STOP], [vx.Friction(0, 0.05)] * 3),
    ),
    "friction of a contact": (rubbing(0.15), rubbing(0.05, 0.1)),
    "compliant stops": (oscillator([soft(1.0)]), oscillator([soft(0.3), soft(0.7)])),
}
_SLOW = "opposite rows", "three", "friction of a contact", "compliant stops"
_NAMES = [
    pytest.param(name, marks=pytest.mark.slow if name in _SLOW else pytest.mark.thorough) for name in PAIRS
]


def orbit_of(machine: vx.ImpactSystem) -> vx.PeriodicOrbit:
    start = np.eye(machine.num_masses)[0] * 0.1
    return vx.periodic_orbit(machine, start, start)


@pytest.mark.parametrize("name", _NAMES)
def test_a_branch_is_that_of_the_sum(name):
    one, several = (
        vx.continuation(orbit_of(machine), "forcing.frequency", (0.7, 1.3), progress=False)
        for machine in PAIRS[name]
    )
    assert several.ends == one.ends
    assert [point.kind for point in several.bifurcations] == [point.kind for point in one.bifurcations]
    values = ([point.value for point in branch.bifurcations] for branch in (several, one))
    np.testing.assert_allclose(*values, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", _NAMES)
def test_the_events_of_an_orbit_are_those_of_its_motion(name):
    machine = PAIRS[name][1]
    orbit = orbit_of(machine)
    run = vx.simulate(machine, 0.0, 2 * np.pi / 0.9, orbit.x0, orbit.v0)
    num = int(run.num_events)
    assert num > 0
    for own in ("kind", "stop"):
        expected = np.asarray(getattr(run.events, own))
        np.testing.assert_array_equal(getattr(orbit.events, own)[:num], expected[:num])
        assert np.all(np.asarray(getattr(orbit.events, own))[num:] == -1)
    np.testing.assert_allclose(orbit.events.t[:num], run.events.t[:num], rtol=0, atol=1e-10)


def test_the_first_of_several_has_the_sum():
    friction = [vx.Friction(0, 0.05), vx.Friction({0: -2.0}, 0.1, 0.2), vx.Friction(0, 0.4, velocity=1.0)]
    laws = summed(numbers_of(oscillator([soft(0.3), STOP, soft(0.7)], friction))).laws
    assert laws is not None
    expected = {
        "force": [0.0, 0.0, 0.0, 0.25, 0.0, 0.4],
        "grip": [0.0, 0.0, 0.0, 0.45, 0.0, 0.4],
        "stiffness": [20.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "damping": [0.4, 0.0, 0.0, 0.0, 0.0, 0.0],
        "preload": [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(laws, name), values, rtol=1e-15)


def test_what_does_not_switch_together_stays_as_it_is():
    stops = [
        vx.CompliantStop(0, 0.3, "upper", 20.0, 0.4),
        vx.CompliantStop(0, 0.3, "upper", 20.0, 0.1),  # opens earlier
        vx.CompliantStop(0, 0.4, "upper", 20.0, 0.4),
        vx.CompliantStop(0, -0.3, "lower", 20.0, 0.4),
    ]
    numbers = numbers_of(oscillator(stops, [vx.Friction(0, 0.1), vx.Friction(0, 0.1, velocity=0.2)]))
    laws, before = summed(numbers).laws, numbers.laws
    assert laws is not None
    assert before is not None
    for name in ("force", "grip", "stiffness", "damping", "preload"):
        np.testing.assert_array_equal(getattr(laws, name), getattr(before, name))
