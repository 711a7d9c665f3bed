"""Movable drawing of a machine: all its parts except the words follow one pose.

A box is 1 wide and high; boxes at rest are `PITCH` apart. Displacements are scaled to at most `ROOM`, so that boxes and
walls touch only where a gap of the machine is closed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from ...plot._axes import figure_of
from ...plot._colors import curve_colors, ink, merge_style
from ...plot._contacts import name_of
from .scheme import DrawnLimit, Link, Scheme
from .symbols import circles, damper, spring
from .words import Words, write_words

PITCH, ROOM = 2.3, 0.5
# Heights of springs, dampers, walls and plates of contacts; radius of the wheels.
_SPRING, _DAMPER, _WALL, _PLATE, _WHEEL = 0.82, 0.56, 0.2, 0.32, 0.1
_FLOOR = -2 * _WHEEL
# Ground ends of springs: height above boxes, distance of walls from the outermost middles; thickness of a hatch.
_CEILING, _END, _HATCHED = 1.55, 1.75, 0.14
# Length of the spring of a compliant stop at rest, and height of the spring; width and height of a friction pad.
_YIELDING, _CUSHION, _PAD = 0.35, 0.0, (0.5, 0.07)
# Visible floor beside the outermost boxes without a wall.
_BESIDE = 1.25
# Load arrows: height, and start relative to the middle of the box. Height of the double arrows of moving stops.
_LOAD, _ROOT, _TRAVEL = 1.15, 0.15, _FLOOR - 0.14
# Inches per length of 1, and largest width of the drawing in inches, in a new figure.
_INCHES, _WIDEST = 1.1, 10.0


class Pose(NamedTuple):
    """State of the movable parts, in lengths of the drawing.

    Attributes:
        x: displacements of the masses, (n,).
        gap: gaps of all stops and contacts, (stops,).
        load: signed lengths of the load arrows, (n,).
    """

    x: np.ndarray
    gap: np.ndarray
    load: np.ndarray


Move = Callable[[Pose], None]


class Drawing(NamedTuple):
    """Handle of a finished drawing.

    Attributes:
        move: function that moves it to a pose.
        size: preferred width and height in inches.
        boxes: boxes of the masses.
    """

    move: Move
    size: tuple[float, float]
    boxes: list[Rectangle]


def draw(
    ax: Axes, scheme: Scheme, pose: Pose, gaps: np.ndarray | None, style: dict[str, Any], *, fits_axes: bool
) -> Drawing:
    """Draw a machine.

    Args:
        ax: the axes.
        scheme: the machine.
        pose: its first pose.
        gaps: gaps of the stops and contacts to write below them; None for none.
        style: properties of the boxes that replace the defaults.
        fits_axes: whether the axes keep their size, so that the words must fit into it.
    """
    ax.set_axis_off()
    ax.set_aspect("equal")
    home = PITCH * np.arange(scheme.num_masses)
    ends = _ends(scheme, home)
    given = ax.get_window_extent().width / figure_of(ax).dpi if fits_axes else _WIDEST
    scale = min(_INCHES, given / float(np.ptp(ends)))
    thin = min(1.0, 2 * scale)  # thinner lines in a small drawing
    boxes, moves = _boxes(ax, scheme, home, thin, style)
    moves += [_link(ax, home, link, thin, is_spring=is_spring) for link, is_spring in scheme.links]
    moves += [_limit(ax, scheme, home, limit) for limit in scheme.limits]
    moves += [_pad(ax, home, mass, velocity) for mass, velocity in scheme.pads]
    for mass in scheme.grounded:
        _ground(ax, home, mass)
    loads = {i: text for i in range(scheme.num_masses) if (text := scheme.load_in_words(i))}
    moves += [_arrow(ax, home, i) for i in loads]

    def move(pose: Pose) -> None:
        for one in moves:
            one(pose)

    move(pose)
    ax.plot(ends, [_FLOOR, _FLOOR], color=ink("0.6", "0.5"), linewidth=1, zorder=0)
    words = Words(
        above=[(float(home[i]) + _ROOT, text) for i, text in loads.items()],
        below=[_name_of_limit(scheme, home, pose, limit, gaps) for limit in scheme.limits],
        notes=scheme.notes,
    )
    has_arrows = scheme.is_moving.any() or any(velocity for _, velocity in scheme.pads)
    below = _TRAVEL - 0.12 if has_arrows else _FLOOR - 0.08
    size = write_words(ax, words, ends, (below, _LOAD + 0.15, _top(scheme, home)), scale, fits_axes=fits_axes)
    return Drawing(move, size, boxes)


def side_position(home: np.ndarray, pose: Pose, mass: int, side: int) -> float:
    """Position of a side of a box: -1 left, 0 middle, 1 right."""
    return float(home[mass] + pose.x[mass]) + 0.5 * side


def place_of_limit(home: np.ndarray, pose: Pose, limit: DrawnLimit) -> float:
    """Position of a wall or plate."""
    return side_position(home, pose, limit.mass, limit.side) + limit.side * float(pose.gap[limit.number])


def _ends(scheme: Scheme, home: np.ndarray) -> np.ndarray:
    """Left and right end of the visible floor, (2,)."""
    at_walls = {_wall_beside(home, mass) for mass in scheme.grounded}
    left, right = (_END if side in at_walls else _BESIDE for side in (-1, 1))
    return np.array([home[0] - left - 0.2, home[-1] + right + 0.2])


def _top(scheme: Scheme, home: np.ndarray) -> float:
    """Height of the drawing without words."""
    ceilings = [_CEILING + _HATCHED for mass in scheme.grounded if not _wall_beside(home, mass)]
    arcs = [
        1.1 + _rise(link, is_spring=is_spring)
        for link, is_spring in scheme.links
        if link.other is not None and link.other > link.mass + 1
    ]
    return max([_LOAD + 0.1, *ceilings, *arcs])


def _name_of_limit(
    scheme: Scheme, home: np.ndarray, pose: Pose, limit: DrawnLimit, gaps: np.ndarray | None
) -> tuple[float, str]:
    """Position and text of the label below a stop or contact."""
    j = limit.number
    gap = [] if gaps is None else [f"gap {gaps[j]:.3g}"]
    words = [name_of(j, scheme.masses), *gap, scheme.restitution[j]]
    return place_of_limit(home, pose, limit), "\n".join(words)


def _boxes(
    ax: Axes, scheme: Scheme, home: np.ndarray, thin: float, style: dict[str, Any]
) -> tuple[list[Rectangle], list[Move]]:
    """Draw the masses with their numbers, on wheels, in the colours of their curves in other pictures."""
    colors = curve_colors(scheme.num_masses)
    edge = {"facecolor": ax.get_facecolor(), "linewidth": 2.2 * thin, "zorder": 3}
    boxes = [
        _rectangle(ax, 0.0, 0.0, 1.0, 1.0, **merge_style(style, Rectangle, edgecolor=color, **edge))
        for color in colors
    ]
    names = [
        ax.text(
            0, 0.5, str(i), ha="center", va="center", zorder=4, fontsize=12 * thin, color=ink(), clip_on=True
        )
        for i in range(len(home))
    ]
    (wheels,) = ax.plot([], [], color=ink("0.4", "0.6"), linewidth=thin, zorder=2)

    def move(pose: Pose) -> None:
        middle = home + pose.x
        for box, name, x in zip(boxes, names, middle, strict=True):
            box.set_x(x - 0.5)
            name.set_x(x)
        wheels.set_data(*circles(np.concatenate([middle - 0.3, middle + 0.3]), -_WHEEL, _WHEEL))

    return boxes, [move]


def _link(ax: Axes, home: np.ndarray, link: Link, thin: float, *, is_spring: bool) -> Move:
    """Draw a spring or damper, dashed if its strength is negative."""
    symbol, height = (spring, _SPRING) if is_spring else (damper, _DAMPER)
    style = "-" if link.strength > 0 else (0, (2, 1))
    (line,) = ax.plot([], [], color=ink("0.25", "0.8"), linestyle=style, linewidth=1.1 * thin, zorder=1)
    line.set_gid("spring" if is_spring else "damper")
    aside = -0.4 if is_spring else -0.18

    def move(pose: Pose) -> None:
        line.set_data(*symbol(*_link_path(home, pose, link, height, aside)))

    return move


def _link_path(
    home: np.ndarray, pose: Pose, link: Link, height: float, aside: float
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Start, end and rise of the arc of a spring or damper."""
    i, j = link.mass, link.other
    if j is None and (side := _wall_beside(home, i)):
        wall = float(home[i]) + side * _END
        return (wall, height), (side_position(home, pose, i, side), height), 0.0
    if j is None:
        top = float(home[i]) + aside, _CEILING
        return top, (side_position(home, pose, i, 0) + aside, 1.0), 0.0
    if j == i + 1:
        return (side_position(home, pose, i, 1), height), (side_position(home, pose, j, -1), height), 0.0
    start, end = side_position(home, pose, i, 0) + 0.25, side_position(home, pose, j, 0) + 0.05
    return (start, 1.0), (end, 1.0), _rise(link, is_spring=height == _SPRING)


