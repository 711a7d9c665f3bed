"""Steps along branches on which nothing happens, of many branches side by side.

Most steps of a branch are like that, and all that is to be decided about them is decided by arrays. A branch on whose next
step anything may happen, where a test function changes its sign, the bounds are passed or the machine does something else,
is given back as it was before that step, for `follow.py` to look into.
"""

from typing import Any, NamedTuple

import jax
import numpy as np

from .._orbits.sequence import NOTHING, Sequence
from .corrector import Corrected
from .kernels import CorrectedCycle, Followed, padded, room_for
from .parameter_family import ExtendedCycle
from .point import TRUSTED, BranchPoint, Walk
from .test_functions import TESTS_OF_NEIGHBOURS, is_crossed, margins, num_unstable, test_slopes

# Lengths of steps: the longest, along the parameter or of a cycle of size 1; the shortest.
_LONGEST, SHORTEST = 5e-2, 1e-9
# The most by which a step may turn, as a cosine; iterations of Newton's method after which steps grow, or shrink.
STRAIGHT, _FEW, _MANY = 0.98, 4, 7
# Length of the first step, and of the probe before it from which is known how fast multipliers turn.
FIRST, PROBE = 2e-3, 1e-5
# How far a multiplier may move on a step, in distances from +1: at most, and as the next step is planned for. A resonance
# is a pair of them that passes there. Steps as short as the last are not made shorter by it.
_TURNED, _PLANNED, _NARROWEST = 0.6, 0.4, 1e-6
# Multipliers this near the real axis are real: folds and branch points have tests of their own.
_REAL = 1e-9


