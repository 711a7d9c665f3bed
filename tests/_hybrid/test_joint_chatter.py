"""Contacts that feed each other's bounces come to rest at the limit of ever smaller bounces."""

import numpy as np
import pytest
from helpers import log_of
from joint_chatter import Machine, closings, dropped_stack, random_machine

import vijax as vx

T1 = 3.0
MACHINES = {f"stack of r = {r}": dropped_stack(r) for r in (0.4, 0.6, 0.7)}
# About one in fifteen random machines with pressed contacts comes to rest in this way.
MACHINES |= {f"random machine {seed}": random_machine(seed) for seed in (17, 24, 36, 48, 74, 102, 119)}
# Speeds at which the bounces are cut off; the last one stands for the limit. At 1e-8 rounding decides which contact is last.
SPEEDS = [1e-1, 1e-2, 1e-3, 1e-4, 1e-7]
# The error is at most 3 times the cube of the speed, in these machines of size one.
ORDER, FACTOR, ROUNDED = 3, 3.0, 1e-15
# Error of the motion before, some sixty impacts.
EXACT = 3e-14
# Duration of the last bounces, which the engine cuts off below a speed of 1e-6.
LAST_BOUNCES = 1e-5

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module", params=MACHINES)
def machine(request) -> Machine:
    return MACHINES[request.param]


@pytest.fixture(scope="module")
def found(machine):
    return closings(machine, T1, SPEEDS)


def test_what_is_left_out_is_of_the_third_order_in_the_speed_of_the_bounces(found):
    errors = np.array([abs(one.end - found[-1].end).max() for one in found[:-1]])
    assert (errors < FACTOR * np.array(SPEEDS[:-1]) ** ORDER + ROUNDED).all()


def test_without_the_impulse_of_dampers_it_would_be_of_the_second():
    machine = MACHINES["stack of r = 0.7"]
    *ends, limit = closings(machine, T1, SPEEDS, is_damped=False)
    errors = np.array([abs(one.end - limit.end).max() for one in ends])
    assert (errors < np.array(SPEEDS[:-1]) ** 2).all()
    assert (errors > FACTOR * np.array(SPEEDS[:-1]) ** ORDER + ROUNDED).any()


@pytest.mark.slow
def test_joint_chatter_ends_as_its_ever_smaller_bounces_do(machine, found):
    *_, limit = found
    sol = vx.simulate(machine.system, 0.0, T1, machine.x0, max_events=512)
    assert np.asarray(sol.stuck1).all()
    np.testing.assert_allclose(np.concatenate([sol.x1, sol.v1]), limit.end, rtol=0, atol=EXACT)
    sticks = [event for event in log_of(sol) if event.kind == "stick"]
    assert sorted(stick.stop for stick in sticks) == [0, 1]
    assert max(abs(stick.t - limit.t) for stick in sticks) < LAST_BOUNCES


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stack of r = 0.6", "random machine 17"])
def test_joint_chatter_ends_alike_in_a_machine_with_a_compliant_stop(name):
    """The compliant stop is far away. Followed further, bounces of some machines shrink into the rounding of the gaps, and go on."""
    given = MACHINES[name]
    system, x0 = given.system, given.x0
    far = vx.CompliantStop(0, -1e3, "lower", 1.0)
    both = vx.ImpactSystem(
        system.mass, system.damping, system.stiffness, system.forcing, [*system.stops, far]
    )
    one, other = (vx.simulate(own, 0.0, T1, x0, max_events=512) for own in (system, both))
    assert np.asarray(other.stuck1)[:2].all()
    assert other.num_events == one.num_events
    np.testing.assert_allclose(other.x1, one.x1, rtol=0, atol=EXACT)
    np.testing.assert_allclose(other.v1, one.v1, rtol=0, atol=EXACT)
    sticks = [event.stop for event in log_of(other) if event.kind == "stick"]
    assert sorted(sticks) == [0, 1]
