"""Colour, marker and legend entry of each attractor."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ._cloud import MARKERS
from ._colors import ink, with_lightness
from ._legend import add_legend
from ._motions import HATCHES, color_of_other, color_of_unknown, legend_title

# Hues after Okabe and Ito, distinguishable by colour-blind readers.
_HUES = ("#0072b2", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#d55e00", "#56b4e9", "#7f4fc9")
# Lightness of each hue: all differ in greyscale, the first ones most; all suit black points and white edges.
_LIGHTNESS = (0.46, 0.72, 0.32, 0.85, 0.59, 0.39, 0.785, 0.525)
COLORS = tuple(
    to_hex((red, green, blue))
    for red, green, blue in (with_lightness(*one) for one in zip(_HUES, _LIGHTNESS, strict=True))
)
# Hatch of starts without a known attractor.
HATCH = HATCHES["not settled"]


def check_count(max_attractors: int) -> None:
    """Raise if there are more attractors than colours."""
    if not 0 <= max_attractors <= len(COLORS):
        raise ValueError(
            f"Argument `max_attractors` must lie in 0 to {len(COLORS)}, but is {max_attractors}."
        )


def path_along(followed: xr.Dataset, picture: str) -> str:
    """Path of the parameter along which the attractors were followed."""
    dims = [str(dim) for dim in followed["share"].dims if dim != "attractor"] if "share" in followed else []
    if len(dims) != 1 or followed.sizes[dims[0]] < 2:
        raise ValueError(
            f"{picture} needs what `vx.follow_attractors` returned for two values of a parameter or more, but has "
            f"`share` along {dims}."
        )
    return dims[0]


def draw_marks(ax: Axes, x: np.ndarray, y: np.ndarray, number: int, size: float) -> None:
    """Draw the marker of an attractor at given points."""
    ax.plot(
        x,
        y,
        linestyle="none",
        marker=MARKERS[number],
        markersize=size,
        markerfacecolor="black",
        markeredgecolor="white",
        markeredgewidth=size / 8,
        rasterized=True,
    )


def add_legend_of_attractors(
    ax: Axes,
    ds: xr.Dataset,
    words: list[str],
    has_mark: list[bool],
    *,
    is_shown: bool,
    has_other: bool,
    has_unknown: bool,
) -> None:
    """Add a legend entry for each attractor, its colour beside its marker, and for the areas without a colour.

    Args:
        ax: the axes.
        ds: the dataset of the attractors.
        words: label of each attractor.
        has_mark: whether its marker is drawn anywhere.
        is_shown: whether to add it.
        has_other: whether some attractors have no colour of their own.
        has_unknown: whether the attractor of some starts is unknown.
    """
    handles = []
    for k, is_marked in enumerate(has_mark):
        one = Line2D(
            [], [], linestyle="none", marker=MARKERS[k], color="black", markeredgecolor="white", markersize=6
        )
        handles.append((_patch(COLORS[k]), one) if is_marked else (_patch(COLORS[k]),))
    plain = {"other": (_patch(color_of_other()),)} if has_other else {}
    plain |= {"not known": (_patch(color_of_unknown(), HATCH),)} if has_unknown else {}
    add_legend(
        ax,
        is_shown=is_shown,
        is_covered=True,
        handles=[*handles, *plain.values()],
        labels=[*words, *plain],
        handler_map={tuple: HandlerTuple(ndivide=None)},
        title=f"{legend_title(ds)},\nand share of the starts",
    )


def _patch(color: str, strokes: str | None = None) -> Patch:
    return Patch(facecolor=color, edgecolor=ink(), linewidth=0.6, hatch=strokes)
