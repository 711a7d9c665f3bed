"""Points of a branch, and the requests that compute them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import numpy as np

from .._jax.packing import Packed
from .._orbits.sequence import Sequence
from .kernels import CorrectedCycle, corrected_cycle
from .kinds import EndKind
from .multiplier_functions import of_neighbours
from .padding import trimmed
from .parameter_family import ExtendedCycle
from .requests import KernelCall, Requests, ask, simulation_of
from .tolerances import LONGEST_STEP

MAXIMUM, MINIMUM = "maximum", "minimum"


class PeakMark(NamedTuple):
    """Mark of a peak: its quantity and height.

    Attributes:
        kind: `MAXIMUM` or `MINIMUM`.
        quantity: with its mass.
        height: the quantity at the peak.
        event: kind of the bifurcation at which the quantity has a kink; "" where it is smooth.
    """

    kind: str
    quantity: str
    height: float
    event: str = ""


class BranchPoint(NamedTuple):
    """A cycle on a branch.

    Attributes:
        sequence: events of the cycle.
        place: the cycle and its parameter.
        cycle: the corrected cycle with its margins, padded.
        kind: kind of the bifurcation, or "".
        arc: arclength from the start of the branch.
        is_admissible: True if the machine follows the cycle.
        peak: the `PeakMark` of a peak, or None.
    """

    sequence: Sequence
    place: ExtendedCycle
    cycle: CorrectedCycle
    kind: str
    arc: float
    is_admissible: bool
    peak: PeakMark | None = None

    @classmethod
    def of(cls, sequence: Sequence, cycle: CorrectedCycle, arc: float, *, kind: str = "") -> "BranchPoint":
        """The point of a corrected cycle."""
        return cls(
            sequence, trimmed(cycle.found.place, len(sequence.kind)), cycle, kind, arc, is_admissible=True
        )

    @property
    def tangent(self) -> ExtendedCycle:
        """Tangent of the branch."""
        return trimmed(self.cycle.found.tangent, len(self.sequence.kind))

    def turned(self) -> "BranchPoint":
        """The point with the opposite tangent."""
        found, rates = self.cycle.found, type(self.cycle.rates)(*(-rate for rate in self.cycle.rates))
        found = found._replace(tangent=found.tangent.turned())
        neighbours, past = of_neighbours(found), np.full_like(self.cycle.past, np.nan)
        cycle = self.cycle._replace(found=found, rates=rates, neighbours=neighbours, past=past)
        return self._replace(cycle=cycle)


class PlainPoint(NamedTuple):
    """A point of a plain step, as one row of a batched result: most are never unpacked alone.

    Attributes:
        sequence: events of the cycle.
        rows: packed corrected cycles of a batch.
        row: row of this point.
        arc: arclength, as in `BranchPoint`.
    """

    sequence: Sequence
    rows: Packed
    row: int
    arc: float

    @property
    def kind(self) -> str:
        """Always empty: a plain step has no bifurcation."""
        return ""

    @property
    def peak(self) -> None:
        """Always None: a peak is found between points, or where a bifurcation is."""

    @property
    def is_admissible(self) -> bool:
        """Always True: else the step would not be plain."""
        return True

    def alone(self) -> BranchPoint:
        """The same point, unpacked."""
        return BranchPoint.of(self.sequence, self.rows.at(self.row).unpacked(), self.arc)


def stacked_cycles(points: list[BranchPoint | PlainPoint]) -> CorrectedCycle:
    """Corrected cycles of points, stacked, (points, ...); events are padded to the largest room of any point."""
    groups: dict[int, list[int]] = {}
    for k, point in enumerate(points):
        make = id(point.rows.layout) if isinstance(point, PlainPoint) else len(point.cycle.found.speeds)
        groups.setdefault(make, []).append(k)
    parts = [_stacked([points[k] for k in own]) for own in groups.values()]

    def joined(*arrays: np.ndarray) -> np.ndarray:
        whole = np.zeros((len(points), *np.max([a.shape[1:] for a in arrays], axis=0)), arrays[0].dtype)
        for own, a in zip(groups.values(), arrays, strict=True):
            whole[(own, *map(slice, a.shape[1:]))] = a
        return whole

    return jax.tree.map(joined, *parts)


def _stacked(points: list) -> CorrectedCycle:
    """`stacked_cycles` for points of one class and room."""
    if not isinstance(points[0], PlainPoint):
        return jax.tree.map(lambda *a: np.stack(a), *(point.cycle for point in points))
    rows = [point.rows.at(point.row) for point in points]
    reals, wholes = (np.stack(own) for own in zip(*((row.reals, row.wholes) for row in rows), strict=True))
    return Packed(reals, wholes, points[0].rows.layout).unpacked()


@dataclass
class Budget:
    """Budget of points of all branches of a call.

    Attributes:
        points: number of points that are left.
        is_spent: True once none is; checked between steps, each of which adds a point to every branch.
    """

    points: int | float = np.inf
    is_spent: bool = False


@dataclass
class DirectedBranch:
    """A branch in one direction, as far as it was followed.

    Attributes:
        num_periods: n; infinite where no load sets the period, see `ParameterFamily.last_phase`.
        bounds: bounds of the scaled parameter.
        max_points: largest number of points.
        longest: longest step, along the scaled parameter or for a cycle of size 1.
        points: points so far.
        cascade: stop and point of the last grazings, if all added an impact of one stop without other events between.
        rounds: number of times that its cycles traverse a shorter one.
        end: reason for its end.
        monitored: zeros of monitors, located between its points.
        last: arclength at which a requested condition ends it, or None.
        budget: points that all branches together may have.
    """

    num_periods: float
    bounds: tuple[float, float]
    max_points: int
    longest: float = LONGEST_STEP
    points: list[BranchPoint | PlainPoint] = field(default_factory=list)
    cascade: list[tuple[int, BranchPoint]] = field(default_factory=list)
    rounds: int = 1
    end: str = EndKind.INTERRUPTED
    monitored: list[BranchPoint] = field(default_factory=list)
    last: float | None = None
    budget: Budget = field(default_factory=Budget)

    @property
    def is_full(self) -> bool:
        """True if there are `max_points` points, or all branches together have as many as they may, or it was ended."""
        return self.last is not None or self.budget.is_spent or len(self.points) >= self.max_points

    def all_points(self) -> list[BranchPoint | PlainPoint]:
        """Points up to the requested end, with the zeros of monitors between them."""
        last = np.inf if self.last is None else self.last
        points = [point for point in self.points if point.arc <= last]
        end = points[-1].arc if points and self.last is None else last
        monitored = [point for point in self.monitored if point.arc <= end]
        return sorted([*points, *monitored], key=lambda point: point.arc) if monitored else points

    def nearest_bound(self, p: float) -> float:
        """The bound nearest to a parameter."""
        return min(self.bounds, key=lambda bound: abs(bound - p))


class End(NamedTuple):
    """End of a branch.

    Attributes:
        kind: its reason, an `EndKind` or the kind of the bifurcation that no branch passes.
        point: the point where it ends, if the walk has it not yet.
    """

    kind: str
    point: BranchPoint | None = None


class TooManyEvents(Exception):
    """A branch requests a cycle with more events than there is room for, which ends it."""


def at_parameter(sequence: Sequence, guess: ExtendedCycle, p: float) -> Requests[CorrectedCycle]:
    """Correct a cycle at a fixed parameter."""
    only_p = ExtendedCycle(0 * guess.z, 0 * guess.flights, np.asarray(1.0))
    return (yield from corrected(sequence, guess, only_p, p))


def between(point: BranchPoint, new: BranchPoint, share: float) -> ExtendedCycle:
    """Linear interpolation between the cycles of two points."""
    return ExtendedCycle(*(a + share * (b - a) for a, b in zip(point.place, new.place, strict=True)))


def predicted_point(point: BranchPoint, ds: float) -> Requests[BranchPoint]:
    """Predict and correct the point a length `ds` along the branch; it may not have converged."""
    cycle = yield from on_plane(point, point.place.moved(point.tangent, ds), ds)
    return BranchPoint.of(point.sequence, cycle, point.arc + ds)


def on_plane(point: BranchPoint, guess: ExtendedCycle, s: float) -> Requests[CorrectedCycle]:
    """Correct a cycle in the plane across the tangent of a point, at a distance `s` from it."""
    tangent = point.tangent
    return (yield from corrected(point.sequence, guess, tangent, point.place.along(tangent) + s))


def corrected(
    sequence: Sequence, guess: ExtendedCycle, weights: ExtendedCycle, target: float
) -> Requests[CorrectedCycle]:
    """Correct a cycle with `weights . place = target`."""
    cycle = yield from ask(KernelCall(corrected_cycle, sequence, (guess, weights, np.asarray(target))))
    return cycle


def correct_with_free_parameter(sequence: Sequence, place: ExtendedCycle) -> Requests[CorrectedCycle]:
    """Correct a cycle where it is: the plane of random weights is generic, so it does not contain the branch."""
    rng = np.random.default_rng(0)
    weights = ExtendedCycle(*(np.asarray(rng.normal(size=np.shape(a))) for a in place))
    weights = ExtendedCycle(*(a / np.sqrt(weights.along(weights)) for a in weights))
    return (yield from corrected(sequence, place, weights, place.along(weights)))


def first_followed(
    sequence: Sequence, place: ExtendedCycle, along: ExtendedCycle, lengths: tuple[float, ...]
) -> Requests[BranchPoint | None]:
    """The cycle at the first of several distances in a direction at which the machine follows it; None if at none."""
    for ds in lengths:
        cycle = yield from corrected(sequence, place.moved(along, ds), along, place.along(along) + ds)
        other = BranchPoint.of(sequence, cycle, 0.0)
        if cycle.found.is_converged and (yield from is_followed(other)):
            return other
    return None


def is_followed(point: BranchPoint) -> Requests[bool]:
    """True if the machine follows the cycle."""
    followed = yield from ask(simulation_of(point.sequence, point.place))
    return bool(followed.is_alike)
