"""Insets: a part of a picture, enlarged in its emptiest part."""

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ._colors import ink

# Sides of an inset and its distance from the frame, as shares of those of the picture.
_WIDTH, _HEIGHT, _APART = 0.34, 0.3, 0.05
# Numbers of places along each side that are compared.
_TRIALS = 6
# Share of the height left free above and below what an inset shows.
_MARGIN = 0.08


def inset(
    ax: Axes,
    xlim: tuple[float, float],
    ylim: tuple[float, float] | None = None,
    *,
    place: tuple[float, float, float, float] | None = None,
) -> Axes:
    """Enlarge a part of a picture in an inset, as of a short branch in a bifurcation diagram.

    The inset has all lines and markers that the axes have when it is made: draw first. A frame in the picture shows the
    enlarged part.

    Args:
        ax: the axes of the picture.
        xlim: ends of the part along x.
        ylim: along y; all that lies within `xlim` if omitted.
        place: left end, lower end, width and height of the inset as shares of those of the axes; the part with fewest
            points if omitted.

    Returns:
        The axes of the inset.

    Raises:
        ValueError: if nothing is drawn within `xlim`, or its ends do not rise.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])
        ax = vx.plot.branch(vx.continuation(orbit, "forcing.frequency", (0.7, 1.0)))
        vx.plot.inset(ax, (0.95, 0.99))
        ```
    """
    if not xlim[0] < xlim[1]:
        raise ValueError(f"Argument `xlim` must be a lower and a higher end, but is {xlim}.")
    lines = [line for line in ax.lines if len(np.asarray(line.get_xdata()))]
    data = [_points(line) for line in lines if line.get_transform() == ax.transData]
    points = np.concatenate([np.empty((0, 2)), *data])
    shown = points[(points[:, 0] >= xlim[0]) & (points[:, 0] <= xlim[1])]
    if not len(shown):
        raise ValueError(f"Nothing is drawn for x in {xlim}: draw first, or choose another part.")
    if ylim is None:
        low, high = shown[:, 1].min(), shown[:, 1].max()
        margin = _MARGIN * (high - low or abs(high) or 1.0)
        ylim = float(low - margin), float(high + margin)
    small = ax.inset_axes(_emptiest_place(ax, points) if place is None else place)
    for line in lines:
        _copy(line, ax, small)
    small.set(xlim=xlim, ylim=ylim)
    small.tick_params(labelsize="x-small")
    ax.indicate_inset_zoom(small, edgecolor=ink("0.4", "0.6"))
    return small


def _points(line: Line2D) -> np.ndarray:
    """Finite points of a line, (points, 2)."""
    points = np.column_stack([np.asarray(a, float) for a in line.get_data()])
    return points[np.isfinite(points).all(axis=1)]


def _copy(line: Line2D, ax: Axes, small: Axes) -> None:
    """Draw a line in an inset, without an entry in a legend."""
    own = Line2D(*line.get_data())
    own.update_from(line)
    own.set_label("_inset")
    is_data = line.get_transform() == ax.transData
    along = (
        small.get_xaxis_transform
        if line.get_transform() == ax.get_xaxis_transform()
        else small.get_yaxis_transform
    )
    own.set_transform(small.transData if is_data else along())
    small.add_line(own)
    own.set_clip_path(small.patch)


def _emptiest_place(ax: Axes, points: np.ndarray) -> tuple[float, float, float, float]:
    """Place of an inset that covers fewest points; of several the first from the right and from above."""
    ax.viewLim.get_points()  # matplotlib adapts the limits to the data when they are asked for
    within = ax.transAxes.inverted().transform(ax.transData.transform(points))
    within = np.unique(np.round(within, 2), axis=0)  # points upon each other hide no more than one
    # The numbers beside an inset lie on its left and below.
    left, low = (np.linspace(2 * _APART, 1 - size - _APART / 2, _TRIALS) for size in (_WIDTH, _HEIGHT))

    def covered(corner: tuple[float, float]) -> list[int]:
        """Numbers of points under an inset, and of those under it or beside."""
        beyond, size = within - corner, np.array([_WIDTH, _HEIGHT])
        inside = [(beyond > -apart) & (beyond < size + apart) for apart in (0.0, _APART)]
        return [int(np.count_nonzero(flags.all(axis=1))) for flags in inside]

    x, y = min(itertools.product(left[::-1], low[::-1]), key=covered)
    return float(x), float(y), _WIDTH, _HEIGHT
