"""Zeros of functions of the cycle, located by corrected cycles between two points of a branch."""

from collections.abc import Callable

import numpy as np

from .bracket import Bracket, next_trial
from .kernels import CorrectedCycle
from .point import BranchPoint, End, between, on_plane
from .requests import Requests
from .section import in_section
from .sequence_edits import are_alike
from .tolerances import NEGLIGIBLE


def zero_between(
    before: BranchPoint,
    after: BranchPoint,
    ends: tuple[float, float],
    value_at: Callable[[BranchPoint], Requests[float]],
    num_periods: float,
) -> Requests[BranchPoint | None]:
    """The point between two others at which a function of the cycle vanishes; None if it jumps there or has no value."""
    length, cycle_at = way_between(before, after)
    bracket, best, value = Bracket.between(*ends, length), None, np.nan
    while (s := next_trial(bracket)) is not None:
        cycle = yield from cycle_at(s)
        arc = before.arc + s / length * (after.arc - before.arc)
        best = BranchPoint.of(after.sequence, cycle, arc)
        value = (yield from value_at(best)) if cycle.found.is_converged else np.nan
        if not np.isfinite(value):
            return None
        bracket = bracket.narrowed(s, value)
    if best is None or not abs(value) <= NEGLIGIBLE * max(map(abs, ends)):
        return None
    point = yield from in_section(best, num_periods)
    return None if isinstance(point, End) else point


def way_between(
    before: BranchPoint, after: BranchPoint
) -> tuple[float, Callable[[float], Requests[CorrectedCycle]]]:
    """Length of the way between two points, and the cycle in the plane at a distance from the first.

    The cycles have the sequence of the second point. Where the first has another one, as at an event, the way goes back
    along the tangent of the second.
    """
    if are_alike(before.sequence, after.sequence):
        length = float(after.place.along(before.tangent) - before.place.along(before.tangent))
        if length > 0:
            return length, lambda s: on_plane(before, between(before, after, s / length), s)
    length = after.arc - before.arc
    return length, lambda s: on_plane(after, after.place.moved(after.tangent, s - length), s - length)