def _ground(ax: Axes, home: np.ndarray, mass: int) -> None:
    """Draw the ground of a mass: a wall at the end of the row, or a ceiling above its box."""
    side, x = _wall_beside(home, mass), float(home[mass])
    if side:
        x += side * _END
        _hatch(ax, x if side > 0 else x - _HATCHED, _FLOOR, _HATCHED, 1.1 - _FLOOR)
        ax.plot([x, x], [_FLOOR, 1.1], color=ink(), linewidth=1.2)
    else:
        _hatch(ax, x - 0.52, _CEILING, 0.46, _HATCHED)
        ax.plot([x - 0.52, x - 0.06], [_CEILING, _CEILING], color=ink(), linewidth=1.2)


def _wall_beside(home: np.ndarray, mass: int) -> int:
    """Side of a mass with room for a wall: -1 for the first, 1 for the last, 0 for others."""
    return -1 if mass == 0 else int(mass == len(home) - 1)


def _rise(link: Link, *, is_spring: bool) -> float:
    """Rise of an arc above the boxes."""
    span = 1 if link.other is None else link.other - link.mass
    return 0.6 * span**0.5 + (0.0 if is_spring else 0.25)


def _hatch(ax: Axes, x: float, y: float, width: float, height: float, gid: str | None = None) -> Rectangle:
    """Draw a hatched piece of the ground."""
    style = {"facecolor": "none", "edgecolor": ink("0.35", "0.7"), "hatch": "/////", "linewidth": 0}
    return _rectangle(ax, x, y, width, height, gid=gid, **style)


