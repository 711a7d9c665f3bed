"""Placement of words above and below a drawing, or on both sides of a vertical one, without overlap."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text

from ...plot._axes import figure_of
from ...plot._colors import ink

# Letters, which shrink in turn in axes of the user where a length of 1 would have fewer inches than is readable.
_FONTS, _READABLE = (9, 8, 7, 6, 5), 0.4
# Inches between words.
_SPACE = 0.06
# Least inches per length of 1: in smaller axes the words overlap.
_SMALLEST = 0.05


class Words(NamedTuple):
    """Words of a drawing, each with its position along the drawing.

    Attributes:
        above: words that begin at their position.
        below: words centred at their position.
        notes: lines at the bottom.
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
    """Write the words, and set the limits of the axes to the drawing with all words.

    Args:
        ax: the axes.
        words: the words.
        ends: left and right end of the drawing.
        heights: start of the words below, start of the words above, and top of the drawing.
        scale: inches per length of 1.
        fits_axes: whether the axes keep their size, and the scale is reduced to fit.

    Returns:
        Width and height in inches.
    """
    ground = {"facecolor": ax.get_facecolor(), "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
    common = {"fontsize": _FONTS[0], "color": ink(), "zorder": 5}
    above = [_Block(ax.text(x, 0, text, va="bottom", bbox=ground, **common)) for x, text in words.above]
    centred = {"ha": "center", "va": "top", "linespacing": 1.1}
    below = [_Block(ax.text(x, 0, text, **centred, **common)) for x, text in words.below]
    notes = [_Block(ax.text(float(ends[0]), 0, text, va="top", **common)) for text in words.notes]

    def arranged(scale: float) -> tuple[float, float, float, float]:
        low = _stack(below, scale, heights[0], up=False)
        high = max(_stack(above, scale, heights[1], up=True), heights[2]) + 0.05
        for note in notes:
            note.text.set_y(low)
            low -= note.size[1] / scale
        spans = [ends, *(_span(block, scale) for block in [*above, *below, *notes])]
        return float(np.min(spans)), float(np.max(spans)), low - 0.05, high

    return _fit(ax, [*above, *below, *notes], arranged, scale, fits_axes=fits_axes)


def write_words_beside(
    ax: Axes,
    words: Words,
    ends: np.ndarray,
    sides: tuple[float, float, float],
    scale: float,
    *,
    fits_axes: bool,
) -> tuple[float, float]:
    """Write the words of a vertical drawing: those below at its left, those above at its right.

    Args:
        ax: the axes.
        words: the words.
        ends: bottom and top of the drawing.
        sides: end of the words at the left, start of the words at the right, and right end of the drawing.
        scale: inches per length of 1.
        fits_axes: whether the axes keep their size, and the scale is reduced to fit.

    Returns:
        Width and height in inches.
    """
    common = {"fontsize": _FONTS[0], "color": ink(), "zorder": 5}
    beside, lines = {"va": "center", "linespacing": 1.1}, {"ha": "left", "va": "top"}
    before = [_Block(ax.text(sides[0], y, text, ha="right", **beside, **common)) for y, text in words.below]
    after = [_Block(ax.text(sides[1], y, text, ha="left", **beside, **common)) for y, text in words.above]
    notes = [_Block(ax.text(0, 0, text, **lines, **common)) for text in words.notes]
    at = [[y for y, _ in part] for part in (words.below, words.above)]

    def arranged(scale: float) -> tuple[float, float, float, float]:
        columns = zip((before, after), at, strict=True)
        spans = [ends, *(_spread(part, y, scale) for part, y in columns if part)]
        low, high = float(np.min(spans)), float(np.max(spans))
        left = sides[0] - max((block.size[0] for block in before), default=0.0) / scale
        right = max([sides[2], *(sides[1] + block.size[0] / scale for block in after)])
        right = max([right, *(left + block.size[0] / scale for block in notes)])
        low -= 0.05
        for note in notes:
            note.text.set_position((left, low))
            low -= note.size[1] / scale
        return left, right, low - 0.05, high

    return _fit(ax, [*before, *after, *notes], arranged, scale, fits_axes=fits_axes)


def _fit(
    ax: Axes,
    blocks: Sequence["_Block"],
    arranged: Callable[[float], tuple[float, float, float, float]],
    scale: float,
    *,
    fits_axes: bool,
) -> tuple[float, float]:
    """Arrange the words so that all fits, and set the limits of the axes; return width and height in inches.

    Args:
        ax: the axes.
        blocks: all words.
        arranged: puts the words at a scale, and returns the left, right, lower and upper end of all.
        scale: inches per length of 1.
        fits_axes: whether the axes keep their size, and the letters and the scale are reduced to fit.
    """

    def scale_of(font: int) -> float:
        for block in blocks:
            block.text.set_fontsize(font)
        return _largest_scale(_inches(ax), arranged, scale)

    if fits_axes:
        scales: dict[int, float] = {}
        for font in _FONTS:
            scales[font] = scale_of(font)
            if scales[font] >= min(_READABLE, scale):
                break
        scale = scale_of(max(scales, key=lambda font: scales[font]))
    left, right, low, high = arranged(scale)
    ax.set_xlim(left, right)
    ax.set_ylim(low, high)
    return scale * (right - left), scale * (high - low)


def _largest_scale(
    room: tuple[float, float], arranged: Callable[[float], tuple[float, float, float, float]], scale: float
) -> float:
    """Scale at which all fits into the room, found by ever smaller ones: the smaller the drawing, the more lines words take."""
    while scale >= _SMALLEST:
        left, right, low, high = arranged(scale)
        fitting = min(room[0] / (right - left), room[1] / (high - low))
        if fitting >= 0.999 * scale:
            break
        scale = fitting
    return scale


def _spread(blocks: Sequence["_Block"], wished: Sequence[float], scale: float) -> tuple[float, float]:
    """Put blocks of one column at their heights, or above the block below; return the ends of the column."""
    end = -np.inf
    for k in np.argsort(wished):
        half = blocks[k].size[1] / scale / 2
        y = max(wished[k], end + half)
        blocks[k].text.set_y(y)
        end = y + half
    first = int(np.argmin(wished))
    return wished[first] - blocks[first].size[1] / scale / 2, end


class _Block(NamedTuple):
    """Words in letters of some size."""

    text: Text

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in inches, including the space between words."""
        width, height = _inches(self.text)
        return width + _SPACE, height + _SPACE


def _stack(blocks: Sequence[_Block], scale: float, start: float, *, up: bool) -> float:
    """Put each block into the first line from `start` on with room for it; return the end of the last line."""
    reached: list[float] = []
    height = max((block.size[1] for block in blocks), default=0.0) / scale
    for block in sorted(blocks, key=lambda block: block.text.get_position()[0]):
        left, right = _span(block, scale)
        line = next((k for k, end in enumerate(reached) if end <= left), len(reached))
        reached[line : line + 1] = [right]
        block.text.set_y(start + (line if up else -line) * height)
    return start + (len(reached) if up else -len(reached)) * height


def _span(block: _Block, scale: float) -> tuple[float, float]:
    """Left and right end of a block."""
    x, width = float(block.text.get_position()[0]), block.size[0] / scale
    left = x - (width / 2 if block.text.get_horizontalalignment() == "center" else 0.0)
    return left, left + width


def _inches(artist: Text | Axes) -> tuple[float, float]:
    """Width and height in inches."""
    box, dpi = artist.get_window_extent(), figure_of(artist).dpi
    return box.width / dpi, box.height / dpi
