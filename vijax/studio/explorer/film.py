"""Animation of the machine in the browser, drawn as by `vx.plot.machine`.

Rendering pictures of all frames would take a minute. So the browser gets only the coordinates of all frames at once:
the lines, concatenated with gaps between them, and the positions of boxes and walls.
"""

from pathlib import Path
from typing import Any

import numpy as np
import param
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from panel.custom import JSComponent

from ...plot._colors import curve_colors
from ..drawing.animate import held_masses, poses_of_solution
from ..drawing.drawing import draw
from .look import PageStyle
from .motion import PointMotion

FRAMES = 80
_DIGITS = 3


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
        `x`, `y` of all lines, None between them, (frames, points); `box`, centres of the boxes, and `held`, flags of
        the held masses, (frames, n); `wall`, horizontal centres of the hatched pieces, (frames, walls), and `walls`,
        their heights, widths and vertical centres, (walls, 3); `extent`, the visible part: left, right, bottom, top.
    """
    sol, times = motion.solution, np.linspace(*motion.shown, FRAMES)
    scheme, poses, _ = poses_of_solution(sol, times)
    ax = Figure(figsize=(8, 2)).subplots()
    drawing = draw(ax, scheme, poses[0], None, {}, positive="right", fits_axes=False)
    lines = [line for line in ax.lines if line.get_linestyle() != "None"]
    rectangles = [patch for patch in ax.patches if isinstance(patch, Rectangle)]
    boxes = [one for one in rectangles if one in drawing.boxes]
    walls = [one for one in rectangles if one not in boxes]
    curves, box, wall = [], [], []
    gap = np.full((1, 2), np.nan)
    for pose in poses:
        drawing.move(pose)
        curves.append(np.concatenate([part for line in lines for part in (line.get_xydata(), gap)]))
        box.append([one.get_x() + 0.5 for one in boxes])
        wall.append([one.get_x() + one.get_width() / 2 for one in walls])
    x, y = np.moveaxis(np.array(curves), -1, 0)
    return {
        "x": _rounded(x),
        "y": _rounded(y),
        "box": _rounded(np.array(box)),
        "held": held_masses(sol, scheme, times).tolist(),
        "wall": _rounded(np.array(wall)),
        "walls": [[one.get_height(), one.get_width(), one.get_y() + one.get_height() / 2] for one in walls],
        "extent": [float(end(a)) for a in (x, y) for end in (np.nanmin, np.nanmax)],
    }


def _rounded(a: np.ndarray) -> list:
    """Numbers rounded to few digits for the browser, None for NaN."""
    rounded = a.round(_DIGITS).astype(object)
    rounded[np.isnan(a)] = None
    return rounded.tolist()
