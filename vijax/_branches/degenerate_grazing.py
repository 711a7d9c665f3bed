"""Degenerate grazing: several impacts of a cycle vanish at once, where it repeats a shorter cycle that grazes.

Branches of cycles of several periods end at the grazing of a cycle of fewer: its impacts may appear in any of its rounds, so
that several branches meet there, and none of them continues another. Only the motion without any impact continues them.

If several impacts vanish no step leads there, for with m of them of speed v the multipliers grow like v^-m; but the cycle
without these impacts is as well-conditioned there as anywhere.
"""

import numpy as np

from .._hybrid.limits import IMPACT
from .behind_event import corrected_on_sequence
from .kinds import Kind
from .locate import locate
from .point import BranchPoint, End, at_parameter, predicted_point
from .requests import Requests
from .sequence_edits import without_event
from .test_functions import kind_at, tests_of
from .tolerances import CYCLES_NEAR, LIGHT_IMPACT, RESONANT, SLOPE_STEP, VANISHED_IMPACT, ZERO_NEAR


def grazing_of_shorter_cycle(point: BranchPoint) -> Requests[BranchPoint | None]:
    """Grazing at which a branch ends close to a point, on the sequence without the impacts that vanish; else None."""
    kind = point.sequence.kind
    speeds = np.where(kind == IMPACT, point.seen.found.speeds[: len(kind)], np.inf)
    light = np.flatnonzero(speeds < LIGHT_IMPACT * np.max(speeds, where=np.isfinite(speeds), initial=0))
    if len(light) < 2:
        return None
    sequence, place = point.sequence, point.place
    for k in light[::-1]:
        sequence, place = without_event(sequence, place, int(k))
    seen = yield from at_parameter(sequence, place, float(place.p))
    if not seen.found.is_converged:
        return None
    start = BranchPoint.of(sequence, seen, point.arc)
    for stop in np.unique(point.sequence.stop[light]):
        found = yield from vanishing(start, Kind.TOUCH, int(stop))
        if found is not None and _is_near(point, found, speeds[light].max()):
            return found._replace(arc=point.arc)
    return None


def without_impacts(event: BranchPoint) -> Requests[BranchPoint | End | None]:
    """The point of an event on the motion without impacts; None if other events remain.

    An `End` at a resonance without losses, where all free vibrations repeat and no orbit is isolated.
    """
    sequence, place, found = event.sequence, event.place, event.seen.found
    _, velocities = np.split(np.abs(event.seen.start), 2)
    speeds = np.abs(found.speeds[: len(sequence.kind)])
    # Impacts at which friction turns leave turns behind.
    is_one_mode = np.all(sequence.mode == sequence.mode[:1])
    if (
        np.any(sequence.kind != IMPACT)
        or np.any(speeds > VANISHED_IMPACT * velocities.max())
        or not is_one_mode
    ):
        return None
    for k in range(len(sequence.kind))[::-1]:
        sequence, place = without_event(sequence, place, k)
    free = yield from corrected_on_sequence(sequence, place, event)
    return End(Kind.GRAZING) if isinstance(free, End) or abs(free.tangent.p) < RESONANT else free


def vanishing(start: BranchPoint, kind: str, stop: int) -> Requests[BranchPoint | None]:
    """Point near a start at which the least gap or force of a stop vanishes; None if there is none.

    It is positive where the tangent points: the start may lie beyond by rounding.
    """
    test = next(test for test in tests_of(start.sequence) if test.kind == kind and test.index == stop)
    beside = yield from predicted_point(start, SLOPE_STEP)
    gap = test.of(start.seen)
    slope = (test.of(beside.seen) - gap) / SLOPE_STEP
    way = -gap / slope if slope else np.inf
    if not abs(way) < ZERO_NEAR:
        return None
    if gap == 0:
        found = start._replace(kind=kind_at(test, start.sequence, start.seen))
        return found if slope > 0 else found.turned()
    start = start if way > 0 else start.turned()
    beyond = yield from predicted_point(start, 2 * abs(way) + SLOPE_STEP)
    if not gap * test.of(beyond.seen) < 0:
        return None
    found = yield from locate(start, beyond, test)
    if isinstance(found, End):
        return None
    return found if gap < 0 else found.turned()


def _is_near(point: BranchPoint, found: BranchPoint, speed: float) -> bool:
    return bool(np.abs(found.place.z - point.place.z).max() < CYCLES_NEAR * speed)
