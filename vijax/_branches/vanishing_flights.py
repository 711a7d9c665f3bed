"""Points at which a hop between two sticks vanishes.

A stop releases its mass for so short a while that it has hardly left when it sticks again: the contact force touches
zero. On the branch with the hop the time of landing is a double root there, and no step leads nearer. The cycle without
the hop, whose mass is held throughout, is as well-conditioned there as anywhere.
"""

from collections.abc import Iterator

import numpy as np

from .._hybrid.limits import IMPACT, RELEASE
from .._orbits.sequence import Sequence
from .degenerate_grazing import vanishing
from .kinds import Kind
from .parameter_family import ExtendedCycle
from .point import BranchPoint, at_parameter, correct_with_free_parameter
from .requests import Requests
from .sequence_edits import exchanged, letters_between
from .test_functions import TestFunction
from .tolerances import DOUBLE_ROOT, LOCATED, NEAR, SHORT_HOP


def end_of_vanishing_flight(point: BranchPoint, flight: int | None = None) -> Requests[BranchPoint | None]:
    """The point without a hop near a point with it, where the contact force touches zero; None if there is none.

    `flight` is the number of the hop; any short hop if left out.
    """
    for stop, sequence, place in _without_hops(point, flight):
        cycle = yield from at_parameter(sequence, place, float(place.p))
        if not cycle.found.is_converged:  # the parameter may be stationary where the hop vanishes
            cycle = yield from correct_with_free_parameter(sequence, place)
        if not cycle.found.is_converged or np.abs(cycle.found.place.z - place.z).max() > NEAR:
            continue
        start = BranchPoint.of(sequence, cycle, point.arc)
        found = yield from vanishing(start, Kind.FORCE_ZERO, stop)
        if found is not None:
            return found
    return None


def hop_that_ends(test: TestFunction, event: BranchPoint) -> Requests[BranchPoint | None]:
    """The point where a hop vanishes, if that makes an impact lose its speed or holds a mass back; else None."""
    watched, k = event.cycle.watched, test.index
    if test.kind == Kind.GRAZING:
        return (yield from end_of_vanishing_flight(event, k))
    if test.kind in (Kind.ONSET, Kind.TOUCH):
        flights = watched.rise_flight if test.kind == Kind.ONSET else watched.gap_flight
        return (yield from end_of_vanishing_flight(event, int(flights[k])))
    if test.kind == Kind.FORCE_ZERO:
        hops = np.where(event.sequence.stop == k, _durations(event), np.inf)
        if np.min(hops, initial=np.inf) < DOUBLE_ROOT:
            found = yield from end_of_vanishing_flight(event, int(np.argmin(hops)))
            if found is not None and abs(found.place.p - event.place.p) < LOCATED:
                return found
    return None


def _without_hops(point: BranchPoint, flight: int | None) -> Iterator[tuple[int, Sequence, ExtendedCycle]]:
    """Pairs of the stop of each short hop, the shortest first, and the cycle without the hop."""
    sequence, durations = point.sequence, _durations(point)
    num = len(durations) if sequence.num_groups == 1 or point.cycle.watched.grip is not None else 0
    for k in np.argsort(durations[:num]) if flight is None else [flight % max(num, 1)]:
        last = _end_of_hop(point, int(k)) if num and durations[k] < SHORT_HOP else None
        if last is not None:
            shorter = _held_from_the_start(point, last) if k == 0 else _held(point, int(k), last)
            yield int(sequence.stop[k]), *shorter


def _durations(point: BranchPoint) -> np.ndarray:
    """Times from each event back to the one before it, cyclically, in forcing periods, (events,)."""
    durations = np.array(point.place.flights)
    durations[:1] += point.cycle.watched.last
    return durations


def _end_of_hop(point: BranchPoint, k: int) -> int | None:
    """Number of the last impact, after which the mass is held, of the hop with flight `k`; None if that is no hop."""
    sequence, num = point.sequence, len(point.sequence.kind)
    stop, before = sequence.stop[k], (k - 1) % num
    if before == k or sequence.held[k, stop] or sequence.stop[before] != stop:
        return None
    if sequence.kind[before] != RELEASE and not point.cycle.watched.is_plastic[stop]:
        return None
    for last in range(k, num):
        if sequence.kind[last] != IMPACT or sequence.stop[last] != stop:
            return None
        if sequence.held[last + 1, stop]:
            return last
    return None


def _held(point: BranchPoint, k: int, last: int) -> tuple[Sequence, ExtendedCycle]:
    """The cycle whose mass is held from the event before `k` on, or throughout if that is a release."""
    sequence, place = point.sequence, point.place
    word, mode = letters_between(sequence, k - 1, k), letters_between(sequence, last, last + 1)[0].mode
    word = () if word[0].kind == RELEASE else (word[0]._replace(mode=mode),)
    return exchanged(sequence, place, [((k - 1, last + 1), float(place.flights[:k].sum()), word)])


def _held_from_the_start(point: BranchPoint, last: int) -> tuple[Sequence, ExtendedCycle]:
    """`_held` for a hop from the last event of the cycle over its start."""
    sequence, flights = point.sequence, point.place.flights
    num = len(flights)
    end = num - int(sequence.kind[-1] == RELEASE)
    kept, left = slice(last + 1, end), flights[last + 1 : end].copy()
    left[:1] += flights[: last + 1].sum()
    mode = sequence.mode[last + 1 : end + 1].copy()
    mode[-1] = mode[0]
    return Sequence(sequence.kind[kept], sequence.stop[kept], mode), point.place._replace(flights=left)
