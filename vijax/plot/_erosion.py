"""Profiles of erosion: the integrity of attractors against a parameter."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from .._dataset_checks import check_is_dataset
from ._attractors import COLORS, check_count, path_along
from ._axes import create_axes
from ._colors import ink, merge_style
from ._labels import Units, axis_label
from ._legend import add_legend
from ._motions import label_of_motion, legend_title

# Line style, marker and words of each measure.
_MEASURES: dict[str, tuple[Any, Any, str]] = {
    "share": ("-", "o", "share of the starts"),
    "integrity_factor": ("--", "s", "integrity factor"),
    "local_integrity": (":", "^", "local integrity"),
}


def erosion(
    followed: xr.Dataset,
    *,
    measures: Sequence[str] = ("share", "integrity_factor", "local_integrity"),
    max_attractors: int = 8,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw how the integrity of each attractor falls along a parameter: its profile of erosion.

    An attractor has one colour, a measure one line style and marker. A safe machine has all three far from 0: a large share
    does not help where the basin is fractal, which the integrity factor shows, or where the attractor lies close
    to the boundary, which the local integrity shows. "1 | 2 in 1" is a motion that repeats after 1 forcing period,
    with 1 impact at stop 0 and 2 at stop 1 in it, that where its share is largest.

    Args:
        followed: result of `vx.follow_attractors(..., integrity=True)` for two values of the parameter or more.
        measures: names of the measures to draw.
        max_attractors: number of attractors that are drawn, the largest shares first, 8 at most.
        units: units of swept quantities, or of their parts, as in `{"time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into; new axes if omitted.
        **style: properties of the lines for matplotlib's `plot`: `linewidth`, `markersize`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if a measure is missing or unknown, it is not along a parameter, or `max_attractors` exceeds 8.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        grid = {"x0[0]": np.linspace(-0.5, 0.5, 20), "v0[0]": np.linspace(-3, 3, 20)}
        system, values = vx.models.two_sided_oscillator(3.0, damping_ratio=0.025), np.linspace(2.9, 3.1, 3)
        ax = vx.plot.erosion(vx.follow_attractors(system, "forcing.frequency", values, grid, integrity=True))
        ```

    References:
        J. M. T. Thompson, Proc. R. Soc. Lond. A 421 (1989) 195; S. Lenci & G. Rega, Nonlinear Dyn. 33 (2003) 71.
    """
    check_is_dataset(followed, "followed", "`vx.follow_attractors`")
    _check_measures(followed, measures)
    path = path_along(followed, "A profile of erosion")
    check_count(max_attractors)
    followed = followed.sortby(path)
    largest = followed["share"].transpose("attractor", path).values.max(axis=1)
    named = np.argsort(-largest, kind="stable")[:max_attractors]
    ax = create_axes() if ax is None else ax
    handles = []
    for k, number in enumerate(named.tolist()):
        one = followed.isel(attractor=number)
        for name in measures:
            stroke, marker, _ = _MEASURES[name]
            own: dict[str, Any] = {"color": COLORS[k], "linestyle": stroke, "marker": marker, "markersize": 4}
            ax.plot(one[path].values, one[name].values, **merge_style(style, **own))
        words = label_of_motion(one.isel({path: int(one["share"].values.argmax())}))
        handles.append(Line2D([], [], color=COLORS[k], linewidth=3, label=words))
    for name in measures:
        stroke, marker, words = _MEASURES[name]
        handles.append(
            Line2D([], [], color=ink(), linestyle=stroke, marker=marker, markersize=4, label=words)
        )
    ax.set(xlabel=axis_label(path, units, followed), ylabel="Share, and radii in widths of the window")
    ax.set_ylim(bottom=0)
    add_legend(ax, is_shown=legend, handles=handles, title=legend_title(followed))
    return ax


def _check_measures(followed: xr.Dataset, measures: Sequence[str]) -> None:
    for name in measures:
        if name not in _MEASURES or name not in followed:
            raise ValueError(
                f"A profile of erosion needs `{name}`, which is not there: choose among {', '.join(_MEASURES)}, and call "
                "`vx.follow_attractors` with `integrity=True`."
            )
