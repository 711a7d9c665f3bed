"""Attractors as pictures tell them apart: a colour, a mark and a line of the legend for each."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ._axes import legend_beside
from ._cloud import MARKERS
from ._motions import heading

# After Okabe and Ito, told apart by the colour-blind as well; light enough for black points, dark enough for white edges.
COLORS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442", "#0072b2", "#d55e00", "#b0e0c8")
OTHER, UNKNOWN = "#a0a0a0", "#606060"


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
    ax: Axes, ds: xr.Dataset, words: list[str], has_mark: list[bool], greys: dict[str, str]
) -> None:
    """One entry for each attractor, its colour beside its mark, and for what is grey.

    Args:
        ax: the axes.
        ds: whose attractors they are.
        words: of each attractor.
        has_mark: whether its mark is drawn anywhere.
        greys: colours of others by their words.
    """
    handles = []
    for k, is_marked in enumerate(has_mark):
        one = Line2D(
            [], [], linestyle="none", marker=MARKERS[k], color="black", markeredgecolor="white", markersize=6
        )
        handles.append((_patch(COLORS[k]), one) if is_marked else (_patch(COLORS[k]),))
    legend_beside(
        ax,
        handles=[*handles, *((_patch(color),) for color in greys.values())],
        labels=[*words, *greys],
        handler_map={tuple: HandlerTuple(ndivide=None)},
        title=f"{heading(ds)},\nand share of the starts",
    )


def _patch(color: str) -> Patch:
    return Patch(facecolor=color, edgecolor="black", linewidth=0.6)
