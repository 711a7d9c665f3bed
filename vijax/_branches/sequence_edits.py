"""Edits of the sequence of a cycle where an event appears, vanishes or passes another; the motion stays the same."""

from typing import NamedTuple

import numpy as np

from .._hybrid.limits import SLIP, STICK, TURN
from .._machine.state import BEHIND, STICKING
from .._orbits.sequence import SECOND, Sequence, effective
from .parameter_family import ExtendedCycle

Modes = tuple[int, ...]


def are_alike(one: Sequence, other: Sequence) -> bool:
    """True if two sequences have the same events at the same stops, and the same motion between them."""
    modes = effective(one.mode), effective(other.mode)
    return all(map(np.array_equal, (one.kind, one.stop, modes[0]), (other.kind, other.stop, modes[1])))


class Letter(NamedTuple):
    """An event: its kind, its element, and the modes of all elements behind it, as in `Sequence`."""

    kind: int
    stop: int
    mode: Modes


Word = tuple[Letter, ...]


def letters_between(sequence: Sequence, first: int, last: int) -> Word:
    """Events `first` to `last - 1` of a sequence."""
    return tuple(
        Letter(int(sequence.kind[k]), int(sequence.stop[k]), tuple(map(int, sequence.mode[k + 1])))
        for k in range(first, last)
    )


def exchanged(
    sequence: Sequence, place: ExtendedCycle, changes: list[tuple[tuple[int, int], float, Word]]
) -> tuple[Sequence, ExtendedCycle]:
    """The cycle with other letters at some instants: for each the events from first to last, its time, and the new word."""
    times, begin = np.cumsum(place.flights), 0
    kinds, stops, modes, when = [], [], [sequence.mode[:1]], [np.zeros(1)]
    for (first, last), time, word in [*changes, ((len(times), len(times)), 0.0, ())]:
        kept = slice(begin, first)
        kinds += [sequence.kind[kept], [letter.kind for letter in word]]
        stops += [sequence.stop[kept], [letter.stop for letter in word]]
        modes += [sequence.mode[1:][kept], *([letter.mode] for letter in word)]
        when += [times[kept], [time] * len(word)]
        begin = last
    whole = zip(sequence, (kinds, stops, modes), strict=True)
    new = Sequence(*(np.concatenate(parts, dtype=old.dtype, casting="unsafe") for old, parts in whole))
    return new, place._replace(flights=np.diff(np.concatenate(when)))


def with_event(
    sequence: Sequence, place: ExtendedCycle, kind: int, stop: int, flight: int, time: float
) -> tuple[Sequence, ExtendedCycle]:
    """Insert an event without effect on a flight, `time` forcing periods after the start.

    It is an impact of zero speed, where a gap vanishes, or a release that frees no mass, where a force vanishes.
    """
    event = Letter(kind, stop, tuple(map(int, sequence.mode[flight])))
    return exchanged(sequence, place, [((flight, flight), time, (event,))])


def without_event(sequence: Sequence, place: ExtendedCycle, k: int) -> tuple[Sequence, ExtendedCycle]:
    """Remove an event without effect, such as an impact of zero speed."""
    return exchanged(sequence, place, [((k, k + 1), 0.0, ())])


def with_slip_behind(
    sequence: Sequence, place: ExtendedCycle, k: int, element: int
) -> tuple[Sequence, ExtendedCycle]:
    """Let the grip of friction that event `k` tears off give way of itself, right behind the event."""
    (event,) = letters_between(sequence, k, k + 1)
    sticks = (*event.mode[:element], STICKING, *event.mode[element + 1 :])
    slip = Letter(SLIP + SECOND * (event.mode[element] == BEHIND), element, event.mode)
    time = float(place.flights[: k + 1].sum())
    return exchanged(sequence, place, [((k, k + 1), time, (event._replace(mode=sticks), slip))])


def with_events_merged(sequence: Sequence, place: ExtendedCycle, k: int) -> tuple[Sequence, ExtendedCycle]:
    """Replace event `k` and the one before, of one element and at one time, by one event, or by none if both cancel."""
    (last,) = letters_between(sequence, k, k + 1)
    before, after = sequence.mode[k - 1, last.stop], last.mode[last.stop]
    word = () if before == after else (last._replace(kind=STICK if after == STICKING else TURN),)
    return exchanged(sequence, place, [((k - 1, k + 1), float(place.flights[:k].sum()), word)])


def with_order_exchanged(sequence: Sequence, place: ExtendedCycle, k: int) -> tuple[Sequence, ExtendedCycle]:
    """Exchange impact `k` and the one before it, at the same time."""
    one, other = letters_between(sequence, k - 1, k + 1)
    word = other._replace(mode=one.mode), one._replace(mode=other.mode)
    times = np.cumsum(place.flights)
    return exchanged(
        sequence, place, [((k - 1, k), times[k - 1], word[:1]), ((k, k + 1), times[k], word[1:])]
    )


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