def _rectangle(ax: Axes, x: float, y: float, width: float, height: float, **style: Any) -> Rectangle:
    rectangle = Rectangle((x, y), width, height, **style)
    ax.add_patch(rectangle)
    return rectangle


def _limit(ax: Axes, scheme: Scheme, home: np.ndarray, limit: DrawnLimit) -> Move:
    """Draw a wall on the floor, or the plate of a contact with its arm; with a double arrow below if it moves."""
    (line,) = ax.plot([], [], color=ink(), linewidth=1.8, zorder=2, gid=f"limit {limit.number}")
    wall = None
    if limit.support is None:
        wall = _hatch(ax, 0.0, _FLOOR, _HATCHED, _WALL - _FLOOR, gid=f"wall {limit.number}")
    arrow = _double_arrow(ax) if scheme.is_moving[limit.number] else []
    under = -0.06 - 0.07 * (limit.number % 2)

    is_cushion = wall is not None and bool(scheme.is_compliant[limit.number])
    symbols = [(spring, _CUSHION)] if is_cushion else []
    if is_cushion and scheme.is_damped[limit.number]:
        symbols = [(spring, _CUSHION + 0.12), (damper, _CUSHION - 0.12)]
    parts = [ax.plot([], [], color=ink(), linewidth=1.0, zorder=2)[0] for _ in symbols]

    def move(pose: Pose) -> None:
        x = place_of_limit(home, pose, limit)
        back = x + limit.side * _YIELDING if is_cushion else x
        if wall is not None:
            wall.set_x(back if limit.side > 0 else back - _HATCHED)
        if is_cushion:  # the face of a compliant stop goes with the mass that pushes it
            x = side_position(home, pose, limit.mass, limit.side) + limit.side * max(
                0.0, float(pose.gap[limit.number])
            )
        for (symbol, height), part in zip(symbols, parts, strict=True):
            part.set_data(*symbol((x, height), (back, height)))
        line.set_data(*_plate(home, pose, limit, x, under))
        for part in arrow:
            part.set_data([x - 0.25, x + 0.25], [_TRAVEL, _TRAVEL])

    return move


