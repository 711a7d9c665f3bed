"""Stops and contacts: walls on the ground, plates on arms, ends of containers; springs and dampers of compliant ones."""

from collections.abc import Callable

import numpy as np

from ...plot._colors import ink
from .arrangement import YIELDING, Arrangement, Move, Pose, place_of_limit, side_position
from .canvas import HATCHED, TRAVEL, Canvas
from .scheme import DrawnLimit, Scheme
from .symbols import damper, spring

# Coordinate across of the plates of contacts, and both ends of a cavity.
_PLATE, CAVITY = 0.32, (0.1, 0.7)
# Lower, with its spring and damper, below the dampers of the row.
_LOWER = 0.27
# Half the width of a plate, and of one with a damper beside its spring; distance of these two from their middle.
_THIN, _WIDE, _BESIDE = 0.1, 0.16, 0.09
# Overlap of a latch with the face that it holds.
_LATCH = 0.04

Path = tuple[list[float], list[float]]


def draw_limit(canvas: Canvas, scheme: Scheme, arrangement: Arrangement, limit: DrawnLimit) -> Move:
    """Draw a wall on the floor, or the plate of a contact with its arm; with a double arrow below if it moves."""
    is_inside, is_cushion = limit.mass in arrangement.inside, bool(scheme.is_compliant[limit.number])
    zorder = 3.3 if is_inside else 2.0
    line = canvas.line(color=ink(), linewidth=1.8, zorder=zorder, gid=f"limit {limit.number}")
    ends, middle = _face(canvas, scheme, arrangement, limit)
    wall = None
    if limit.support is None:
        wall = canvas.hatch(0.0, ends[0], HATCHED, ends[1] - ends[0], gid=f"wall {limit.number}")
    arrow = canvas.double_arrow() if scheme.is_moving[limit.number] else []
    under = -0.06 - 0.07 * (limit.number % 2)
    show_cushion = _cushion(canvas, scheme, limit, ends, middle, zorder) if is_cushion else None

    def move(pose: Pose) -> None:
        face = place_of_limit(arrangement, pose, limit)
        back = back_of_limit(scheme, arrangement, pose, limit)
        if wall is not None:
            wall.set_x(back if limit.side > 0 else back - HATCHED)
        if show_cushion is not None:
            at_rest = face  # the face of a compliant stop goes with the mass that pushes it
            face = side_position(arrangement, pose, limit.mass, limit.side) + limit.side * max(
                0.0, float(pose.gap[limit.number])
            )
            show_cushion(at_rest, face, back)
        x, y = _arm(arrangement, pose, limit, back, under, ends)
        line.set_data([*x, np.nan, face, face], [*y, np.nan, *ends])
        for part in arrow:
            part.set_data([face - 0.25, face + 0.25], [TRAVEL, TRAVEL])

    return move


def back_of_limit(scheme: Scheme, arrangement: Arrangement, pose: Pose, limit: DrawnLimit) -> float:
    """Position of the wall behind the spring of a compliant stop, or of a rigid one itself."""
    yielding = YIELDING if scheme.is_compliant[limit.number] else 0.0
    return place_of_limit(arrangement, pose, limit) + limit.side * yielding


def _face(
    canvas: Canvas, scheme: Scheme, arrangement: Arrangement, limit: DrawnLimit
) -> tuple[tuple[float, float], float]:
    """Both ends of the face of a stop, and the middle of its spring, across."""
    if limit.support is None:
        is_outermost = limit.mass == arrangement.row[-1 if limit.side > 0 else 0]
        return canvas.wall(is_outermost=is_outermost), canvas.cushion(is_outermost=is_outermost)
    if limit.mass in arrangement.inside:
        return CAVITY, sum(CAVITY) / 2
    middle, half = (_LOWER, _WIDE) if scheme.is_damped[limit.number] else (_PLATE, _THIN)
    return (middle - half, middle + half), middle


def _cushion(
    canvas: Canvas,
    scheme: Scheme,
    limit: DrawnLimit,
    ends: tuple[float, float],
    middle: float,
    zorder: float,
) -> Callable[[float, float, float], None]:
    """Draw the spring of a compliant stop, its damper, and a latch at its face if the spring has a preload."""
    is_damped, side = bool(scheme.is_damped[limit.number]), limit.side
    symbols = [(spring, middle + _BESIDE * is_damped)] + [(damper, middle - _BESIDE)] * is_damped
    look = {"color": ink(), "linewidth": 1.0, "zorder": zorder}
    parts = [canvas.line(gid=f"{symbol.__name__} of limit {limit.number}", **look) for symbol, _ in symbols]
    is_preloaded = bool(scheme.is_preloaded[limit.number])
    latch = canvas.line(gid=f"preload {limit.number}", **look) if is_preloaded else None

    def show(at_rest: float, face: float, back: float) -> None:
        for (symbol, height), part in zip(symbols, parts, strict=True):
            part.set_data(*symbol((face, height), (back, height)))
        if latch is not None:
            hook, top = at_rest - side * _LATCH, ends[1] + _LATCH
            latch.set_data([back, back, hook, hook], [ends[1], top, top, ends[1] - _LATCH])

    return show


def _arm(
    arrangement: Arrangement,
    pose: Pose,
    limit: DrawnLimit,
    back: float,
    under: float,
    ends: tuple[float, float],
) -> Path:
    """Arm of a plate with its end, straight from the left neighbour, else bent below; nothing for walls and containers."""
    if limit.support is None or limit.mass in arrangement.inside:
        return [], []
    if limit.mass == limit.support + 1 and limit.side < 0:
        root = side_position(arrangement, pose, limit.support, 1)
        middle = sum(ends) / 2
        return [root, back, np.nan, back, back], [middle, middle, np.nan, *ends]
    root = side_position(arrangement, pose, limit.support, 0) + 0.4
    return [root, root, back, back], [0.0, under, under, ends[1]]
