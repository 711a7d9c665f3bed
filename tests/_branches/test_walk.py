"""The walk along a curve of solutions: on a unit circle, whose points are known."""

import numpy as np
import pytest

from vijax._branches.point import End
from vijax._branches.requests import HostCall, ask
from vijax._branches.walk import AbstractCurve, at_once, walk_alone
from vijax._orbits.sequence import empty_sequence

WHOLE = 2 * np.pi


class UnitCircle(AbstractCurve):
    """Angles of a unit circle; steps longer than `longest` are refused, and from `gap` on all are."""

    shortest = 1e-3

    def __init__(self, most=1000, longest=0.5, gap=np.inf, jump=0.0):
        self.most, self.longest, self.gap, self.jump = most, longest, gap, jump
        self.found, self.lengths = [], []

    @property
    def is_full(self):
        return len(self.found) >= self.most

    def step(self, here, ds, tried):
        self.lengths.append(ds)
        is_refused = ds > self.longest or here + ds >= self.gap
        return at_once(None if is_refused else here + ds)

    def take(self, here, step):
        self.found.append(step)
        return at_once(End("closed") if step >= WHOLE else (step, 2 * (step - here)))

    def beyond(self, here):
        if not self.jump:
            return at_once(End("no step"))
        self.gap = np.inf
        return at_once((here + self.jump, 0.25))


def test_it_ends_where_the_curve_says():
    curve = UnitCircle()
    assert walk_alone(curve, 0.0, 0.125) == End("closed")
    assert curve.found[-1] >= WHOLE > curve.found[-2]


def test_steps_are_halved_until_one_is_taken():
    curve = UnitCircle()
    walk_alone(curve, 0.0, 2.0)
    assert curve.lengths[:3] == [2.0, 1.0, 0.5]
    assert np.diff([0.0, *curve.found]).max() <= curve.longest


def test_none_is_tried_that_is_too_short():
    curve = UnitCircle(gap=1.0)
    assert walk_alone(curve, 0.0, 0.25) == End("no step")
    assert min(curve.lengths) >= curve.shortest > min(curve.lengths) / 2
    assert 0 < curve.gap - curve.found[-1] < 2 * curve.shortest


def test_it_goes_on_behind_where_no_step_leads():
    curve = UnitCircle(gap=1.0, jump=0.1)
    assert walk_alone(curve, 0.0, 0.25) == End("closed")
    assert 0.1 < np.diff(curve.found).max() < 0.1 + curve.longest


@pytest.mark.parametrize("most", [0, 3])
def test_a_full_curve_has_no_end(most):
    curve = UnitCircle(most=most)
    assert walk_alone(curve, 0.0, 0.25) is None
    assert len(curve.found) == most


def test_plain_steps_may_fill_it():
    class Fast(UnitCircle):
        def plain_steps(self, here, ds):
            self.found.append(here + ds)
            return at_once((here + ds, ds, here + 2 * ds))

    curve = Fast(most=1)
    assert walk_alone(curve, 0.0, 0.25) is None
    assert (curve.found, curve.lengths) == ([0.25], [])


def test_one_that_requests_something_is_not_followed_alone():
    class Asking(UnitCircle):
        def step(self, here, ds, tried):
            return ask(HostCall(lambda family: family.span, empty_sequence(0, ())))

    with pytest.raises(RuntimeError, match="requested"):
        walk_alone(Asking(), 0.0, 0.25)
