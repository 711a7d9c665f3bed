"""Curves of bifurcations in the plane of two parameters."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._dataset_checks import check_is_dataset
from ._axes import create_axes, label_if_new
from ._branch import OTHER, draw_special, label_of_kind
from ._branch_lines import MARKERS
from ._colors import curve_styles, merge_style
from ._labels import Units
from ._legend import add_legend
from ._ordinates import Labels, label_of


def curves(
    curves: xr.Dataset | Sequence[xr.Dataset],
    *,
    units: Units | None = None,
    labels: Labels | None = None,
    xlim: tuple[float, float] | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw curves of bifurcations in the plane of their two parameters, with their special points.

    Args:
        curves: result of `vx.bifurcation_curve`, one or several in one plane; curves of one kind have one colour.
        units: units of the parameters, as in `{"time": "s"}`; labels show none if omitted.
        labels: words of the parameters by their paths, as in `{"force.mu": "Friction"}`.
        xlim: ends of the x axis; those of the curves if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into, over their content, such as a chart of motions; new axes if omitted.
        **style: properties of the lines for matplotlib's `plot`: `color`, `linewidth`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if there is no curve, or the curves lie in different planes.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])
        fold = vx.continuation(orbit, "forcing.frequency", (0.8, 1.0)).bifurcations[1]
        bounds = {"forcing.frequency": (0.8, 1.1), "stops[0].position": (0.2, 0.4)}
        ax = vx.plot.curves(vx.bifurcation_curve(fold, "stops[0].position", bounds))
        ```
    """
    given: Any = [curves] if isinstance(curves, xr.Dataset) else curves
    several: list[Any] = [*given] if isinstance(given, Sequence) else [given]
    for one in several:
        check_is_dataset(one, "curves", "`vx.bifurcation_curve`")
    right, up = _plane(several)
    kinds = list(dict.fromkeys(str(one.attrs["kind"]) for one in several))
    looks = dict(zip(kinds, curve_styles(len(kinds), style), strict=True))
    ax = create_axes() if ax is None else ax
    for one in several:
        kind = str(one.attrs["kind"])
        color, stroke = looks[kind]
        words = label_if_new(ax, label_of_kind(kind))
        look = merge_style(style, color=color, linestyle=stroke, linewidth=1.4, label=words)
        ax.plot(one[right].values, one[up].values, **look)
    _mark(several, right, up, ax)
    ax.set(xlabel=label_of(right, labels, units, several[0]), ylabel=label_of(up, labels, units, several[0]))
    if xlim is not None:
        ax.set_xlim(xlim)
    add_legend(ax, is_shown=legend)
    return ax


def _plane(several: list[xr.Dataset]) -> tuple[str, str]:
    """The paths of the two common parameters."""
    if not several:
        raise ValueError("Argument `curves` is empty: give one or more.")
    planes = [tuple(map(str, one.coords)) for one in several]
    if len(planes[0]) != 2 or any(set(plane) != set(planes[0]) for plane in planes):
        raise ValueError(
            f"Curves in one plane of two parameters can be drawn together, but these are over {planes}."
        )
    return planes[0][0], planes[0][1]


def _mark(several: list[xr.Dataset], right: str, up: str, ax: Axes) -> None:
    """Draw the special points, one marker per name."""
    names = np.concatenate([one["special"].values.astype(str) for one in several])
    places = np.concatenate([np.stack([one[right].values, one[up].values], axis=1) for one in several])
    marks = [*MARKERS.values(), OTHER]
    for k, name in enumerate(dict.fromkeys(names[names != ""].tolist())):
        draw_special(ax, places[names == name], name, marker=marks[k % len(marks)], markersize=7.0)
