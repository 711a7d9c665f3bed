"""Families of cycles that leave a grazing.

An orbit that touches a stop is also one of twice the period or more, with an impact of zero speed in some of its
rounds. On each such sequence a family begins along which these impacts gain speed. The machine follows it if the other
rounds do not reach the stop (A. B. Nordmark, Nonlinearity 14 (2001) 1517).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._orbits.sequence import Sequence
from .closing import repetitions_of
from .padding import trimmed
from .parameter_family import ExtendedCycle
from .point import BranchPoint, correct_with_free_parameter, first_followed
from .requests import Requests
from .sequence_edits import Letter, Word, exchanged, in_a_row, letters_between
from .touch import turns_beside

# Largest number of rounds.
_MOST = 3


class Touch(NamedTuple):
    """A cycle that touches a stop.

    Attributes:
        sequence: events of the cycle, without the touch.
        place: the cycle.
        num_periods: n.
        flight: number of the flight with the touch.
        time: time of the touch, in forcing periods.
        impact: the touch as an impact of zero speed.
        without: the events at that time where there is no impact: those of friction that turns.
    """

    sequence: Sequence
    place: ExtendedCycle
    num_periods: int
    flight: int
    time: float
    impact: Letter
    without: Word

    def as_impact(self) -> tuple[Sequence, ExtendedCycle]:
        """The cycle with the touch as an impact of zero speed."""
        replaced = self.flight, self.flight + len(self.without)
        return exchanged(self.sequence, self.place, [(replaced, self.time, (self.impact,))])


def touch_of(sequence: Sequence, place: ExtendedCycle, k: int, num_periods: int) -> Requests[Touch]:
    """The touch at impact `k` of zero speed, on the shortest cycle that the given one traverses."""
    (impact,), without = letters_between(sequence, k, k + 1), turns_beside(sequence, k)
    time = float(place.flights[: k + 1].sum())
    sequence, place = exchanged(sequence, place, [((k, k + 1), time, without)])
    rounds = yield from repetitions_of(sequence, place, num_periods)
    num = len(sequence.kind) // rounds
    sequence, place, num_periods = trimmed(sequence, num), trimmed(place, num), num_periods // rounds
    time %= num_periods
    flight = k % num if without else int(np.count_nonzero(np.cumsum(place.flights) < time))
    return Touch(sequence, place, num_periods, flight, time, impact, without)


def hits_of(touch: Touch, num_periods: int) -> Iterator[list[bool]]:
    """Flags of the rounds with an impact, a list for each family, except that of a branch of `num_periods`."""
    for rounds in range(1, _MOST + 1):
        for hits in range(1, max(rounds, 2)):
            if (rounds * touch.num_periods, hits) != (num_periods, 1):
                yield [k < hits for k in range(rounds)]


def repeated(touch: Touch, is_hit: list[bool]) -> tuple[Sequence, ExtendedCycle, list[int]]:
    """Several rounds of the cycle, with the touch as an impact in some of them, and the numbers of these impacts."""
    rounds = [touch.as_impact() if hit else (touch.sequence, touch.place) for hit in is_hit]
    ends = np.cumsum([len(sequence.kind) for sequence, _ in rounds])
    hits = [
        int(end) - len(rounds[0][0].kind) + touch.flight for end, hit in zip(ends, is_hit, strict=True) if hit
    ]
    return *in_a_row(rounds, touch.num_periods), hits


def leave(
    sequence: Sequence, place: ExtendedCycle, hits: list[int], lengths: tuple[float, ...]
) -> Requests[BranchPoint | None]:
    """The point of a family at the first of some distances at which the machine follows it; None if at none."""
    cycle = yield from correct_with_free_parameter(sequence, place)
    if not cycle.found.is_converged:
        return None
    at = BranchPoint.of(sequence, cycle, 0.0)
    is_ahead = cycle.rates.speeds[hits] > 0
    if is_ahead.any() != is_ahead.all():
        return None
    tangent = at.tangent if is_ahead.all() else at.tangent.turned()
    return (yield from first_followed(sequence, at.place, tangent, lengths))
