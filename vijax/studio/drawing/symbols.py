"""Symbols of drawings as polylines: springs, dampers, wheels; straight or in an arc."""

import numpy as np

# Half the width of springs and dampers; the box of a mass is 1 wide and high.
_HALF = 0.09
_NUM_TURNS = 6
# Number of points of a straight end, which an arc bends.
_BENT = 12


def spring(start: tuple[float, float], end: tuple[float, float], rise: float = 0.0) -> np.ndarray:
    """A zigzag between two points, in an arc if `rise` is not 0, (2, points)."""
    way = _CentreLine(start, end, rise)
    first = 0.5 - min(0.3, 0.5 / way.length)
    coil = np.linspace(first, 1 - first, 2 * _NUM_TURNS + 1)
    lead, none = np.linspace(0, first, _BENT), np.zeros(_BENT)
    aside = np.concatenate([none, _HALF * np.tile([1.0, -1.0], _NUM_TURNS), none])
    return way.beside(np.concatenate([lead, (coil[1:] + coil[:-1]) / 2, 1 - lead[::-1]]), aside)


def damper(start: tuple[float, float], end: tuple[float, float], rise: float = 0.0) -> np.ndarray:
    """A piston in a cylinder open towards the start, (2, points), with NaN between its lines."""
    way = _CentreLine(start, end, rise)
    gap, half, depth = np.nan, _HALF, min(0.12, 0.2 / way.length)
    rod, back = np.linspace(0, 0.5, _BENT), np.linspace(0.5 + depth, 1, _BENT)
    cylinder = [0.5 - depth, 0.5 + depth, 0.5 + depth, 0.5 - depth]
    along = [*rod, gap, 0.5, 0.5, gap, *cylinder, gap, *back]
    aside = [*(0 * rod), gap, -0.7 * half, 0.7 * half, gap, half, half, -half, -half, gap, *(0 * back)]
    return way.beside(np.array(along), np.array(aside))


def slider(
    start: tuple[float, float], end: tuple[float, float], rise: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Two plates that overlap, (2, points), with the pad of friction between them, its corners (2, 4)."""
    way = _CentreLine(start, end, rise)
    half, shift = min(0.2, 0.3 / way.length), 0.5 * _HALF
    first, second = np.linspace(0, 0.5 + half, _BENT), np.linspace(0.5 - half, 1, _BENT)
    along = np.concatenate([first, [np.nan], second])
    aside = np.concatenate([np.full(_BENT, -shift), [np.nan], np.full(_BENT, shift)])
    corners = 0.5 + 0.6 * half * np.array([-1.0, 1.0, 1.0, -1.0])
    return way.beside(along, aside), way.beside(corners, shift * np.array([-1.0, -1.0, 1.0, 1.0]))


def circles(x: np.ndarray, y: float, radius: float) -> np.ndarray:
    """Circles at one height, (2, points), separated by NaN."""
    angle = np.append(np.linspace(0, 2 * np.pi, 25), np.nan)
    return np.stack(
        [np.add.outer(x, radius * np.cos(angle)).ravel(), np.tile(y + radius * np.sin(angle), len(x))]
    )


class _CentreLine:
    """The centre line of a symbol: a straight line, or half an ellipse over it."""

    def __init__(self, start: tuple[float, float], end: tuple[float, float], rise: float):
        a, b = np.array(start), np.array(end)
        angle = np.pi * np.linspace(0, 1, 201)[:, None]
        self.points = (a + b) / 2 - (b - a) / 2 * np.cos(angle) + np.array([0.0, rise]) * np.sin(angle)
        share = np.append(0, np.cumsum(np.hypot(*np.diff(self.points, axis=0).T)))
        self.length = float(share[-1])
        self.share = share / self.length

    def beside(self, along: np.ndarray, aside: np.ndarray) -> np.ndarray:
        """Points at shares `along` of the centre line and distances `aside` to its left, (2, points)."""
        slope = np.stack([np.gradient(a, self.share) for a in self.points.T], axis=1)
        slope = slope / np.hypot(*slope.T)[:, None]
        x, y, dx, dy = (np.interp(along, self.share, a) for a in (*self.points.T, *slope.T))
        return np.stack([x - aside * dy, y + aside * dx])
