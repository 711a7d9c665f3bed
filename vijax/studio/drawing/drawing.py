"""Movable drawing of a machine: all its parts except the words follow one pose.

A box is 1 wide and high; boxes at rest are `PITCH` apart. A container is wider, with its loose mass in it. Displacements are scaled to at most `ROOM`, so that boxes and
walls touch only where a gap of the machine is closed.
"""

import itertools
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
# Ground ends of springs: height above boxes, distance of walls from the outermost boxes; thickness of a hatch.
_CEILING, _END, _HATCHED = 1.55, 1.25, 0.14
# Length of the spring of a compliant stop at rest, and height of the spring; width and height of a friction pad.
_YIELDING, _CUSHION, _PAD = 0.35, 0.0, (0.5, 0.07)
# Visible floor beside the outermost boxes without a wall.
_BESIDE = 0.75
# Half of the width of a box, of a container and of a loose mass in it; floor and ceiling of a cavity; height of the loose
# mass; height of the name of a container.
_HALF, _OUTSIDE, _LOOSE = 0.5, 1.0, 0.3
_CAVITY, _INSIDE, _NAME = (0.1, 0.7), 0.5, 0.85
# Load arrows: height, and start relative to the middle of the box. Height of the double arrows of moving stops.
_LOAD, _ROOT, _TRAVEL = 1.15, 0.15, _FLOOR - 0.14
# Inches per length of 1, and largest width of the drawing in inches, in a new figure.
_INCHES, _WIDEST = 1.1, 10.0


class Arrangement(NamedTuple):
    """Places of the masses at rest.

    Attributes:
        home: middles of the boxes, (n,).
        half: halves of their widths, (n,).
        row: the masses from left to right, without those in containers.
        inside: the masses in containers, each with its container.
    """

    home: np.ndarray
    half: np.ndarray
    row: list[int]
    inside: dict[int, int]


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


def arrangement_of(scheme: Scheme) -> Arrangement:
    """Place the masses in a row, each container with its loose mass in it."""
    inside, every = scheme.containers, range(scheme.num_masses)
    half = np.array([_LOOSE if i in inside else _OUTSIDE if i in inside.values() else _HALF for i in every])
    row = [i for i in every if i not in inside]
    home, space = np.zeros(scheme.num_masses), PITCH - 2 * _HALF
    for before, i in itertools.pairwise(row):
        home[i] = home[before] + half[before] + space + half[i]
    for loose, container in inside.items():
        home[loose] = home[container]
    return Arrangement(home, half, row, inside)


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
    arrangement = arrangement_of(scheme)
    ends = _ends(scheme, arrangement)
    given = ax.get_window_extent().width / figure_of(ax).dpi if fits_axes else _WIDEST
    scale = min(_INCHES, given / float(np.ptp(ends)))
    thin = min(1.0, 2 * scale)  # thinner lines in a small drawing
    boxes, moves = _boxes(ax, scheme, arrangement, thin, style)
    moves += [_link(ax, arrangement, link, thin, is_spring=is_spring) for link, is_spring in scheme.links]
    moves += [_limit(ax, scheme, arrangement, limit) for limit in scheme.limits]
    moves += [_pad(ax, arrangement, mass, velocity) for mass, velocity in scheme.pads]
    for mass in scheme.grounded:
        _ground(ax, arrangement, mass)
    loads = {i: text for i in range(scheme.num_masses) if (text := scheme.load_in_words(i))}
    moves += [_arrow(ax, arrangement, i) for i in loads]

    def move(pose: Pose) -> None:
        for one in moves:
            one(pose)

    move(pose)
    ax.plot(ends, [_FLOOR, _FLOOR], color=ink("0.6", "0.5"), linewidth=1, zorder=0)
    words = Words(
        above=[(float(arrangement.home[i]) + _ROOT, text) for i, text in loads.items()],
        below=[_name_of_limit(scheme, arrangement, pose, limit, gaps) for limit in scheme.limits],
        notes=scheme.notes,
    )
    has_arrows = scheme.is_moving.any() or any(velocity for _, velocity in scheme.pads)
    below = _TRAVEL - 0.12 if has_arrows else _FLOOR - 0.08
    size = write_words(
        ax, words, ends, (below, _LOAD + 0.15, _top(scheme, arrangement)), scale, fits_axes=fits_axes
    )
    return Drawing(move, size, boxes)


