"""Continuation of a curve of bifurcations in the plane of two parameters, in one direction."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import jax
import numpy as np

from .._orbits.sequence import Sequence
from .bracket import Bracket, next_trial
from .codim1_point import CurvePoint, correct_in_plane, neighbours
from .codim2_tests import CurveNeighbourhood, CurveTest, curve_tests, faces_of, special_point_name
from .defining_systems import AbstractCondition, AtEvent, AtGrip, AtTurn, DefiningSystem, Plane
from .degenerate_multiplier import DegenerateMultiplier
from .kinds import EndKind, Kind
from .padding import padded, room_for, trimmed
from .parameter_family import ExtendedCycle
from .peak_condition import AtPeak
from .peak_quantities import PeakQuantity
from .peak_setup import extremes_at, is_at_its_extremes, peak_condition
from .point import End
from .requests import KernelCall, Requests, T, location_on, simulation_of
from .scheduler import answer, drive
from .sequence_edits import in_a_row, passed_section, shifted
from .singular import distance_of_halves, doubling_of_half
from .tolerances import (
    CURVE_IS_BACK,
    EXACT,
    FIRST_STEP,
    HALVES_FARTHER,
    HALVES_NEAR,
    LEAST_COSINE,
    LONGEST_ON_CURVE,
    ROUNDED,
    TRUSTED,
)
from .walk import AbstractCurve, at_once, walk_alone

# `_FEW`: largest number of Newton iterations after which steps grow.
# `_MANY`: largest number of Newton iterations of an accepted step.
# `_SECANTS`: largest number of steps of the secant method.
_FEW, _MANY, _SECANTS = 4, 7, 20


class CurveState(NamedTuple):
    """Point of a curve with its defining system.

    Attributes:
        near: the point and its neighbours.
        defining: its defining system, padded.
        special: name of the special point, or "".
    """

    near: CurveNeighbourhood
    defining: DefiningSystem
    special: str = ""

    @property
    def at(self) -> CurvePoint:
        """The point without its neighbours."""
        return self.near.at

    @property
    def sequence(self) -> Sequence:
        """Sequence of the orbit, without padding."""
        return unpadded_sequence(self.defining)

    def turned(self) -> "CurveState":
        """The same point with the opposite direction."""
        at = self.at._replace(tangent=-self.at.tangent, direction=-self.at.direction)
        return self._replace(near=self.near._replace(at=at))

    def in_plane(self, guess: np.ndarray, weights: np.ndarray, target: float) -> CurveNeighbourhood:
        """Point of the curve in a plane, near a guess."""
        return point_with_neighbours(self.defining, guess, Plane(weights, np.asarray(target, guess.dtype)))

    def ahead(self, s: float, towards: CurvePoint | None = None) -> CurveNeighbourhood:
        """Point of the curve at distance `s` along the tangent, guessed from it or from the chord to another point."""
        y, tangent = self.at.y, self.at.tangent
        way = tangent if towards is None else (towards.y - y) / ((towards.y - y) @ tangent)
        return self.in_plane(y + s * way, tangent, y @ tangent + s)


def unpadded_sequence(defining: DefiningSystem) -> Sequence:
    """Sequence of a defining system, without padding."""
    return trimmed(defining.sequence, int(np.count_nonzero(defining.sequence.kind >= 0)))


def point_with_neighbours(defining: DefiningSystem, guess: np.ndarray, plane: Plane) -> CurveNeighbourhood:
    """Point of a curve in a plane, with its neighbours on each face."""
    at = jax.device_get(correct_in_plane(defining, guess, plane))
    sequence = unpadded_sequence(defining)
    place, room = trimmed(at.place, len(sequence.kind)), len(defining.sequence.kind)
    faces = []
    for change in faces_of(defining, sequence):
        its_own, there = change(sequence, place)
        faces.append(jax.device_get(neighbours(defining.family, *padded(its_own, (there,), room))))
    return CurveNeighbourhood(at, tuple(faces))


def begin_curve(defining: DefiningSystem, place: ExtendedCycle) -> CurveState:
    """Point of a curve at a known cycle."""
    y = np.asarray(defining.unknowns(place))
    # Random weights, so that the plane does not contain the tangent of the curve.
    weights = np.random.default_rng(0).normal(size=len(y)).astype(y.dtype)
    weights /= np.linalg.norm(weights)
    near = point_with_neighbours(defining, y, Plane(weights, weights @ y))
    if not near.at.is_found:
        raise ValueError(
            "The curve cannot be followed from this point: take one farther from other bifurcations."
        )
    return CurveState(near, defining)


class _CurveStep(NamedTuple):
    """Step along a curve.

    Attributes:
        points: special points on it and, unless the curve ends before, its last point.
        next_length: length of the next step.
        end: reason why the curve ends there, or "".
    """

    points: list[CurveState]
    next_length: float
    end: str = ""


@dataclass
class Curve(AbstractCurve[CurveState, _CurveStep]):
    """Curve of bifurcations in one direction.

    Attributes:
        kind: of the bifurcation.
        box: bounds of both parameters in their scale, (2, 2).
        most: largest number of points.
        begun: the first point, which is not one of `found`.
        note: called with the number of new points.
        peak: the quantity of a peak, or None.
        found: points so far.
        why: reason why the last step was too long.
    """

    kind: str
    box: np.ndarray
    most: int
    begun: CurveState
    note: Callable[[int], object]
    peak: PeakQuantity | None = None
    found: list[CurveState] = field(default_factory=list)
    why: str = ""

    @cached_property
    def degenerate(self) -> DegenerateMultiplier:
        """Test for points at which the multiplier is degenerate."""
        return DegenerateMultiplier(self.kind)

    @property
    def is_full(self) -> bool:
        return len(self.found) >= self.most

    def follow(self) -> str:
        """Add points to the end of the curve; return why it ends."""
        end = walk_alone(self, self.begun, FIRST_STEP)
        return end.kind if end else EndKind.MAX_POINTS

    def step(self, here: CurveState, ds: float, tried: None) -> Requests[_CurveStep | End | None]:
        """Make a step with its special points; None if it is too long, or leads to a cycle that the machine does not follow."""
        del tried
        return at_once(self._step(here, ds))

    def take(self, here: CurveState, step: _CurveStep) -> Requests[tuple[CurveState, float] | End]:
        """Add the points of a step."""
        self.found += step.points
        self.note(len(step.points))
        return at_once(End(step.end) if step.end else (step.points[-1], step.next_length))

    def beyond(self, here: CurveState) -> Requests[End]:
        """End where no step is short enough."""
        del here
        return at_once(End(self.why))

    def _step(self, here: CurveState, ds: float) -> _CurveStep | End | None:
        new = _next_point(here, ds)
        if new is None:
            self.why = EndKind.NOT_CONVERGED
            last = _degenerate_doubling(here) if self.kind == Kind.FOLD else None
            return None if last is None else _CurveStep([last], ds, last.special)
        bound = self._at_bound(here, new.at)
        points, end = self._met(here, new if bound is None else bound)
        if end:
            return _CurveStep(points, ds, end)
        # An event that passes the start of the cycle only renumbers the events.
        points[-1] = _in_section(points[-1], self.peak)
        if self.peak is not None and (other := at_other_extremes(points[-1], self.peak)) is not None:
            if isinstance(other, End):
                return other
            points[-1] = other
        if not _is_followed(points[-1]):
            self.why = EndKind.LEFT_THE_STOPS
            return None
        if bound is not None:
            end = EndKind.BOUNDS
        elif len(self.found) + len(points) > 2 and _is_back(self.begun.at, here.at, new.at):
            end = EndKind.CLOSED
        longer = min(ds * (1.5 if new.at.num_steps <= _FEW else 1.0), LONGEST_ON_CURVE)
        return _CurveStep(points, longer, end)

    def _at_bound(self, here: CurveState, new: CurvePoint) -> CurveNeighbourhood | None:
        """Point of the curve at the first bound between two points, or None."""
        p, ahead = here.at.place.p, new.place.p
        crossed = [
            ((bound - p[k]) / (ahead[k] - p[k]), k, bound)
            for k, bounds in enumerate(self.box)
            for bound, side in zip(bounds, (-1, 1), strict=True)
            if side * (ahead[k] - bound) > 0 and side * (p[k] - bound) < -EXACT
        ]
        if not crossed:
            return here.near if np.any((ahead < self.box[:, 0]) | (ahead > self.box[:, 1])) else None
        share, k, bound = min(crossed)
        y, weights = here.at.y, np.zeros_like(here.at.y)
        weights[len(y) - len(here.at.own) - 2 + k] = np.sign(ahead[k] - p[k])
        return here.in_plane(y + share * (new.y - y), weights, bound * weights.sum())

    def _met(self, here: CurveState, new: CurveNeighbourhood) -> tuple[list[CurveState], str]:
        """Special points of a step and, unless the curve ends before, its last point; and why the curve ends."""
        found: list[CurveState] = []
        for _, test, near in sorted(self._special(here, new), key=lambda one: one[0]):
            if name := special_point_name(test, near):
                found.append(here._replace(near=near, special=name))
                if test.is_end:
                    return found, name
        return [*found, here._replace(near=new, special="")], ""

    def _special(
        self, here: CurveState, new: CurveNeighbourhood
    ) -> Iterator[tuple[float, CurveTest, CurveNeighbourhood]]:
        """Zeros of test functions on a step: distance ahead, test, and point."""
        length = float((new.at.y - here.at.y) @ here.at.tangent)
        degenerate = self.degenerate.tests(here.defining.family, here.sequence, here.near)
        for test in curve_tests(self.kind, here.defining, here.sequence) + degenerate:
            if not test.is_met(here.near, new):
                continue
            bracket = Bracket.between(test.of(here.near, here.near), test.of(new, here.near), length)
            s, near = length, new
            while near.at.is_found and (trial := next_trial(bracket)) is not None:
                s, near = trial, here.ahead(trial, new.at)
                bracket = bracket.narrowed(s, test.of(near, here.near))
            if near.at.is_found:
                yield s, test, near


def _next_point(here: CurveState, ds: float) -> CurveNeighbourhood | None:
    """Next point, or None if the curve is too curved for such a step."""
    new = here.ahead(ds)
    at = new.at
    is_sound = at.is_found and at.tangent @ here.at.tangent > LEAST_COSINE and at.num_steps <= _MANY
    return new if is_sound else None


def _degenerate_doubling(here: CurveState) -> CurveState | None:
    """The degenerate period doubling at which a curve of folds of doubled orbits ends, as an orbit that is traversed twice.

    Both curves touch there, and the equations of the fold are singular: a multiplier of the doubled orbit is 1 on all of the curve of
    doublings. So the point is located on that one. None if there is none near.
    """
    family, sequence = here.defining.family, here.sequence
    num, num_periods = len(sequence.kind) // 2, float(family.num_periods)
    place = trimmed(here.at.place, len(sequence.kind))
    (away,) = drive([family], [distance_of_halves(num_periods, sequence, place)], lambda: None)
    if not away < HALVES_NEAR:
        return None
    once = trimmed(sequence, num)
    longer, guess = padded(once, (trimmed(place, num),), room_for(num))
    try:
        begun = begin_curve(doubling_of_half(family, longer, guess), guess)
    except ValueError:
        return None
    found = _zero_along(begun, DegenerateMultiplier(Kind.PERIOD_DOUBLING), away**2)
    if found is None or np.abs(found.at.place.p - place.p).max() > HALVES_FARTHER * away**2:
        return None
    twice, place = in_a_row([(once, trimmed(found.at.place, num))] * 2, num_periods / 2)
    twice, place = padded(twice, (place,), len(here.defining.sequence.kind))
    whole = replace(here.defining, sequence=twice)
    y = np.asarray(whole.unknowns(place))
    if (y - here.at.y) @ here.at.tangent <= 0:  # the curve comes from there
        return None
    near = point_with_neighbours(whole, y, Plane(here.at.tangent, y @ here.at.tangent))
    return CurveState(near._replace(at=near.at._replace(place=place)), whole, "degenerate_pd")


def _zero_along(
    begun: CurveState, degenerate: DegenerateMultiplier, step: float
) -> CurveNeighbourhood | None:
    """Point of a curve at which the multiplier is degenerate, by the secant method from a point; None if it is not found."""
    value = lambda near: degenerate.value(begun.defining.family, begun.sequence, near)  # noqa: E731
    (before, last), s = (0.0, value(begun.near)), step
    for _ in range(_SECANTS):
        near = begun.ahead(s)
        now = value(near)
        if not near.at.is_found or not np.isfinite(now) or now == last:
            return None
        (before, last), s = (s, now), s - now * (s - before) / (now - last)
        if abs(s - before) <= ROUNDED * step:
            return near
    return None


def _is_followed(here: CurveState) -> bool:
    """True if the machine follows the cycle, or a run cannot decide: at an event it may follow either face."""
    if isinstance(here.defining.condition, AtEvent) or np.abs(here.near.faces[0].multipliers[0]) > TRUSTED:
        return True
    place = trimmed(here.at.place, len(here.sequence.kind))
    return bool(_answer(here, simulation_of(here.sequence, place)).is_alike)


def _is_back(begun: CurvePoint, here: CurvePoint, new: CurvePoint) -> bool:
    """True if a step passes the first point of the curve."""
    if len(begun.y) != len(new.y) or begun.tangent @ new.tangent < LEAST_COSINE:
        return False
    way, passed = new.y - here.y, begun.y - here.y
    share = (passed @ way) / (way @ way)
    return bool(0 < share <= 1 and np.linalg.norm(passed - share * way) < CURVE_IS_BACK * np.linalg.norm(way))


def at_other_extremes(here: CurveState, peak: PeakQuantity) -> CurveState | End | None:
    """The point with the extremes of its cycle where these lie on other flights than before; its end, or None."""
    condition, place = here.defining.condition, trimmed(here.at.place, len(here.sequence.kind))
    assert isinstance(condition, AtPeak)
    extremes = extremes_at(here.defining.family, here.sequence, place)
    if is_at_its_extremes(condition, extremes, peak):
        return None
    condition = peak_condition(here.defining.family, here.sequence, place, peak.words)
    try:
        moved = _begun_beside(here, here.sequence, condition, place)
    except ValueError:
        return End(EndKind.OTHER_EXTREME)
    is_there = np.abs(moved.at.place.p - here.at.place.p).max() <= ROUNDED
    return moved if is_there else End(EndKind.OTHER_EXTREME)


def _begun_beside(
    here: CurveState, sequence: Sequence, condition: AbstractCondition, place: ExtendedCycle
) -> CurveState:
    """The point with other equations for it, in the same direction."""
    (sequence, place) = padded(sequence, (place,), len(here.defining.sequence.kind))
    moved = begin_curve(replace(here.defining, sequence=sequence, condition=condition), place)
    moved = moved._replace(special=here.special)
    return moved if moved.at.direction @ here.at.direction > 0 else moved.turned()


def _in_section(here: CurveState, peak: PeakQuantity | None) -> CurveState:
    """The point with all its events between the start of the cycle and its end."""
    sequence, num_periods = here.sequence, float(here.defining.family.num_periods)
    place = trimmed(here.at.place, len(sequence.kind))
    by = passed_section(place, num_periods)
    if by == 0:
        return here
    z = _answer(here, location_on(sequence, place, 0.0 if by > 0 else num_periods))
    sequence, place = shifted(sequence, place, by, num_periods, np.asarray(z))
    condition = replace(here.defining.condition, own=here.at.own)
    if isinstance(condition, AtEvent | AtTurn | AtGrip):
        condition = replace(condition, index=(condition.index - by) % len(sequence.kind))
    if peak is not None:
        condition = peak_condition(here.defining.family, sequence, place, peak.words)
    return _begun_beside(here, sequence, condition, place)


def _answer(here: CurveState, request: KernelCall[T]) -> T:
    """Result of a kernel for the family of a point."""
    return answer(here.defining.family, request)
