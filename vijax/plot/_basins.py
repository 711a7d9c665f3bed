"""Basins of attraction over a plane of starts, and the attractors in it."""

import re
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from .._dataset_checks import check_columns, check_is_dataset
from .._sweep.short_names import with_paths
from ._attractors import COLORS, HATCH, add_legend_of_attractors, check_count, draw_marks
from ._axes import create_axes
from ._labels import Units
from ._mesh import check_plane, draw_mesh, hatch
from ._motions import check_flags, color_of_other, color_of_unknown, label_of_motion
from ._percent import percent

# (largest count, marker size): large for the few points of a cycle, small for a cloud.
_SIZES = ((20, 6.0), (100, 4.0), (np.inf, 2.0))


def basins(
    basins: xr.Dataset,
    *,
    max_attractors: int = 8,
    points: bool = True,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the basins of attraction over a plane of starts, one colour each, with the sections of their attractors.

    "1 | 2 in 1, 43 ± 5 %" is a motion that repeats after 1 forcing period, with 1 impact at stop 0 and 2 at stop 1 in it,
    reached from 43 % of the starts of the grid. Starts whose motion has not settled, or failed, are hatched. Markers are the states
    of each attractor at phase 0; they may lie in another's colour, since the plane shows only two coordinates.

    Args:
        basins: result of `vx.basins` over two start quantities, the first on the x axis, the second on the y axis.
        max_attractors: number of attractors with a colour each, the largest shares first, 8 at most; the rest is
            "other".
        points: whether to draw the sections.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into; new axes if omitted.
        **style: properties of the plane for matplotlib's `pcolormesh`: `alpha`, `rasterized`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if `label` is missing or lacks two quantities of two values or more, or `max_attractors` exceeds 8.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        grid = {"x0[0]": np.linspace(-0.3, 0.3, 60), "v0[0]": np.linspace(-1, 1, 60)}
        ax = vx.plot.basins(vx.basins(vx.models.wagg_bishop_b(2.05), grid))
        ```

    References:
        J. M. T. Thompson & H. B. Stewart, Nonlinear Dynamics and Chaos, 2nd ed. (2002).
    """
    check_is_dataset(basins, "basins", "`vx.basins`")
    _check(basins, max_attractors)
    basins = with_paths(basins)
    right, up = map(str, basins["label"].dims)
    basins = basins.sortby([right, up])
    ax = create_axes() if ax is None else ax
    count = min(max_attractors, basins.sizes["attractor"])
    codes = basins["label"].values
    codes = np.where(codes >= count, count, codes)
    colors = ListedColormap([color_of_unknown(), *COLORS[:count], color_of_other()])
    mesh = draw_mesh(ax, basins["label"], codes, units, style, cmap=colors, vmin=-1.5, vmax=count + 0.5)
    ax.set(xlim=ax.get_xlim(), ylim=ax.get_ylim())  # attractors may lie far outside
    named = [basins.isel(attractor=k) for k in range(count)]
    has_mark = [points and _draw_section(ax, one, right, up, k) for k, one in enumerate(named)]
    words = [f"{label_of_motion(one)}, {_share(one)}" for one in named]
    has_other, is_unknown = bool((codes == count).any()), codes < 0
    hatch(ax, mesh, is_unknown.T, HATCH)
    add_legend_of_attractors(
        ax, basins, words, has_mark, is_shown=legend, has_other=has_other, has_unknown=bool(is_unknown.any())
    )
    return ax


def _share(attractor: xr.Dataset) -> str:
    """Share of the starts of the grid: no sample of them, so that it has no standard error."""
    return percent(float(attractor.share))


# What is written about each attractor, and the dimensions.
_COLUMNS = {
    **dict.fromkeys(("motion", "num_periods", "share"), ("attractor",)),
    **dict.fromkeys(("section_x", "section_v"), ("attractor", "section", "mass")),
    "num_impacts": ("attractor", "stop"),
    "label": (),
}


def _check(basins: xr.Dataset, max_attractors: int) -> None:
    if "label" not in basins:
        raise ValueError(f"A picture of basins needs the variable `label`, but there are {list(basins)}.")
    check_plane(basins["label"], "A picture of basins", "start")
    check_columns(basins, "`vx.basins`", _COLUMNS)
    check_flags(basins.motion)
    check_count(max_attractors)


def _draw_section(ax: Axes, attractor: xr.Dataset, right: str, up: str, number: int) -> bool:
    """Draw the section of an attractor in the plane; True if any of its points lies within the axes."""
    x, y = (_coordinate(attractor, path) for path in (right, up))
    if x is None or y is None:
        return False
    (left, end), (low, high) = ax.get_xlim(), ax.get_ylim()
    seen = (x >= left) & (x <= end) & (y >= low) & (y <= high)
    size = next(size for most, size in _SIZES if seen.sum() <= most)
    draw_marks(ax, x[seen], y[seen], number, size)
    return bool(seen.any())


def _coordinate(attractor: xr.Dataset, path: str) -> np.ndarray | None:
    match = re.fullmatch(r"([xv])0\[(\d+)\]", path)
    if match is None:
        return None
    return attractor[f"section_{match[1]}"].isel(mass=int(match[2])).values
