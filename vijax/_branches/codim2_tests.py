"""Test functions on a curve of bifurcations: another bifurcation meets it, or its own is degenerate.

Where an impact appears or disappears, or two exchange their order, the orbit has two faces: the neighbours on either
side have different events, hence different multipliers.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .._hybrid.limits import CLOSE, IMPACT, RELEASE, SLIP
from .._orbits.sequence import SECOND, Sequence
from .codim1_point import CurvePoint, LinearisedReturn
from .defining_systems import AbstractCondition, AtEvent, AtTurn, DefiningSystem
from .kinds import Kind, public_kind
from .multiplier_functions import of_doubling, of_meeting, of_pairs
from .parameter_family import ExtendedCycle
from .sequence_edits import with_order_exchanged, without_event
from .test_functions import (
    TestFunction,
    is_between_events,
    kind_at,
    num_on_circle,
    tests_of,
)
from .tolerances import AT_BIFURCATION, HALF_DIGITS, INFINITE_MULTIPLIER, ROUNDED

Change = Callable[[Sequence, ExtendedCycle], tuple[Sequence, ExtendedCycle]]

# Strong resonances, where orbits of other periods meet: angle of the pair of multipliers, whether the curve ends.
_ANGLES = {"1:1": (0.0, True), "1:2": (np.pi, True), "1:3": (2 * np.pi / 3, False), "1:4": (np.pi / 2, False)}
# Multipliers at each kind of point.
_NEAR = {
    Kind.FOLD: [1],
    Kind.BRANCH_POINT: [1],
    Kind.PITCHFORK: [1],
    Kind.PERIOD_DOUBLING: [-1],
    "1:1": [1, 1],
    "1:2": [-1, -1],
}
# Kinds at which branches cross.
_CROSSINGS = Kind.BRANCH_POINT, Kind.PITCHFORK
# Kinds whose condition has the angle of a multiplier as its unknown.
_WITH_ANGLE = Kind.FOLD, Kind.PERIOD_DOUBLING, Kind.NEIMARK_SACKER


class CurveNeighbourhood(NamedTuple):
    """Point of a curve with its neighbours on each face."""

    at: CurvePoint
    faces: tuple[LinearisedReturn, ...]


class CurveTest(NamedTuple):
    """Test function: changes sign at a special point.

    Attributes:
        name: of the point; kinds that meet are joined by a plus sign.
        of: the function, of a point and of the first point of the step.
        face: index of the face whose multipliers it reads.
        is_end: whether the curve ends there, as the machine follows no orbit beyond or the kind does not exist there.
        name_at: the name where it depends on the point, see `kind_at`; None otherwise.
    """

    name: str
    of: Callable[[CurveNeighbourhood, CurveNeighbourhood], float]
    face: int = 0
    is_end: bool = False
    name_at: Callable[[CurveNeighbourhood], str] | None = None

    def is_met(self, before: CurveNeighbourhood, after: CurveNeighbourhood) -> bool:
        """True if the function vanishes on a step."""
        first, last = self.of(before, before), self.of(after, before)
        return bool(first >= -ROUNDED > last if self.is_end else first * last < 0)


def curve_tests(kind: str, defining: DefiningSystem, sequence: Sequence) -> list[CurveTest]:
    """All test functions on a curve of a kind."""
    found = [test for k in range(len(faces_of(defining, sequence))) for test in _of_neighbours(kind, k)]
    if kind == Kind.FOLD:
        found.append(CurveTest("cusp", lambda near, before: float(near.at.direction @ before.at.direction)))
    if kind == Kind.NEIMARK_SACKER:
        found += [
            CurveTest(name, lambda near, before, to=angle: _angle_difference(to, near, before), is_end=is_end)
            for name, (angle, is_end) in _ANGLES.items()
        ]
    return found + [
        CurveTest(
            _meeting(kind, test.kind),
            lambda near, _, of=test.of: of(near.at),
            is_end=True,
            name_at=lambda near, test=test: _meeting(kind, kind_at(test, sequence, near.at)),
        )
        for test in tests_of(sequence)
        if not _is_own(kind, defining.condition, sequence, test)
    ]


def faces_of(defining: DefiningSystem, sequence: Sequence) -> list[Change]:
    """Edits that turn the sequence and the cycle of an orbit into those of each face."""
    as_it_is = lambda sequence, place: (sequence, place)  # noqa: E731
    condition = defining.condition
    if not isinstance(condition, AtEvent):
        return [as_it_is]
    k = int(condition.index)
    if sequence.kind[k] != IMPACT:
        return [as_it_is]
    other = without_event if condition.is_tangent else with_order_exchanged
    return [as_it_is, lambda sequence, place: other(sequence, place, k)]


def _of_neighbours(kind: str, face: int) -> list[CurveTest]:
    """Test functions of the multipliers on a face."""
    others = lambda near: _others(kind, near, face)  # noqa: E731
    doubling = "1:2" if kind == Kind.PERIOD_DOUBLING else _meeting(kind, Kind.PERIOD_DOUBLING)
    found = [
        CurveTest(doubling, lambda near, _: of_doubling(others(near)), face),
        CurveTest(_meeting(kind, Kind.NEIMARK_SACKER), lambda near, _: of_pairs(others(near)), face),
    ]
    if kind in (Kind.FOLD, *_CROSSINGS):
        return [*found, CurveTest("1:1", lambda near, _: of_meeting(others(near)), face)]
    return [*found, CurveTest(_meeting(kind, Kind.FOLD), lambda near, _: float(near.faces[face].fold), face)]


def _meeting(kind: str, other: str) -> str:
    return "+".join(sorted((kind, public_kind(other))))


def _is_own(kind: str, condition: AbstractCondition, sequence: Sequence, test: TestFunction) -> bool:
    """True for a test function that is zero on all of the curve: of its event, or of the guard whose event was inserted."""
    if not isinstance(condition, AtEvent | AtTurn):
        return False
    k = int(condition.index)
    if not is_between_events(test):
        return test.index == k and public_kind(test.kind) == kind
    of_guards = np.isin(sequence.kind % SECOND, (CLOSE, SLIP, RELEASE))
    inserted = of_guards & (sequence.mode[:-1] == sequence.mode[1:]).all(axis=1)
    guards = sequence.stop + sequence.mode.shape[1] * (sequence.kind >= SECOND)
    return any(inserted[i] and guards[i] == test.index for i in {max(k - 1, 0), k})


def special_point_name(test: CurveTest, near: CurveNeighbourhood) -> str:
    """Name of a special point, or "" if its multipliers disagree: functions also change sign at infinity."""
    name = test.name_at(near) if test.name_at else test.name
    kinds = name.split("+")
    mu, _, independence = near.faces[test.face]
    # Where a grazing impact does not act on its next return the pencil is singular: every number is a multiplier.
    if (
        Kind.GRAZING in kinds
        and {Kind.FOLD, Kind.PERIOD_DOUBLING, Kind.NEIMARK_SACKER} & {*kinds}
        and independence < HALF_DIGITS
    ):
        return "resonant_grazing"
    if Kind.NEIMARK_SACKER in kinds:
        return name if num_on_circle(mu) >= 2 * kinds.count(Kind.NEIMARK_SACKER) else ""
    values = _NEAR.get(name) or [
        _NEAR[kind][0] for kind in kinds if kind in (Kind.FOLD, *_CROSSINGS, Kind.PERIOD_DOUBLING)
    ]
    is_there = all(
        np.count_nonzero(np.abs(mu - a) < np.sqrt(AT_BIFURCATION)) >= values.count(a) for a in values
    )
    return name if is_there else ""


def _others(kind: str, near: CurveNeighbourhood, face: int) -> np.ndarray:
    """Finite multipliers on a face without those that define the curve."""
    mu = np.asarray(near.faces[face].multipliers)
    mu = mu[np.abs(mu) < INFINITE_MULTIPLIER]
    theta = np.asarray(near.at.own) if kind in _WITH_ANGLE else np.zeros(int(kind in _CROSSINGS))
    own = np.exp(1j * (np.concatenate([theta, -theta]) if kind == Kind.NEIMARK_SACKER else theta))
    for value in own[: len(mu)]:
        mu = np.delete(mu, np.argmin(np.abs(mu - value)))
    return mu


def _angle_difference(angle: float, near: CurveNeighbourhood, before: CurveNeighbourhood) -> float:
    """Difference of the angle of the pair and another, positive where the step began."""
    side = np.sign(before.at.own[0] - angle) or 1.0
    return float(side * (near.at.own[0] - angle))
