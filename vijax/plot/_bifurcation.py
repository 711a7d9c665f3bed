"""Bifurcation diagrams: recorded impacts against a swept quantity."""

from collections.abc import Sequence
from typing import overload

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._sweep.endings import warn_of_endings
from ._axes import check_index, column_of_axes, ink, label, legend_above, span_of_phase

_ORDINATES = {
    "velocity": ("impact_velocity", "Velocity $v^-$ before impact\nat stop {} (length / time)"),
    "relative velocity": (
        "impact_relative_velocity",
        "Velocity before impact, relative\nto stop {} (length / time)",
    ),
    "phase": ("impact_phase", "Phase $\\varphi$ of impact\nat stop {} (rad)"),
}
# Drawn one over the other: where both agree, a dark point in a light one.
_DIRECTIONS = {
    "down": ("swept down", ("#f59b42", "#d9731a"), 4.0),
    "up": ("swept up", ("#10264f", "#bcd4ff"), 1.8),
}


@overload
def bifurcation(
    ds: xr.Dataset,
    stop: int = 0,
    *,
    ordinate: str = "velocity",
    ax: Axes | None = None,
) -> Axes: ...
@overload
def bifurcation(
    ds: xr.Dataset,
    stop: None,
    *,
    ordinate: str = "velocity",
    ax: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray: ...
def bifurcation(
    ds: xr.Dataset,
    stop: int | None = 0,
    *,
    ordinate: str = "velocity",
    ax: Axes | Sequence[Axes] | np.ndarray | None = None,
) -> Axes | np.ndarray:
    """Draw a bifurcation diagram: the velocities of the recorded impacts against the swept quantity.

    Of a sweep up and down (`carry="both"`) the points of the way up are small and dark, those of the way
    down large and light, below them: where both ways agree, a dark point in a light one. A warning tells of
    points not all of whose impacts were recorded.

    Args:
        ds: what `vx.sweep` returned for one swept quantity; of several, select all but one first.
        stop: the stop whose impacts are drawn; None for all, one panel a stop.
        ordinate: "velocity" before the impacts, "relative velocity" where stops move, counted from theirs, or
            the "phase" of the impacts in the forcing period.
        ax: where to draw, for `stop=None` one axes for each stop; new axes if left out.

    Returns:
        The axes; an array of them for `stop=None`.

    Raises:
        ValueError: if not exactly one quantity is swept, or there is no such stop.

    Example:
        ```python
        import numpy as np, vijax as vx
        system, frequency = vx.models.wagg_bishop_b(1.0), np.arange(0.3, 2.1, 0.01)
        ds = vx.sweep(system, {"forcing.frequency": frequency}, carry="both")
        top, bottom = vx.plot.bifurcation(ds, stop=None)
        ```

    References:
        Wagg & Bishop (2004), Figs. 4 and 7.
    """
    swept = [dim for dim in ds.result.dims if dim != "direction"]
    if len(swept) != 1:
        raise ValueError(
            f"A bifurcation diagram needs one swept quantity, but there are {swept}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    if ordinate not in _ORDINATES:
        names = " or ".join(f'"{name}"' for name in _ORDINATES)
        raise ValueError(f'Argument `ordinate` must be {names}, but is "{ordinate}".')
    if _ORDINATES[ordinate][0] not in ds:
        raise ValueError(
            'Argument `ordinate` must be "velocity" where no stop moves: there it is the relative one.'
        )
    check_index("stop", 0 if stop is None else stop, ds.sizes["stop"])
    stops = range(ds.sizes["stop"]) if stop is None else [stop]
    warn_of_endings(ds, "max_impacts_reached")
    column = column_of_axes(ax, len(stops))
    for j, panel in zip(stops, column, strict=True):
        _draw(ds, str(swept[0]), j, ordinate, panel, with_legend=j == stops[0])
    column[-1].set_xlabel(label(str(swept[0])))
    return column if stop is None else column[0]


def _draw(ds: xr.Dataset, path: str, stop: int, ordinate: str, ax: Axes, *, with_legend: bool) -> None:
    """One panel."""
    if "direction" in ds.result.dims:
        for direction, (words, colors, size) in _DIRECTIONS.items():
            _draw_points(ds.sel(direction=direction), path, stop, ordinate, ax, ink(*colors), size, words)
        if with_legend:
            legend_above(ax, markerscale=2.5)
    else:
        _draw_points(ds, path, stop, ordinate, ax, ink(), 2.0, "")
    ax.set_xlim(ds[path].values.min(), ds[path].values.max())
    ax.set_ylabel(_ORDINATES[ordinate][1].format(stop))
    if ordinate == "phase":
        span_of_phase(ax.set_ylim, ax.set_yticks)
    else:
        ax.axhline(0, color="0.7", linewidth=0.8, zorder=0)


def _draw_points(
    ds: xr.Dataset, path: str, stop: int, ordinate: str, ax: Axes, color: str, size: float, words: str
) -> None:
    """All impacts of a stop in one colour."""
    swept, drawn, of_stop = xr.broadcast(ds[path], ds[_ORDINATES[ordinate][0]], ds.impact_stop)
    is_drawn = (of_stop == stop).values
    ax.plot(
        swept.values[is_drawn],
        drawn.values[is_drawn],
        linestyle="none",
        marker=".",
        markersize=size,
        markeredgewidth=0,
        color=color,
        label=words,
        rasterized=True,
    )
