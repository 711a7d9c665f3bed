"""Plain steps along branches, on which nothing happens, for a batch of branches.

Most steps are plain, and array operations decide all about them. A branch whose next step may not be plain (a test
function changes sign, a bound is passed, the machine leaves the sequence) is returned as it was before that step, for
`follow.py`.
"""

from typing import Any, NamedTuple

import jax
import numpy as np

from .._orbits.sequence import NOTHING, Sequence
from .corrector import Corrected
from .kernels import CorrectedCycle, SimulatedMotion, padded, room_for
from .parameter_family import ExtendedCycle
from .point import TRUSTED, BranchPoint, DirectedBranch
from .test_functions import TESTS_OF_NEIGHBOURS, is_crossed, margins, num_unstable, test_slopes

# Shortest step, along the scaled parameter or for a cycle of size 1.
SHORTEST = 1e-9
# `MIN_TANGENT_COSINE`: cosine of the largest angle between the tangents at the ends of a step.
# `_FEW`: largest number of Newton iterations after which steps grow by half.
# `_MANY`: number of Newton iterations from which steps shrink, and the most of an accepted step.
MIN_TANGENT_COSINE, _FEW, _MANY = 0.98, 4, 7
# `FIRST`: length of the first step.
# `PROBE`: length of the probe before it, which measures how fast multipliers move.
FIRST, PROBE = 2e-3, 1e-5
# Move of a multiplier on a step, relative to its distance from +1, which a pair passes at a resonance:
# `_TURNED`: the largest accepted.
# `_PLANNED`: the one for which the next step is planned.
# `_NARROWEST`: length of a step from which on these limits do not shorten it.
_TURNED, _PLANNED, _NARROWEST = 0.6, 0.4, 1e-6
# Multipliers this close to the real axis are real: folds and branch points have test functions of their own.
_REAL = 1e-9


class Tried(NamedTuple):
    """A step that is resolved, but not plain.

    Attributes:
        point: the point at its end.
        motion: motion of the machine started there, if it was simulated.
    """

    point: BranchPoint
    motion: SimulatedMotion | None


class PlainSteps(NamedTuple):
    """Request for plain steps.

    The answer is the last point, the length of the next step, and this step itself if it was tried, or None.

    Attributes:
        walk: receives the points.
        start: first point of the branch.
        point: point from which to step.
        ds: length of the first step.
    """

    walk: DirectedBranch
    start: BranchPoint
    point: BranchPoint
    ds: float

    @property
    def sequence(self) -> Sequence:
        """Sequence of the cycles."""
        return self.point.sequence


