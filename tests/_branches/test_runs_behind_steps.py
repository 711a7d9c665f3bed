"""Branches whose runs are made behind the program of steps are those of a program that makes them itself."""

import numpy as np
import pytest

import vijax as vx
from vijax._branches import followed_steps
from vijax._branches.batches import FamilyStack

pytestmark = pytest.mark.slow


def _branch():
    """A mass with a preloaded soft stop and friction, whose orbit begins to touch it."""
    load = vx.Harmonic([1.0], 0.8)
    soft = vx.CompliantStop(0, 1.2, "upper", 20.0, 0.1)
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [soft], friction=[vx.Friction(0, 0.2)])
    start = vx.simulate(system, 0.0, 100 * system.forcing.period, max_events=1, throw=False)
    orbit = vx.periodic_orbit(system, start.x1, start.v1)
    return vx.continuation(orbit, "forcing.frequency", (0.5, 1.1), progress=False)


@pytest.fixture(scope="module")
def behind():
    """The branch, and how many calls of the program of steps had runs behind them."""
    calls, ends_of = [], followed_steps._end_of

    def watched(*args):
        calls.append(args)
        return ends_of(*args)

    followed_steps._end_of = watched
    try:
        return _branch(), len(calls)
    finally:
        followed_steps._end_of = ends_of


def _assert_same(one, other):
    assert len(one) == len(other)
    assert [point.kind for point in one.bifurcations] == [point.kind for point in other.bifurcations]
    for name in ("forcing.frequency", "x0", "v0", "multipliers"):
        np.testing.assert_allclose(one.points[name], other.points[name], rtol=1e-9, atol=1e-11)


def test_a_branch_is_the_same_with_runs_in_the_program_and_behind_it(monkeypatch, behind):
    branch, num = behind
    assert num > 10
    made = FamilyStack.__init__

    def inside(self, families):
        made(self, families)
        self.switches = False

    monkeypatch.setattr(FamilyStack, "__init__", inside)
    monkeypatch.setattr(followed_steps, "_end_of", None)  # not called
    _assert_same(branch, _branch())


def test_steps_behind_one_that_is_not_followed_are_dropped(monkeypatch, behind):
    # A step that is refused here is looked at alone, accepted, and stepped on from with the same length.
    judged, judge = [], followed_steps.is_followed_or_unstable

    def refuses(*args):
        judged.append(judge(*args))
        return judged[-1] & (len(judged) % 3 != 0)

    monkeypatch.setattr(followed_steps, "is_followed_or_unstable", refuses)
    _assert_same(behind[0], _branch())
    assert len(judged) > 60
