"""Defining system of a bifurcation that was found on a branch."""

from collections.abc import Iterable

import numpy as np

from .._hybrid.limits import CLOSE, IMPACT, RELEASE, SLIP
from .._orbits.sequence import SECOND, Sequence
from .branch import Bifurcation, Peak, cycle_of
from .defining_systems import (
    AbstractCondition,
    AtBranchPoint,
    AtEvent,
    AtGrip,
    AtMultiplier,
    AtTurn,
    DefiningSystem,
)
from .kernels import CorrectedCycle
from .kinds import MONITOR, Kind, public_kind
from .padding import padded, room_for
from .parameter_family import ExtendedCycle, ParameterFamily
from .peak_setup import peak_condition
from .point import BranchPoint, correct_with_free_parameter
from .scheduler import drive
from .sequence_edits import with_event, with_events_merged, with_slip_behind
from .starts import Start, family_of, starting_orbits
from .test_functions import TestFunction, grips, kind_at, tests_of
from .tolerances import AT_BIFURCATION, ROUNDED, ROUNDED_BY_TYPE

_NO_SYSTEM: dict[str, str] = {
    Kind.CHATTER_COMPLETION: 'Where a chatter is completed infinitely many changes meet: take one of them, of a kind "gr" '
    'or "fold".',
}


def defining_system_of(point: Bifurcation, low: float, high: float) -> tuple[DefiningSystem, ExtendedCycle]:
    """Padded defining system of a bifurcation, and its cycle; the scale of the parameter is `high - low`.

    Raises:
        ValueError: for the kind "chatter_completion" and for zeros of monitors.
    """
    if point.kind in _NO_SYSTEM:
        raise ValueError(_NO_SYSTEM[point.kind])
    if point.kind.startswith(MONITOR):
        raise ValueError(
            f"The point is a zero of a monitor, {point.kind!r}, and has no curve or value: take one of `branch.bifurcations`."
        )
    _, family, sequence, place = family_at(point, low, high)
    if isinstance(point, Peak):
        if point.event:
            raise ValueError(
                f"The quantity has a kink at this peak, where the branch has a {point.event!r}: take that point of `branch.bifurcations`."
            )
        condition = peak_condition(family, sequence, place, point.quantity)
    elif point.kind in (Kind.FOLD, Kind.PERIOD_DOUBLING, Kind.NEIMARK_SACKER):
        condition = _at_multiplier(point)
    elif point.kind in (Kind.BRANCH_POINT, Kind.PITCHFORK):
        size = len(place.z)
        condition = AtBranchPoint(np.zeros(1), np.zeros(size), np.zeros((2, size + 1)))
    else:
        condition, sequence, place = _at_event(family, point.kind, sequence, place)
    sequence, place = padded(sequence, (place,), room_for(len(sequence.kind)))
    return DefiningSystem(family, sequence, condition), place


def family_at(
    point: Bifurcation, low: float, high: float
) -> tuple[Start, ParameterFamily, Sequence, ExtendedCycle]:
    """Orbit of a point, the family of its machines between two parameter values, and its cycle in their scale."""
    if point.branch.points.attrs["num_periods"] == 0:
        raise ValueError(
            "Curves, values and other branches of a bifurcation are found for machines with a load: this cycle has none. Follow "
            "it by `vx.continuation` at several values of a second parameter."
        )
    (start,) = starting_orbits(point.orbit)
    start = start._replace(is_admissible=True)
    family = family_of(start, point.branch.path, low, high)
    return start, family, *cycle_of(point, family.scale, point.value / float(family.span))


def _at_multiplier(point: Bifurcation) -> AbstractCondition:
    multipliers = point.branch.points["multipliers"].values[point.index]
    away = np.abs(multipliers + 1) if point.kind == Kind.PERIOD_DOUBLING else np.abs(np.abs(multipliers) - 1)
    if point.kind == Kind.PERIOD_DOUBLING and not away.min() < AT_BIFURCATION:
        raise ValueError(
            "The orbit of this point is another one twice: take the period doubling on the branch of that one."
        )
    # The angle of a pair is that of its multiplier above the real axis.
    angle = np.angle(multipliers[np.argmin(np.where(multipliers.imag > 0, away, np.inf))])
    thetas: dict[str, float] = {Kind.FOLD: 0.0, Kind.PERIOD_DOUBLING: np.pi}
    theta = thetas.get(point.kind, angle)
    return AtMultiplier(np.array([theta]), np.zeros((2, len(multipliers)), complex))


