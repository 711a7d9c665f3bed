"""Legends that leave axes their size: inside where nothing is drawn, else beside the axes of a figure that grows by it.

Figures of the user keep their size, so in their axes a legend stands inside: where it covers least, in smaller letters
and in several columns if it would fill the axes.
"""

import itertools
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.legend import Legend
from matplotlib.lines import Line2D

from ._axes import figure_of, is_own

# Largest shares of the axes that a legend inside takes in an own figure, and in one of the user.
_SMALL, _LARGE = (0.5, 0.5), (0.96, 0.62)
# Letters and columns that are tried in turn in axes of the user.
_LETTERS, _COLUMNS = (None, 8.0, 7.0, 6.0), (1, 2, 3, 4)
# Distance of points along a line that may be covered, as a share of the axes; the largest number of them in a segment.
_STEP, _MOST = 0.02, 60
# Places inside by their name in matplotlib, and their shares of the free width and height; the first of the best is taken.
_PLACES = {
    "upper right": (1.0, 1.0),
    "upper left": (0.0, 1.0),
    "lower right": (1.0, 0.0),
    "lower left": (0.0, 0.0),
    "upper center": (0.5, 1.0),
    "lower center": (0.5, 0.0),
    "center right": (1.0, 0.5),
    "center left": (0.0, 0.5),
}


def add_legend(
    ax: Axes,
    *,
    is_shown: bool = True,
    markersize: float | None = None,
    is_covered: bool = False,
    is_second: bool = False,
    **options: Any,
) -> None:
    """Add a legend in place of the one that the axes have; none where nothing is drawn.

    Args:
        ax: the axes.
        is_shown: whether to add one.
        markersize: size of the markers in it; that of the picture if omitted.
        is_second: whether to keep the legend that the axes have.
        is_covered: whether the picture fills the axes, so that there is no place inside.
        **options: of matplotlib's `legend`: `handles`, `labels`, `title`, `markerscale`, ...
    """
    if not is_shown or not options.get("handles", ax.get_legend_handles_labels()[0]):
        return
    before = ax.get_legend()
    if is_second and before is not None:
        if before.get_frame_on() and (found := _best_place(ax, before, _LARGE, _drawn(ax))) is not None:
            before.set_loc(found[1])  # more is drawn now than when it was placed
        ax.add_artist(before).set_clip_on(False)  # else layouts leave no room for it
    if is_own(ax) and not is_second:
        _add_to_own(ax, markersize, is_covered, options)
    else:
        _add_within(ax, markersize, options)


def _add_to_own(ax: Axes, markersize: float | None, is_covered: bool, options: dict[str, Any]) -> None:
    """Add a legend in a figure that may grow."""
    if (before := ax.get_legend()) is not None:
        _widen(ax, -_width_beside(before))
        before.remove()
    found = (
        None
        if is_covered
        else _best_place(ax, _legend(ax, markersize, options), _SMALL, _drawn(ax, counts_meshes=True))
    )
    if found is not None and found[0] == 0:
        _legend(ax, markersize, options | _INSIDE, found[1])
        return
    beside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "frameon": False}
    _widen(ax, _width_beside(_legend(ax, markersize, options | beside)))


def _add_within(ax: Axes, markersize: float | None, options: dict[str, Any]) -> None:
    """Add a legend inside the axes, in the largest letters with which it covers least.

    Areas that fill the axes do not count: of them letters of any size cover some, and the smallest least. Of places that are as
    good it takes the one with the fewest cells of rarer colours, such as a small basin.
    """
    drawn, least, chosen, place = _drawn(ax), np.inf, {}, "upper right"
    for letters, columns in itertools.product(_LETTERS, _COLUMNS):
        own = {"fontsize": letters, "title_fontsize": letters, "ncols": columns, **_TIGHT}
        found = _best_place(ax, _legend(ax, markersize, options | own), _LARGE, drawn)
        if found is not None and found[0] < least:
            (least, place), chosen = found, own
        if least == 0:
            break
    _legend(ax, markersize, options | (chosen or own) | _INSIDE, place).set_in_layout(False)


_INSIDE = {"frameon": True, "framealpha": 0.8, "edgecolor": "none", "fancybox": False}
_TIGHT = {
    "borderaxespad": 0.3,
    "borderpad": 0.25,
    "labelspacing": 0.3,
    "columnspacing": 1.0,
    "handletextpad": 0.5,
}


def _legend(
    ax: Axes, markersize: float | None, options: dict[str, Any], place: str = "upper right"
) -> Legend:
    """Make a legend, whose points are opaque, as clouds of many points are not."""
    legend = ax.legend(**{"loc": place} | options)
    for handle in legend.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
        if markersize is not None and isinstance(handle, Line2D):
            handle.set_markersize(markersize)
    return legend