def side_position(arrangement: Arrangement, pose: Pose, mass: int, side: int) -> float:
    """Position of a side of a box: -1 left, 0 middle, 1 right."""
    return float(arrangement.home[mass] + pose.x[mass] + arrangement.half[mass] * side)


def place_of_limit(arrangement: Arrangement, pose: Pose, limit: DrawnLimit) -> float:
    """Position of a wall or plate."""
    return side_position(arrangement, pose, limit.mass, limit.side) + limit.side * float(
        pose.gap[limit.number]
    )


def _ends(scheme: Scheme, arrangement: Arrangement) -> np.ndarray:
    """Left and right end of the visible floor, (2,)."""
    at_walls = {_wall_beside(arrangement, mass) for mass in scheme.grounded}
    left, right = (0.2 + (_END if side in at_walls else _BESIDE) for side in (-1, 1))
    (first, *_), (*_, last) = arrangement.row, arrangement.row
    home, half = arrangement.home, arrangement.half
    return np.array([home[first] - half[first] - left, home[last] + half[last] + right])


def _top(scheme: Scheme, arrangement: Arrangement) -> float:
    """Height of the drawing without words."""
    ceilings = [_CEILING + _HATCHED for mass in scheme.grounded if not _wall_beside(arrangement, mass)]
    arcs = [
        1.1 + _rise(link, is_spring=is_spring)
        for link, is_spring in scheme.links
        if link.other is not None and not _are_neighbours(arrangement, link.mass, link.other)
    ]
    return max([_LOAD + 0.1, *ceilings, *arcs])


def _name_of_limit(
    scheme: Scheme, arrangement: Arrangement, pose: Pose, limit: DrawnLimit, gaps: np.ndarray | None
) -> tuple[float, str]:
    """Position and text of the label below a stop or contact."""
    j = limit.number
    gap = [] if gaps is None else [f"gap {gaps[j]:.3g}"]
    words = [name_of(j, scheme.masses), *gap, scheme.restitution[j]]
    return place_of_limit(arrangement, pose, limit), "\n".join(words)


def _boxes(
    ax: Axes, scheme: Scheme, arrangement: Arrangement, thin: float, style: dict[str, Any]
) -> tuple[list[Rectangle], list[Move]]:
    """Draw the masses with their numbers, on wheels, in the colours of their curves in other pictures."""
    colors, inside = curve_colors(scheme.num_masses), arrangement.inside
    edge = {"facecolor": ax.get_facecolor(), "linewidth": 2.2 * thin}
    (floor, _), widths = _CAVITY, 2 * arrangement.half
    boxes = []
    for i, color in enumerate(colors):
        bottom, height, order = (floor, _INSIDE, 3.2) if i in inside else (0.0, 1.0, 3)
        own = merge_style(style, Rectangle, edgecolor=color, zorder=order, gid=f"mass {i}", **edge)
        boxes.append(_rectangle(ax, 0.0, bottom, widths[i], height, **own))
    heights = [
        floor + _INSIDE / 2 if i in inside else _NAME if i in inside.values() else 0.5
        for i in range(len(boxes))
    ]
    font = {"fontsize": 12 * thin, "color": ink(), "clip_on": True}
    names = [ax.text(0, y, str(i), ha="center", va="center", zorder=4, **font) for i, y in enumerate(heights)]
    (wheels,) = ax.plot([], [], color=ink("0.4", "0.6"), linewidth=thin, zorder=2)

    def move(pose: Pose) -> None:
        middle = arrangement.home + pose.x
        for box, name, x, half in zip(boxes, names, middle, arrangement.half, strict=True):
            box.set_x(x - half)
            name.set_x(x)
        axles = middle[arrangement.row], 0.6 * arrangement.half[arrangement.row]
        wheels.set_data(*circles(np.concatenate([axles[0] - axles[1], axles[0] + axles[1]]), -_WHEEL, _WHEEL))

    cavities = [_cavity(ax, scheme, arrangement, loose, colors[own], thin) for loose, own in inside.items()]
    return boxes, [move, *cavities]


