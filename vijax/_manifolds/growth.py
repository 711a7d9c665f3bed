"""Growth of a one-dimensional invariant manifold from a saddle: one branch of the unstable curve of a map.

Close to the saddle the curve is the line along an eigenvector. The map G, with the multiplier m > 1, carries the piece of the line
from d / m to d, the fundamental domain, to the next piece of the curve, and so on. Where neighbours on a piece are too far apart, or
turn too much, points are inserted: not between them, but between their preimages on an earlier piece, where they are so close that
the curve is straight to rounding, and mapped from there. G contracts onto the curve, and so the errors too. At grazing impacts the
curve has corners, which are approached; where neighbours stay apart however close their preimages are, it is cut.

Points of the line itself, mapped by all maps since, were tried first: they are rounding errors apart before a long curve is resolved.
"""

from dataclasses import dataclass, field

import numpy as np

from .._progress import tqdm
from .curve_points import CurvePoints, is_known, needed
from .reversal import StateMap

# Largest angle between neighbouring chords, in radians, unless they are shorter than this share of the spacing.
ANGLE, FINE = 0.2, 0.05
# Parts into which an interval is divided at most, and intervals of the fundamental domain at least and at most.
_MOST_PARTS, _LEAST, _MOST = 8, 32, 512
# Error of a state whose image or preimage is compared, relative to the size of the motion.
_RETURNS = 1e-6
# Pieces beyond the bounds after which the curve is given up.
_PATIENCE = 30


@dataclass(frozen=True)
class Seed:
    """The line at a saddle from which a branch grows, in states (W x, v).

    Attributes:
        saddle: the state of the saddle, (2 n,).
        direction: unit eigenvector, towards the branch, (2 n,).
        multiplier: of the map G, more than 1.
        reach: distance at which the line ends.
        map: the map over a forcing period.
        inverse: its inverse, by which states are checked; None if they need no check.
        num_periods: forcing periods of G.
        size: size of the motion.
    """

    saddle: np.ndarray
    direction: np.ndarray
    multiplier: float
    reach: float
    map: StateMap
    inverse: StateMap | None
    num_periods: int
    size: float

    def line(self, places: np.ndarray) -> np.ndarray:
        """States of the fundamental domain at places from 0 to 1, (places, 2 n)."""
        away = self.reach * self.multiplier ** (places - 1)
        return self.saddle + away[:, None] * self.direction

    def after(self, states: np.ndarray) -> np.ndarray:
        """Images of states under G, NaN where there are none."""
        ends = self.map(states, self.num_periods)
        if self.inverse is not None:
            error = np.abs(self.inverse(ends, self.num_periods) - states).max(axis=1, initial=0.0)
            ends[~(error < _RETURNS * self.size)] = np.nan
        return ends