def _pad(ax: Axes, home: np.ndarray, mass: int, velocity: float) -> Move:
    """Draw the pad of friction between a box and the floor, with an arrow below it for a floor that moves."""
    width, height = _PAD
    pad = _rectangle(ax, 0.0, _FLOOR, width, height, facecolor=ink(), linewidth=0, gid=f"friction {mass}")
    marker, end = (">", 1) if velocity > 0 else ("<", 0)
    style = {"color": ink(), "linewidth": 1, "marker": marker, "markersize": 5, "markevery": [end]}
    belt = ax.plot([], [], gid=f"belt {mass}", **style)[0] if velocity else None

    def move(pose: Pose) -> None:
        x = side_position(home, pose, mass, 0)
        pad.set_x(x - width / 2)
        if belt is not None:
            belt.set_data([x - 0.25, x + 0.25], [_TRAVEL, _TRAVEL])

    return move


def _double_arrow(ax: Axes) -> list[Line2D]:
    common = {"color": ink(), "linewidth": 1, "markersize": 5}
    tips = (("<", 0), (">", 1))
    return [ax.plot([], [], marker=tip, markevery=[end], **common)[0] for tip, end in tips]


def _plate(
    home: np.ndarray, pose: Pose, limit: DrawnLimit, x: float, under: float
) -> tuple[list[float], list[float]]:
    """Face of a wall; or a plate on an arm, straight from the left neighbour, else bent below the boxes."""
    if limit.support is None:
        return [x, x], [_FLOOR, _WALL]
    if limit.mass == limit.support + 1 and limit.side < 0:
        root = side_position(home, pose, limit.support, 1)
        return [root, x, np.nan, x, x], [_PLATE, _PLATE, np.nan, _PLATE - 0.1, _PLATE + 0.1]
    root = side_position(home, pose, limit.support, 0) + 0.4
    return [root, root, x, x], [0.0, under, under, _PLATE + 0.1]


def _arrow(ax: Axes, home: np.ndarray, mass: int) -> Move:
    """Draw the load on a mass as an arrow above its box."""
    (line,) = ax.plot([], [], color=ink(), linewidth=1.6, zorder=4, gid=f"load {mass}")
    (tip,) = ax.plot([], [], color=ink(), linestyle="none", markersize=6, zorder=4)

    def move(pose: Pose) -> None:
        root, length = side_position(home, pose, mass, 0) + _ROOT, pose.load[mass]
        line.set_data([root, root + length], [_LOAD, _LOAD])
        tip.set_data([root + length], [_LOAD])
        tip.set_marker(">" if length >= 0 else "<")

    return move
