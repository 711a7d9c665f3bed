"""Changes of the events of a cycle where friction or compliant contacts act."""

from typing import Any

import numpy as np

from .._hybrid.limits import IMPACT, OPEN, STICK, TURN
from .._machine.state import AHEAD, BEHIND, SPRING
from .._orbits.sequence import SECOND, Sequence
from .behind_event import (
    corrected_on_sequence,
    followed_beside,
    oriented,
    step_off,
    vanishing_with,
    with_earlier_impacts,
)
from .kernels import torn_margins
from .kinds import Kind
from .parameter_family import ExtendedCycle
from .point import BranchPoint, End, corrected, is_followed
from .requests import KernelCall, Requests, ask
from .sequence_edits import (
    with_contact,
    with_event,
    with_events_merged,
    with_other_kind,
    with_slip,
)
from .test_functions import TestFunction, is_between_events
from .tolerances import (
    CORNER_NEAR,
    EVENTS_AT_ONCE,
    NEW_CONTACTS,
    STEP_OFF_LIGHT,
    TRIALS_AHEAD,
    VANISHES_TOGETHER,
)

# Bifurcations at which a stick, or a slip between two, has no duration.
_OF_STICKS = (Kind.CROSSING_SLIDING, Kind.GRAZING_SLIDING, Kind.SWITCHING_SLIDING, Kind.ADDING_SLIDING)
# Modes of friction that slips, each with that of the opposite direction.
_OTHER_WAY = {AHEAD: BEHIND, BEHIND: AHEAD}


def by_switching(event: BranchPoint, test: TestFunction) -> Requests[BranchPoint | End | None]:
    """Continue behind an event on the new sequence; None where that changes as without friction and compliant contacts."""
    if _is_of_slider(event.sequence, test):
        return End(test.kind)  # the machine tells what follows
    if test.kind == Kind.IN_IMPACT:
        return End(test.kind) if test.of_flight else (yield from _past_impact(event, test))
    if event.kind in (Kind.DOUBLE_IMPACT, Kind.TEAR) and not test.of_flight:
        return (yield from _with_slips(event, test))
    together = vanishing_with(event, test)
    if test.kind == Kind.TOUCH:
        new = yield from _with_impacts(event, together)
        return new if isinstance(new, BranchPoint) else (yield from _with_contacts(event, together))
    if test.kind == Kind.GRAZING and event.sequence.kind[test.index] == IMPACT:
        other = _events_behind_lost_impacts(event, together)
        return (yield from _with_other_reversal(event, *other)) if other else None
    if _stops_at_impact(event.sequence, test):
        return (yield from _with_other_slip(event, test.index))
    return (yield from _with_merged_events(event, test, together))


def _past_impact(event: BranchPoint, test: TestFunction) -> Requests[BranchPoint | End]:
    """Continue behind an impact in which friction begins or ceases to stick, with the same events.

    The branch has a corner there: behind it, it may go on or come back.
    """
    tangent, along = event.tangent, event.place.along(event.tangent)
    for side in (1, -1):
        for ds in TRIALS_AHEAD:
            guess = event.place.moved(tangent, ds)
            seen = yield from corrected(event.sequence, guess, tangent, along + side * ds)
            new = BranchPoint.of(event.sequence, seen, event.arc + ds)
            is_near = seen.found.is_converged and new.place.distance(event.place) < CORNER_NEAR * ds
            if is_near and test.of(seen) < 0 and (yield from is_followed(new)):
                return new if side > 0 else new.turned()
    return End(test.kind)


def _is_of_slider(sequence: Sequence, test: TestFunction) -> bool:
    """True for an event of a Jenkins element, alone or with another one."""
    k, num = test.index, sequence.mode.shape[1]
    events = () if is_between_events(test) else (k - 1, k) if test.of_flight else (k,)
    elements = [sequence.stop[i] for i in events] or [k % num]
    return bool((sequence.mode[:, elements] == SPRING).any())


def _with_slips(event: BranchPoint, test: TestFunction) -> Requests[BranchPoint | End]:
    """Continue behind a point where friction that an event tears off slips of itself, just before it or behind it.

    In all rounds of a symmetric cycle at once.
    """
    if test.least == "gap":
        return End(Kind.DOUBLE_IMPACT)  # the cycle has not yet one of the two events
    left, excess = yield from ask(KernelCall(torn_margins, event.sequence, (event.place,)))
    is_behind = test.kind == Kind.TEAR
    sequence, place, new = event.sequence, event.place, []
    torn = np.argwhere(
        np.abs(excess if is_behind else left)[: len(sequence.kind)] < VANISHES_TOGETHER
    ).tolist()
    for k, element in torn:
        sequence, place = with_slip(sequence, place, k + len(new), element, is_behind=is_behind)
        new.append(k + len(new) + 1)
    if not new:
        return End(Kind.DOUBLE_IMPACT)
    return (yield from oriented(sequence, place, event, lambda at: float(at.tangent.flights[new].sum())))


def _with_impacts(event: BranchPoint, stops: list[int]) -> Requests[BranchPoint | End]:
    """Continue behind a touch of rigid stops."""
    sequence, place, impacts = events_behind_touches(event, stops)
    if len(stops) == 1:
        return (yield from _with_other_reversal(event, sequence, place))
    new = yield from with_earlier_impacts(event, sequence, place, impacts)
    return End(Kind.GRAZING) if new is None else new


