"""Motions that leave a saddle along its unstable manifold, and where they pass its stable manifold when they come back.

Near the saddle the stable manifold is the hyperplane on which a linear function is zero, the left eigenvector of the multiplier
outside the unit circle. Its sign tells on which side a motion passes. Its extremum along the unstable manifold, a turn, is zero where
the manifolds touch. Each further return makes the value more exact: the motion comes closer to the saddle, where the hyperplane is
exact, and the function grows by the multiplier.

The stable manifold itself is not needed, so that the map may have no inverse: masses may stick, restitution may be 0.
"""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from .growth import Seed
from .reversal import BATCH

# Places on the fundamental domain, which is sampled beyond its ends: a turn may lie at one of them.
_PLACES = np.linspace(-0.1, 1.1, 4 * BATCH)
# Width of an interval that is narrowed, at the end, and the times it is narrowed or moved at most.
_NARROW, _MOST = 1e-10, 24
# Largest width of an interval, in fundamental domains.
_WIDE = 0.5
# Distance from the saddle, relative to the farthest one, within which a turn counts.
_NEAR = 0.5
# Distance beyond which a motion is taken to leave for ever, relative to the size of the saddle.
_FARTHEST = 1e3
# Differences of offsets below which the curve is level, as where many motions stick and become one, relative to the farthest state.
_LEVEL = 1e-9
# The same where all of them are one number.
_ROUNDING = 1e-13
# Distances from a turn at which its shape is measured, and the least power of the distance there that is no jump, and no corner.
_BESIDE, _NO_JUMP, _SMOOTH = (1e-3, 1e-5), 0.25, 1.7
Shape = Literal["smooth", "corner", "jump"]


class Turn(NamedTuple):
    """An extremum, along the unstable manifold, of the offset from the stable one.

    Attributes:
        maps: number of maps since the fundamental domain.
        sign: 1 for a minimum, -1 for a maximum.
        place: place on the fundamental domain, about 0 to 1.
        offset: offset from the stable manifold.
        along: distance from the saddle along the stable manifold.
    """

    maps: int
    sign: int
    place: float
    offset: float
    along: float


@dataclass(frozen=True)
class Excursions:
    """Motions from one side of one point of a saddle, back to its first point.

    Attributes:
        seed: the line at the point that they leave.
        target: state (W x, v) of the first point, (2 n,).
        direction: unit vector along the unstable manifold there.
        left: left eigenvector there; its product with `direction` is 1.
    """

    seed: Seed
    target: np.ndarray
    direction: np.ndarray
    left: np.ndarray

    def nearer(self) -> "Excursions":
        """The same motions, from a line shorter by one map."""
        return replace(self, seed=replace(self.seed, reach=self.seed.reach / self.seed.multiplier))

    def motions(self, places: np.ndarray, maps: int) -> np.ndarray:
        """States from the fundamental domain on, (maps + 1, places, 2 n)."""
        states = [self.seed.line(places)]
        for _ in range(maps):
            states.append(self.seed.after(states[-1]))
        return np.stack(states)

    def ends(self, places: np.ndarray, maps: int) -> np.ndarray:
        """States after a number of maps, (places, 2 n)."""
        return self.seed.map(self.seed.line(places), maps * self.seed.num_periods)

    def turns(self, returns: int) -> list[Turn]:
        """Turns near the saddle, where places are so dense that they are resolved.

        Args:
            returns: maps beyond those that lead to the farthest states.
        """
        away = 0
        while True:
            states = self.motions(_PLACES, away + returns)
            extent = float(np.nanmax(np.linalg.norm(states - self.target, axis=-1)))
            # Motions may leave for ever.
            extent = min(extent, _FARTHEST * self.seed.size)
            if away >= self._maps_to(_NEAR * extent):
                break
            away = self._maps_to(_NEAR * extent)
        (offset, along), turns = self._offsets(states), []
        for k in range(1, away + returns + 1):
            is_near = np.maximum(np.abs(offset[k]), along[k]) < _NEAR * extent
            is_near[1:] &= np.abs(np.diff(offset[k])) < _NEAR * extent / 2
            found = [(sign, j) for sign in (1, -1) for j in _minima(sign * offset[k], _LEVEL * extent)]
            turns += [
                Turn(k, sign, *map(float, (_PLACES[j], offset[k][j], along[k][j])))
                for sign, j in found
                if is_near[j]
            ]
        return turns

    def _maps_to(self, distance: float) -> int:
        """Maps after which the line would be as long as a distance."""
        return max(int(np.ceil(np.log(distance / self.seed.reach) / np.log(self.seed.multiplier))), 0)

    def turn(self, near: Turn, maps: int, width: float) -> Turn | None:
        """The turn near another, after a number of maps; None if there is none, or the curve jumps there."""
        low, high = near.place - width, near.place + width
        for _ in range(_MOST):
            places = np.linspace(low, high, BATCH)
            offset, along = self._offsets(self.ends(places, maps))
            values = near.sign * offset
            j = int(np.argmin(values))
            if not np.isfinite(values).all() or high - low > _WIDE:
                return None
            if np.ptp(values) <= _ROUNDING * self.seed.size:
                break
            if j in (0, BATCH - 1):
                low, high = places[j] - (high - low), places[j] + (high - low)
                continue
            rises = values[[j - 1, j + 1]] - values[j]
            if high - low < _NARROW or rises.max() <= 0:
                break
            low, high = places[j - 1], places[j + 1]
        else:
            return None
        return Turn(maps, near.sign, *map(float, (places[j], offset[j], along[j])))

    def shape(self, turn: Turn) -> Shape:
        """Shape of the curve at a turn."""
        far, near = _BESIDE
        places = turn.place + np.array([0.0, -far, far, -near, near])
        offset = self._offsets(self.ends(places, turn.maps))[0]
        rises = np.maximum(turn.sign * (offset[1:] - offset[0]), np.finfo(float).tiny)
        is_level = rises[:2] <= _LEVEL * self.seed.size
        order = np.log(rises[:2] / rises[2:])[~is_level] / np.log(far / near)
        if (order < _NO_JUMP).any():
            return "jump"
        return "corner" if is_level.any() or (order < _SMOOTH).any() else "smooth"

    def _offsets(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets from the stable manifold, and distances along it, (..., places)."""
        away = states - self.target
        offset = away @ self.left
        return offset, np.linalg.norm(away - offset[..., None] * self.direction, axis=-1)


def _minima(values: np.ndarray, level: float) -> np.ndarray:
    """Numbers of the minima, one in the middle of each that is level."""
    with np.errstate(invalid="ignore"):
        begins = np.append(0, np.flatnonzero(~(np.abs(np.diff(values)) <= level)) + 1)
        middles = (begins + np.append(begins[1:], len(values)) - 1) // 2
        own = values[middles]
        return middles[1:-1][(own[1:-1] < own[:-2]) & (own[1:-1] < own[2:])]
