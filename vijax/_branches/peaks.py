"""Peaks along a branch: points where a quantity of the cycle is largest or smallest.

At every point of a branch the derivative of each quantity along the tangent is exact, see `extremes.py`. Where it changes sign between
two points the zero is located as events are. Where it jumps, as at a grazing, the peak is the point at which the
sequence of events changes.
"""

from collections.abc import Sequence as Many
from itertools import pairwise

import numpy as np

from .extremes import Extremes, extremes_of_cycle
from .kinds import EndKind, public_kind
from .parameter_family import ParameterFamily
from .peak_quantities import PeakQuantity
from .point import MAXIMUM, MINIMUM, BranchPoint, DirectedBranch, PeakMark, PlainPoint
from .requests import KernelCall, Requests, ask
from .scheduler import drive
from .sequence_edits import are_alike
from .tolerances import SAME
from .zero_between import zero_between


def find_peaks(
    walk: DirectedBranch, family: ParameterFamily, start: BranchPoint, wanted: Many[PeakQuantity]
) -> list[BranchPoint]:
    """Peaks on a walk from its start, marked."""
    points = [start, *(point.alone() if isinstance(point, PlainPoint) else point for point in walk.points)]
    if walk.end == EndKind.CLOSED and are_alike(points[-1].sequence, start.sequence):
        length = start.place.along(points[-1].tangent) - points[-1].place.along(points[-1].tangent)
        points += [start._replace(arc=points[-1].arc + float(length))] if length > 0 else []
    pairs = list(pairwise(points))
    known = drive([family] * len(points), [_extremes_at(point) for point in points], lambda: None)
    tasks = [
        _peak_between(*pair, known[k : k + 2], one, walk.num_periods, family)
        for k, pair in enumerate(pairs)
        for one in wanted
    ]
    found = drive([family] * len(tasks), tasks, lambda: None)
    return [peak for peak in found if peak is not None]


def _extremes_at(point: BranchPoint) -> Requests[Extremes]:
    call = KernelCall(extremes_of_cycle, point.sequence, (point.place, point.tangent))
    return (yield from ask(call))


def _peak_between(
    before: BranchPoint,
    after: BranchPoint,
    known: Many[Extremes],
    wanted: PeakQuantity,
    num_periods: float,
    family: ParameterFamily,
) -> Requests[BranchPoint | None]:
    """The peak of a quantity between two points whose extremes are known, marked; None if there is none."""
    scale = float(family.scale[wanted.coordinate])
    first, last = (wanted.of(one.slope) / scale for one in known)
    is_flat, are_followed = max(abs(first), abs(last)) < SAME, before.is_admissible and after.is_admissible
    if not (are_followed and np.isfinite(first + last)) or (first > 0) == (last > 0) or is_flat:
        return None

    def slope_at(point: BranchPoint) -> Requests[float]:
        extremes = yield from _extremes_at(point)
        return wanted.of(extremes.slope) / scale

    peak = yield from zero_between(before, after, (first, last), slope_at, num_periods)
    # Where the slope jumps, one of the two points is where the sequence of events changes.
    if peak is None and min(abs(first), abs(last)) > SAME:
        peak = before if before.kind else after if after.kind else None
    if peak is None:
        return None
    extremes = yield from _extremes_at(peak)
    kind = MAXIMUM if first > 0 else MINIMUM
    mark = PeakMark(kind, wanted.words, wanted.of(extremes.value), public_kind(peak.kind))
    return peak._replace(kind="", peak=mark)
