"""Shares of the starts that lead to each attractor, against a parameter."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from .._dataset_checks import check_is_dataset
from ._attractors import COLORS, HATCH, add_legend_of_attractors, check_count, draw_marks, path_along
from ._axes import create_axes
from ._colors import ink, merge_style
from ._labels import Units, axis_label
from ._motions import color_of_other, color_of_unknown, label_of_motion
from ._percent import percent

# Share below which a band is rounding.
_NOTHING = 1e-9


def shares(
    followed: xr.Dataset,
    *,
    max_attractors: int = 8,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the shares of the starts that lead to each attractor against a parameter, as stacked bands.

    Each value of the parameter has a column, up to the midpoints between neighbours. "1 | 2 in 1" is a motion that
    repeats after 1 forcing period, with 1 impact at stop 0 and 2 at stop 1 in it. If the motion of an attractor changes
    along the parameter, it is named where its share is largest: the legend gives this share, and a marker in the band
    shows the place. Other attractors are grey; starts whose motion has not settled, or failed, are hatched.

    Args:
        followed: result of `vx.follow_attractors` for two values of the parameter or more.
        max_attractors: number of attractors with a colour each, the largest shares first, 8 at most; the rest is
            "other".
        units: units of swept quantities, or of their parts, as in `{"time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into; new axes if omitted.
        **style: properties of the bands for matplotlib's `fill_between`: `alpha`, `linewidth`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if there are no shares along a parameter, or `max_attractors` exceeds 8.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        values = np.linspace(1.9, 2.1, 5)
        followed = vx.follow_attractors(vx.models.wagg_bishop_b(2.0), "forcing.frequency", values, 50)
        ax = vx.plot.shares(followed)
        ```

    References:
        G. Datseris, K. L. Rossi & A. Wagemakers, Framework for global stability analysis of dynamical systems,
        Chaos 33 (2023) 073151.
    """
    check_is_dataset(followed, "followed", "`vx.follow_attractors`")
    path = path_along(followed, "A picture of shares")
    check_count(max_attractors)
    followed = followed.sortby(path)
    share, values = followed["share"].transpose("attractor", path).values, followed[path].values
    order = np.argsort(-share.max(axis=1), kind="stable")
    order = order[share[order].max(axis=1) > _NOTHING]
    named, others = order[:max_attractors], order[max_attractors:]
    bands = [*share[named], share[others].sum(axis=0), 1 - share.sum(axis=0)]
    ax = create_axes() if ax is None else ax
    edges = _edges(values)
    _draw_bands(ax, edges, bands, [*COLORS[: len(named)], color_of_other(), color_of_unknown()], style)
    words = []
    for k, number in enumerate(named):
        best = int(share[number].argmax())
        middle = sum(band[best] for band in bands[:k]) + share[number, best] / 2
        draw_marks(ax, values[best : best + 1], np.array([middle]), k, 6.0)
        motion = followed.isel({path: best, "attractor": int(number)})
        words.append(f"{label_of_motion(motion)}, up to {percent(float(share[number, best]))}")
    has_other, has_unknown = (bool((band > _NOTHING).any()) for band in bands[-2:])
    ax.set(
        xlim=(edges[0], edges[-1]),
        ylim=(0, 1),
        xlabel=axis_label(path, units, followed),
        ylabel="Share of the starts",
    )
    add_legend_of_attractors(
        ax,
        followed,
        words,
        [True] * len(named),
        is_shown=legend,
        has_other=has_other,
        has_unknown=has_unknown,
    )
    return ax


def _edges(values: np.ndarray) -> np.ndarray:
    """Edges of the columns of the values, (values + 1,)."""
    middles = (values[1:] + values[:-1]) / 2
    return np.concatenate([[2 * values[0] - middles[0]], middles, [2 * values[-1] - middles[-1]]])


def _draw_bands(
    ax: Axes, edges: np.ndarray, bands: list[np.ndarray], colors: list[str], style: dict[str, Any]
) -> None:
    """Draw the bands stacked from the bottom, without the empty ones."""
    below = np.zeros_like(bands[0])
    strokes = [*[None] * (len(bands) - 1), HATCH]
    for band, color, hatch in zip(bands, colors, strokes, strict=True):
        above = below + band
        if (band > _NOTHING).any():
            look = merge_style(
                style, PolyCollection, facecolor=color, edgecolor=ink(), linewidth=0.4, hatch=hatch
            )
            low, high = (np.append(a, a[-1]) for a in (below, above))
            ax.fill_between(edges, low, high, where=_wide(band), step="post", **look)
        below = above


def _wide(band: np.ndarray) -> np.ndarray:
    """Flags of the edges next to a column in which a band is not empty, (values + 1,)."""
    is_there = np.append(band > _NOTHING, False)
    return is_there | np.roll(is_there, 1)
