"""Edits of the sequence of a cycle where an event appears, vanishes or passes another; the motion stays the same."""

import numpy as np

from .._hybrid.limits import SLIP, STICK, TURN
from .._machine.state import BEHIND, STICKING
from .._orbits.sequence import SECOND, Sequence, effective
from .parameter_family import ExtendedCycle


def are_alike(one: Sequence, other: Sequence) -> bool:
    """True if two sequences have the same events at the same stops, and the same motion between them."""
    modes = effective(one.mode), effective(other.mode)
    return all(map(np.array_equal, (one.kind, one.stop, modes[0]), (other.kind, other.stop, modes[1])))


def with_event(
    sequence: Sequence, place: ExtendedCycle, kind: int, stop: int, flight: int, time: float
) -> tuple[Sequence, ExtendedCycle]:
    """Insert an event without effect on a flight, `time` forcing periods after the start.

    It is an impact of zero speed, where a gap vanishes, or a release that frees no mass, where a force vanishes.
    """
    since = time - place.flights[:flight].sum()
    mode = np.insert(sequence.mode, flight, sequence.mode[flight], axis=0)
    flights = np.insert(place.flights, flight, since)
    if flight < len(place.flights):
        flights[flight + 1] -= since
    kinds, stops = np.insert(sequence.kind, flight, kind), np.insert(sequence.stop, flight, stop)
    return Sequence(kinds, stops, mode), place._replace(flights=flights)


def with_slip(
    sequence: Sequence, place: ExtendedCycle, k: int, element: int, *, is_behind: bool
) -> tuple[Sequence, ExtendedCycle]:
    """Let the grip of friction that event `k` tears off give way of itself, at the same time: behind the event, or before."""
    slips = sequence.mode[k + 1, element]
    mode = np.insert(sequence.mode, k + 1, sequence.mode[k + is_behind], axis=0)
    mode[k + 1, element] = STICKING if is_behind else slips
    kinds = np.insert(sequence.kind, k + is_behind, SLIP + SECOND * (slips == BEHIND))
    stops = np.insert(sequence.stop, k + is_behind, element)
    return Sequence(kinds, stops, mode), place._replace(flights=np.insert(place.flights, k + 1, 0.0))


def without_event(sequence: Sequence, place: ExtendedCycle, k: int) -> tuple[Sequence, ExtendedCycle]:
    """Remove an event without effect, such as an impact of zero speed."""
    flights = np.delete(place.flights, k)
    if k < len(flights):
        flights[k] += place.flights[k]
    mode = np.delete(sequence.mode, k + 1, axis=0)
    return Sequence(np.delete(sequence.kind, k), np.delete(sequence.stop, k), mode), place._replace(
        flights=flights
    )


def with_events_merged(sequence: Sequence, place: ExtendedCycle, k: int) -> tuple[Sequence, ExtendedCycle]:
    """Replace event `k` and the one before, of one element and at one time, by one event, or by none if both cancel."""
    stop, flights = sequence.stop[k], np.delete(place.flights, k)
    before, after = sequence.mode[k - 1, stop], sequence.mode[k + 1, stop]
    if k < len(flights):
        flights[k] += place.flights[k]
    kinds = sequence.kind.copy()
    kinds[k - 1] = STICK if after == STICKING else TURN
    kind, stops = np.delete(kinds, k), np.delete(sequence.stop, k)
    merged = Sequence(kind, stops, np.delete(sequence.mode, k, axis=0))
    merged_place = place._replace(flights=flights)
    return without_event(merged, merged_place, k - 1) if before == after else (merged, merged_place)


def with_order_exchanged(sequence: Sequence, place: ExtendedCycle, k: int) -> tuple[Sequence, ExtendedCycle]:
    """Exchange impact `k` and the one before it, at the same time."""
    order = np.arange(len(sequence.kind))
    order[[k - 1, k]] = k, k - 1
    return Sequence(sequence.kind[order], sequence.stop[order], sequence.mode), place


def in_a_row(
    rounds: list[tuple[Sequence, ExtendedCycle]], num_periods: int | float
) -> tuple[Sequence, ExtendedCycle]:
    """Concatenate cycles of `num_periods` each that all start from the same state."""
    flights, left = [], 0.0
    for _, place in rounds:
        own = place.flights.copy()
        own[:1] += left
        flights.append(own)
        left = num_periods - place.flights.sum() + (0.0 if len(own) else left)
    sequences = [sequence for sequence, _ in rounds]
    whole = Sequence(
        np.concatenate([sequence.kind for sequence in sequences]),
        np.concatenate([sequence.stop for sequence in sequences]),
        np.concatenate([*(sequence.mode[:-1] for sequence in sequences), sequences[-1].mode[-1:]]),
    )
    return whole, rounds[0][1]._replace(flights=np.concatenate(flights))


def passed_section(place: ExtendedCycle, num_periods: float) -> int:
    """Number of first events before the start of the cycle; else minus that of last events after its end."""
    times = np.cumsum(place.flights)
    return int(np.count_nonzero(times < 0)) or -int(np.count_nonzero(times > num_periods))


def shifted(
    sequence: Sequence, place: ExtendedCycle, by: int, num_periods: float, z: np.ndarray
) -> tuple[Sequence, ExtendedCycle]:
    """Move the first `by` events of a cycle to its end, or the last `-by` to its front; `z` is its new start."""
    times = np.cumsum(place.flights)
    order = np.roll(np.arange(len(times)), -by)
    times[: max(by, 0)] += num_periods
    times[len(times) + min(by, 0) :] -= num_periods
    mode = np.concatenate(
        [np.roll(sequence.mode[:-1], -by, axis=0), sequence.mode[[by]] if by > 0 else sequence.mode[[by - 1]]]
    )
    flights = np.diff(times[order], prepend=0)
    return Sequence(sequence.kind[order], sequence.stop[order], mode), place._replace(z=z, flights=flights)