def _cavity(ax: Axes, scheme: Scheme, arrangement: Arrangement, loose: int, color: Any, thin: float) -> Move:
    """Draw the cavity in which a loose mass bounces, between the ends of its container."""
    ends = sorted((limit for limit in scheme.limits if limit.mass == loose), key=lambda limit: limit.side)
    (bottom, top), style = _CAVITY, {"facecolor": ax.get_facecolor(), "edgecolor": color, "zorder": 3.1}
    cavity = _rectangle(
        ax, 0.0, bottom, 0.0, top - bottom, linewidth=1.1 * thin, gid=f"cavity {loose}", **style
    )

    def move(pose: Pose) -> None:
        left, right = (place_of_limit(arrangement, pose, limit) for limit in ends)
        cavity.set_x(left)
        cavity.set_width(right - left)

    return move


def _link(ax: Axes, arrangement: Arrangement, link: Link, thin: float, *, is_spring: bool) -> Move:
    """Draw a spring or damper, dashed if its strength is negative."""
    symbol, height = (spring, _SPRING) if is_spring else (damper, _DAMPER)
    style = "-" if link.strength > 0 else (0, (2, 1))
    (line,) = ax.plot([], [], color=ink("0.25", "0.8"), linestyle=style, linewidth=1.1 * thin, zorder=1)
    line.set_gid("spring" if is_spring else "damper")
    aside = -0.4 if is_spring else -0.18

    def move(pose: Pose) -> None:
        line.set_data(*symbol(*_link_path(arrangement, pose, link, height, aside)))

    return move


