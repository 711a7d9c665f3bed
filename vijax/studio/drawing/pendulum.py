"""Movable drawing of a pendulum: its position is the angle from the downward vertical, counted to the right.

Angles are true, so that nothing is scaled. The face of a stop is the tangent of the bob at the angle of the stop.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

from ...plot._axes import figure_of
from ...plot._colors import curve_colors, ink, merge_style
from .arrangement import Move, Pose
from .canvas import HATCHED, Canvas
from .drawing import Drawing, name_of_limit
from .scheme import DrawnLimit, Scheme

# Length of the rod, radius of the bob, half of the length of a wall, length of the plumb line, half width of the ground.
_ROD, _BOB, _WALL, _PLUMB, _GROUND = 2.0, 0.35, 0.45, 2.6, 0.4
# Distance of the words of a stop from the pivot, beyond the wall; space around the bob.
_WORDS, _ROOM, _FONT = 0.35, 0.55, 9
_INCHES = 0.8


def draw_pendulum(
    ax: Axes,
    scheme: Scheme,
    poses: list[Pose],
    gaps: np.ndarray | None,
    style: dict[str, Any],
    *,
    fits_axes: bool,
) -> Drawing:
    """Draw a pendulum.

    Args:
        ax: the axes.
        scheme: the machine, `is_pendulum`.
        poses: its poses, in radians, all of which have room; the first is drawn.
        gaps: gaps of the stops to write beside them; None for none.
        style: properties of the bob that replace the defaults.
        fits_axes: whether the axes keep their size, so that the words must fit into it.
    """
    pose, limits = poses[0], scheme.limits
    ax.set_axis_off()
    ax.set_aspect("equal")
    canvas = Canvas(ax, "right")
    canvas.hatch(-_GROUND, 0.0, 2 * _GROUND, HATCHED)
    canvas.line([-_GROUND, _GROUND], [0, 0], color=ink(), linewidth=1.2)
    canvas.line([0, 0], [0, -_PLUMB], color=ink("0.6", "0.5"), linewidth=1, linestyle="--", zorder=0)
    bob, move_bob = _bob(canvas, style)
    moves = [move_bob, *(_wall(canvas, limit) for limit in scheme.limits)]

    def move(pose: Pose) -> None:
        for one in moves:
            one(pose)

    move(pose)
    reach = _ROD + _BOB + _ROOM
    width = 2 * _INCHES * reach
    shown = ax.get_window_extent().width / figure_of(ax).dpi if fits_axes else width
    words = {"fontsize": _FONT * min(1.0, shown / width), "color": ink(), "zorder": 5}
    for limit in scheme.limits:
        x, y = _at(_angle_of(limit, pose), _ROD + _WALL + _WORDS, limit.side * _BOB)
        aside = {"ha": "center", "va": "top" if y < 0 else "bottom", "linespacing": 1.1}
        canvas.text(x, y, name_of_limit(scheme, limit, gaps), **aside, **words)
    load = scheme.load_in_words(0)
    notes = [*([f"moment {load}"] if load else []), *scheme.notes]
    angles = [float(pose.x[0]) for pose in poses] + [_angle_of(limit, pose) for limit in limits]
    is_high = min(np.cos(angles)) < 0
    low, high = -reach - 2 * _ROOM - 0.3 * len(notes), reach + _ROOM if is_high else _ROOM
    canvas.text(0.1 - reach, -reach - 2 * _ROOM, "\n".join(notes), ha="left", va="top", **words)
    ax.set_xlim(-reach, reach)
    ax.set_ylim(low, high)

    def spot(number: int, pose: Pose) -> tuple[list[float], list[float]]:
        (limit,) = (one for one in scheme.limits if one.number == number)
        x, y = _at(_angle_of(limit, pose), _ROD, limit.side * _BOB)
        return [x], [y]

    return Drawing(move, (width, _INCHES * (high - low)), [bob], spot)


def _at(angle: float, along: float, aside: float) -> tuple[float, float]:
    """Point at a distance along the rod of an angle, and aside of it, to the right."""
    sine, cosine = float(np.sin(angle)), float(np.cos(angle))
    return along * sine + aside * cosine, aside * sine - along * cosine


def _angle_of(limit: DrawnLimit, pose: Pose) -> float:
    """Angle of a stop."""
    return float(pose.x[0] + limit.side * pose.gap[limit.number])


def _bob(canvas: Canvas, style: dict[str, Any]) -> tuple[Circle, Move]:
    """Draw the rod, and the bob with its number."""
    own = {"edgecolor": curve_colors(1)[0], "facecolor": canvas.ax.get_facecolor(), "linewidth": 2.2}
    bob = Circle((0, 0), _BOB, **merge_style(style, Circle, zorder=3, gid="mass 0", **own))
    canvas.ax.add_patch(bob)
    rod = canvas.line(color=ink(), linewidth=1.8, zorder=2, gid="rod")
    name = canvas.text(0.0, 0.0, "0", ha="center", va="center", zorder=4, fontsize=12, color=ink())

    def move(pose: Pose) -> None:
        place = _at(float(pose.x[0]), _ROD, 0.0)
        bob.set_center(place)
        name.set_position(place)
        rod.set_data(*zip((0.0, 0.0), place, strict=True))

    return bob, move


def _wall(canvas: Canvas, limit: DrawnLimit) -> Move:
    """Draw a stop: a hatched wall along the rod at its angle."""
    line = canvas.line(color=ink(), linewidth=1.8, zorder=2, gid=f"limit {limit.number}")
    wall: Rectangle = canvas.hatch(0.0, 0.0, HATCHED, 2 * _WALL, gid=f"wall {limit.number}")
    near, far = (limit.side * _BOB, limit.side * _BOB + min(limit.side, 0) * HATCHED)

    def move(pose: Pose) -> None:
        angle = _angle_of(limit, pose)
        ends = [_at(angle, _ROD + end, near) for end in (-_WALL, _WALL)]
        line.set_data(*zip(*ends, strict=True))
        wall.set_xy(_at(angle, _ROD + _WALL, far))
        wall.set_angle(np.degrees(angle))

    return move