class StepState(NamedTuple):
    """Quantities by which steps are judged, of a batch of branches.

    Attributes:
        sequence: padded.
        place: the last points.
        tangent: of the branches at these.
        margins: values of the test functions of the sequence, (branches, tests).
        slopes: derivatives of these along the branches.
        neighbours: values of the test functions of the multipliers, (branches, 4).
        num_unstable: numbers of unstable multipliers.
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


class BranchProgress(NamedTuple):
    """Progress and limits of a batch of branches.

    Attributes:
        ds: lengths of the next steps.
        arc: arclengths so far.
        num_periods: n.
        bounds: of the scaled parameter, (branches, 2).
        longest: longest steps, along the scaled parameter or for a cycle of size 1.
        start: first points.
        tangent: at these; zero for a branch whose sequence has changed since.
    """

    ds: np.ndarray
    arc: np.ndarray
    num_periods: np.ndarray
    bounds: np.ndarray
    longest: np.ndarray
    start: ExtendedCycle
    tangent: ExtendedCycle


def is_accepted(found: Corrected, turn: Any, ds: Any) -> Any:
    """True where the corrector converged fast and the tangents at both ends, of product `turn`, are close."""
    is_near = found.is_converged & (found.first < 10 * ds) & (found.num_steps <= _MANY)
    return is_near & (turn > MIN_TANGENT_COSINE)


def is_resolved(known: StepState, new: StepState, ds: Any) -> np.ndarray:
    """True where a step is short enough: no pair of multipliers passes +1, and no test function vanishes twice."""
    is_slow = (_multiplier_motion(known, new) <= _TURNED) | (ds <= _NARROWEST)
    falls, rises = known.slopes * _row(ds) / 3, new.slopes * _row(ds) / 3
    # The Hermite cubic through both ends is positive if these two of its Bernstein coefficients are.
    with np.errstate(invalid="ignore"):
        dips = (falls < 0) & (rises > 0) & ((known.margins + falls <= 0) | (new.margins - rises <= 0))
    is_known = (known.margins > 0) & (new.margins > 0)
    return is_slow & ~np.any(dips & is_known, axis=1)


def next_length(found: Corrected, known: StepState, new: StepState, ds: Any, most: Any) -> Any:
    """Length of the step after one of length `ds`, `most` for a cycle of size 1."""
    steps = found.num_steps
    grown = ds * np.where(steps <= _FEW, 1.5, np.where(steps < _MANY, 1.2, 0.7))
    # Cycles may grow far beyond the first one; along the parameter no step exceeds `most`.
    size = np.maximum(np.max(np.abs(new.place.z), axis=1), 1)
    longest = np.minimum(most * size, np.maximum(most / np.maximum(np.abs(new.tangent.p), _REAL), most))
    grown = np.minimum(np.where(ds == PROBE, FIRST, grown), longest)
    planned = ds * _PLANNED / np.maximum(_multiplier_motion(known, new), np.finfo(float).tiny)
    return np.minimum(grown, np.maximum(planned, _NARROWEST))


def _multiplier_motion(known: StepState, new: StepState) -> np.ndarray:
    """Largest move of a complex multiplier, relative to its distance from +1."""
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
    """Inner products of extended cycles, one for each branch."""
    return (one.z * other.z).sum(1) + (one.flights * other.flights).sum(1) + one.p * other.p


def predictions(known: StepState, ds: np.ndarray) -> tuple[ExtendedCycle, ExtendedCycle, np.ndarray]:
    """Guesses, weights and targets of the corrector for the next points."""
    place, tangent = known.place, known.tangent
    by = ds[:, None]
    guess = ExtendedCycle(
        place.z + by * tangent.z, place.flights + by * tangent.flights, place.p + ds * tangent.p
    )
    return guess, tangent, inner_products(place, tangent) + ds


def step_state_of(sequence: Sequence, place: ExtendedCycle, seen: CorrectedCycle) -> StepState:
    """`StepState` of corrected cycles."""
    values = np.stack([test.of(seen) for test in TESTS_OF_NEIGHBOURS], axis=-1)
    return StepState(
        sequence,
        place,
        seen.found.tangent,
        margins(sequence, seen),
        test_slopes(sequence, seen),
        values,
        np.asarray(num_unstable(seen)),
        np.asarray(seen.found.multipliers),
    )


def step_state_of_point(point: BranchPoint) -> StepState:
    """`StepState` of one point, as a batch of one."""
    sequence, place = padded(point.sequence, (point.place,), len(point.seen.found.speeds))
    return step_state_of(*jax.tree.map(lambda a: np.asarray(a)[None], (sequence, place, point.seen)))


def batch_rows_of(plain: list[PlainSteps]) -> tuple[StepState, BranchProgress]:
    """State of branches whose cycles have the same room."""
    rows = [_row_of(one) for one in plain]
    (sequence, place, seen), ways = jax.tree.map(lambda *a: np.stack(a), *rows)
    return step_state_of(sequence, place, seen), ways


def _row_of(plain: PlainSteps) -> tuple[tuple[Sequence, ExtendedCycle, CorrectedCycle], BranchProgress]:
    walk, start, point, ds = plain
    room = room_for(len(point.sequence.kind))
    sequence, place = padded(point.sequence, (point.place,), room)
    one, other = start.sequence, point.sequence
    is_same = one is other or (np.array_equal(one.kind, other.kind) and np.array_equal(one.stop, other.stop))
    origin, tangent = place, place.moved(place, -1.0)
    if is_same:
        _, origin, tangent = padded(one, (start.place, start.tangent), room)
    numbers = ds, point.arc, walk.num_periods, walk.bounds, walk.longest
    ds, arc, num_periods, bounds, longest = map(np.asarray, numbers)
    ways = BranchProgress(ds, arc, num_periods, bounds, longest, origin, tangent)
    return (sequence, place, point.seen), ways


def is_plain(known: StepState, new: StepState, ways: BranchProgress) -> np.ndarray:
    """True where a step passes no zero of a test function, no bound, no start of a cycle or of the branch."""
    is_met = np.any((known.margins > 0) & (new.margins <= 0), axis=1)
    is_special = np.any(is_crossed(known.neighbours, new.neighbours), axis=1)
    is_odd = (new.num_unstable - known.num_unstable) % 2 != 0
    low, high = ways.bounds.T
    is_out = (new.place.p < low) | (new.place.p > high)
    times = np.cumsum(new.place.flights, axis=1)
    is_other = (new.sequence.kind != NOTHING) & ((times < 0) | (times > ways.num_periods[:, None]))
    s = inner_products(ways.start, known.tangent) - inner_products(known.place, known.tangent)
    is_back = (s > 0) & (s <= ways.ds) & (inner_products(ways.tangent, known.tangent) >= MIN_TANGENT_COSINE)
    return ~(is_met | is_special | is_odd | is_out | is_back | np.any(is_other, axis=1))


def follows_cycle(known: StepState, seen: CorrectedCycle, followed: SimulatedMotion) -> np.ndarray:
    """True where a run follows the cycle with as many events, or cannot, as a multiplier exceeds `TRUSTED`."""
    same_number = np.count_nonzero((followed.sequence.kind != NOTHING), axis=1) == np.count_nonzero(
        (known.sequence.kind != NOTHING), axis=1
    )
    is_trusted = np.abs(seen.found.multipliers[:, 0]) < TRUSTED
    return np.where(followed.is_alike, same_number, ~is_trusted)
