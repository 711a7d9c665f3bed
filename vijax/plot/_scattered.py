"""Scattered points of a bifurcation diagram: values of the swept quantity at which the motion repeats none of its impacts.

The points of a periodic motion lie on each other and form a line, which is drawn opaque. Those of chaotic motion have
few neighbours where it is sparse, so that they vanish beside the lines, and cover each other where it is dense, so that
nothing of its structure is left. They are therefore drawn larger the sparser, and more transparent the denser they are.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from ._axes import figure_of

# Points that differ by less than this share of the range of all are one impact that repeats.
_SAME = 1e-4
# Fewer scattered points are drawn like others.
_NUM_LEAST = 300
# Least number of different points of a scattered motion, their least share in its points, and the number that suffices.
_FEW, _SHARE, _MANY = 5, 0.5, 1000
# Wanted number of points that overlap where they are sparse, and the diameters allowed for it, in points of 1/72 inch.
_WANTED, _DIAMETERS = 2.0, (1.0, 1.7)
# Shares of the points that are sparser than what counts as sparse and as dense; number of levels from one to the other.
_ENDS, _LEVELS = (0.1, 0.97), 8
# Darkness, of 1, where points are sparse and overlap, where they are sparse and stand alone, and where they are dense.
_LIGHT, _ALONE, _DARK = 0.7, 0.95, 0.985


class Level(NamedTuple):
    """Points of one density: flags of them, diameter in points of 1/72 inch, opacity."""

    points: np.ndarray
    diameter: float
    alpha: float


def is_scattered(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Flags of the points whose value `x` of the swept quantity has a motion that does not repeat, if there are many."""
    if len(x) < _NUM_LEAST:
        return np.zeros(len(x), bool)
    column, counts = np.unique(x, return_inverse=True, return_counts=True)[1:]
    order = np.lexsort((y, column))
    far = np.diff(y[order]) > _SAME * np.ptp(y)
    is_new = np.concatenate([[True], far | (np.diff(column[order]) > 0)])
    different = np.bincount(column[order], weights=is_new, minlength=len(counts))
    scattered = ((different > _FEW) & (different > np.minimum(_SHARE * counts, _MANY)))[column]
    return scattered & (scattered.sum() >= _NUM_LEAST)


def levels_of(
    x: np.ndarray, y: np.ndarray, spans: tuple[float, float], ax: Axes, given: float | None = None
) -> list[Level]:
    """Sort scattered points by their density; the darkness of the drawing grows with its logarithm.

    Args:
        x: their values of the swept quantity, (points,).
        y: their ordinates, (points,).
        spans: ranges of the two axes in the picture.
        ax: the axes.
        given: diameter of the points, by their density if omitted.
    """
    box = ax.get_window_extent()
    largest = _DIAMETERS[1]
    columns, rows = (
        np.floor((a - a.min()) / span * size * 72 / figure_of(ax).dpi / largest).astype(int)
        for a, span, size in zip((x, y), spans, (box.width, box.height), strict=True)
    )
    _, cell, counts = np.unique(columns * (rows.max() + 1) + rows, return_inverse=True, return_counts=True)
    crowd = counts[cell]
    sparse, dense = np.quantile(crowd, _ENDS)
    diameter = given or float(np.clip(largest * np.sqrt(_WANTED / sparse), *_DIAMETERS))
    # Mean number of points that cover a place in a cell.
    covering = np.pi / 4 * (diameter / largest) ** 2
    least = float(np.clip(_ALONE / max(sparse * covering, 1.0), _LIGHT, _ALONE))
    share = np.clip(np.log(crowd / sparse) / max(np.log(dense / sparse), 1.0), 0.0, 1.0)
    level = np.minimum((share * _LEVELS).astype(int), _LEVELS - 1)
    found = []
    for k in np.unique(level):
        here = level == k
        darkness = least + (_DARK - least) * k / (_LEVELS - 1)
        overlapping = max(covering * np.mean(crowd[here]), 1.0)
        found.append(Level(here, diameter, float(1 - (1 - darkness) ** (1 / overlapping))))
    return found
