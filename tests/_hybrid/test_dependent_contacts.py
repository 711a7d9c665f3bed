"""Contacts with linearly dependent rows: tables of four legs, slots without clearance, duplicate contacts."""

import numpy as np
import pytest
from helpers import log_of

import vijax as vx

LEGS = ((1, 1), (1, -1), (-1, -1), (-1, 1))
ROUNDING = 1e-14

pytestmark = pytest.mark.thorough


def table(wandering: float, load: float = 0.0, restitution: float = 0.5) -> vx.ImpactSystem:
    """A table of mass 1 and four legs on a floor: its height and two tilts, on which its load exerts moments."""
    forcing = vx.Harmonic([0.0, wandering, 0.0], 2.0, mean=[-1.0, load, 0.1])
    legs = [vx.Contact({0: -1.0, 1: -a, 2: -b}, 0.0, restitution) for a, b in LEGS]
    return vx.ImpactSystem(np.array([1.0, 0.5, 0.5]), np.zeros((3, 3)), np.zeros((3, 3)), forcing, legs)


@pytest.mark.slow
def test_a_table_of_four_legs_stands_while_its_load_wanders_from_leg_to_leg():
    sol = vx.simulate(table(0.7), 0.0, 10.0, max_events=64)
    t = np.linspace(0.0, 10.0, 101)
    force = np.asarray(sol.contact_force(t))
    np.testing.assert_allclose(sol.evaluate(t)[0], 0, atol=ROUNDING)
    assert (force > -ROUNDING).all()
    # The legs carry the weight and its moments: three equations for the four forces.
    moments = np.array([[1, a, b] for a, b in LEGS])
    expected = np.stack([np.ones_like(t), -0.7 * np.cos(2 * t), np.full_like(t, -0.1)], 1)
    np.testing.assert_allclose(force @ moments, expected, rtol=0, atol=ROUNDING)
    assert {event.kind for event in log_of(sol)} == {"stick", "release"}


@pytest.mark.slow
def test_it_tips_over_two_legs_once_its_load_is_beyond_them():
    sol = vx.simulate(table(-1.25), 0.0, 0.3, max_events=64)
    # The load is 1.25 cos 2t from the middle, at the start beyond the legs at 1: the table tips about these legs.
    assert int(sol.num_events) == 0
    t = np.linspace(0.0, 0.3, 30)
    x = np.asarray(sol.evaluate(t)[0])
    gaps = x @ np.array([[1, a, b] for a, b in LEGS]).T
    assert gaps.min() > -ROUNDING
    # About the line of legs the table has the inertia 1 + 0.5, and the moment 1.25 cos 2t - 1.
    turned = (1.25 * (1 - np.cos(2 * t)) / 4 - t**2 / 2) / 1.5
    np.testing.assert_allclose(np.abs(x[:, 1]), turned, rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_contact_that_is_told_thrice_is_that_contact():
    load = vx.Harmonic([0.8, 0.0], 1.1, mean=[0.0, 0.3])
    one = vx.Contact({0: -1.0, 1: 1.0}, 0.1, 0.6)
    link, damper = np.diag([1.0, 0.0]), np.diag([0.05, 0.0])
    make = lambda contacts: vx.ImpactSystem([1.0, 0.2], damper, link, load, contacts)  # noqa: E731
    single, thrice = (vx.simulate(make([one] * k), 0.0, 40.0, max_events=2048) for k in (1, 3))
    np.testing.assert_allclose(thrice.x1, single.x1, rtol=0, atol=1e-12)
    assert int(np.asarray(single.events.kind == vx.RELEASE).sum()) > 3
    # One of the copies holds it, at the same times.
    for kind in (vx.STICK, vx.RELEASE):
        times = [np.asarray(s.events.t)[np.asarray(s.events.kind == kind)] for s in (single, thrice)]
        np.testing.assert_allclose(times[1], times[0], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_what_is_shut_stays_so_under_a_solver():
    exact, solved = (
        vx.simulate(table(0.7), 0.0, 4.0, max_events=64, flow=flow) for flow in (None, vx.DiffraxFlow())
    )
    np.testing.assert_allclose(solved.x1, exact.x1, rtol=0, atol=1e-9)
    releases = [[e.t for e in log_of(s) if e.kind == "release"] for s in (exact, solved)]
    np.testing.assert_allclose(releases[1], releases[0], rtol=0, atol=1e-7)
    assert releases[0]


@pytest.mark.slow
@pytest.mark.parametrize("coupling", [0.1, -0.1])
def test_two_contacts_that_lose_their_force_at_one_instant_are_let_go_together_or_one_holds(coupling):
    """A force on the outer mass presses both on a wall until it reverses; inertia then acts on the inner one."""
    mass = np.array([[0.6, coupling], [coupling, 0.2]])
    contacts = [vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.5), vx.Contact({1: 1.0}, 0.0, 0.5)]
    system = vx.ImpactSystem(mass, np.zeros((2, 2)), np.zeros((2, 2)), vx.Harmonic([1.0, 0.0], 1.0), contacts)
    sol = vx.simulate(system, 0.0, 4.0, max_events=16)
    is_pushed = coupling > 0
    assert [(e.kind, e.stop) for e in log_of(sol)] == [("release", 0), ("release", 1)][: 1 + (not is_pushed)]
    # The force, cos t, is -sin s with s = t - pi / 2.
    s = 4.0 - np.pi / 2
    way = np.sin(s) - s
    inertia = np.array([1 / mass[0, 0], 0.0]) if is_pushed else np.linalg.inv(mass)[:, 0]
    np.testing.assert_allclose(sol.x1, inertia * way, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(sol.v1, inertia * (np.cos(s) - 1), rtol=0, atol=ROUNDING)
