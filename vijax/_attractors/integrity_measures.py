"""Measures of basins on a grid of starts: the largest balls in them, and the entropies of their boundary.

A ball is judged by the starts of the grid. With h the diagonal of the largest cell, the boundary of a basin that the grid
resolves lies at most h before the first start that leads elsewhere. A ball about an attractor of radius R thus has
its first such start between R and R + h; the largest ball anywhere, its centre on the grid, between R - h / 2 and
R + h. Radii below are the middles of what this leaves, their errors half of it.

The edge of the window bounds a ball too, as nothing is known beyond it, unless a stop stands there.
"""

import re
from typing import NamedTuple

import numpy as np

from .._system.system import ImpactSystem
from .ensemble import rigid_stops
from .starts import slots

# A stop stands at an edge within this fraction of the window.
_AT_EDGE = 1e-9


class Window(NamedTuple):
    """A grid of starts.

    Attributes:
        paths: the start quantity along each dimension.
        axes: its values in increasing order, divided by the length that counts as 1.
        scale: these lengths, (dims,).
        is_wall: whether a stop stands at the lower and at the upper edge, (dims, 2).
    """

    paths: tuple[str, ...]
    axes: tuple[np.ndarray, ...]
    scale: np.ndarray
    is_wall: np.ndarray

    @property
    def cell(self) -> float:
        """Diagonal of the largest cell."""
        return float(np.linalg.norm([np.diff(a).max(initial=0.0) for a in self.axes]))

    @property
    def starts(self) -> np.ndarray:
        """The starts, (starts, dims), the last dimension varying fastest."""
        return np.stack([a.reshape(-1) for a in np.meshgrid(*self.axes, indexing="ij")], axis=1)

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Distance of points, (points, dims), from the nearest edge without a stop, negative outside, (points,)."""
        low, high = np.array([[a[0], a[-1]] for a in self.axes]).T
        lengths = np.where(self.is_wall.T[:, None], np.inf, np.stack([points - low, high - points]))
        is_out = (points < low - _AT_EDGE) | (points > high + _AT_EDGE)
        return np.where(is_out.any(axis=1), -1.0, lengths.min(axis=(0, 2), initial=np.inf))

    def coordinates(self, states: np.ndarray) -> np.ndarray | None:
        """States (x, v), (points, 2 n), in this window; None unless it spans all of them."""
        n = states.shape[1] // 2
        wanted = [f"{name}0[{i}]" for name in "xv" for i in range(n)]
        if {*wanted} != {*self.paths}:
            return None
        return states[:, [wanted.index(path) for path in self.paths]] / self.scale


def window_of(
    axes: dict[str, np.ndarray], scale: dict[str, float], system: ImpactSystem | None
) -> tuple[Window, tuple[np.ndarray, ...]]:
    """The window of a grid, and the order along each dimension in which its values increase.

    Args:
        axes: values of each start quantity by its path.
        scale: the length of each that counts as 1; the width of the window where it is left out.
        system: the machine, which tells where stops stand.
    """
    order = tuple(np.argsort(a) for a in axes.values())
    axes = {path: a[k].astype(float) for (path, a), k in zip(axes.items(), order, strict=True)}
    length = np.array([scale.get(path, np.ptp(a) or 1.0) for path, a in axes.items()])
    is_wall = np.zeros((len(axes), 2), bool)
    for row, (path, a) in zip(is_wall, axes.items(), strict=True):
        mass = re.fullmatch(r"x0\[(\d+)\]", path)
        if mass and system is not None:
            near = _AT_EDGE * np.ptp(a)
            ends = (side[int(mass[1])] for side in slots(system, rigid_stops(system)))
            row[:] = [abs(end - known) <= near for end, known in zip(ends, a[[0, -1]], strict=True)]
    scaled = tuple(a / one for a, one in zip(axes.values(), length, strict=True))
    return Window(tuple(axes), scaled, length, is_wall), order


def ball_about(window: Window, label: np.ndarray, number: int, points: np.ndarray) -> tuple[float, float]:
    """Radius of the largest ball in a basin about any point of its attractor, (points, dims), and its error."""
    edge = window.inside(points)
    if not len(points) or (edge < 0).any():
        return np.nan, np.nan
    first = _nearest(window.starts[label.reshape(-1) != number], points)
    low, high = np.minimum(np.maximum(first - window.cell, 0), edge).min(), np.minimum(first, edge).min()
    return float(low + high) / 2, float(high - low) / 2


def largest_ball(window: Window, label: np.ndarray, number: int) -> tuple[float, float, np.ndarray]:
    """Radius of the largest ball in a basin, its error, and its centre, (dims,)."""
    starts, is_own = window.starts, label.reshape(-1) == number
    if not is_own.any():
        return 0.0, 0.0, np.full(len(window.axes), np.nan)
    own = starts[is_own]
    radius = np.minimum(_nearest(starts[~is_own], own), window.inside(own))
    k, cell = int(radius.argmax()), window.cell
    low, high = max(radius[k] - cell, 0.0), radius[k] + cell / 2
    return float(low + high) / 2, float(high - low) / 2, own[k] * window.scale


def entropies(label: np.ndarray, box: int) -> tuple[float, float]:
    """Basin entropy, and boundary basin entropy, over boxes of `box` starts along each dimension."""
    count = int(label.max(initial=-1)) + 1
    label = label[tuple(slice(0, size // box * box) for size in label.shape)]
    split = [part for size in label.shape for part in (size // box, box)]
    first = range(0, 2 * label.ndim, 2)
    boxes = label.reshape(split).transpose(*first, *(k + 1 for k in first)).reshape(-1, box**label.ndim)
    counts = np.stack([(boxes == k).sum(axis=1) for k in range(count)], axis=1) if count else boxes[:, :0]
    counts = counts[counts.sum(axis=1) > 0]
    share = counts / counts.sum(axis=1, keepdims=True)
    entropy = -(share * np.log(np.where(share > 0, share, 1))).sum(axis=1)
    is_boundary = (counts > 0).sum(axis=1) > 1
    mean = lambda a: float(a.mean()) if a.size else np.nan  # noqa: E731
    return mean(entropy), mean(entropy[is_boundary])


def _nearest(others: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of points from the nearest of others, infinite if there are none, (points,)."""
    from scipy.spatial import KDTree  # late, as it takes long to import

    return KDTree(others).query(points)[0] if len(others) else np.full(len(points), np.inf)