class PlainSteps(NamedTuple):
    """What a branch asks for: steps as long as nothing happens on them. The answer is the last point and the next length.

    Attributes:
        walk: to which the points are added.
        start: where the branch was begun.
        point: from where.
        ds: length of the first step.
    """

    walk: Walk
    start: BranchPoint
    point: BranchPoint
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
        slopes: how these change along the branch.
        neighbours: those of the neighbours, (branches, 4).
        num_unstable: how many neighbours leave.
        multipliers: (branches, 2 n).
    """

    sequence: Sequence
    place: ExtendedCycle
    tangent: ExtendedCycle
    margins: np.ndarray
    slopes: np.ndarray
    neighbours: np.ndarray
    num_unstable: np.ndarray
    multipliers: np.ndarray


class BranchSteps(NamedTuple):
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
    start: ExtendedCycle
    tangent: ExtendedCycle


def is_sound(found: Corrected, turn: Any, ds: Any) -> Any:
    """Whether a branch is not too curved for steps of such lengths, whose ends have tangents with this product."""
    is_near = found.is_converged & (found.first < 10 * ds) & (found.num_steps <= _MANY)
    return is_near & (turn > STRAIGHT)


def is_resolved(known: Known, new: Known, ds: Any) -> np.ndarray:
    """Whether steps are short enough to see all that happens on them: no resonance is passed, and no test vanishes twice."""
    is_slow = (_turned(known, new) <= _TURNED) | (ds <= _NARROWEST)
    falls, rises = known.slopes * _row(ds) / 3, new.slopes * _row(ds) / 3
    # The cubic through both ends is positive if these of its coefficients are.
    with np.errstate(invalid="ignore"):
        dips = (falls < 0) & (rises > 0) & ((known.margins + falls <= 0) | (new.margins - rises <= 0))
    is_known = (known.margins > 0) & (new.margins > 0)
    return is_slow & ~np.any(dips & is_known, axis=1)


def next_length(found: Corrected, known: Known, new: Known, ds: Any) -> Any:
    """The length of a step after one of length `ds`."""
    steps = found.num_steps
    grown = ds * np.where(steps <= _FEW, 1.5, np.where(steps < _MANY, 1.2, 0.7))
    # Cycles may become much larger than the first one, but no step is longer along the parameter.
    size = np.maximum(np.max(np.abs(new.place.z), axis=1), 1)
    longest = np.minimum(
        _LONGEST * size, np.maximum(_LONGEST / np.maximum(np.abs(new.tangent.p), _REAL), _LONGEST)
    )
    grown = np.minimum(np.where(ds == PROBE, FIRST, grown), longest)
    planned = ds * _PLANNED / np.maximum(_turned(known, new), np.finfo(float).tiny)
    return np.minimum(grown, np.maximum(planned, _NARROWEST))


def _turned(known: Known, new: Known) -> np.ndarray:
    """How far multipliers have moved, in distances from +1, at most; real ones are not counted."""
    mu, before = new.multipliers, known.multipliers
    is_pair = np.isfinite(mu) & (np.abs(np.imag(mu)) > _REAL)
    mu = np.where(is_pair, mu, 0)
    with np.errstate(invalid="ignore"):
        ways = np.abs(mu[:, :, None] - before[:, None, :])
    way = np.min(np.where(np.isfinite(ways), ways, np.inf), axis=2)
    return np.max(np.where(is_pair, way / np.maximum(np.abs(mu - 1), _REAL), 0), axis=1)


def _row(ds: Any) -> np.ndarray:
    return np.reshape(ds, (-1, 1))


def inner_products(one: ExtendedCycle, other: ExtendedCycle) -> np.ndarray:
    """The products of places of branches side by side."""
    return (one.z * other.z).sum(1) + (one.flights * other.flights).sum(1) + one.p * other.p


def predictions(known: Known, ds: np.ndarray) -> tuple[ExtendedCycle, ExtendedCycle, np.ndarray]:
    """What the next points are corrected from: guesses, weights and targets."""
    place, tangent = known.place, known.tangent
    by = ds[:, None]
    guess = ExtendedCycle(
        place.z + by * tangent.z, place.flights + by * tangent.flights, place.p + ds * tangent.p
    )
    return guess, tangent, inner_products(place, tangent) + ds


def known_of(sequence: Sequence, place: ExtendedCycle, seen: CorrectedCycle) -> Known:
    """What steps from cycles that were seen are judged by."""
    values = np.stack([test.of(seen) for test in TESTS_OF_NEIGHBOURS], axis=-1)
    return Known(
        sequence,
        place,
        seen.found.tangent,
        margins(sequence, seen),
        test_slopes(sequence, seen),
        values,
        np.asarray(num_unstable(seen)),
        np.asarray(seen.found.multipliers),
    )


def known_alone(point: BranchPoint) -> Known:
    """What steps from one point are judged by."""
    sequence, place = padded(point.sequence, (point.place,), len(point.seen.found.speeds))
    return known_of(*jax.tree.map(lambda a: np.asarray(a)[None], (sequence, place, point.seen)))


def begun(asked: PlainSteps) -> tuple[Known, BranchSteps]:
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
    ways = BranchSteps(ds, arc, num_periods, bounds, origin, tangent)
    return known_of(sequence, place, point.seen), ways


def is_plain(known: Known, new: Known, ways: BranchSteps) -> np.ndarray:
    """Whether nothing is met on steps to new points."""
    is_met = np.any((known.margins > 0) & (new.margins <= 0), axis=1)
    is_special = np.any(is_crossed(known.neighbours, new.neighbours), axis=1)
    is_odd = (new.num_unstable - known.num_unstable) % 2 != 0
    low, high = ways.bounds.T
    is_out = (new.place.p < low) | (new.place.p > high)
    times = np.cumsum(new.place.flights, axis=1)
    is_other = (new.sequence.kind != NOTHING) & ((times < 0) | (times > ways.num_periods[:, None]))
    s = inner_products(ways.start, known.tangent) - inner_products(known.place, known.tangent)
    is_back = (s > 0) & (s <= ways.ds) & (inner_products(ways.tangent, known.tangent) >= STRAIGHT)
    return ~(is_met | is_special | is_odd | is_out | is_back | np.any(is_other, axis=1))


def follows_cycle(known: Known, seen: CorrectedCycle, followed: Followed) -> np.ndarray:
    """Whether machines follow cycles, with as many events as these have; not asked of those that no run can follow."""
    same_number = np.count_nonzero((followed.sequence.kind != NOTHING), axis=1) == np.count_nonzero(
        (known.sequence.kind != NOTHING), axis=1
    )
    is_trusted = np.abs(seen.found.multipliers[:, 0]) < TRUSTED
    return np.where(followed.is_alike, same_number, ~is_trusted)
