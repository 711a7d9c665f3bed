"""Region charts: the motions over a plane of two swept quantities."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from scipy import ndimage

from .._dataset_checks import check_is_dataset
from .._sweep.short_names import with_paths
from ._axes import create_axes, figure_of
from ._colors import is_dark, lightness_of
from ._labels import Units
from ._legend import add_legend
from ._mesh import draw_mesh, hatch
from ._motions import HATCHES, Entry, check_motions, legend_entries, legend_title, motions_of

# Labels in the plane: font size in points; width and height of a letter relative to it; least distance to another
# region, relative to half the width and height of the label.
_FONT, _LETTER, _ROOM = 8, (0.55, 1.2), 1.15
# Share of the width of the axes that remains beside the legend.
_LEFT = 0.75


def regions(
    classes: xr.Dataset,
    *,
    max_classes: int = 6,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the motions found over a plane of two swept quantities as regions of colour.

    "1 | 2 in 1" is a motion that repeats after 1 forcing period, with 1 impact at stop 0 and 2 at stop 1 in it; an
    infinity sign is a complete chatter. The label is written into the region if there is room. The hue shows after how
    many forcing periods the motion repeats, or that it chatters. Colours darken down the legend, so that they differ in
    greyscale too. Motions without impacts have the colour of the background, non-periodic ones that of the ink; motions
    that have not settled are hatched.

    Args:
        classes: result of `vx.classify` over two swept quantities, the first on the x axis, the second on the y axis:
            `motion`, an integer with the attributes `flag_values` and `flag_meanings`, `num_periods`, and `num_impacts`
            with the further dimension `stop`, infinite or -1 for a complete chatter.
        max_classes: number of motions, the most frequent ones, with a colour of their own beside those without impacts,
            the non-periodic and those not settled; the rest is "other".
        units: units of swept quantities, as in `{"force": "N", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into; new axes if omitted.
        **style: properties of the plane for matplotlib's `pcolormesh`: `alpha`, `rasterized`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if a variable or its flags are missing, or without two swept dimensions of two values or more.

    Example:
        ```python
        import numpy as np, vijax as vx
        plane = {"forcing.frequency": np.arange(0.4, 2, 0.1), "forcing.amplitude[0]": np.arange(0.2, 1, 0.1)}
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), plane)
        ax = vx.plot.regions(vx.classify(ds))
        ```

    References:
        Wagg & Bishop (2004), Fig. 6.
    """
    check_is_dataset(classes, "classes", "`vx.classify` or `vx.chart`")
    check_motions(classes, max_classes)
    classes = with_paths(classes)
    classes = classes.sortby(list(classes.motion.dims))
    drawn, numbers = legend_entries(motions_of(classes), max_classes)
    code = numbers.reshape(classes.motion.shape).T
    ax = create_axes() if ax is None else ax
    colors = ListedColormap([entry.color for entry in drawn])
    mesh = draw_mesh(ax, classes.motion, code.T, units, style, cmap=colors, vmin=-0.5, vmax=len(drawn) - 0.5)
    for number, entry in enumerate(drawn):
        if entry.words in HATCHES:
            hatch(ax, mesh, code == number, HATCHES[entry.words])
    _name(ax, classes, code, drawn)
    add_legend(ax, is_shown=legend, is_covered=True, title=legend_title(classes), **_legend(drawn))
    return ax


def _name(ax: Axes, classes: xr.Dataset, code: np.ndarray, drawn: list[Entry]) -> None:
    """Write each label into the widest place of the largest part of its region, horizontal or vertical, if it fits."""
    x, y = (classes[dim].values for dim in classes.motion.dims)
    box, dots = ax.get_window_extent(), figure_of(ax).dpi / 72
    page = (
        np.array([box.height / code.shape[0], _LEFT * box.width / code.shape[1]]) / dots
    )  # size of a cell, in points
    for number, entry in enumerate(drawn):
        if entry.is_other:
            continue
        parts = np.empty(np.add(code.shape, 2), np.int32)
        ndimage.label(np.pad(code == number, 1), output=parts)
        is_largest = parts == 1 + np.bincount(parts.ravel())[1:].argmax()
        letters = len(entry.words.replace(r"$\infty$", "o"))
        half = np.array([_LETTER[1], _LETTER[0] * letters]) * _FONT / 2
        for angle, needed in ((0, half), (90, half[::-1])):
            inside = np.asarray(ndimage.distance_transform_edt(is_largest, sampling=page / needed))
            row, column = np.unravel_index(np.argmax(inside), inside.shape)
            if inside[row, column] >= _ROOM:
                outline = withStroke(linewidth=2, foreground=entry.color)
                visible = "black" if lightness_of(entry.color) > 0.5 else "white"
                common = {"fontsize": _FONT, "color": visible, "path_effects": [outline]}
                middle = {"ha": "center", "va": "center", "rotation": angle, "clip_on": True}
                ax.text(x[column - 1], y[row - 1], entry.words, **common, **middle)
                break


def _legend(drawn: list[Entry]) -> dict[str, Any]:
    """Handles and labels of the legend, grouped under the names of families."""
    handles, words, family = [], [], ""
    for entry in drawn:
        if entry.family != family:
            family = entry.family
            if family:
                handles.append(Patch(facecolor="none", edgecolor="none"))
                words.append(family)
        edge = "white" if is_dark() and lightness_of(entry.color) < 0.5 else "black"
        common = {"edgecolor": edge, "linewidth": 0.6, "hatch": HATCHES.get(entry.words)}
        handles.append(Patch(facecolor=entry.color, **common))
        words.append(entry.words)
    return {"handles": handles, "labels": words}
