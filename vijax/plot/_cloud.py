"""Points of a section: few are drawn large, many small, and fainter the more of them lie in one place."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ._colors import styled

MARKERS = "os^Dv<>p"
# Up to how many points are how large.
_SIZES = ((100, 6.0), (1000, 3.5), (5000, 2.0), (np.inf, 1.2))
# Cells along either axis in which points are counted, about the size of the smallest points.
_CELLS = 250
# So many points on one another are as dark as one by itself would be; no point is fainter than the least.
_ENOUGH, _FAINTEST = 4.0, 0.1


def size_for(count: int) -> float:
    """How large to draw so many points."""
    return next(size for most, size in _SIZES if count <= most)


def draw_cloud(ax: Axes, x: np.ndarray, y: np.ndarray, style: dict[str, Any], **own: Any) -> None:
    """Draw points; where they are thousands, the darker a place the more often it is visited."""
    marks = {"linestyle": "none", "marker": "o", "markeredgewidth": 0, "alpha": _alpha(x, y)}
    ax.plot(x, y, **styled(style, rasterized=True, **marks | own))


def _alpha(x: np.ndarray, y: np.ndarray) -> float | None:
    """How faint the points are, by how many share the place of a typical one."""
    if len(x) <= _SIZES[1][0]:
        return None
    counts = np.histogram2d(x, y, bins=_CELLS)[0]
    typical = (counts**2).sum() / counts.sum()
    return float(np.clip(_ENOUGH / typical, _FAINTEST, 1.0))
