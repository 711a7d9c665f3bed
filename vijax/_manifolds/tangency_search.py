"""The search for homoclinic tangencies along a parameter.

At every value turns of the unstable manifold are found, and by a second value beside it where they would touch the stable one. Those
that would near the value are followed there by the secant method. Then motions are followed for further returns, which make
the value exact.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .._branches.branch import Branch
from .._orbits.orbit import ORBIT_RESULTS, PeriodicOrbit
from .._orbits.periodic_orbit import periodic_orbit
from .._system.parameters import set_parameter
from .excursions import Excursions, Turn
from .growth import Seed
from .manifolds import size_of
from .seeds import Names, NotSmooth, seeds_of

# Distance of the second value, and of that where manifolds would touch, in distances of two values.
_BESIDE, _FORESEEN = 0.02, 1.5
# Distance in fundamental domains within which a turn is the same at two values, and within which it is then looked for.
_ALIKE, _AROUND = 0.05, 0.02
# Change of the value that is rounding, relative to the bounds, and steps of the secant method at most.
_ROUNDING, _STEPS = 1e-14, 12
# Largest share of an offset that a step of the secant method leaves.
_SHRINKS = 0.5
# Further returns at most, and the error above which the motion does not come back to the saddle, relative to the bounds.
_RETURNS, _EXACT = 12, 1e-6
# Distances below which two tangencies are one, in fundamental domains and relative to the bounds.
_ONE = 1e-4, 1e-7


class Tangency(NamedTuple):
    """A value of the parameter at which the manifolds touch.

    Attributes:
        value: of the parameter.
        error: of the value.
        which: number of the side and point of the saddle.
        turn: where they touch.
        meet: 1 where they cross above the value, -1 below.
        is_smooth: false if a corner touches, or a level piece.
    """

    value: float
    error: float
    which: int
    turn: Turn
    meet: int
    is_smooth: bool


class _Zero(NamedTuple):
    """A value at which a turn has the offset zero, and the derivative of the offset by the value."""

    value: float
    slope: float
    turn: Turn


class Saddles:
    """Saddles along a part of a branch, and the motions from their sides and points.

    Attributes:
        path: the parameter.
        values: values of the parameter on that part, ascending, (points,).
        names: side and point of the saddle, of each kind of motion.
        phase: of the load, in radians, at the saddles.
    """

    def __init__(self, branch: Branch, points: np.ndarray):
        order = points[np.argsort(branch.values[points], kind="stable")]
        middle = branch.orbit(int(order[len(order) // 2]))
        self.path, self.values = branch.path, branch.values[order]
        self.phase = float(middle.phase)
        self._middle, self._starts = middle, _states(branch)[order]
        self.names, lines = _names_and_lines(middle)
        self._first = _excursions(lines)
        self._known: dict[float, list[Excursions] | None] = {}

    @property
    def num_periods(self) -> int:
        """Forcing periods of one map."""
        return self._first[0].seed.num_periods

    @property
    def span(self) -> float:
        """Distance of the lowest and the highest value."""
        return float(self.values[-1] - self.values[0])

    def at(self, value: float) -> list[Excursions] | None:
        """Motions from the saddle at a value; None if there is none on this part of the branch."""
        if value not in self._known:
            self._known[value] = self._new(value) if self.values[0] <= value <= self.values[-1] else None
        return self._known[value]

    def _new(self, value: float) -> list[Excursions] | None:
        orbit = self._orbit(value)
        if orbit is None:
            return None
        try:
            lines = _names_and_lines(orbit)[1]
        except NotSmooth:
            return None
        return _excursions([_like(*both) for both in zip(lines, self._first, strict=True)])

    def _orbit(self, value: float) -> PeriodicOrbit | None:
        k, n = max(int(np.searchsorted(self.values, value)), 1), self._starts.shape[1] // 2
        share = (value - self.values[k - 1]) / (self.values[k] - self.values[k - 1] or 1.0)
        last, following = self._starts[k - 1], self._starts[k]
        for start in (last + share * (following - last), following if share > 0.5 else last):
            found = periodic_orbit(
                set_parameter(self._middle.system, self.path, value),
                start[:n],
                start[n:],
                self._middle.num_periods,
                phase=self.phase,
                throw=False,
            )
            is_found = bool(found.result == ORBIT_RESULTS.successful)
            if (
                is_found
                and np.sum(np.abs(found.multipliers) > 1) == 1
                and np.isfinite(found.multipliers).all()
            ):
                return found
        return None


@dataclass
class TangencySearch:
    """The search along a part of a branch.

    Attributes:
        saddles: its saddles.
        values: values at which turns are looked for.
        max_returns: maps beyond those that lead away, within which a motion is back.
    """

    saddles: Saddles
    values: np.ndarray
    max_returns: int

    @property
    def spacing(self) -> float:
        """Distance of two values."""
        return float(self.values[1] - self.values[0])

    @property
    def rounding(self) -> float:
        """Change of the parameter that is rounding."""
        ends = self.saddles.values[[0, -1]]
        return float(max(_ROUNDING * np.ptp(ends), 4 * np.spacing(np.abs(ends).max())))

    def run(self, update: Callable[[], object]) -> list[Tangency]:
        """The tangencies, in the order of the parameter."""
        found: list[Tangency] = []
        for value in self.values.tolist():
            for which, turn, slope in self._candidates(value):
                foreseen = _Zero(value - turn.offset / slope, slope, turn)
                if any(self._is_near(which, foreseen, other) for other in found):
                    continue
                one = self._tangency(which, foreseen)
                if one is not None and not any(self._is_same(one, other) for other in found):
                    found.append(one)
            update()
        return sorted(found)

    def motions(self, which: int, value: float) -> Excursions:
        """Motions from a side and point of the saddle at a value at which there is one."""
        motions = self.saddles.at(value)
        assert motions is not None
        return motions[which]

    def _candidates(self, value: float) -> list[tuple[int, Turn, float]]:
        """Turns that would touch the stable manifold near a value, and the derivatives of their offsets."""
        beside = value + _BESIDE * self.spacing * (1 if value < self.values[-1] else -1)
        both, found = (self.saddles.at(value), self.saddles.at(beside)), []
        for which, (here, there) in enumerate(zip(*(one or [] for one in both), strict=False)):
            others = there.turns(self.max_returns)
            for turn in here.turns(self.max_returns):
                alike = [a for a in others if (a.maps, a.sign) == (turn.maps, turn.sign)]
                other = min(alike, key=lambda a: abs(a.place - turn.place), default=None)
                if other is None or abs(other.place - turn.place) > _ALIKE:
                    continue
                slope = (other.offset - turn.offset) / (beside - value)
                if abs(turn.offset) < _FORESEEN * self.spacing * abs(slope):
                    found.append((which, turn, slope))
        return found

    def _tangency(self, which: int, foreseen: _Zero) -> Tangency | None:
        """The tangency near a value where one is foreseen; None if there is none."""
        zeros = [self._zero(which, foreseen, foreseen.turn.maps, _AROUND)]
        changes: list[float] = []
        while zeros[-1] is not None and len(zeros) <= _RETURNS:
            last = zeros[-1]
            growth = self.motions(which, last.value).seed.multiplier
            width = _AROUND * growth ** (-len(zeros) / 2)
            zeros.append(
                self._zero(which, last._replace(slope=growth * last.slope), last.turn.maps + 1, width)
            )
            if zeros[-1] is None:
                break
            changes.append(abs(zeros[-1].value - last.value))
            if changes[-1] < self.rounding or (len(changes) > 2 and changes[-1] > min(changes)):
                break
        if not changes:
            return None
        best = int(np.argmin(changes))
        zero = zeros[best + 1]
        assert zero is not None
        nearer = self._zero(which, zero, zero.turn.maps + 1, _AROUND, is_nearer=True)
        if nearer is None:
            return None
        error = max(changes[best], abs(nearer.value - zero.value), self.rounding)
        shape = self.motions(which, zero.value).shape(zero.turn)
        if error > _EXACT * self.saddles.span or shape == "jump":
            return None
        meet = -int(np.sign(zero.slope)) * zero.turn.sign
        return Tangency(zero.value, float(error), which, zero.turn, meet, shape == "smooth")

    def _zero(
        self, which: int, near: _Zero, maps: int, width: float, is_nearer: bool = False
    ) -> _Zero | None:
        """The value at which a turn has the offset zero, by the secant method; None if there is none in the bounds.

        Args:
            which: number of the side and point of the saddle.
            near: a guess.
            maps: maps since the fundamental domain.
            width: distance, in fundamental domains, within which the turn is looked for.
            is_nearer: take the fundamental domain before, nearer to the saddle.
        """
        value, slope, turn, before = near.value, near.slope, near.turn, None
        for _ in range(_STEPS):
            motions = self.saddles.at(value)
            if motions is None:
                return None
            at = motions[which].nearer() if is_nearer else motions[which]
            found = at.turn(turn, maps, width)
            if found is None:
                return None
            if abs(found.offset) <= self.rounding * abs(slope):
                return _Zero(float(value), float(slope), found)
            if before is not None:
                if abs(found.offset) > _SHRINKS * abs(before[1].offset):
                    return None
                slope = (found.offset - before[1].offset) / (value - before[0])
            before, turn = (value, found), found
            value = value - found.offset / slope
        return None

    def _is_near(self, which: int, foreseen: _Zero, other: Tangency) -> bool:
        """True if a zero that is foreseen is most likely a tangency that was found."""
        away = (foreseen.turn.place - other.turn.place + 0.5) % 1 - 0.5
        is_near = abs(foreseen.value - other.value) < _ALIKE * self.spacing
        return bool(which == other.which and abs(away) < _ALIKE and is_near)

    def _is_same(self, one: Tangency, other: Tangency) -> bool:
        place, share = _ONE
        away = (one.turn.place - other.turn.place + 0.5) % 1 - 0.5
        is_near = abs(one.value - other.value) < share * self.saddles.span
        return bool(one.which == other.which and abs(away) < place and is_near)


def _states(branch: Branch) -> np.ndarray:
    """Starts of the orbits of a branch, (points, 2 n)."""
    return np.concatenate([branch.points["x0"].values, branch.points["v0"].values], axis=1)


def _names_and_lines(orbit: PeriodicOrbit) -> tuple[list[Names], list[Seed]]:
    """Each side and point of a saddle, and the line on which motions leave it there."""
    seeds = seeds_of(orbit, "unstable", size_of(orbit), all_points=True)
    return [names for names, _ in seeds], [seed for _, seed in seeds]


def _excursions(lines: list[Seed]) -> list[Excursions]:
    """Motions that leave a saddle on some lines, the first of them at its first point."""
    left = _left_eigenvector(lines[0])
    return [Excursions(line, lines[0].saddle, lines[0].direction, left) for line in lines]


def _like(line: Seed, other: Excursions) -> Seed:
    """A line as long as another and to the same side, so that places and sides keep their meaning."""
    sign = np.sign(line.direction @ other.seed.direction)
    return replace(line, reach=other.seed.reach, direction=sign * line.direction)


def _left_eigenvector(seed: Seed) -> np.ndarray:
    """Left eigenvector of the multiplier outside the unit circle, whose product with the direction is 1."""
    values, vectors = np.linalg.eig(seed.map.derivative(seed.saddle, seed.num_periods).T)
    left = np.real(vectors[:, np.abs(values).argmax()])
    return left / (left @ seed.direction)
