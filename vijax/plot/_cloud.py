"""Clouds of points: smaller the more points there are, more transparent the more they overlap."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from ._colors import curve_colors, ink, merge_style
from ._legend import add_legend

MARKERS = "os^Dv<>p"
# (largest count, marker size).
_SIZES = ((100, 6.0), (1000, 3.5), (5000, 2.0), (np.inf, 1.2))
# Size of the markers in the legend.
_IN_LEGEND = 7.0
# Cells per axis for counting overlaps, about the size of the smallest points.
_CELLS = 250
# Number of overlapping points that are as dark as one opaque point, and the least opacity.
_ENOUGH, _FAINTEST = 4.0, 0.1


class Cloud(NamedTuple):
    """Points of one colour, (points,) each, and their legend label."""

    name: str
    x: np.ndarray
    y: np.ndarray


def draw_clouds(ax: Axes, clouds: list[Cloud], style: dict[str, Any]) -> None:
    """Draw clouds, which differ in colour and marker; of thousands of points, overlaps are darker."""
    many = len(clouds) > 1
    for (name, x, y), color, marker in zip(
        clouds, curve_colors(len(clouds)), MARKERS * len(clouds), strict=False
    ):
        look = {"color": color, "marker": marker} if many else {"color": ink(), "marker": "o"}
        # Of its own number of points: one point beside a cloud of thousands is still seen.
        size = next(size for most, size in _SIZES if len(x) <= most)
        marks = {"linestyle": "none", "markersize": size, "markeredgewidth": 0, "alpha": _alpha(x, y)}
        ax.plot(x, y, **merge_style(style, rasterized=True, label=name, **marks, **look))


def name_clouds(ax: Axes, clouds: list[Cloud], style: dict[str, Any], *, is_shown: bool) -> None:
    """Add the legend of several clouds, or of one that the user named, once the limits are set."""
    add_legend(ax, is_shown=is_shown and (len(clouds) > 1 or "label" in style), markersize=_IN_LEGEND)


def _alpha(x: np.ndarray, y: np.ndarray) -> float | None:
    """Opacity from the number of points in the cell of a typical point; None for few points."""
    if len(x) <= _SIZES[1][0]:
        return None
    counts = np.histogram2d(x, y, bins=_CELLS)[0]
    typical = (counts**2).sum() / counts.sum()
    return float(np.clip(_ENOUGH / typical, _FAINTEST, 1.0))
