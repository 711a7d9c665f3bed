"""Changes of the events of a cycle where friction or compliant contacts act."""

from typing import Any

import numpy as np

from .._hybrid.limits import IMPACT, OPEN, STICK, TURN
from .._machine.state import AHEAD, BEHIND
from .._orbits.sequence import SECOND, Sequence
from .behind_event import corrected_on_sequence, is_joined, oriented, step_off
from .kinds import Kind
from .parameter_family import ExtendedCycle
from .point import BranchEnd, BranchPoint, KernelRequests, corrected, is_followed
from .sequence_edits import with_contact, with_event, with_events_merged, with_other_kind
from .test_functions import TestFunction

# Bifurcations at which a stick, or a slip between two, has no duration.
_OF_STICKS = (Kind.CROSSING_SLIDING, Kind.GRAZING_SLIDING, Kind.SWITCHING_SLIDING, Kind.ADDING_SLIDING)
# Modes of friction that slips, each with that of the opposite direction.
_OTHER_WAY = {AHEAD: BEHIND, BEHIND: AHEAD}
# Lengths of the step off a slow impact beside friction: the machine takes one below 1e-6 for the end of a chatter.
_OFF_LIGHT = 1e-4, 1e-5, 1e-6
# Durations, in forcing periods, of a new contact behind its first touch.
_CONTACTS = 1e-4, 1e-5, 1e-3
# Time within which two events are at once, in forcing periods.
_AT_ONCE = 1e-6


def by_switching(event: BranchPoint, test: TestFunction) -> KernelRequests:
    """Continue behind an event on the new sequence; None where that changes as without friction and compliant contacts."""
    if event.kind == Kind.DOUBLE_IMPACT and not test.of_flight:
        raise BranchEnd(Kind.DOUBLE_IMPACT)  # the cycle has not yet one of the two events
    if test.kind == Kind.TOUCH:
        try:
            return (yield from _with_other_reversal(event, *_events_behind_touch(event, test.index)))
        except BranchEnd:
            return (yield from _with_contact(event, test.index))
    if test.kind == Kind.GRAZING and event.sequence.kind[test.index] == IMPACT:
        other = _events_behind_lost_impact(event, test.index)
        return (yield from _with_other_reversal(event, *other)) if other else None
    if _stops_at_impact(event.sequence, test):
        return (yield from _with_other_slip(event, test.index))
    return (yield from _with_merged_events(event, test))


def _events_behind_touch(event: BranchPoint, stop: int) -> tuple[Sequence, ExtendedCycle]:
    """The events behind a touch of a rigid stop; where friction turns the mass there, the impact does that instead."""
    sequence, place, at = event.sequence, event.place, event.seen.watched.touch_of(stop)
    is_turn = (sequence.kind == TURN) & (np.abs(np.cumsum(place.flights) - at[1]) < _AT_ONCE)
    if is_turn.any():
        return with_other_kind(sequence, int(np.argmax(is_turn)), IMPACT, stop), place
    return with_event(sequence, place, IMPACT, stop, *at)


def _events_behind_lost_impact(event: BranchPoint, k: int) -> tuple[Sequence, ExtendedCycle] | None:
    """The events behind an impact that loses its speed, where friction turns or stops the mass in its place; else None."""
    sequence, place = event.sequence, event.place
    turned = np.flatnonzero(sequence.mode[k] != sequence.mode[k + 1])
    if len(turned) != 1:
        return None
    sequence = with_other_kind(sequence, k, TURN, int(turned[0]))
    ends = k + 1 < len(sequence.kind) and sequence.stop[k + 1] == turned[0]
    stops_at_once = ends and abs(place.flights[k + 1]) < _AT_ONCE
    return with_events_merged(sequence, place, k + 1) if stops_at_once else (sequence, place)


