"""Animation of the machine in the browser, drawn as by `vx.plot.machine`.

Rendering pictures of all frames would take a minute. So the browser gets only the coordinates of all frames at once:
the lines, concatenated with gaps between them, and all rectangles.
"""

from pathlib import Path
from typing import Any

import numpy as np
import param
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from panel.custom import JSComponent

from ...plot._colors import curve_colors
from ..drawing.animate import held_masses, poses_of_solution
from ..drawing.canvas import Canvas
from ..drawing.drawing import Drawing, draw
from .look import PageStyle
from .motion import PointMotion

FRAMES = 80
_DIGITS = 3
# Lines of a higher order are drawn over the boxes.
_BOXES = 3.0
# Heads of arrows, by the markers that draw them in a figure: three points, the middle one is the tip.
_HEAD = 0.1 * np.array([[-1.0, 0.6], [0.0, 0.0], [-1.0, -0.6]])
_HEADS = {">": _HEAD, "<": -_HEAD, "^": _HEAD[:, ::-1], "v": -_HEAD[:, ::-1]}


class MachineFilm(JSComponent):
    """The drawing and its player; the browser part is `film.js`."""

    frames = param.Dict({})
    colors = param.Dict({})

    _esm = Path(__file__).with_name("film.js")


def film_of(num_masses: int, look: PageStyle) -> MachineFilm:
    """An empty film, with boxes in the colours of their curves in other pictures."""
    with look.style():
        masses = [to_hex(color) for color in curve_colors(num_masses)]
    colors = {"ink": look.ink, "faint": look.faint, "page": look.page, "held": look.down, "masses": masses}
    return MachineFilm(colors=colors, sizing_mode="stretch_width", min_height=240)


def frames_of(motion: PointMotion) -> dict[str, Any]:
    """Coordinates of a film of the shown part of a motion.

    Returns:
        `lines` and `over`, x and y of all lines below and above the boxes, None between them, (frames, 2, points); `parts`,
        left, bottom, width and height of all rectangles in drawing order, (frames, parts, 4), and `looks`, the mass of
        each, or "hatch", "ink" or "cavity", (parts,); `names`, positions of the numbers of the masses, (frames, n, 2);
        `held`, flags of the held masses, (frames, n); `extent`, the visible part: left, right, bottom, top.
    """
    sol, times = motion.solution, np.linspace(*motion.shown, FRAMES)
    scheme, poses, _ = poses_of_solution(sol, times)
    canvas = Canvas(Figure(figsize=(8, 2)).subplots(), scheme.positive)
    drawing = draw(canvas.ax, scheme, poses[0], None, {}, positive=canvas.positive, fits_axes=False)
    split = [
        [line for line in canvas.ax.lines if (line.get_zorder() > _BOXES) is over] for over in (False, True)
    ]
    parts = [patch for patch in canvas.ax.patches if isinstance(patch, Rectangle)]
    parts = sorted(parts, key=lambda part: part.get_zorder())
    names = canvas.ax.texts[: scheme.num_masses]  # the numbers in the boxes come first
    frames = []
    for pose in poses:
        drawing.move(pose)
        frames.append(
            (
                *(_joined(canvas, some) for some in split),
                np.array([_bounds(canvas, part) for part in parts]),
                canvas.turned.transform([name.get_position() for name in names]),
            )
        )
    below, over, bounds, places = (np.array(a) for a in zip(*frames, strict=True))
    ends = np.concatenate([below, over, bounds[..., :2].swapaxes(1, 2)], axis=-1)
    return {
        "lines": _rounded(below),
        "over": _rounded(over),
        "parts": _rounded(bounds),
        "looks": [_look(part, drawing) for part in parts],
        "names": _rounded(places),
        "held": held_masses(sol, scheme, times).tolist(),
        "extent": [float(end(ends[:, axis])) for axis in (0, 1) for end in (np.nanmin, np.nanmax)],
    }


def _joined(canvas: Canvas, lines: list[Line2D]) -> np.ndarray:
    """Points of lines and of heads of arrows in the picture, each followed by NaN, (2, points)."""
    gap = np.full((1, 2), np.nan)
    points = [part for line in lines for stroke in _strokes(canvas, line) for part in (stroke, gap)]
    return np.concatenate([np.empty((0, 2)), *points]).T


def _strokes(canvas: Canvas, line: Line2D) -> list[np.ndarray]:
    """The line in the picture, and the heads of arrows among its points, (points, 2) each."""
    points = canvas.turned.transform(line.get_xydata())
    strokes = [] if line.get_linestyle() == "None" else [points]
    if (head := _HEADS.get(str(line.get_marker()))) is not None:
        marked: Any = line.get_markevery()  # the points with a marker, None for all
        strokes += [end + head for end in (points if marked is None else points[marked])]
    return strokes


def _bounds(canvas: Canvas, part: Rectangle) -> np.ndarray:
    """Left, bottom, width and height of a rectangle in the picture."""
    (x, y), length, width = part.get_xy(), part.get_width(), part.get_height()
    corners = canvas.turned.transform([[x, y], [x + length, y + width]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return np.concatenate([low, high - low])


def _look(part: Rectangle, drawing: Drawing) -> int | str:
    """The mass of a box; the look of another rectangle."""
    if part in drawing.boxes:
        return drawing.boxes.index(part)
    return "hatch" if part.get_hatch() else "cavity" if str(part.get_gid()).startswith("cavity") else "ink"


def _rounded(a: np.ndarray) -> list:
    """Numbers rounded to few digits for the browser, None for NaN."""
    rounded = a.round(_DIGITS).astype(object)
    rounded[np.isnan(a)] = None
    return rounded.tolist()
