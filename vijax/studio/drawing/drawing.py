"""Movable drawing of a machine: all its parts except the words follow one pose.

Displacements are scaled to at most `ROOM`, so that boxes and walls touch only where a gap of the machine is closed.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle

from ...plot._axes import figure_of
from ...plot._colors import curve_colors, ink, merge_style
from ...plot._contacts import name_of
from .arrangement import (
    END,
    Arrangement,
    Move,
    Pose,
    are_neighbours,
    arrangement_of,
    place_of_limit,
    side_position,
    wall_beside,
)
from .canvas import FLOOR, HATCHED, LOAD, TRAVEL, WHEEL, Canvas, Positive
from .friction import INSIDE, draw_pad, rise_of_slider
from .limits import CAVITY, back_of_limit, draw_limit
from .links import CEILING, draw_ground, draw_link, rise_of
from .scheme import DrawnLimit, Scheme
from .symbols import circles
from .words import Words, write_words, write_words_beside

ROOM = 0.5
# Visible length beside the outermost boxes without a wall.
_BESIDE = 0.75
# Height of a loose mass; height of the name of a container; start of load arrows relative to the middle of the box.
_INSIDE, _NAME, _ROOT = 0.5, 0.85, 0.15
# Coordinate across of the marks of impacts in horizontal and vertical drawings.
_MARKED = 0.2, 0.5
# Inches per length of 1, and largest length of the drawing in inches, in a new figure.
_INCHES, _LONGEST = 1.1, 10.0


class Drawing(NamedTuple):
    """Handle of a finished drawing.

    Attributes:
        move: function that moves it to a pose.
        size: preferred width and height in inches.
        boxes: boxes of the masses.
        spot: function from the number of a stop or contact, and a pose, to the places where an impact is marked, along
            and across; those of the masses of a contact that is not drawn.
    """

    move: Move
    size: tuple[float, float]
    boxes: Sequence[Patch]
    spot: Callable[[int, Pose], tuple[list[float], list[float]]]


def draw(
    ax: Axes,
    scheme: Scheme,
    pose: Pose,
    gaps: np.ndarray | None,
    style: dict[str, Any],
    *,
    positive: Positive,
    fits_axes: bool,
) -> Drawing:
    """Draw a machine.

    Args:
        ax: the axes.
        scheme: the machine.
        pose: its first pose.
        gaps: gaps of the stops and contacts to write beside them; None for none.
        style: properties of the boxes that replace the defaults.
        positive: the direction of positive positions.
        fits_axes: whether the axes keep their size, so that the words must fit into it.
    """
    ax.set_axis_off()
    ax.set_aspect("equal")
    canvas, arrangement = Canvas(ax, positive), arrangement_of(scheme)
    ends = _ends(scheme, arrangement)
    window = ax.get_window_extent()
    given = (window.height if canvas.is_vertical else window.width) / figure_of(ax).dpi
    scale = min(_INCHES, (given if fits_axes else _LONGEST) / float(np.ptp(ends)))
    thin = min(1.0, 2 * scale)  # thinner lines in a small drawing
    boxes, moves = _boxes(canvas, scheme, arrangement, thin, style)
    moves += [
        draw_link(canvas, arrangement, link, thin, is_spring=is_spring) for link, is_spring in scheme.links
    ]
    moves += [draw_limit(canvas, scheme, arrangement, limit) for limit in scheme.limits]
    moves += [draw_pad(canvas, arrangement, pad) for pad in scheme.pads]
    for mass in scheme.grounded:
        draw_ground(canvas, arrangement, mass)
    if scheme.base:
        for part in canvas.double_arrow(gid="base"):
            part.set_data([ends.mean() - 0.35, ends.mean() + 0.35], [TRAVEL, TRAVEL])
    moves += [_arrow(canvas, arrangement, i) for i in range(scheme.num_masses) if scheme.load_in_words(i)]

    def move(pose: Pose) -> None:
        for one in moves:
            one(pose)

    move(pose)
    if scheme.has_floor_pads or not canvas.is_vertical:
        canvas.line(ends, [FLOOR, FLOOR], color=ink("0.6", "0.5"), linewidth=1, zorder=0)
    words = _words(canvas, scheme, arrangement, pose, gaps)
    has_arrows = bool(scheme.base) or scheme.is_moving.any()
    has_arrows = has_arrows or any(pad.support is None and pad.velocity for pad in scheme.pads)
    sides = TRAVEL - 0.12 if has_arrows else FLOOR - 0.08, LOAD + 0.15, _top(scheme, arrangement)
    write = write_words_beside if canvas.is_vertical else write_words
    size = write(ax, words, np.sort(canvas.sign * ends), sides, scale, fits_axes=fits_axes)
    limits, height = {limit.number: limit for limit in scheme.limits}, _MARKED[canvas.is_vertical]

    def spot(number: int, pose: Pose) -> tuple[list[float], list[float]]:
        if number in limits:
            x = [place_of_limit(arrangement, pose, limits[number])]
        else:
            x = [side_position(arrangement, pose, i, 0) for i in np.flatnonzero(scheme.rows[number]).tolist()]
        return x, [height] * len(x)

    return Drawing(move, size, boxes, spot)


def _words(
    canvas: Canvas, scheme: Scheme, arrangement: Arrangement, pose: Pose, gaps: np.ndarray | None
) -> Words:
    """All words, at their positions in the picture."""
    loads = [(float(arrangement.home[i]) + _ROOT, scheme.load_in_words(i)) for i in range(scheme.num_masses)]
    names = [
        (place_of_limit(arrangement, pose, limit), name_of_limit(scheme, limit, gaps))
        for limit in scheme.limits
    ]
    above, below = ([(canvas.sign * x, text) for x, text in part if text] for part in (loads, names))
    return Words(above, below, scheme.notes)


def _ends(scheme: Scheme, arrangement: Arrangement) -> np.ndarray:
    """Left and right end of the visible floor, (2,)."""
    at_walls = {wall_beside(arrangement, mass) for mass in scheme.grounded}
    left, right = (0.2 + (END if side in at_walls else _BESIDE) for side in (-1, 1))
    (first, *_), (*_, last) = arrangement.row, arrangement.row
    home, half = arrangement.home, arrangement.half
    return np.array([home[first] - half[first] - left, home[last] + half[last] + right])


def _top(scheme: Scheme, arrangement: Arrangement) -> float:
    """Height of the drawing without words."""
    ceilings = [CEILING + HATCHED for mass in scheme.grounded if not wall_beside(arrangement, mass)]
    arcs = [
        1.1 + rise_of(link, is_spring=is_spring)
        for link, is_spring in scheme.links
        if link.other is not None and not are_neighbours(arrangement, link.mass, link.other)
    ]
    arcs += [
        1.1 + rise_of_slider(pad)
        for pad in scheme.pads
        if not (
            pad.support is None
            or pad.mass in arrangement.inside
            or are_neighbours(arrangement, *sorted((pad.mass, pad.support)))
        )
    ]
    return max([LOAD + 0.1, *ceilings, *arcs])


def name_of_limit(scheme: Scheme, limit: DrawnLimit, gaps: np.ndarray | None) -> str:
    """Label of a stop or contact."""
    j = limit.number
    gap = [] if gaps is None else [f"gap {gaps[j]:.3g}"]
    return "\n".join([name_of(j, scheme.masses), *gap, scheme.restitution[j]])


def _boxes(
    canvas: Canvas, scheme: Scheme, arrangement: Arrangement, thin: float, style: dict[str, Any]
) -> tuple[list[Rectangle], list[Move]]:
    """Draw the masses with their numbers, on wheels, in the colours of their curves in other pictures."""
    colors, inside = curve_colors(scheme.num_masses), arrangement.inside
    edge = {"facecolor": canvas.ax.get_facecolor(), "linewidth": 2.2 * thin}
    widths, rubbing = 2 * arrangement.half, {pad.mass for pad in scheme.pads if pad.mass in inside}
    floors = [CAVITY[0] + (INSIDE[1] if i in rubbing else 0.0) for i in range(scheme.num_masses)]
    boxes = []
    for i, color in enumerate(colors):
        bottom, height, order = (floors[i], _INSIDE, 3.2) if i in inside else (0.0, 1.0, 3)
        own = merge_style(style, Rectangle, edgecolor=color, zorder=order, gid=f"mass {i}", **edge)
        boxes.append(canvas.rectangle(0.0, bottom, widths[i], height, **own))
    heights = [
        floors[i] + _INSIDE / 2 if i in inside else _NAME if i in inside.values() else 0.5
        for i in range(len(boxes))
    ]
    font = {"fontsize": 12 * thin, "color": ink(), "clip_on": True}
    names = [
        canvas.text(0.0, y, str(i), ha="center", va="center", zorder=4, **font) for i, y in enumerate(heights)
    ]
    wheels = canvas.line(color=ink("0.4", "0.6"), linewidth=thin, zorder=2)

    def move(pose: Pose) -> None:
        middle = arrangement.home + pose.x
        for box, name, x, half in zip(boxes, names, middle, arrangement.half, strict=True):
            box.set_x(x - half)
            name.set_x(x)
        if canvas.is_vertical:
            return
        axles = middle[arrangement.row], 0.6 * arrangement.half[arrangement.row]
        wheels.set_data(*circles(np.concatenate([axles[0] - axles[1], axles[0] + axles[1]]), -WHEEL, WHEEL))

    cavities = [
        _cavity(canvas, scheme, arrangement, loose, colors[own], thin) for loose, own in inside.items()
    ]
    return boxes, [move, *cavities]


def _cavity(
    canvas: Canvas, scheme: Scheme, arrangement: Arrangement, loose: int, color: Any, thin: float
) -> Move:
    """Draw the cavity in which a loose mass bounces, between the ends of its container."""
    ends = sorted((limit for limit in scheme.limits if limit.mass == loose), key=lambda limit: limit.side)
    (bottom, top), style = CAVITY, {"facecolor": canvas.ax.get_facecolor(), "edgecolor": color, "zorder": 3.1}
    cavity = canvas.rectangle(
        0.0, bottom, 0.0, top - bottom, linewidth=1.1 * thin, gid=f"cavity {loose}", **style
    )

    def move(pose: Pose) -> None:
        left, right = (back_of_limit(scheme, arrangement, pose, limit) for limit in ends)
        cavity.set_x(left)
        cavity.set_width(right - left)

    return move


def _arrow(canvas: Canvas, arrangement: Arrangement, mass: int) -> Move:
    """Draw the load on a mass as an arrow above its box."""
    line = canvas.line(color=ink(), linewidth=1.6, zorder=4, gid=f"load {mass}")
    tip = canvas.line(color=ink(), linestyle="none", markersize=6, zorder=4)

    def move(pose: Pose) -> None:
        root, length = side_position(arrangement, pose, mass, 0) + _ROOT, pose.load[mass]
        line.set_data([root, root + length], [LOAD, LOAD])
        tip.set_data([root + length], [LOAD])
        tip.set_marker(canvas.tip(is_forward=length >= 0))

    return move
