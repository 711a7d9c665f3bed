"""Corners of a branch: the instants of a cycle at which margins vanish together, and the letters there.

A margin is positive while the machine follows a cycle, see `test_functions.py`. Where one vanishes, others may vanish with
it: at the same instant, as its events share it, or at another one, by a symmetry.
"""

from typing import NamedTuple

import numpy as np

from ..._orbits.sequence import Sequence
from ..margin_sizes import Sizes
from ..parameter_family import ExtendedCycle
from ..point import BranchPoint
from ..sequence_edits import Word, exchanged, letters_between
from ..test_functions import TestFunction, tests_of
from ..tolerances import HALF_DIGITS, LOCATED


class CornerInstant(NamedTuple):
    """An instant of a corner.

    Attributes:
        time: forcing periods since the start of the cycle.
        first: number of the first event at the instant, or of the flight that it lies on.
        last: number of the event behind the last one.
        elements: those whose margins vanish, and those of the events, in order.
        word: the letters before the corner.
        mode: modes of all elements before the first letter, and behind the last.
    """

    time: float
    first: int
    last: int
    elements: tuple[int, ...]
    word: Word
    mode: tuple[tuple[int, ...], tuple[int, ...]]


class CycleOnWords(NamedTuple):
    """The cycle at a corner on other words, one for each instant."""

    words: tuple[Word, ...]
    sequence: Sequence
    place: ExtendedCycle


class Corner(NamedTuple):
    """A point of a branch at which margins vanish, its instants in order, the forcing periods of its cycle, and sizes of margins."""

    event: BranchPoint
    instants: list[CornerInstant]
    num_periods: float
    sizes: Sizes

    def with_words(self, words: tuple[Word, ...]) -> CycleOnWords:
        """The cycle on other words."""
        changes = [
            ((at.first, at.last), at.time, word) for at, word in zip(self.instants, words, strict=True)
        ]
        return CycleOnWords(words, *exchanged(self.event.sequence, self.event.place, changes))


def corner_of(
    event: BranchPoint, test: TestFunction, rounds: int, num_periods: float, sizes: Sizes
) -> Corner:
    """The corner at which a margin vanishes, met in every round of a cycle that traverses a shorter one several times."""
    when, element = _place_of(test, event)
    instants: list[tuple[float, set[int]]] = [(when, {element})]
    for other in tests_of(event.sequence):
        if abs(other.of(event.cycle)) < HALF_DIGITS * sizes.of_test(other, event.sequence):
            at, own = _place_of(other, event)
            # At another instant only a margin of the same kind counts: the last bounces of a chatter are light as well.
            if abs(at - when) < LOCATED or (other.kind, other.of_flight) == (
                test.kind,
                test.of_flight,
            ):
                _add(instants, at, {own})
    for at, own in list(instants) if np.isfinite(num_periods) else ():
        for k in range(1, rounds):
            _add(instants, (at + k * num_periods / rounds) % num_periods, set(own))
    found = [_instant(event, *one) for one in sorted(instants, key=lambda one: one[0])]
    return Corner(event, found, num_periods, sizes)


def _add(instants: list[tuple[float, set[int]]], time: float, elements: set[int]) -> None:
    """Add elements to the instant at a time, or a new one."""
    for known, own in instants:
        if abs(known - time) < LOCATED:
            own |= elements
            return
    instants.append((time, elements))


def _instant(event: BranchPoint, time: float, elements: set[int]) -> CornerInstant:
    sequence, times = event.sequence, np.cumsum(event.place.flights)
    at = np.flatnonzero(np.abs(times - time) < LOCATED)
    first = int(at[0]) if len(at) else int(np.count_nonzero(times < time))
    last = int(at[-1]) + 1 if len(at) else first
    changed = np.flatnonzero(sequence.mode[first] != sequence.mode[last])
    own = elements | {int(a) for a in (*sequence.stop[first:last], *changed)}
    modes = tuple(map(int, sequence.mode[first])), tuple(map(int, sequence.mode[last]))
    return CornerInstant(time, first, last, tuple(sorted(own)), letters_between(sequence, first, last), modes)


def _place_of(test: TestFunction, event: BranchPoint) -> tuple[float, int]:
    """Time and element of a margin."""
    times, watched = np.cumsum(event.place.flights), event.cycle.watched
    if not test.least:
        return float(times[test.index]), int(event.sequence.stop[test.index])
    element = test.index % event.sequence.mode.shape[1]
    if test.least == "rise":
        flight = int(watched.rise_flight[test.index])
        return (float(times[flight - 1]) if flight else 0.0), element
    return float(getattr(watched, test.least + "_time")[test.index]), element