def _widen(ax: Axes, inches: float) -> None:
    """Widen the figure of the axes."""
    figure = figure_of(ax)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width + inches, height)


def _width_beside(legend: Legend) -> float:
    """Width in inches of a legend beside its axes; 0 for one inside."""
    if legend.get_frame_on():
        return 0.0
    return legend.get_window_extent().width / figure_of(legend).dpi + _pad(legend)


def _pad(legend: Legend) -> float:
    """Inches between a legend and the frame of its axes."""
    return legend.borderaxespad * legend.prop.get_size() / 72


def _best_place(
    ax: Axes, legend: Legend, largest: tuple[float, float], drawn: np.ndarray
) -> tuple[int, Any] | None:
    """Number of points that a legend covers, at the place where it covers least; None if it is too large."""
    box, frame = legend.get_window_extent(), ax.get_window_extent()
    pad = _pad(legend) * figure_of(ax).dpi
    page = np.array([frame.width, frame.height])
    size, apart = np.array([box.width, box.height]) / page, pad / page
    if (size > largest).any():
        return None

    def covered(points: np.ndarray, place: str) -> int:
        corner = apart + np.array(_PLACES[place]) * (1 - size - 2 * apart)
        inside = (points > corner - apart / 2) & (points < corner + size + apart / 2)
        return int(np.count_nonzero(inside.all(axis=1)))

    rare = _rare(ax)
    best = min(_PLACES, key=lambda place: (covered(drawn, place), covered(rare, place)))
    return covered(drawn, best), best


def _rare(ax: Axes) -> np.ndarray:
    """Middles of the cells of meshes that have not the commonest value, as shares of the axes, (points, 2)."""
    found = [np.empty((0, 2))]
    for mesh in (one for one in ax.collections if isinstance(one, QuadMesh)):
        values = np.ma.filled(np.ma.asarray(mesh.get_array(), float), np.nan).ravel()
        corners = np.asarray(mesh.get_coordinates())
        corners = _in_axes(ax, mesh, corners.reshape(-1, 2)).reshape(corners.shape)
        middles = (corners[1:, 1:] + corners[:-1, :-1]).reshape(-1, 2) / 2
        known, counts = np.unique(values[np.isfinite(values)], return_counts=True)
        if len(known) and len(values) == len(middles):
            found.append(middles[values != known[counts.argmax()]])
    return np.concatenate(found)


def _drawn(ax: Axes, *, counts_meshes: bool = False) -> np.ndarray:
    """Points of all that is drawn, along lines too, as shares of the axes, (points, 2); of meshes if they count."""
    ax.viewLim.get_points()  # matplotlib adapts the limits to the data when they are asked for
    found = [np.empty((0, 2))]
    for line in ax.lines:
        points = _in_axes(
            ax, line, np.column_stack([np.asarray(a, float) for a in line.get_data(orig=False)])
        )
        found.append(points if line.get_linestyle() == "None" else _along(points))
    for one in ax.collections:
        if isinstance(one, PathCollection):
            found.append(
                ax.transAxes.inverted().transform(one.get_offset_transform().transform(one.get_offsets()))
            )
        elif isinstance(one, LineCollection):
            found += [_along(_in_axes(ax, one, np.asarray(part, float))) for part in one.get_segments()]
        elif not isinstance(one, QuadMesh):  # edges of areas
            found += [_along(_in_axes(ax, one, np.asarray(path.vertices))) for path in one.get_paths()]
        elif counts_meshes:
            found.append(_grid(np.zeros(2), np.ones(2)))
    for one in ax.artists:  # legends that stay
        if isinstance(one, Legend):
            low, high = ax.transAxes.inverted().transform(one.get_window_extent().get_points())
            found.append(_grid(low, high))
    points = np.concatenate(found)
    points = points[np.isfinite(points).all(axis=1)]
    return np.unique(np.round(points, 3), axis=0)


def _grid(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Points that fill a rectangle, (points, 2)."""
    shares = np.linspace(0, 1, round(1 / _STEP))
    return low + np.stack(np.meshgrid(shares, shares), axis=-1).reshape(-1, 2) * (high - low)


def _in_axes(ax: Axes, artist: Artist, points: np.ndarray) -> np.ndarray:
    """Points of an artist as shares of the axes."""
    return ax.transAxes.inverted().transform(artist.get_transform().transform(points))


def _along(points: np.ndarray) -> np.ndarray:
    """Points of a line with others between them."""
    if len(points) < 2:
        return points
    step = np.diff(points, axis=0)
    longest = np.nan_to_num(np.abs(step).max(axis=1))
    count = np.ceil(longest / _STEP).clip(1, _MOST).astype(int)
    first = np.repeat(np.arange(len(step)), count)
    share = (np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)) / count[first]
    return np.concatenate([points[first] + share[:, None] * step[first], points[-1:]])