@dataclass
class CurveGrowth:
    """A branch as it grows.

    Attributes:
        seed: the line at the saddle.
        length: its length at most, in (W x, v).
        spacing: largest distance of neighbours.
        most: its points at most.
        box: lowest and highest states that count, (2, 2 n).
        bar: progress.
        rows: states of the curve so far, NaN where it is cut.
        end: why the branch ends.
    """

    seed: Seed
    length: float
    spacing: float
    most: int
    box: np.ndarray
    bar: tqdm
    rows: list[np.ndarray] = field(default_factory=list)
    end: str = "interrupted"

    def run(self) -> None:
        """Let the branch grow to its end."""
        count = int(np.clip(4 * self.seed.multiplier, _LEAST, _MOST)) + 1
        curve = CurvePoints.of_line(self.seed.line(np.linspace(0, 1, count)), self.seed.after, self.seed.size)
        self.rows.append(self._first_row())
        remaining, room, longest, away = self.length, self.most - len(self.rows[0]), 0.0, 0
        while True:
            is_resolved = self._refine(curve, remaining)
            is_needed = needed(curve.states, self._is_cut(curve), self.spacing, ANGLE)
            is_kept = is_needed | curve.is_first
            curve.keep(is_kept)
            grown = self._grown(curve)
            row = self._row(curve, is_needed[is_kept] & (grown <= remaining))[:room]
            self.rows.append(row)
            count, added = int(is_known(row).sum()), float(min(grown[-1], remaining))
            self.bar.update(count)
            remaining, room = remaining - added, room - count
            longest, away = max(longest, added), 0 if self._is_inside(curve).any() else away + 1
            ends = {
                "points": room <= 0 or not is_resolved,
                "length": remaining <= FINE * self.spacing,
                "lost": not np.isfinite(curve.states).any(),
                "bounds": away > _PATIENCE,
                "attractor": longest > self.spacing and not away and added < FINE * self.spacing,
            }
            if any(ends.values()):
                self.end = next(name for name, holds in ends.items() if holds)
                return
            curve.map()

    def _first_row(self) -> np.ndarray:
        """States from the saddle to the fundamental domain."""
        near = self.seed.reach / self.seed.multiplier
        count = min(int(np.ceil(near / self.spacing)), self.most)
        return self.seed.saddle + near * np.arange(count)[:, None] / count * self.seed.direction

    def _refine(self, curve: CurvePoints, remaining: float) -> bool:
        """Insert points until the piece is resolved as far as its length counts; False if they are too many."""
        while True:
            curve.cut_jumps(FINE * self.spacing)
            is_beyond = self._grown(curve)[:-1] > remaining
            parts = np.where(is_beyond, 1, self._parts(curve))
            if (parts > 1).any():
                if len(curve.states) > 4 * self.most + _MOST:
                    curve.keep(np.arange(len(curve.states)) <= int((parts > 1).argmax()))
                    return False
                curve.divide(parts)
            else:
                is_short = curve.lengths() <= FINE * self.spacing
                if not curve.test_middles(~is_beyond & ~is_short & ~self._is_cut(curve), ANGLE):
                    return True

    def _parts(self, curve: CurvePoints) -> np.ndarray:
        """Parts into which each interval is to be divided, 1 for none."""
        length, chords = curve.lengths(), np.diff(curve.states, axis=0)
        is_finite = np.isfinite(length)
        parts = np.where(length > self.spacing, np.ceil(np.where(is_finite, length, 1) / self.spacing), 1)
        with np.errstate(invalid="ignore"):
            cosine = (chords[1:] * chords[:-1]).sum(axis=1)
            is_sharp = cosine < np.cos(ANGLE) * length[1:] * length[:-1]
        is_sharp &= ~curve.is_cut[1:] & ~curve.is_cut[:-1]
        bends = np.append(is_sharp, False) | np.append(False, is_sharp)
        parts = np.where(bends & (length > FINE * self.spacing), np.maximum(parts, 2), parts)
        is_state = is_known(curve.states)
        parts = np.where(is_state[1:] != is_state[:-1], _MOST_PARTS, parts)
        parts = np.clip(parts, 1, _MOST_PARTS).astype(int)
        return np.where(curve.is_cut | ~self._may_enter(curve), 1, parts)

    def _may_enter(self, curve: CurvePoints) -> np.ndarray:
        """True for intervals that the bounds contain, or that lie beside them by less than their own length."""
        ends = curve.states[:-1], curve.states[1:]
        reach = np.nan_to_num(curve.lengths(), nan=0.0)[:, None]
        with np.errstate(invalid="ignore"):
            low, high = np.fmin(*ends) - reach, np.fmax(*ends) + reach
            return ((low <= self.box[1]) & (high >= self.box[0])).all(axis=1)

    def _is_inside(self, curve: CurvePoints) -> np.ndarray:
        """True for states within the bounds."""
        with np.errstate(invalid="ignore"):
            return ((curve.states >= self.box[0]) & (curve.states <= self.box[1])).all(axis=1)

    def _is_cut(self, curve: CurvePoints) -> np.ndarray:
        """True for intervals that are no part of the curve that is drawn."""
        is_inside = self._is_inside(curve)
        return curve.is_cut | ~np.isfinite(curve.lengths()) | ~is_inside[1:] | ~is_inside[:-1]

    def _grown(self, curve: CurvePoints) -> np.ndarray:
        """Length of a piece up to each of its points."""
        length = np.minimum(curve.lengths(), self.spacing)
        return np.append(0.0, np.cumsum(np.where(self._is_cut(curve), 0, length)))

    def _row(self, curve: CurvePoints, is_shown: np.ndarray) -> np.ndarray:
        """States of a piece but its last, which is the first of the next; NaN where it is cut."""
        is_shown = is_shown & self._is_inside(curve)
        states = np.where(is_shown[:, None], curve.states, np.nan)
        states = np.insert(states[:-1], np.flatnonzero(self._is_cut(curve)) + 1, np.nan, axis=0)
        is_between = np.insert(~is_shown[:-1], np.flatnonzero(self._is_cut(curve)) + 1, False)
        states = states[~is_between]
        is_state = is_known(states)
        return states[is_state | np.append(False, is_state[:-1])]
