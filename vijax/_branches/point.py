"""A cycle on a branch, and how it is asked for."""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from .._orbits.sequence import Sequence
from .kernels import CorrectedCycle, Followed, KernelCall, confirm, corrected_cycle, trimmed
from .packing import Packed
from .parameter_family import ExtendedCycle

# Runs of orbits whose neighbours leave faster than this say nothing.
TRUSTED = 1e4

Asked = Generator[Any, Any, Any]


class BranchPoint(NamedTuple):
    """A cycle on a branch.

    Attributes:
        sequence: what happens.
        place: the cycle.
        seen: what is known of it.
        kind: of the bifurcation, or "".
        arc: length of the branch from where it was begun.
        is_admissible: whether the machine follows it.
    """

    sequence: Sequence
    place: ExtendedCycle
    seen: CorrectedCycle
    kind: str
    arc: float
    is_admissible: bool

    @classmethod
    def of(cls, sequence: Sequence, seen: CorrectedCycle, arc: float, *, kind: str = "") -> "BranchPoint":
        """A point as it is seen."""
        return cls(
            sequence, trimmed(seen.found.place, len(sequence.kind)), seen, kind, arc, is_admissible=True
        )

    @property
    def tangent(self) -> ExtendedCycle:
        """Of the branch."""
        return trimmed(self.seen.found.tangent, len(self.sequence.kind))

    def turned(self) -> "BranchPoint":
        """The point, to be left in the other direction."""
        found = self.seen.found
        return self._replace(seen=self.seen._replace(found=found._replace(tangent=found.tangent.turned())))


class PlainPoint(NamedTuple):
    """A cycle of a plain step, as one row of what was computed for many: most are never looked at by themselves.

    Attributes:
        sequence: what happens.
        rows: what is known of cycles, of this among others.
        row: which of them it is.
        arc: as of `BranchPoint`.
    """

    sequence: Sequence
    rows: Packed
    row: int
    arc: float

    @property
    def kind(self) -> str:
        """None."""
        return ""

    @property
    def is_admissible(self) -> bool:
        """Else the step would not have been plain."""
        return True

    def alone(self) -> BranchPoint:
        """The same by itself."""
        return BranchPoint.of(self.sequence, self.rows.at(self.row).tree(), self.arc)


def side_by_side(points: list[BranchPoint | PlainPoint]) -> CorrectedCycle:
    """What is known of points, (points, ...); for events there is room for the most that any of them has."""
    groups: dict[int, list[int]] = {}
    for k, point in enumerate(points):
        make = id(point.rows.layout) if isinstance(point, PlainPoint) else len(point.seen.found.speeds)
        groups.setdefault(make, []).append(k)
    parts = [_stacked([points[k] for k in own]) for own in groups.values()]

    def joined(*arrays: np.ndarray) -> np.ndarray:
        whole = np.zeros((len(points), *np.max([a.shape[1:] for a in arrays], axis=0)), arrays[0].dtype)
        for own, a in zip(groups.values(), arrays, strict=True):
            whole[(own, *map(slice, a.shape[1:]))] = a
        return whole

    return jax.tree.map(joined, *parts)


def _stacked(points: list) -> CorrectedCycle:
    """The same of points of one kind and room."""
    if not isinstance(points[0], PlainPoint):
        return jax.tree.map(lambda *a: np.stack(a), *(point.seen for point in points))
    rows = zip(*([a[point.row] for a in point.rows.arrays] for point in points), strict=True)
    return Packed(tuple(np.stack(row) for row in rows), points[0].rows.layout).tree()


@dataclass
class Walk:
    """A branch in one direction, as far as it was followed.

    Attributes:
        num_periods: n.
        bounds: of the scaled parameter.
        max_points: the most points.
        points: so far.
        cascade: the last grazings, if all added an impact of one stop, and nothing else happened between them.
        rounds: how often its cycles are a shorter one.
        end: why it ended.
    """

    num_periods: float
    bounds: tuple[float, float]
    max_points: int
    points: list[BranchPoint | PlainPoint] = field(default_factory=list)
    cascade: list[tuple[int, BranchPoint]] = field(default_factory=list)
    rounds: int = 1
    end: str = "interrupted"

    @property
    def is_full(self) -> bool:
        """Whether there are as many points as were asked for."""
        return len(self.points) >= self.max_points

    def nearest_bound(self, p: float) -> float:
        """The bound next to a value of the parameter."""
        return min(self.bounds, key=lambda bound: abs(bound - p))


class Ended(Exception):
    """A branch is not followed any further; says why."""


class Full(Ended):
    """A cycle has more events than there is room for."""


def at_parameter(sequence: Sequence, guess: ExtendedCycle, p: float) -> Asked:
    """The cycle at a value of the parameter."""
    only_p = ExtendedCycle(0 * guess.z, 0 * guess.flights, np.asarray(1.0))
    return (yield from corrected(sequence, guess, only_p, p))


def between(point: BranchPoint, new: BranchPoint, share: float) -> ExtendedCycle:
    """A place on the chord from one point to another."""
    return ExtendedCycle(*(a + share * (b - a) for a, b in zip(point.place, new.place, strict=True)))


def predicted_point(point: BranchPoint, ds: float) -> Asked:
    """The point some way along the branch, as it is found: it may be none."""
    seen = yield from on_plane(point, point.place.moved(point.tangent, ds), ds)
    return BranchPoint.of(point.sequence, seen, point.arc + ds)


def on_plane(point: BranchPoint, guess: ExtendedCycle, s: float) -> Asked:
    """The cycle where the branch meets the plane across its tangent, some way from a point."""
    tangent = point.tangent
    return (yield from corrected(point.sequence, guess, tangent, point.place.along(tangent) + s))


def corrected(sequence: Sequence, guess: ExtendedCycle, weights: ExtendedCycle, target: float) -> Asked:
    """The cycle with `weights . place = target`."""
    seen: CorrectedCycle = yield KernelCall(corrected_cycle, sequence, (guess, weights, np.asarray(target)))
    return seen


def as_it_is(sequence: Sequence, place: ExtendedCycle) -> Asked:
    """A cycle that is known. No direction is special to the weights, and so none is the branch's plane."""
    rng = np.random.default_rng(0)
    weights = ExtendedCycle(*(np.asarray(rng.normal(size=np.shape(a))) for a in place))
    weights = ExtendedCycle(*(a / np.sqrt(weights.along(weights)) for a in weights))
    return (yield from corrected(sequence, place, weights, place.along(weights)))


def first_followed(
    sequence: Sequence, place: ExtendedCycle, along: ExtendedCycle, lengths: tuple[float, ...]
) -> Asked:
    """The cycle some way from a place, at the first of several distances at which the machine follows it; None if at none."""
    for ds in lengths:
        seen = yield from corrected(sequence, place.moved(along, ds), along, place.along(along) + ds)
        other = BranchPoint.of(sequence, seen, 0.0)
        if seen.found.is_converged and (yield from is_followed(other)):
            return other
    return None


def is_followed(point: BranchPoint) -> Asked:
    """Whether the machine follows the cycle."""
    followed: Followed = yield KernelCall(confirm, point.sequence, (point.place,))
    return bool(followed.is_alike)
