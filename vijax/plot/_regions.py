"""Region charts: which motion is found where in a plane of two swept quantities."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from scipy import ndimage

from ._axes import figure_of, legend_beside, new_axes
from ._colors import ink, is_dark, lightness_of
from ._labels import Units
from ._mesh import draw_mesh, hatch
from ._motions import HATCHES, Entry, check_motions, entries, heading, motions_of

# Of words in the plane: the size of their letters in points, how wide and how high these are of it, and how far the nearest
# other region must be at least, of half their width and height.
_FONT, _LETTER, _ROOM = 8, (0.55, 1.2), 1.15
# Of the width of the axes what is left once they have a legend beside them.
_LEFT = 0.75


def regions(
    classes: xr.Dataset,
    *,
    max_classes: int = 6,
    units: Units | None = None,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the motions found over a plane of two swept quantities as regions of colour.

    "1 | 2 in 1" is a motion that repeats after 1 forcing period, with 1 impact at stop 0 and 2 at
    stop 1 in it; an infinity sign is a complete chatter. It stands in the plane where there is room for it. The colour
    tells after how many forcing periods the motion repeats, or that it chatters, and is the darker the farther down in the
    legend, so that a printer without colour tells them too. Motions without impacts have the colour of the background,
    non-periodic ones that of ink, and what has not settled is hatched.

    Args:
        classes: what `vx.classify` returned over two swept quantities, the first one drawn to the right and
            the second upwards: `motion`, an integer with the attributes `flag_values` and `flag_meanings`,
            `num_periods`, and with a dimension `stop` more `num_impacts`, infinite or -1 for a complete chatter.
        max_classes: how many motions, the most frequent ones, have a colour of their own beside those without impacts, the
            non-periodic and those not settled; the rest is "other".
        units: of swept quantities, as in `{"force": "N", "time": "s"}`; none are written if left out.
        ax: where to draw; new axes if left out.
        **style: of the plane, as matplotlib's `pcolormesh` takes them: `alpha`, `rasterized`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if a variable or its flags are missing, or there are not two swept dimensions of two values or more.

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
    check_motions(classes, max_classes)
    classes = classes.sortby(list(classes.motion.dims))
    of_point = motions_of(classes)
    drawn = entries(of_point, max_classes)
    numbers = {motion: k for k, entry in enumerate(drawn) for motion in entry.motions}
    code = np.array([numbers[motion] for motion in of_point]).reshape(classes.motion.shape).T
    ax = new_axes() if ax is None else ax
    colors = {
        "cmap": ListedColormap([entry.color for entry in drawn]),
        "vmin": -0.5,
        "vmax": len(drawn) - 0.5,
    }
    mesh = draw_mesh(ax, classes.motion, code.T, units, style, **colors)
    for number, entry in enumerate(drawn):
        if entry.words in HATCHES:
            hatch(ax, mesh, code == number, HATCHES[entry.words])
    _name(ax, classes, code, drawn)
    legend_beside(ax, **_legend(drawn), title=heading(classes))
    return ax


def _name(ax: Axes, classes: xr.Dataset, code: np.ndarray, drawn: list[Entry]) -> None:
    """Write what a region is into its largest part, where it is widest, lying or standing, if there is room."""
    x, y = (classes[dim].values for dim in classes.motion.dims)
    box, dots = ax.get_window_extent(), figure_of(ax).dpi / 72
    page = (
        np.array([box.height / code.shape[0], _LEFT * box.width / code.shape[1]]) / dots
    )  # of a cell, in points
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
                common = {"fontsize": _FONT, "color": _on(entry.color), "path_effects": [outline]}
                middle = {"ha": "center", "va": "center", "rotation": angle, "clip_on": True}
                ax.text(x[column - 1], y[row - 1], entry.words, **common, **middle)
                break


def _on(color: Any) -> str:
    """Black or white, whichever is seen on a colour."""
    return "black" if lightness_of(color) > 0.5 else "white"


def _legend(drawn: list[Entry]) -> dict[str, list]:
    """The entries, those of one family under its name."""
    handles, words, family = [], [], ""
    for entry in drawn:
        if entry.family != family:
            family = entry.family
            if family:
                handles.append(Patch(facecolor="none", edgecolor="none"))
                words.append(family)
        edge = ink("black", "white") if not is_dark() or lightness_of(entry.color) < 0.5 else "black"
        common = {"edgecolor": edge, "linewidth": 0.6, "hatch": HATCHES.get(entry.words)}
        handles.append(Patch(facecolor=entry.color, **common))
        words.append(entry.words)
    return {"handles": handles, "labels": words}
