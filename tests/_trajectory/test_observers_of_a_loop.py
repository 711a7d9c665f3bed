"""Observers of the loop of a trajectory: one of a few lines sees every step, and ends the motion."""

import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._flow.choose import choose_flow
from vijax._jax.xla import while_any
from vijax._machine.numbers import numbers_of
from vijax._system.system import machine_of
from vijax._trajectory.loop import UNLIMITED_STEPS, LoopArguments, begin_loop, first_carry
from vijax._trajectory.records import AbstractObserver, GrazingWatch, ImpactCount, Saving

MACHINE = vx.models.wagg_bishop_a(0.8)
START, T1 = ([0.1, 0.0], [0.0, 0.1]), 40.0


class PeriodCount(AbstractObserver):
    """Forcing periods that ended, up to `most` of them."""

    most: int

    def first(self, machine, state, t0):
        return jnp.array(0)

    def update(self, machine, seen, leg, live):
        return seen + (live & leg.instant.arrived & ~leg.is_goal)

    def goes_on(self, seen):
        return seen < self.most


def run(observers, goals=()):
    """Motion of the machine, seen by observers: the loop and its last carry."""
    system = machine_of(MACHINE)
    numbers, flow = numbers_of(system), choose_flow(system, can_stick=True, wanted=None)
    t0, t1, x0, v0, goals = (jnp.asarray(a, float) for a in (0.0, T1, *START, goals))
    count = jnp.asarray(len(goals))
    request = LoopArguments(
        t0, t1, x0, v0, goals, count, jnp.array(True), *map(jnp.asarray, (100_000, 0, UNLIMITED_STEPS, True))
    )
    task, first = begin_loop(numbers, flow, request, observers, can_stick=True)
    return task, while_any(task, first_carry(task, first, request.is_sound))


@pytest.fixture(scope="module")
def solution():
    return vx.simulate(MACHINE, 0.0, T1, ts=[10.0, 30.0], x0=START[0], v0=START[1])


def test_each_sees_what_the_solution_holds(solution):
    observers = {
        "saved": Saving(3, 2),
        "grazing": GrazingWatch(),
        "hits": ImpactCount(jnp.array(0), jnp.array(999)),
    }
    _, last = run(observers, [10.0, 30.0])
    xs, vs = last.seen["saved"]
    np.testing.assert_allclose(xs[:2], solution.xs, rtol=0, atol=1e-12)
    np.testing.assert_allclose(vs[:2], solution.vs, rtol=0, atol=1e-12)
    assert last.seen["grazing"].impact_speed == pytest.approx(float(solution.grazing.impact_speed), rel=1e-10)
    table = solution.events.to_dataframe()
    assert int(last.seen["hits"].number) == int(((table.kind == "impact") & (table.stop == 0)).sum()) > 3


def test_one_that_has_enough_ends_the_motion():
    task, last = run({"periods": PeriodCount(3), "hits": ImpactCount(jnp.array(0), jnp.array(999))})
    assert (int(last.seen["periods"]), int(last.state.periods)) == (3, 3)
    assert float(last.state.periods * task.machine.period) < T1
    task, last = run({"periods": PeriodCount(999), "hits": ImpactCount(jnp.array(0), jnp.array(2))})
    assert int(last.seen["hits"].number) == 2


def test_without_any_the_motion_is_the_same(solution):
    task, last = run({})
    x, v = task.machine.in_space(last.state)
    np.testing.assert_allclose(x, solution.x1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(v, solution.v1, rtol=0, atol=1e-12)
