"""What is read off pictures."""

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_rgb

import vijax as vx


def grey(color) -> float:
    return float(np.dot([0.299, 0.587, 0.114], to_rgb(color)))


def events(sol: vx.Solution, kind: int, stop: int) -> np.ndarray:
    return np.asarray(sol.events.t)[(sol.events.kind == kind) & (sol.events.stop == stop)]


def discs(ax, *, filled: bool) -> list[tuple[float, float]]:
    """The round marks, white or filled."""
    marks = [line for line in ax.lines if line.get_marker() == "o"]
    is_white = [mpl.colors.same_color(mark.get_markerfacecolor(), "white") for mark in marks]
    return [points(mark).pop() for mark, white in zip(marks, is_white, strict=True) if white != filled]


def points(line) -> set[tuple[float, float]]:
    return set(zip(*(np.asarray(a).tolist() for a in line.get_data()), strict=True))
