"""Location of the zeros of test functions on a step along a branch."""

from functools import partial
from itertools import compress

import numpy as np

from .bracket import Bracket, SlopedBracket, next_trial
from .kernels import CorrectedCycle
from .kinds import EndKind, Kind
from .margin_sizes import Sizes
from .pitchfork import is_listed, pitchfork_at_fold, with_kind_of_crossing
from .point import BranchPoint, DirectedBranch, End, between, on_plane
from .requests import Requests
from .singular import branch_point, end_of_doubled
from .test_functions import (
    TESTS_OF_NEIGHBOURS,
    TestFunction,
    is_between_events,
    is_crossed,
    kind_at,
    num_on_circle,
    num_unstable,
)
from .tolerances import AT_BIFURCATION, HALF_DIGITS, JUST_BEFORE, LARGE_MULTIPLIER, NEGLIGIBLE

# Kinds of points at which the functions of folds and of branch points may both change sign.
_WITH_CROSSING = Kind.FOLD, Kind.HALF_PERIOD, Kind.PITCHFORK


def first_event(
    point: BranchPoint, new: BranchPoint, met: list[TestFunction], sizes: Sizes
) -> Requests[tuple[tuple[TestFunction, BranchPoint] | None, BranchPoint] | End]:
    """The first of the events of a step, or None; and the point just before it, or the end of the step.

    An `End` if no zero of a test function is there, where several change sign.
    """
    first, before = None, new
    # Where an impact loses its speed a least gap vanishes as well, over a whole interval: the impact is the event. So it is
    # where the impact ends a slip whose speed it has.
    order = lambda test: (is_between_events(test), _share(test.of(point.cycle), test.of(new.cycle)))  # noqa: E731
    for test in sorted(met, key=order):
        if test.of(before.cycle) <= 0:  # else it comes after the first so far, or with it
            event = yield from locate(point, before, test)
            if isinstance(event, End):
                return event
            # The functions of other events may jump behind the first.
            least = 0.0 if is_between_events(test) else HALF_DIGITS * sizes.of_test(test, point.sequence)
            if len(met) > 1 and not abs(test.of(event.cycle)) < max(NEGLIGIBLE * test.of(point.cycle), least):
                return End(EndKind.NOT_CONVERGED)
            first, before = (test, event), (yield from _just_before(point, event))
    return first, before


def is_passed(test: TestFunction, point: BranchPoint, sizes: Sizes) -> bool:
    """True if the guard of a test function has vanished before a point, by more than rounding."""
    least = HALF_DIGITS * sizes.of_test(test, point.sequence)
    return is_between_events(test) and bool(test.of(point.cycle) < -least)


def _share(before: float, after: float) -> float:
    return before / (before - after) if np.isfinite(before - after) else 1.0


def locate(point: BranchPoint, new: BranchPoint, test: TestFunction) -> Requests[BranchPoint | End]:
    """The point between two others at which a test function vanishes."""
    length, at = new.arc - point.arc, partial(_point_at, point, new, test)
    if test.rate is not None:
        ends = [(s, test.of(end.cycle), _slope(test, point, end)) for s, end in ((0.0, point), (length, new))]
        if ends[1][1] == 0:
            return new._replace(kind=kind_at(test, new.sequence, new.cycle))
        if ends[0][1] > 0:
            sloped, best = SlopedBracket.between(*ends), new
            while (s := sloped.next) is not None:
                best = yield from at(s)
                if isinstance(best, End):
                    return best
                sloped = sloped.narrowed(test.of(best.cycle), _slope(test, point, best))
            if not sloped.is_flat:
                return best._replace(kind=kind_at(test, best.sequence, best.cycle))
    bracket = Bracket.between(test.of(point.cycle), test.of(new.cycle), length)
    best = new
    while (s := next_trial(bracket)) is not None:
        best = yield from at(s)
        if isinstance(best, End):
            return best
        bracket = bracket.narrowed(s, test.of(best.cycle))
    return best._replace(kind=kind_at(test, best.sequence, best.cycle))


def _point_at(
    point: BranchPoint, new: BranchPoint, test: TestFunction, s: float
) -> Requests[BranchPoint | End]:
    """The point between two others in the plane at a distance from the first."""
    cycle = yield from on_plane(point, between(point, new, s / (new.arc - point.arc)), s)
    if not cycle.found.is_converged:
        return End(EndKind.NOT_CONVERGED)
    return BranchPoint.of(point.sequence, cycle, point.arc + s, kind=test.kind)


