"""Stops, contacts and friction: walls on the ground, plates on arms, pads."""

import numpy as np

from ...plot._colors import ink
from .arrangement import Arrangement, Move, Pose, place_of_limit, side_position
from .canvas import FLOOR, HATCHED, TRAVEL, Canvas
from .scheme import DrawnLimit, Scheme
from .symbols import damper, spring

# Coordinate across of the plates of contacts, and both ends of a cavity.
_PLATE, CAVITY = 0.32, (0.1, 0.7)
# Length of the spring of a compliant stop at rest; length of a friction pad, and its width beside wheels and without them.
_YIELDING, _PAD = 0.35, (0.5, 0.07, -FLOOR)


def draw_limit(canvas: Canvas, scheme: Scheme, arrangement: Arrangement, limit: DrawnLimit) -> Move:
    """Draw a wall on the floor, or the plate of a contact with its arm; with a double arrow below if it moves."""
    line = canvas.line(
        color=ink(),
        linewidth=1.8,
        zorder=3.3 if limit.mass in arrangement.inside else 2,
        gid=f"limit {limit.number}",
    )
    is_outermost = limit.mass == arrangement.row[-1 if limit.side > 0 else 0]
    ends, cushion = canvas.wall(is_outermost=is_outermost), canvas.cushion(is_outermost=is_outermost)
    wall = None
    if limit.support is None:
        wall = canvas.hatch(0.0, ends[0], HATCHED, ends[1] - ends[0], gid=f"wall {limit.number}")
    arrow = canvas.double_arrow() if scheme.is_moving[limit.number] else []
    under = -0.06 - 0.07 * (limit.number % 2)

    is_cushion = wall is not None and bool(scheme.is_compliant[limit.number])
    symbols = [(spring, cushion)] if is_cushion else []
    if is_cushion and scheme.is_damped[limit.number]:
        symbols = [(spring, cushion + 0.12), (damper, cushion - 0.12)]
    parts = [canvas.line(color=ink(), linewidth=1.0, zorder=2) for _ in symbols]

    def move(pose: Pose) -> None:
        x = place_of_limit(arrangement, pose, limit)
        back = x + limit.side * _YIELDING if is_cushion else x
        if wall is not None:
            wall.set_x(back if limit.side > 0 else back - HATCHED)
        if is_cushion:  # the face of a compliant stop goes with the mass that pushes it
            x = side_position(arrangement, pose, limit.mass, limit.side) + limit.side * max(
                0.0, float(pose.gap[limit.number])
            )
        for (symbol, height), part in zip(symbols, parts, strict=True):
            part.set_data(*symbol((x, height), (back, height)))
        line.set_data(*_plate(arrangement, pose, limit, x, under, ends))
        for part in arrow:
            part.set_data([x - 0.25, x + 0.25], [TRAVEL, TRAVEL])

    return move


def draw_pad(canvas: Canvas, arrangement: Arrangement, mass: int, velocity: float) -> Move:
    """Draw the pad of friction between a box and the floor, with an arrow below it for a floor that moves."""
    width, height = _PAD[0], _PAD[canvas.is_vertical + 1]
    pad = canvas.rectangle(0.0, FLOOR, width, height, facecolor=ink(), linewidth=0, gid=f"friction {mass}")
    tip = {"marker": canvas.tip(is_forward=velocity > 0), "markersize": 5, "markevery": [int(velocity > 0)]}
    style = {"color": ink(), "linewidth": 1, **tip}
    belt = canvas.line(gid=f"belt {mass}", **style) if velocity else None

    def move(pose: Pose) -> None:
        x = side_position(arrangement, pose, mass, 0)
        pad.set_x(x - width / 2)
        if belt is not None:
            belt.set_data([x - 0.25, x + 0.25], [TRAVEL, TRAVEL])

    return move


def _plate(
    arrangement: Arrangement, pose: Pose, limit: DrawnLimit, x: float, under: float, wall: tuple[float, float]
) -> tuple[list[float], list[float]]:
    """Face of a wall or of an end of a container; or a plate on an arm, straight from the left neighbour, else bent below."""
    if limit.support is None:
        return [x, x], [*wall]
    if limit.mass in arrangement.inside:
        return [x, x], [*CAVITY]
    if limit.mass == limit.support + 1 and limit.side < 0:
        root = side_position(arrangement, pose, limit.support, 1)
        return [root, x, np.nan, x, x], [_PLATE, _PLATE, np.nan, _PLATE - 0.1, _PLATE + 0.1]
    root = side_position(arrangement, pose, limit.support, 0) + 0.4
    return [root, root, x, x], [0.0, under, under, _PLATE + 0.1]
