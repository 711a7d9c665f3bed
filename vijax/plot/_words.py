"""Words in a drawing, above and below it, where they overlap no others."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text

from ._axes import figure_of, ink

_FONT = 9
# Inches between words.
_SPACE = 0.06


class Words(NamedTuple):
    """What is written, each with its place along the drawing.

    Attributes:
        above: beginning at their place.
        below: with their middle at it.
        notes: lines at the very bottom.
    """

    above: list[tuple[float, str]]
    below: list[tuple[float, str]]
    notes: list[str]


def write(
    ax: Axes,
    words: Words,
    ends: np.ndarray,
    heights: tuple[float, float, float],
    scale: float,
    *,
    fits_axes: bool,
) -> tuple[float, float]:
    """Write, and let the axes show the drawing with all words.

    Args:
        ax: where.
        words: what.
        ends: left and right end of the drawing.
        heights: where words below it begin, where those above it begin, and its top.
        scale: inches that a length of 1 takes.
        fits_axes: whether it takes fewer where the axes have no room; they keep their size.

    Returns:
        Width and height in inches.
    """
    ground = {"facecolor": ax.get_facecolor(), "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
    common = {"fontsize": _FONT, "color": ink(), "zorder": 5}
    above = [ax.text(x, 0, text, va="bottom", bbox=ground, **common) for x, text in words.above]
    below = [ax.text(x, 0, text, ha="center", va="top", linespacing=1.1, **common) for x, text in words.below]
    notes = [ax.text(float(ends[0]), 0, "\n".join(words.notes), va="top", **common)] if words.notes else []
    room = _inches(ax, ax)
    low, high, left, right = 0.0, 0.0, *map(float, ends)
    # Words keep their size, so the smaller the drawing, the more lines they take, and so on.
    for _ in range(6):
        low = _stack(ax, below, scale, heights[0], up=False)
        high = max(_stack(ax, above, scale, heights[1], up=True), heights[2]) + 0.05
        for note in notes:
            note.set_y(low)
            low -= _inches(ax, note)[1] / scale
        low -= 0.05
        spans = [ends, *(_span(ax, text, scale) for text in [*above, *below, *notes])]
        left, right = float(np.min(spans)), float(np.max(spans))
        if fits_axes:
            scale = min(scale, room[0] / (right - left), room[1] / (high - low))
    ax.set_xlim(left, right)
    ax.set_ylim(low, high)
    return scale * (right - left), scale * (high - low)


def _stack(ax: Axes, texts: Sequence[Text], scale: float, start: float, *, up: bool) -> float:
    """Put words into the first line from `start` on in which there is room for them; where the last line ends."""
    reached: list[float] = []
    height = (max((_inches(ax, text)[1] for text in texts), default=0.0) + _SPACE) / scale
    for text in sorted(texts, key=lambda text: text.get_position()[0]):
        left, right = _span(ax, text, scale)
        line = next((k for k, end in enumerate(reached) if end <= left), len(reached))
        reached[line : line + 1] = [right]
        text.set_y(start + (line if up else -line) * height)
    return start + (len(reached) if up else -len(reached)) * height


def _span(ax: Axes, text: Text, scale: float) -> tuple[float, float]:
    """From where to where words go, with some space."""
    x, width = float(text.get_position()[0]), (_inches(ax, text)[0] + _SPACE) / scale
    left = x - (width / 2 if text.get_horizontalalignment() == "center" else 0.0)
    return left, left + width


def _inches(ax: Axes, artist: Text | Axes) -> tuple[float, float]:
    """Width and height."""
    box, dpi = artist.get_window_extent(), figure_of(ax).dpi
    return box.width / dpi, box.height / dpi