def _with_other_reversal(event: BranchPoint, sequence: Sequence, place: ExtendedCycle) -> KernelRequests:
    """Continue behind a grazing, with or without an impact, on other events."""
    at = yield from corrected_on_sequence(sequence, place, event)
    for is_ahead in (True, False):
        try:
            new = yield from step_off(at, is_ahead, _OFF_LIGHT)
        except BranchEnd:
            continue
        if (yield from is_followed(new)):
            return new
    raise BranchEnd(Kind.GRAZING)


def _with_contact(event: BranchPoint, stop: int) -> KernelRequests:
    """Continue behind the touch of a compliant contact: it closes and opens, with a given short time between."""
    flight, time = event.seen.watched.touch_of(stop)
    for opening in (OPEN, OPEN + SECOND):
        for duration in _CONTACTS:
            sequence, place = with_contact(
                event.sequence, event.place, stop, opening, flight, (time, duration)
            )
            weights = ExtendedCycle(0 * place.z, np.eye(len(place.flights))[flight + 1], 0 * place.p)
            seen = yield from corrected(sequence, place, weights, duration)
            if not seen.found.is_converged:
                continue
            new = BranchPoint.of(sequence, seen, event.arc)
            if (yield from is_followed(new)) and (yield from is_joined(event, new)):
                return new._replace(arc=event.arc + new.place.distance_of_starts(event.place))
    raise BranchEnd(Kind.GRAZING)


def _stops_at_impact(sequence: Sequence, test: TestFunction) -> bool:
    """True if the slip from an impact to a stick loses its duration: the impact leaves no sliding velocity."""
    if not (test.of_flight and test.kind == Kind.DOUBLE_IMPACT):
        return False
    k = test.index
    is_slip = sequence.mode[k, sequence.stop[k]] in _OTHER_WAY
    return bool(sequence.kind[k - 1] == IMPACT and sequence.kind[k] == STICK and is_slip)


def _with_other_slip(event: BranchPoint, k: int) -> KernelRequests:
    """Continue behind a stick right after an impact with a slip in the other direction between the two."""
    mode, stop = event.sequence.mode.copy(), event.sequence.stop[k]
    mode[k, stop] = _OTHER_WAY[mode[k, stop]]
    sequence = event.sequence._replace(mode=mode)
    return (yield from oriented(sequence, event.place, event, lambda at: float(at.tangent.flights[k])))


def _with_merged_events(event: BranchPoint, test: TestFunction) -> KernelRequests:
    """Continue behind two events of one element that meet, without them, or with one event in their place."""
    sequence, k = event.sequence, test.index
    if test.kind == Kind.GRAZING:
        k = later_of_meeting(event, k)
    elif not (test.of_flight and test.kind in _OF_STICKS):
        raise BranchEnd(test.kind)  # an event appears, or two elements switch at once
    stop, num = int(sequence.stop[k]), sequence.mode.shape[1]
    at = yield from corrected_on_sequence(*with_events_merged(sequence, event.place, k), event)
    rates, least = at.seen.rates, at.seen.watched.force
    guard = min((stop, stop + num), key=lambda j: abs(least[j]))
    rates_of: dict[str, Any] = {
        Kind.CROSSING_SLIDING: rates.speeds[k - 1],
        Kind.SWITCHING_SLIDING: rates.force[guard],
        Kind.ADDING_SLIDING: rates.force[guard],
    }
    rate = rates_of[test.kind] if test.kind in rates_of else rates.gap[stop]
    return (yield from step_off(at, float(rate) > 0))


def later_of_meeting(event: BranchPoint, k: int) -> int:
    """Number of the later of two events of one compliant contact of which `k` is one, with no time between."""
    flights, stop = np.append(event.place.flights, np.inf), np.append(event.sequence.stop, -1)
    pairs = [i for i in (k, k + 1) if i and stop[i] == stop[i - 1]]
    if not pairs:
        raise BranchEnd(Kind.GRAZING)
    return min(pairs, key=lambda i: abs(flights[i]))
