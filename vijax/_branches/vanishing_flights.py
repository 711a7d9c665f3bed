"""Where a hop between two holds vanishes.

A stop lets its mass go for so short a while that it has hardly left when it is held again: the force by which it was
held touches zero. Seen from there the time of landing is a double root, and no step leads nearer; but the cycle
without the hop, whose mass is held all the time, is as well-conditioned there as anywhere.
"""

from collections.abc import Iterator

import numpy as np

from .._orbits.sequence import Sequence
from .._trajectory.event_log import IMPACT, RELEASE
from .degenerate_grazing import vanishing
from .parameter_family import ExtendedCycle
from .point import Asked, BranchPoint, at_parameter
from .test_functions import Test

# Hops as short as this, in forcing periods, may vanish close by; the cycle without it is this near.
_SHORT, _NEAR = 5e-2, 1e-2


def end_of_vanishing_flight(point: BranchPoint, flight: int | None = None) -> Asked:
    """The point close to another where the force touches zero, with the sequence without the hop; None if there is none.

    Args:
        point: of the branch with the hop.
        flight: the hop; any that is short if left out.
    """
    for stop, sequence, place in _without_hops(point, flight):
        seen = yield from at_parameter(sequence, place, float(place.p))
        if not seen.found.is_converged or np.abs(seen.found.place.z - place.z).max() > _NEAR:
            continue
        start = BranchPoint.of(sequence, seen, point.arc)
        found = yield from vanishing(start, "force_zero", stop)
        if found is not None:
            return found
    return None


def hop_that_ends(test: Test, event: BranchPoint) -> Asked:
    """The point where a hop vanishes, if that is what makes an impact lose its speed, or a mass not leave; else None."""
    watched, k = event.seen.watched, test.index
    if test.kind == "gr":
        return (yield from end_of_vanishing_flight(event, k))
    if test.kind in ("onset", "touch"):
        flights = watched.rise_flight if test.kind == "onset" else watched.gap_flight
        return (yield from end_of_vanishing_flight(event, int(flights[k])))
    return None


def _without_hops(point: BranchPoint, flight: int | None) -> Iterator[tuple[int, Sequence, ExtendedCycle]]:
    """The stop of each short hop, the shortest first, and the cycle without it."""
    sequence, durations = point.sequence, _durations(point)
    num = len(durations)
    for k in np.argsort(durations) if flight is None else [flight % max(num, 1)]:
        last = _end_of_hop(point, int(k)) if num and durations[k] < _SHORT else None
        if last is not None:
            shorter = _held_from_the_start(point, last) if k == 0 else _held(point, int(k), last)
            yield int(sequence.stop[k]), *shorter


def _durations(point: BranchPoint) -> np.ndarray:
    """How long after the event before it each event comes, the last one before the first."""
    durations = np.array(point.place.flights)
    durations[:1] += point.seen.watched.last
    return durations


def _end_of_hop(point: BranchPoint, k: int) -> int | None:
    """The last impact of the hop that ends with an impact `k`, after which its mass is held; None if that ends none."""
    sequence, num = point.sequence, len(point.sequence.kind)
    stop, before = sequence.stop[k], (k - 1) % num
    if before == k or sequence.held[k, stop] or sequence.stop[before] != stop:
        return None
    if sequence.kind[before] != RELEASE and not point.seen.watched.is_plastic[stop]:
        return None
    for last in range(k, num):
        if sequence.kind[last] != IMPACT or sequence.stop[last] != stop:
            return None
        if sequence.held[last + 1, stop]:
            return last
    return None


def _held(point: BranchPoint, k: int, last: int) -> tuple[Sequence, ExtendedCycle]:
    """The cycle whose mass is held from the event before `k` on, or all the time if that is a release."""
    sequence, flights = point.sequence, point.place.flights
    is_release = int(sequence.kind[k - 1] == RELEASE)
    gone = np.arange(k - is_release, last + 1)
    left = np.delete(flights, gone)
    if last + 1 < len(flights):
        left[gone[0]] += flights[gone].sum()
    held = np.delete(sequence.held, gone + is_release, axis=0)
    shorter = Sequence(np.delete(sequence.kind, gone), np.delete(sequence.stop, gone), held)
    return shorter, point.place._replace(flights=left)


def _held_from_the_start(point: BranchPoint, last: int) -> tuple[Sequence, ExtendedCycle]:
    """The same of a hop from the last event of the cycle over its start."""
    sequence, flights = point.sequence, point.place.flights
    num = len(flights)
    end = num - int(sequence.kind[-1] == RELEASE)
    kept, left = slice(last + 1, end), flights[last + 1 : end].copy()
    left[:1] += flights[: last + 1].sum()
    held = sequence.held[last + 1 : end + 1].copy()
    held[-1] = held[0]
    return Sequence(sequence.kind[kept], sequence.stop[kept], held), point.place._replace(flights=left)
