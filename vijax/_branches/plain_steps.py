"""Steps along branches on which nothing happens, of many branches side by side.

Most steps of a branch are like that, and all that is to be decided about them is decided by arrays. A branch on whose next
step anything may happen, where a test function changes its sign, the bounds are passed or the machine does something else,
is given back as it was before that step, for `follow.py` to look into.
"""

from typing import Any, NamedTuple

import numpy as np

from .._orbits.sequence import NOTHING, Sequence
from .branch_tests import TESTS_OF_NEIGHBOURS, margins, num_unstable
from .correct import Corrected
from .family import Place
from .point import TRUSTED, Point, Walk
from .programs import Followed, Seen, padded, room_for

# Lengths of steps: the longest, the shortest.
_LONGEST, SHORTEST = 5e-2, 1e-9
# The most by which a step may turn, as a cosine; iterations of Newton's method after which steps grow, or shrink.
STRAIGHT, _FEW, _MANY = 0.98, 4, 7


class PlainSteps(NamedTuple):
    """What a branch asks for: steps as long as nothing happens on them. The answer is the last point and the next length.

    Attributes:
        walk: to which the points are added.
        start: where the branch was begun.
        point: from where.
        ds: length of the first step.
    """

    walk: Walk
    start: Point
    point: Point
    ds: float

    @property
    def sequence(self) -> Sequence:
        """What happens on the cycles."""
        return self.point.sequence


class Known(NamedTuple):
    """What steps are judged by, of branches side by side.

    Attributes:
        sequence: with padding.
        place: the last points.
        tangent: of the branches there.
        margins: test functions of the sequence, (branches, tests).
        neighbours: those of the neighbours, (branches, 4).
        num_unstable: how many neighbours leave.
    """

    sequence: Sequence
    place: Place
    tangent: Place
    margins: np.ndarray
    neighbours: np.ndarray
    num_unstable: np.ndarray


class Ways(NamedTuple):
    """How far branches have come, and how far they may go.

    Attributes:
        ds: lengths of the next steps.
        arc: of the branches so far.
        num_periods: n.
        bounds: of the scaled parameter, (branches, 2).
        start: where they were begun.
        tangent: there; zero for a branch whose events are other ones by now.
    """

    ds: np.ndarray
    arc: np.ndarray
    num_periods: np.ndarray
    bounds: np.ndarray
    start: Place
    tangent: Place


def is_sound(found: Corrected, turn: Any, ds: Any) -> Any:
    """Whether a branch is not too curved for steps of such lengths, whose ends have tangents with this product."""
    is_near = found.is_converged & (found.first < 10 * ds) & (found.num_steps <= _MANY)
    return is_near & (turn > STRAIGHT)


def next_length(found: Corrected, ds: Any) -> Any:
    """The length of a step after one of length `ds`."""
    steps = found.num_steps
    return np.minimum(ds * np.where(steps <= _FEW, 1.5, np.where(steps < _MANY, 1.2, 0.7)), _LONGEST)


def along(one: Place, other: Place) -> np.ndarray:
    """The products of places of branches side by side."""
    return (one.z * other.z).sum(1) + (one.flights * other.flights).sum(1) + one.p * other.p


def ahead(known: Known, ds: np.ndarray) -> tuple[Place, Place, np.ndarray]:
    """What the next points are corrected from: guesses, weights and targets."""
    place, tangent = known.place, known.tangent
    by = ds[:, None]
    guess = Place(place.z + by * tangent.z, place.flights + by * tangent.flights, place.p + ds * tangent.p)
    return guess, tangent, along(place, tangent) + ds


def known_of(sequence: Sequence, place: Place, seen: Seen) -> Known:
    """What steps from cycles that were seen are judged by."""
    values = np.stack([test.of(seen) for test in TESTS_OF_NEIGHBOURS], axis=-1)
    return Known(
        sequence, place, seen.found.tangent, margins(sequence, seen), values, np.asarray(num_unstable(seen))
    )


def begun(asked: PlainSteps) -> tuple[Known, Ways]:
    """One branch, to be put beside others."""
    walk, start, point, ds = asked
    room = room_for(len(point.sequence.kind))
    sequence, place = padded(point.sequence, (point.place,), room)
    one, other = start.sequence, point.sequence
    is_same = np.array_equal(one.kind, other.kind) and np.array_equal(one.stop, other.stop)
    origin, tangent = place, place.moved(place, -1.0)
    if is_same:
        _, origin, tangent = padded(one, (start.place, start.tangent), room)
    ds, arc, num_periods, bounds = (np.asarray(a) for a in (ds, point.arc, walk.num_periods, walk.bounds))
    ways = Ways(ds, arc, num_periods, bounds, origin, tangent)
    return known_of(sequence, place, point.seen), ways


def is_plain(known: Known, new: Known, ways: Ways) -> np.ndarray:
    """Whether nothing is met on steps to new points."""
    is_met = np.any((known.margins > 0) & (new.margins <= 0), axis=1)
    is_special = np.any(known.neighbours * new.neighbours < 0, axis=1)
    is_odd = (new.num_unstable - known.num_unstable) % 2 != 0
    low, high = ways.bounds.T
    is_out = (new.place.p < low) | (new.place.p > high)
    times = np.cumsum(new.place.flights, axis=1)
    is_other = (new.sequence.kind != NOTHING) & ((times < 0) | (times > ways.num_periods[:, None]))
    s = along(ways.start, known.tangent) - along(known.place, known.tangent)
    is_back = (s > 0) & (s <= ways.ds) & (along(ways.tangent, known.tangent) >= STRAIGHT)
    return ~(is_met | is_special | is_odd | is_out | is_back | np.any(is_other, axis=1))


def is_as_told(known: Known, seen: Seen, followed: Followed) -> np.ndarray:
    """Whether machines follow cycles, with as many events as these have; not asked of those that no run can follow."""
    same_number = np.count_nonzero((followed.sequence.kind != NOTHING), axis=1) == np.count_nonzero(
        (known.sequence.kind != NOTHING), axis=1
    )
    is_trusted = np.abs(seen.found.multipliers[:, 0]) < TRUSTED
    return np.where(followed.is_alike, same_number, ~is_trusted)
