"""The families of cycles that leave a grazing.

An orbit that touches a stop is also one of twice the period, or more, with an impact without speed in some of its rounds. On
each of these sequences a family begins along which such impacts gain speed; the machine follows it if in the other rounds the
stop is not reached (A. B. Nordmark, Nonlinearity 14 (2001) 1517).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._orbits.sequence import Sequence
from .._trajectory.event_log import IMPACT
from .closing import rounds_of
from .kernels import BranchRates, KernelCall, rates_along
from .parameter_family import ExtendedCycle
from .point import Asked, BranchPoint, as_it_is, first_followed
from .sequence_edits import in_a_row, with_event, without_event

# The most rounds.
_MOST = 3


class Touch(NamedTuple):
    """A cycle that touches a stop.

    Attributes:
        sequence: what happens, without the touch.
        place: the cycle.
        num_periods: n.
        stop: that it touches.
        flight: on which flight.
        time: when, in forcing periods.
    """

    sequence: Sequence
    place: ExtendedCycle
    num_periods: int
    stop: int
    flight: int
    time: float

    def as_impact(self) -> tuple[Sequence, ExtendedCycle]:
        """The same with the touch as an impact."""
        return with_event(self.sequence, self.place, IMPACT, self.stop, self.flight, self.time)


def touch_of(sequence: Sequence, place: ExtendedCycle, k: int, num_periods: int) -> Asked:
    """The touch of an impact `k` without speed, of a cycle that is not several times another."""
    stop, time = int(sequence.stop[k]), float(place.flights[: k + 1].sum())
    sequence, place = without_event(sequence, place, k)
    rounds = yield from rounds_of(sequence, place, num_periods)
    num = len(sequence.kind) // rounds
    sequence = Sequence(sequence.kind[:num], sequence.stop[:num], sequence.held[: num + 1])
    place, num_periods = place._replace(flights=place.flights[:num]), num_periods // rounds
    time %= num_periods
    flight = int(np.count_nonzero(np.cumsum(place.flights) < time))
    return Touch(sequence, place, num_periods, stop, flight, time)


def hits_of(touch: Touch, num_periods: int) -> Iterator[list[bool]]:
    """In which rounds the touch becomes an impact, for all families but that of a branch with so many periods."""
    for rounds in range(1, _MOST + 1):
        for hits in range(1, max(rounds, 2)):
            if (rounds * touch.num_periods, hits) != (num_periods, 1):
                yield [k < hits for k in range(rounds)]


def repeated(touch: Touch, is_hit: list[bool]) -> tuple[Sequence, ExtendedCycle, list[int]]:
    """Rounds of the cycle, with the touch as an impact in some of them, and the numbers of these impacts."""
    rounds = [touch.as_impact() if hit else (touch.sequence, touch.place) for hit in is_hit]
    ends = np.cumsum([len(sequence.kind) for sequence, _ in rounds])
    hits = [
        int(end) - len(rounds[0][0].kind) + touch.flight for end, hit in zip(ends, is_hit, strict=True) if hit
    ]
    return *in_a_row(rounds, touch.num_periods), hits


def leave(sequence: Sequence, place: ExtendedCycle, hits: list[int], lengths: tuple[float, ...]) -> Asked:
    """A point on the family of a sequence, at the first of some distances that the machine follows; None if at none."""
    seen = yield from as_it_is(sequence, place)
    if not seen.found.is_converged:
        return None
    at = BranchPoint.of(sequence, seen, 0.0)
    rates: BranchRates = yield KernelCall(rates_along, sequence, (at.place, at.tangent, np.asarray(0.0)))
    is_ahead = rates.speeds[hits] > 0
    if is_ahead.any() != is_ahead.all():
        return None
    tangent = at.tangent if is_ahead.all() else at.tangent.turned()
    return (yield from first_followed(sequence, at.place, tangent, lengths))