def events_behind_touches(event: BranchPoint, stops: list[int]) -> tuple[Sequence, ExtendedCycle, list[int]]:
    """The events behind a touch of rigid stops, and the numbers of the new impacts; one replaces friction's turn there."""
    sequence, place, impacts = event.sequence, event.place, []
    for (flight, time), stop in sorted((event.seen.watched.touch_of(stop), stop) for stop in stops)[::-1]:
        turns = (sequence.kind == TURN) & (np.abs(np.cumsum(place.flights) - time) < EVENTS_AT_ONCE)
        if turns.any():
            impact = int(np.argmax(turns))
            sequence = with_other_kind(sequence, impact, IMPACT, stop)
        else:
            impact, impacts = flight, [k + 1 for k in impacts]
            sequence, place = with_event(sequence, place, IMPACT, stop, flight, time)
        impacts.append(impact)
    return sequence, place, impacts


def _events_behind_lost_impacts(event: BranchPoint, lost: list[int]) -> tuple[Sequence, ExtendedCycle] | None:
    """The events behind impacts that lose their speed, where friction turns or stops the mass in their place; else None."""
    sequence, place = event.sequence, event.place
    for k in lost[::-1]:
        turned = np.flatnonzero(sequence.mode[k] != sequence.mode[k + 1])
        if len(turned) != 1:
            return None
        sequence = with_other_kind(sequence, k, TURN, int(turned[0]))
        ends = k + 1 < len(sequence.kind) and sequence.stop[k + 1] == turned[0]
        if ends and abs(place.flights[k + 1]) < EVENTS_AT_ONCE:  # it stops at once
            sequence, place = with_events_merged(sequence, place, k + 1)
    return sequence, place


def _with_other_reversal(
    event: BranchPoint, sequence: Sequence, place: ExtendedCycle
) -> Requests[BranchPoint | End]:
    """Continue behind a grazing, with or without an impact, on other events."""
    at = yield from corrected_on_sequence(sequence, place, event)
    if isinstance(at, End):
        return at
    for is_ahead in (True, False):
        new = yield from step_off(at, is_ahead, STEP_OFF_LIGHT)
        if isinstance(new, BranchPoint) and (yield from is_followed(new)):
            return new
    return End(Kind.GRAZING)


def _with_contacts(event: BranchPoint, stops: list[int]) -> Requests[BranchPoint | End]:
    """Continue behind the touch of compliant contacts: each closes and opens, with a given short time between."""
    touches = sorted((event.seen.watched.touch_of(stop), stop) for stop in stops)[::-1]
    for opening in (OPEN, OPEN + SECOND):
        for duration in NEW_CONTACTS:
            sequence, place = event.sequence, event.place
            lasts = 0 * place.flights
            for (flight, time), stop in touches:
                sequence, place = with_contact(sequence, place, stop, opening, flight, (time, duration))
                lasts = np.insert(lasts, flight, [0.0, 1.0])
            weights = ExtendedCycle(0 * place.z, lasts, 0 * place.p)
            new = yield from followed_beside(event, sequence, place, weights)
            if new is not None:
                return new
    return End(Kind.GRAZING)


def _stops_at_impact(sequence: Sequence, test: TestFunction) -> bool:
    """True if the slip from an impact to a stick loses its duration: the impact leaves no sliding velocity."""
    if not (test.of_flight and test.kind == Kind.DOUBLE_IMPACT):
        return False
    k = test.index
    is_slip = sequence.mode[k, sequence.stop[k]] in _OTHER_WAY
    return bool(sequence.kind[k - 1] == IMPACT and sequence.kind[k] == STICK and is_slip)


def _with_other_slip(event: BranchPoint, k: int) -> Requests[BranchPoint | End]:
    """Continue behind a stick right after an impact with a slip in the other direction between the two."""
    mode, stop = event.sequence.mode.copy(), event.sequence.stop[k]
    mode[k, stop] = _OTHER_WAY[mode[k, stop]]
    sequence = event.sequence._replace(mode=mode)
    return (yield from oriented(sequence, event.place, event, lambda at: float(at.tangent.flights[k])))


def _with_merged_events(
    event: BranchPoint, test: TestFunction, together: list[int]
) -> Requests[BranchPoint | End]:
    """Continue behind two events of one element that meet, without them, or with one event in their place.

    Pairs that meet `together` with them are merged as well.
    """
    sequence, place, k = event.sequence, event.place, test.index
    if test.kind == Kind.GRAZING:
        later = [later_of_meeting(event, one) for one in (k, *together)]
        if None in later:
            return End(Kind.GRAZING)
        k, *together = (one for one in later if one is not None)
    elif not (test.of_flight and test.kind in _OF_STICKS):
        return End(test.kind)  # an event appears, or two elements switch at once
    stop, num = int(sequence.stop[k]), sequence.mode.shape[1]
    for one in sorted({*together})[::-1]:
        sequence, place = with_events_merged(sequence, place, one)
    at = yield from corrected_on_sequence(sequence, place, event)
    if isinstance(at, End):
        return at
    rates, least = at.seen.rates, at.seen.watched.force
    guard = min((stop, stop + num), key=lambda j: abs(least[j]))
    rates_of: dict[str, Any] = {
        Kind.CROSSING_SLIDING: rates.speeds[k - 1],
        Kind.SWITCHING_SLIDING: rates.force[guard],
        Kind.ADDING_SLIDING: rates.force[guard],
    }
    rate = rates_of[test.kind] if test.kind in rates_of else rates.gap[stop]
    return (yield from step_off(at, float(rate) > 0))


def later_of_meeting(event: BranchPoint, k: int) -> int | None:
    """Number of the later of two events of one compliant contact of which `k` is one, with no time between; None if it has none."""
    flights, stop = np.append(event.place.flights, np.inf), np.append(event.sequence.stop, -1)
    pairs = [i for i in (k, k + 1) if i and stop[i] == stop[i - 1]]
    return min(pairs, key=lambda i: abs(flights[i]), default=None)
