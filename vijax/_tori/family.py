"""Family of invariant circles that begins at a Neimark-Sacker bifurcation, followed by pseudo-arclength."""

from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from .._branches.point import End
from .._branches.requests import Requests
from .._branches.walk import AbstractCurve, at_once, walk_alone
from .circle import Circle, interpolation
from .invariance import CorrectedCircle, corrected
from .section_map import MapOfStates

# Angles of the first circle, and by how much their number grows where the error is too large.
_FIRST_ANGLES, _GROWTH = 33, 2
# Length of the first step, the longest and the shortest one, in the scale of the states.
_FIRST, _LONGEST, _SHORTEST = 0.02, 0.03, 1e-4
# Newton steps up to which the next step is longer, and its factor.
_FEW_STEPS, _LONGER = 4, 1.4
# Least cosine between the tangents of two circles.
_STRAIGHT = 0.8
# Periods run to see where motions lead that were on a circle, longest period that is looked for, and distance of equal states.
_RUN, _LONGEST_PERIOD, _EQUAL = 600, 60, 1e-7


class TorusEnd(StrEnum):
    """End of a family; a member is the string that users read."""

    BOUNDS = "bounds"
    LOCKED = "locked"
    NOT_RESOLVED = "not_resolved"
    NOT_CONVERGED = "not_converged"
    MAX_POINTS = "max_points_reached"
    INTERRUPTED = "interrupted"


class Limits(NamedTuple):
    """Limits of a family: of the scaled parameter, of the number of circles and angles, and of the error."""

    low: float
    high: float
    max_points: int
    max_angles: int
    tolerance: float


class FamilyPoint(NamedTuple):
    """Circle of a family, and the tangent of the family there."""

    circle: Circle
    way: Circle


class TorusFamily(AbstractCurve[FamilyPoint, tuple[CorrectedCircle, float]]):
    """Circles of a family, in their order.

    Args:
        section: the map.
        limits: where it ends.
        note: called for each circle.
    """

    shortest = _SHORTEST

    def __init__(self, section: MapOfStates, limits: Limits, note: Callable[[], object]):
        self.section, self.limits, self.note = section, limits, note
        self.found: list[CorrectedCircle] = []
        self.end: str = TorusEnd.INTERRUPTED
        self.locked_period = 0

    def follow(self, first: FamilyPoint) -> None:
        """Follow the family from the circle without size at a bifurcation, along its tangent there."""
        end = walk_alone(self, first, _FIRST)
        self.end = end.kind if end else TorusEnd.MAX_POINTS

    @property
    def is_full(self) -> bool:
        return len(self.found) >= self.limits.max_points

    def step(
        self, here: FamilyPoint, ds: float, tried: None
    ) -> Requests[tuple[CorrectedCircle, float] | End | None]:
        """Find the next circle, with as many angles as it needs, and the length of the next step; None if that is too long."""
        del tried
        found = self._step(*here, ds)
        if not isinstance(found, CorrectedCircle):
            return at_once(found)
        return at_once((found, min(ds * _LONGER, _LONGEST) if found.num_steps <= _FEW_STEPS else ds))

    def take(
        self, here: FamilyPoint, step: tuple[CorrectedCircle, float]
    ) -> Requests[tuple[FamilyPoint, float] | End]:
        """Add a circle."""
        del here
        circle, length = step
        self.found.append(circle)
        self.note()
        is_last = circle.circle.parameter in (self.limits.low, self.limits.high)
        return at_once(
            End(TorusEnd.BOUNDS) if is_last else (FamilyPoint(circle.circle, circle.tangent), length)
        )

    def beyond(self, here: FamilyPoint) -> Requests[End]:
        """End where no step is short enough."""
        return at_once(End(self._why(*here)))

    def _step(self, now: Circle, way: Circle, length: float) -> CorrectedCircle | End | None:
        """The next circle; None for a shorter step."""
        found = corrected(self.section, now.moved(way, length), way)
        if found is None or (self.found and found.tangent.along(way) < _STRAIGHT):
            return None
        is_last = not self.limits.low <= found.circle.parameter <= self.limits.high
        if is_last:
            found = self._at_bound(now, found.circle)
        while found is not None and found.error > self.limits.tolerance:
            num = _GROWTH * len(found.circle.states) + 1
            if num > self.limits.max_angles:
                return None if length > 2 * _SHORTEST else End(TorusEnd.NOT_RESOLVED)
            finer, tangent = found.circle.resampled(num), found.tangent.resampled(num)
            found = self._with_parameter(finer) if is_last else corrected(self.section, finer, tangent)
        return found

    def _at_bound(self, now: Circle, beyond: Circle) -> CorrectedCircle | None:
        """The circle at the bound that lies before another circle."""
        low, high = self.limits.low, self.limits.high
        bound = low if beyond.parameter < low else high
        share = (bound - now.parameter) / (beyond.parameter - now.parameter)
        return self._with_parameter(now.moved(beyond.minus(now), share)._replace(parameter=bound))

    def _with_parameter(self, guess: Circle) -> CorrectedCircle | None:
        """The circle at the parameter of a guess."""
        fixed = Circle(np.zeros_like(guess.states), 0.0, 1.0)
        found = corrected(self.section, guess, fixed)
        return found and found._replace(circle=found.circle._replace(parameter=guess.parameter))

    def _why(self, now: Circle, way: Circle) -> TorusEnd:
        """Reason why no further circle was found: the motions beyond are periodic, or it is not known."""
        if not self.found:
            return TorusEnd.NOT_CONVERGED
        states = now.states[:: max(len(now.states) // 32, 1)]
        parameter = now.parameter + np.sign(way.parameter) * _SHORTEST
        past = []
        for number in range(_RUN + _LONGEST_PERIOD + 1):
            states = self.section(states, parameter).states
            if number >= _RUN:
                past.append(states)
        away = np.array([np.abs(one - past[0]).max() for one in past[1:]])
        if not (away < _EQUAL).any():
            return TorusEnd.NOT_CONVERGED
        self.locked_period = int(np.argmax(away < _EQUAL)) + 1
        return TorusEnd.LOCKED


def first_circle(state: np.ndarray, mode: np.ndarray, rotation: float, parameter: float) -> FamilyPoint:
    """Circle without size at a bifurcation, and the tangent of the family there, from the eigenvector of its multiplier."""
    angles = 2 * np.pi * np.arange(_FIRST_ANGLES) / _FIRST_ANGLES
    states = np.real(mode * np.exp(1j * angles)[:, None])
    way = Circle(states, 0.0, 0.0)
    length = np.sqrt(way.along(way))
    center = Circle(np.broadcast_to(state, states.shape).copy(), rotation, parameter)
    return FamilyPoint(center, way._replace(states=states / length))


def states_at(circle: Circle, num_angles: int) -> np.ndarray:
    """Scaled states at equal angles, the first of which is reached with the largest position of the first mass."""
    fine = interpolation(np.arange(1024) / 1024, len(circle.states)) @ circle.states[:, 0]
    start = np.argmax(fine) / 1024
    return (
        interpolation((start + np.arange(num_angles) / num_angles) % 1.0, len(circle.states)) @ circle.states
    )
