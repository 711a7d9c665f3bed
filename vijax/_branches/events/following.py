"""Whether a machine follows a cycle just behind a corner."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..._hybrid.limits import RELEASE, SLIP
from ..._orbits.sequence import SECOND
from ..kinds import Kind
from ..point import BranchPoint, is_followed
from ..requests import Requests
from ..section import in_section
from ..sequence_edits import Word
from ..test_functions import TestFunction, tests_of
from ..tolerances import ECHO_NEAR, ECHO_VALUE, END_OF_FLIGHT, NO_FLIGHT, TRUSTED
from .corner import Corner


def is_behind(point: BranchPoint, corner: Corner, words: Sequence[Word]) -> bool:
    """True if a point on some words has positive margins, and is none of the motions before the corner."""
    return lowest_margin(point, corner, words) >= 0 and not _is_only_reordered(point, corner, words)


def _is_only_reordered(point: BranchPoint, corner: Corner, words: Sequence[Word]) -> bool:
    """True if words have the events of before, and those in another order are at one instant still, as a symmetry keeps them."""
    times, apart = np.cumsum(point.place.flights), []
    for at, word in zip(corner.instants, words, strict=True):
        own, old = ([(letter.kind, letter.stop) for letter in letters] for letters in (word, at.word))
        if sorted(own) != sorted(old):
            return False
        for (i, one), (j, other) in combinations(enumerate(own), 2):
            if old.index(one) > old.index(other):
                apart.append(abs(times[at.first + j] - times[at.first + i]))
    return bool(apart) and max(apart) < END_OF_FLIGHT


def lowest_margin(point: BranchPoint, corner: Corner, words: Sequence[Word]) -> float:
    """The lowest margin behind a corner as a share of its size, 0 at most; negative also for a speed that is zero.

    Durations that a symmetry keeps at zero may be rounding. The least value of a guard beside a letter of its own element
    vanishes with that: the margins of the letter decide.
    """
    least = 0.0
    for test in tests_of(point.sequence):
        value = test.of(point.cycle) / corner.sizes.of_test(test, point.sequence)
        is_speed = test.kind == Kind.GRAZING and not test.least
        is_low = value <= (NO_FLIGHT if is_speed else -NO_FLIGHT)
        if is_low and not (test.least and value > -ECHO_VALUE and _is_echo(test, point, corner, words)):
            least = min(least, value, -NO_FLIGHT)
    return least


def _is_echo(test: TestFunction, point: BranchPoint, corner: Corner, words: Sequence[Word]) -> bool:
    """True if a guard is least beside a letter of its own element at a corner."""
    watched, element = point.cycle.watched, test.index % point.sequence.mode.shape[1]
    if test.least == "rise":
        return False
    when = float(getattr(watched, test.least + "_time")[test.index])
    for instant, word in zip(corner.instants, words, strict=True):
        is_near = abs(when - instant.time) < ECHO_NEAR
        for letter in word:
            of_force = letter.kind % SECOND in (SLIP, RELEASE)
            if is_near and letter.stop == element and of_force == (test.least == "force"):
                return True
    return False


def is_followed_behind(point: BranchPoint, num_periods: float) -> Requests[BranchPoint | None]:
    """The point with all its events inside the cycle, if the machine follows it or it is too unstable for a run; else None."""
    if np.isfinite(num_periods):
        within = yield from in_section(point, num_periods)
        if not isinstance(within, BranchPoint):
            return None
        point = within
    if abs(point.cycle.found.multipliers[0]) > TRUSTED or (yield from is_followed(point)):
        return point
    return None
