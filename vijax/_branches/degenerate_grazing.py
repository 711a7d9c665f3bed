"""Degenerate grazing: several impacts of a cycle vanish at once, where it repeats a shorter cycle that grazes.

No step leads there, for with m impacts of speed v the multipliers grow like v^-m; but the cycle without these impacts is as
well-conditioned there as anywhere.
"""

import numpy as np

from .._hybrid.limits import IMPACT
from .kinds import Kind
from .locate import locate
from .point import BranchPoint, End, at_parameter, predicted_point
from .requests import Requests
from .sequence_edits import without_event
from .test_functions import kind_at, tests_of
from .tolerances import CYCLES_NEAR, LIGHT_IMPACT, LOCATED, NEAR


def grazing_of_shorter_cycle(point: BranchPoint) -> Requests[BranchPoint | None]:
    """Grazing at which a branch ends close to a point, on the sequence without the impacts that vanish; else None."""
    kind = point.sequence.kind
    speeds = np.where(kind == IMPACT, point.cycle.found.speeds[: len(kind)], np.inf)
    light = np.flatnonzero(speeds < LIGHT_IMPACT * np.max(speeds, where=np.isfinite(speeds), initial=0))
    if len(light) < 2:
        return None
    sequence, place = point.sequence, point.place
    for k in light[::-1]:
        sequence, place = without_event(sequence, place, int(k))
    cycle = yield from at_parameter(sequence, place, float(place.p))
    if not cycle.found.is_converged:
        return None
    start = BranchPoint.of(sequence, cycle, point.arc)
    for stop in np.unique(point.sequence.stop[light]):
        found = yield from vanishing(start, Kind.TOUCH, int(stop))
        if found is not None and _is_near(point, found, speeds[light].max()):
            return found._replace(arc=point.arc)
    return None


def vanishing(start: BranchPoint, kind: str, stop: int) -> Requests[BranchPoint | None]:
    """Point near a start at which the least gap or force of a stop vanishes; None if there is none.

    It is positive where the tangent points: the start may lie beyond by rounding.
    """
    test = next(test for test in tests_of(start.sequence) if test.kind == kind and test.index == stop)
    beside = yield from predicted_point(start, LOCATED)
    gap = test.of(start.cycle)
    slope = (test.of(beside.cycle) - gap) / LOCATED
    way = -gap / slope if slope else np.inf
    if not abs(way) < NEAR:
        return None
    if gap == 0:
        found = start._replace(kind=kind_at(test, start.sequence, start.cycle))
        return found if slope > 0 else found.turned()
    start = start if way > 0 else start.turned()
    beyond = yield from predicted_point(start, 2 * abs(way) + LOCATED)
    if not gap * test.of(beyond.cycle) < 0:
        return None
    found = yield from locate(start, beyond, test)
    if isinstance(found, End):
        return None
    return found if gap < 0 else found.turned()


def _is_near(point: BranchPoint, found: BranchPoint, speed: float) -> bool:
    return bool(np.abs(found.place.z - point.place.z).max() < CYCLES_NEAR * speed)
