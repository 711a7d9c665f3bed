"""Words in a drawing, above and below it, where they overlap no others."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text

from ...plot._axes import figure_of
from ...plot._colors import ink

_FONT = 9
# Inches between words.
_SPACE = 0.06
# Inches that a length of 1 takes at least: in axes that are too small for the words, these overlap.
_SMALLEST = 0.05


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


def write_words(
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
    above = [_block(ax.text(x, 0, text, va="bottom", bbox=ground, **common)) for x, text in words.above]
    centred = {"ha": "center", "va": "top", "linespacing": 1.1}
    below = [_block(ax.text(x, 0, text, **centred, **common)) for x, text in words.below]
    notes = [_block(ax.text(float(ends[0]), 0, text, va="top", **common)) for text in words.notes]
    room = _inches(ax)
    while True:
        low = _stack(below, scale, heights[0], up=False)
        high = max(_stack(above, scale, heights[1], up=True), heights[2]) + 0.05
        for note in notes:
            note.text.set_y(low)
            low -= note.size[1] / scale
        low -= 0.05
        spans = [ends, *(_span(block, scale) for block in [*above, *below, *notes])]
        left, right = float(np.min(spans)), float(np.max(spans))
        fitting = min(room[0] / (right - left), room[1] / (high - low))
        # Words keep their size, so the smaller the drawing, the more lines they take, and so on.
        if not fits_axes or fitting >= 0.999 * scale or scale < _SMALLEST:
            break
        scale = fitting
    ax.set_xlim(left, right)
    ax.set_ylim(low, high)
    return scale * (right - left), scale * (high - low)


class _Block(NamedTuple):
    """Words, and their width and height in inches with the space that they need."""

    text: Text
    size: tuple[float, float]


def _block(text: Text) -> _Block:
    width, height = _inches(text)
    return _Block(text, (width + _SPACE, height + _SPACE))


def _stack(blocks: Sequence[_Block], scale: float, start: float, *, up: bool) -> float:
    """Put words into the first line from `start` on in which there is room for them; where the last line ends."""
    reached: list[float] = []
    height = max((block.size[1] for block in blocks), default=0.0) / scale
    for block in sorted(blocks, key=lambda block: block.text.get_position()[0]):
        left, right = _span(block, scale)
        line = next((k for k, end in enumerate(reached) if end <= left), len(reached))
        reached[line : line + 1] = [right]
        block.text.set_y(start + (line if up else -line) * height)
    return start + (len(reached) if up else -len(reached)) * height


def _span(block: _Block, scale: float) -> tuple[float, float]:
    """From where to where words go."""
    x, width = float(block.text.get_position()[0]), block.size[0] / scale
    left = x - (width / 2 if block.text.get_horizontalalignment() == "center" else 0.0)
    return left, left + width


def _inches(artist: Text | Axes) -> tuple[float, float]:
    """Width and height."""
    box, dpi = artist.get_window_extent(), figure_of(artist).dpi
    return box.width / dpi, box.height / dpi