def _slope(test: TestFunction, point: BranchPoint, at: BranchPoint) -> float:
    """Rate of a test function by the distance from the plane of a point."""
    return test.rate(at.cycle) / at.tangent.along(point.tangent) if test.rate else np.nan


def _just_before(point: BranchPoint, event: BranchPoint) -> Requests[BranchPoint]:
    """The point just before a change of the sequence, at which multipliers may be infinite."""
    s = event.arc - point.arc - JUST_BEFORE
    if s <= JUST_BEFORE:
        return point
    cycle = yield from on_plane(point, event.place, s)
    return BranchPoint.of(point.sequence, cycle, point.arc + s)


def special_points(
    walk: DirectedBranch, point: BranchPoint, new: BranchPoint
) -> Requests[tuple[list[BranchPoint], bool] | End]:
    """Bifurcations on a step, in order, and whether the number of unstable multipliers implies no more of them."""
    found, change = [], 0
    is_infinite = _passes_infinity(*(complex(at.cycle.found.multipliers[0]) for at in (point, new)))
    crossed = is_crossed(point.cycle.neighbours, new.cycle.neighbours)
    for test in compress(TESTS_OF_NEIGHBOURS, crossed):
        if test.kind in (Kind.PERIOD_DOUBLING, Kind.BRANCH_POINT) and is_infinite:
            continue
        if test.kind == Kind.BRANCH_POINT and any(at.kind in _WITH_CROSSING for at in found):
            continue
        at = yield from (branch_point if test.kind == Kind.BRANCH_POINT else locate)(point, new, test)
        if isinstance(at, End):
            return at
        if not _is_there(test, at.cycle):
            continue
        if test.kind in (Kind.FOLD, Kind.BRANCH_POINT):
            at = yield from _named(walk, point, at)
            if isinstance(at, End):
                return at
        if not is_listed(walk, at):
            change += _change_of_stability(test.kind, at.kind)
            found.append(at)
    is_whole = (num_unstable(new.cycle) - num_unstable(point.cycle) - change) % 2 == 0
    return sorted(found, key=lambda at: at.arc), bool(is_whole) and not _is_hidden(point, found)


def _named(walk: DirectedBranch, point: BranchPoint, at: BranchPoint) -> Requests[BranchPoint | End]:
    """A fold or a branch point behind a point, or what else it is: the end of a doubled branch, or a pitchfork."""
    if walk.rounds % 2:
        end = yield from end_of_doubled(walk.num_periods, at)
        if end is not None:
            return end
    if at.kind == Kind.BRANCH_POINT:
        return (yield from with_kind_of_crossing(walk, at))
    return (yield from pitchfork_at_fold(walk, point, at)) or at


def _change_of_stability(seen_as: str, kind: str) -> int:
    """Number of multipliers that leave the unit circle at a bifurcation, or enter it, from the kind of its test function."""
    if kind == Kind.PITCHFORK and seen_as == Kind.FOLD:
        return 0  # behind it comes the mirror image, which is as stable
    changes: dict[str, int] = {Kind.NEIMARK_SACKER: 2, Kind.HALF_PERIOD: 0}
    return changes.get(kind, 1)


def _is_hidden(point: BranchPoint, found: list[BranchPoint]) -> bool:
    """True if a bifurcation lies between a point and the end of a doubled branch: behind it the step has its mirror image."""
    end = next((at for at in found if at.kind == Kind.HALF_PERIOD), None)
    if end is None:
        return False
    kinds = {Kind.PERIOD_DOUBLING, Kind.NEIMARK_SACKER} - {at.kind for at in found}
    tests = [test for test in TESTS_OF_NEIGHBOURS if test.kind in kinds]
    return any(is_crossed(test.of(point.cycle), test.of(end.cycle)) for test in tests)


def _passes_infinity(before: complex, after: complex) -> bool:
    """True if the largest multiplier passes infinity, where functions of multipliers change sign as well."""
    is_large = min(abs(before), abs(after)) > LARGE_MULTIPLIER
    return bool(is_large and np.sign(before.real) != np.sign(after.real))


def _is_there(test: TestFunction, cycle: CorrectedCycle) -> bool:
    """True if multipliers confirm a zero: a test function changes sign also where a multiplier is infinite."""
    mu = cycle.found.multipliers
    if test.kind == Kind.NEIMARK_SACKER:
        return num_on_circle(mu) > 0
    wanted: dict[str, int] = {Kind.PERIOD_DOUBLING: -1, Kind.BRANCH_POINT: 1}
    return test.kind not in wanted or bool(np.any(np.abs(mu - wanted[test.kind]) < AT_BIFURCATION))
