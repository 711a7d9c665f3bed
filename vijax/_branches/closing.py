"""Whether a branch has come back to where it was, and how often a cycle is another one."""

import numpy as np

from .._orbits.sequence import Sequence
from .batched_steps import STRAIGHT
from .kernels import KernelCall, locate_start, trimmed
from .parameter_family import ExtendedCycle
from .point import Asked, BranchPoint, Walk, on_plane

# A cycle this near to another is that one; the same state of a cycle that is another one several times.
_AGAIN, _SAME = 1e-8, 1e-6


def rounds_of(sequence: Sequence, place: ExtendedCycle, num_periods: int) -> Asked:
    """How often a cycle of `num_periods` forcing periods is a shorter one."""
    for n in (n for n in range(1, num_periods) if num_periods % n == 0):
        if len(sequence.kind) % (num_periods // n):
            continue
        z = yield KernelCall(locate_start, sequence, (place, np.asarray(float(n))))
        if np.abs(z - place.z).max() < _SAME:
            return num_periods // n
    return 1


def is_at_start(walk: Walk, start: BranchPoint, point: BranchPoint, new: BranchPoint) -> Asked:
    """Whether the step from a point to a new one comes back to the start."""
    same = np.array_equal(start.sequence.kind, point.sequence.kind) and np.array_equal(
        start.sequence.stop, point.sequence.stop
    )
    if not same or len(walk.points) < 4:
        return False
    tangent, ds = point.tangent, new.arc - point.arc
    s = start.place.along(tangent) - point.place.along(tangent)
    if not 0 < s <= ds or start.tangent.along(tangent) < STRAIGHT:
        return False
    seen = yield from on_plane(point, start.place, s)
    found = trimmed(seen.found.place, len(point.sequence.kind))
    away = found.moved(start.place, -1.0)
    return bool(seen.found.is_converged and np.sqrt(away.along(away)) < _AGAIN)


def first_repeated(walk: Walk, last: BranchPoint) -> Asked:
    """The number of the first point of a walk that was passed again, if its last one was passed before; else None.

    A cycle may come back some forcing periods later.
    """
    before = walk.points[:-1]
    numbers = [k for k, point in enumerate(before) if point.kind]
    for place, k in enumerate(numbers):
        old = before[k]
        if not isinstance(old, BranchPoint) or not _may_be_same(old, last):
            continue
        for n in range(int(walk.num_periods)):
            z = yield KernelCall(locate_start, last.sequence, (last.place, np.asarray(float(n))))
            if np.abs(z - old.place.z).max() < _AGAIN and (n > 0 or _is_same_way(old, last)):
                # The last as many bifurcations were the first ones again.
                return [*numbers, len(before)][-place - 1]
    return None


def _may_be_same(old: BranchPoint, new: BranchPoint) -> bool:
    """Whether two points may be the same: a grazing of one sequence is none of another, as near as it may be."""
    is_near = old.kind == new.kind and abs(old.place.p - new.place.p) < _AGAIN
    return bool(is_near and _events(old.sequence) == _events(new.sequence))


def _events(sequence: Sequence) -> list[tuple[int, int]]:
    """What happens on a cycle, in whatever order."""
    return sorted(zip(sequence.kind.tolist(), sequence.stop.tolist(), strict=True))


def _is_same_way(old: BranchPoint, new: BranchPoint) -> bool:
    """Whether a branch passes a point in the direction in which it did; where it crosses itself it does not."""
    return bool(old.tangent.along(new.tangent) > STRAIGHT)
