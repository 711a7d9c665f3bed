"""Tests for closed branches, and for cycles that repeat a shorter cycle."""

import numpy as np

from .._orbits.sequence import Sequence
from .padding import trimmed
from .parameter_family import ExtendedCycle
from .point import BranchPoint, DirectedBranch, between, on_plane
from .requests import Requests, ask, location_on
from .sequence_edits import are_alike
from .tolerances import LEAST_COSINE, LOCATED, SAME


def repetitions_of(
    sequence: Sequence, place: ExtendedCycle, num_periods: int | float, within: float = LOCATED
) -> Requests[int]:
    """Number of times that a cycle of `num_periods` forcing periods repeats a shorter one, within a distance."""
    num_periods = _finite(num_periods)
    for n in _periods_of_shorter(num_periods):
        is_whole = len(sequence.kind) % (num_periods // n) == 0
        if is_whole and (yield from _has_returned(sequence, place, n, within)):
            return num_periods // n
    return 1


def _periods_of_shorter(num_periods: int) -> list[int]:
    return [n for n in range(1, num_periods) if num_periods % n == 0]


def _has_returned(sequence: Sequence, place: ExtendedCycle, n: int, within: float) -> Requests[bool]:
    """Test whether a cycle is back at its start after n forcing periods."""
    z = yield from ask(location_on(sequence, place, float(n)))
    return bool(np.abs(z - place.z).max() < within)


def _finite(num_periods: int | float) -> int:
    """Number of forcing periods of a cycle; 1 where no load sets the period."""
    return int(num_periods) if np.isfinite(num_periods) else 1


def is_at_start(
    walk: DirectedBranch, start: BranchPoint, point: BranchPoint, new: BranchPoint
) -> Requests[bool]:
    """Test whether the step from a point to a new one passes the start of the branch."""
    if not are_alike(start.sequence, point.sequence) or len(walk.points) < 4:
        return False
    tangent, ds = point.tangent, new.arc - point.arc
    s = start.place.along(tangent) - point.place.along(tangent)
    if not 0 < s <= ds or start.tangent.along(tangent) < LEAST_COSINE:
        return False
    if start.place.distance(between(point, new, s / ds)) > ds:  # at the level of the step, but far from it
        return False
    cycle = yield from on_plane(point, start.place, s)
    found = trimmed(cycle.found.place, len(point.sequence.kind))
    return bool(cycle.found.is_converged and found.distance(start.place) < SAME)


def first_repeated(walk: DirectedBranch, last: BranchPoint) -> Requests[int | None]:
    """Index of the first point of a walk that is passed twice; None if its last point is a new one.

    A cycle may return shifted by some forcing periods.
    """
    before = walk.points[:-1]
    numbers = [k for k, point in enumerate(before) if point.kind]
    for place, k in enumerate(numbers):
        old = before[k]
        if not isinstance(old, BranchPoint) or not _may_be_same(old, last):
            continue
        for n in range(_finite(walk.num_periods)):
            z = yield from ask(location_on(last.sequence, last.place, float(n)))
            if np.abs(z - old.place.z).max() < SAME and (n > 0 or _is_same_way(old, last)):
                # The last `place` + 1 bifurcations are the first ones again.
                return [*numbers, len(before)][-place - 1]
    return None


def _may_be_same(old: BranchPoint, new: BranchPoint) -> bool:
    """True if kind, parameter and events agree: close grazings of different sequences are different points."""
    is_near = old.kind == new.kind and abs(old.place.p - new.place.p) < SAME
    return bool(is_near and _events(old.sequence) == _events(new.sequence))


def _events(sequence: Sequence) -> list[tuple[int, int]]:
    """Kinds and stops of the events of a cycle, sorted."""
    return sorted(zip(sequence.kind.tolist(), sequence.stop.tolist(), strict=True))


def _is_same_way(old: BranchPoint, new: BranchPoint) -> bool:
    """True if a branch passes a point twice in the same direction, unlike where it crosses itself."""
    return bool(old.tangent.along(new.tangent) > LEAST_COSINE)
