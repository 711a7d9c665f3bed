"""Attractors as pictures tell them apart: a colour, a mark and a line of the legend for each."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ._axes import legend_beside
from ._cloud import MARKERS
from ._colors import ink, with_lightness
from ._motions import HATCHES, heading, not_known, other

# Hues after Okabe and Ito, told apart by the colour-blind as well, each as light as no other, so that a printer without colour
# tells them apart, the first ones best; light enough for black points, dark enough for white edges.
_HUES = ("#0072b2", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#d55e00", "#56b4e9", "#7f4fc9")
_LIGHTNESS = (0.46, 0.72, 0.32, 0.85, 0.59, 0.39, 0.785, 0.525)
COLORS = tuple(
    to_hex((red, green, blue))
    for red, green, blue in (with_lightness(*one) for one in zip(_HUES, _LIGHTNESS, strict=True))
)
# What has no colour: others, and what is not known.
HATCH = HATCHES["not settled"]


def check_count(max_attractors: int) -> None:
    """Refuse more attractors than there are colours."""
    if not 0 <= max_attractors <= len(COLORS):
        raise ValueError(
            f"Argument `max_attractors` must lie in 0 to {len(COLORS)}, but is {max_attractors}."
        )


def draw_marks(ax: Axes, x: np.ndarray, y: np.ndarray, number: int, size: float) -> None:
    """Draw the mark of an attractor at some points."""
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


def add_legend(
    ax: Axes, ds: xr.Dataset, words: list[str], has_mark: list[bool], *, has_other: bool, has_unknown: bool
) -> None:
    """One entry for each attractor, its colour beside its mark, and for what has no colour.

    Args:
        ax: the axes.
        ds: whose attractors they are.
        words: of each attractor.
        has_mark: whether its mark is drawn anywhere.
        has_other: whether some have no colour of their own.
        has_unknown: whether of some starts no attractor is known.
    """
    handles = []
    for k, is_marked in enumerate(has_mark):
        one = Line2D(
            [], [], linestyle="none", marker=MARKERS[k], color="black", markeredgecolor="white", markersize=6
        )
        handles.append((_patch(COLORS[k]), one) if is_marked else (_patch(COLORS[k]),))
    plain = {"other": (_patch(other()),)} if has_other else {}
    plain |= {"not known": (_patch(not_known(), HATCH),)} if has_unknown else {}
    legend_beside(
        ax,
        handles=[*handles, *plain.values()],
        labels=[*words, *plain],
        handler_map={tuple: HandlerTuple(ndivide=None)},
        title=f"{heading(ds)},\nand share of the starts",
    )


def _patch(color: str, strokes: str | None = None) -> Patch:
    return Patch(facecolor=color, edgecolor=ink(), linewidth=0.6, hatch=strokes)