def _at_event(
    family: ParameterFamily, kind: str, sequence: Sequence, place: ExtendedCycle
) -> tuple[AbstractCondition, Sequence, ExtendedCycle]:
    if kind == Kind.CROSSING_SLIDING and family.has_tied_friction:
        condition = _at_grip(family, sequence, place)
        if condition is not None:
            return condition, sequence, place
    sequence, place, k, is_tangent = with_bifurcation_event(family, kind, sequence, place)
    if kind == Kind.CROSSING_SLIDING:
        return AtTurn(np.zeros(0), np.asarray(k)), sequence, place
    return AtEvent(np.zeros(0), np.asarray(k), np.asarray(is_tangent)), sequence, place


def _corrected(family: ParameterFamily, sequence: Sequence, place: ExtendedCycle) -> CorrectedCycle:
    (cycle,) = drive([family], [correct_with_free_parameter(sequence, place)], lambda: None)
    return cycle


def _at_grip(family: ParameterFamily, sequence: Sequence, place: ExtendedCycle) -> AtGrip | None:
    """Condition that friction just stops within an impact; None unless it does."""
    cycle = _corrected(family, sequence, place)
    left = np.abs(grips(sequence, cycle))
    others = [
        abs(test.of(cycle))
        for test in tests_of(sequence)
        if kind_at(test, sequence, cycle) == Kind.CROSSING_SLIDING
    ]
    if np.isnan(left).all() or np.nanmin(left) > min(others, default=np.inf):
        return None
    k, j = divmod(int(np.nanargmin(left)), sequence.mode.shape[1])
    return AtGrip(np.zeros(0), np.asarray(k), np.asarray(j))


def with_bifurcation_event(
    family: ParameterFamily, kind: str, sequence: Sequence, place: ExtendedCycle
) -> tuple[Sequence, ExtendedCycle, int, bool]:
    """Cycle with the event of the bifurcation, which has a duration; its number, and whether its value has zero rate."""
    cycle, num = _corrected(family, sequence, place), sequence.mode.shape[1]
    tests = [test for test in tests_of(sequence) if public_kind(kind_at(test, sequence, cycle)) == kind]
    test = _vanishing(tests, sequence, cycle)
    k, watched = test.index, cycle.watched
    if test.kind == Kind.TEAR:
        flight = int(watched.rise_flight[k])
        return *with_slip_behind(sequence, place, flight - 1, k), flight, False
    if not (test.least or test.of_flight) and (kind == Kind.CROSSING_SLIDING or sequence.kind[k] == IMPACT):
        return sequence, place, k, kind == Kind.GRAZING
    if not test.least:
        meeting = k if test.of_flight else _later_of_meeting(BranchPoint.of(sequence, cycle, 0.0), k)
        if meeting is None:
            raise ValueError(
                "No two events of the contact meet at this point: begin at another bifurcation of the branch."
            )
        if kind == Kind.DOUBLE_IMPACT:
            return sequence, place, meeting, False
        return with_bifurcation_event(family, kind, *with_events_merged(sequence, place, meeting))
    flight, time = (
        int(getattr(watched, test.least + "_flight")[k]),
        float(getattr(watched, test.least + "_time")[k]),
    )
    events = (IMPACT, RELEASE) if sequence.num_groups == 1 else (CLOSE, SLIP)
    event = events[test.least == "force"] + SECOND * (k >= num)
    sequence, place = with_event(sequence, place, event, k % num, flight, time)
    is_later = bool(place.flights[flight] > ROUNDED_BY_TYPE[str(place.flights.dtype)])
    if kind == Kind.DOUBLE_IMPACT:
        # A guard that another event cuts off vanishes at the beginning of its flight, or at the end.
        return sequence, place, flight + is_later, False
    return sequence, place, flight, is_later


def _vanishing(tests: Iterable[TestFunction], sequence: Sequence, cycle: CorrectedCycle) -> TestFunction:
    """The test function that vanishes: a grazing impact is also a touch, with a gap of exactly zero, and takes precedence."""
    light = ROUNDED * np.abs(cycle.start[len(cycle.start) // 2 :]).max()
    impacts = [
        test
        for test in tests
        if test.kind == Kind.GRAZING and sequence.kind[test.index] == IMPACT and abs(test.of(cycle)) < light
    ]
    return min(impacts or tests, key=lambda test: abs(test.of(cycle)))


def _later_of_meeting(event: BranchPoint, k: int) -> int | None:
    """Number of the later of two events of one compliant contact of which `k` is one, with no time between; None if it has none."""
    flights, stop = np.append(event.place.flights, np.inf), np.append(event.sequence.stop, -1)
    pairs = [i for i in (k, k + 1) if i and stop[i] == stop[i - 1]]
    return min(pairs, key=lambda i: abs(flights[i]), default=None)