def _link_path(
    arrangement: Arrangement, pose: Pose, link: Link, height: float, aside: float
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Start, end and rise of the arc of a spring or damper."""
    i, j = link.mass, link.other
    if j is None and (side := _wall_beside(arrangement, i)):
        wall = _wall_at(arrangement, i)
        return (wall, height), (side_position(arrangement, pose, i, side), height), 0.0
    if j is None:
        top = float(arrangement.home[i]) + aside, _CEILING
        return top, (side_position(arrangement, pose, i, 0) + aside, 1.0), 0.0
    if _are_neighbours(arrangement, i, j):
        return (
            (side_position(arrangement, pose, i, 1), height),
            (side_position(arrangement, pose, j, -1), height),
            0.0,
        )
    start, end = side_position(arrangement, pose, i, 0) + 0.25, side_position(arrangement, pose, j, 0) + 0.05
    return (start, 1.0), (end, 1.0), _rise(link, is_spring=height == _SPRING)


def _ground(ax: Axes, arrangement: Arrangement, mass: int) -> None:
    """Draw the ground of a mass: a wall at the end of the row, or a ceiling above its box."""
    side, x = _wall_beside(arrangement, mass), float(arrangement.home[mass])
    if side:
        x = _wall_at(arrangement, mass)
        _hatch(ax, x if side > 0 else x - _HATCHED, _FLOOR, _HATCHED, 1.1 - _FLOOR)
        ax.plot([x, x], [_FLOOR, 1.1], color=ink(), linewidth=1.2)
    else:
        _hatch(ax, x - 0.52, _CEILING, 0.46, _HATCHED)
        ax.plot([x - 0.52, x - 0.06], [_CEILING, _CEILING], color=ink(), linewidth=1.2)


def _are_neighbours(arrangement: Arrangement, mass: int, other: int) -> bool:
    """True where two masses stand side by side, so that a link of them lies in the row."""
    return (mass, other) in itertools.pairwise(arrangement.row)


def _wall_beside(arrangement: Arrangement, mass: int) -> int:
    """Side of a mass with room for a wall: -1 for the first, 1 for the last, 0 for others."""
    return -1 if mass == arrangement.row[0] else int(mass == arrangement.row[-1])


def _wall_at(arrangement: Arrangement, mass: int) -> float:
    """Position of the wall beside the first or last mass of the row."""
    side = _wall_beside(arrangement, mass)
    return float(arrangement.home[mass] + side * (arrangement.half[mass] + _END))


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


def _limit(ax: Axes, scheme: Scheme, arrangement: Arrangement, limit: DrawnLimit) -> Move:
    """Draw a wall on the floor, or the plate of a contact with its arm; with a double arrow below if it moves."""
    (line,) = ax.plot(
        [],
        [],
        color=ink(),
        linewidth=1.8,
        zorder=3.3 if limit.mass in arrangement.inside else 2,
        gid=f"limit {limit.number}",
    )
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
        x = place_of_limit(arrangement, pose, limit)
        back = x + limit.side * _YIELDING if is_cushion else x
        if wall is not None:
            wall.set_x(back if limit.side > 0 else back - _HATCHED)
        if is_cushion:  # the face of a compliant stop goes with the mass that pushes it
            x = side_position(arrangement, pose, limit.mass, limit.side) + limit.side * max(
                0.0, float(pose.gap[limit.number])
            )
        for (symbol, height), part in zip(symbols, parts, strict=True):
            part.set_data(*symbol((x, height), (back, height)))
        line.set_data(*_plate(arrangement, pose, limit, x, under))
        for part in arrow:
            part.set_data([x - 0.25, x + 0.25], [_TRAVEL, _TRAVEL])

    return move


def _pad(ax: Axes, arrangement: Arrangement, mass: int, velocity: float) -> Move:
    """Draw the pad of friction between a box and the floor, with an arrow below it for a floor that moves."""
    width, height = _PAD
    pad = _rectangle(ax, 0.0, _FLOOR, width, height, facecolor=ink(), linewidth=0, gid=f"friction {mass}")
    marker, end = (">", 1) if velocity > 0 else ("<", 0)
    style = {"color": ink(), "linewidth": 1, "marker": marker, "markersize": 5, "markevery": [end]}
    belt = ax.plot([], [], gid=f"belt {mass}", **style)[0] if velocity else None

    def move(pose: Pose) -> None:
        x = side_position(arrangement, pose, mass, 0)
        pad.set_x(x - width / 2)
        if belt is not None:
            belt.set_data([x - 0.25, x + 0.25], [_TRAVEL, _TRAVEL])

    return move


def _double_arrow(ax: Axes) -> list[Line2D]:
    common = {"color": ink(), "linewidth": 1, "markersize": 5}
    tips = (("<", 0), (">", 1))
    return [ax.plot([], [], marker=tip, markevery=[end], **common)[0] for tip, end in tips]


def _plate(
    arrangement: Arrangement, pose: Pose, limit: DrawnLimit, x: float, under: float
) -> tuple[list[float], list[float]]:
    """Face of a wall or of an end of a container; or a plate on an arm, straight from the left neighbour, else bent below."""
    if limit.support is None:
        return [x, x], [_FLOOR, _WALL]
    if limit.mass in arrangement.inside:
        return [x, x], [*_CAVITY]
    if limit.mass == limit.support + 1 and limit.side < 0:
        root = side_position(arrangement, pose, limit.support, 1)
        return [root, x, np.nan, x, x], [_PLATE, _PLATE, np.nan, _PLATE - 0.1, _PLATE + 0.1]
    root = side_position(arrangement, pose, limit.support, 0) + 0.4
    return [root, root, x, x], [0.0, under, under, _PLATE + 0.1]


def _arrow(ax: Axes, arrangement: Arrangement, mass: int) -> Move:
    """Draw the load on a mass as an arrow above its box."""
    (line,) = ax.plot([], [], color=ink(), linewidth=1.6, zorder=4, gid=f"load {mass}")
    (tip,) = ax.plot([], [], color=ink(), linestyle="none", markersize=6, zorder=4)

    def move(pose: Pose) -> None:
        root, length = side_position(arrangement, pose, mass, 0) + _ROOT, pose.load[mass]
        line.set_data([root, root + length], [_LOAD, _LOAD])
        tip.set_data([root + length], [_LOAD])
        tip.set_marker(">" if length >= 0 else "<")

    return move
