"""Friction: a pad under a mass, on the floor or in a container, or between the plates of a slider of two masses."""

from ...plot._colors import ink
from .arrangement import Arrangement, Move, Pose, are_neighbours, side_position
from .canvas import FLOOR, TRAVEL, Canvas
from .limits import CAVITY
from .scheme import DrawnFriction
from .symbols import slider

# Length of a pad on the floor, and its width beside wheels and without them; length and width of one in a container.
_ON_FLOOR, INSIDE = (0.5, 0.07, -FLOOR), (0.36, 0.07)
# Coordinate across of the slider of neighbours; ends of another, relative to the middles of its masses.
_LOW, _ENDS = 0.08, (0.35, -0.05)


def draw_pad(canvas: Canvas, arrangement: Arrangement, pad: DrawnFriction) -> Move:
    """Draw a friction element."""
    if pad.support is None:
        return _pad_on_floor(canvas, arrangement, pad)
    if arrangement.inside.get(pad.mass) == pad.support:
        return _pad_inside(canvas, arrangement, pad)
    return _slider(canvas, arrangement, pad, pad.support)


def rise_of_slider(pad: DrawnFriction) -> float:
    """Rise of the arc of a slider of two masses that are no neighbours, above those of springs and dampers."""
    return 0.6 * abs(pad.mass - (pad.support or 0)) ** 0.5 + 0.5


def _pad_on_floor(canvas: Canvas, arrangement: Arrangement, pad: DrawnFriction) -> Move:
    """Draw the pad between a box and the floor, with an arrow below it for a floor that moves."""
    width, height = _ON_FLOOR[0], _ON_FLOOR[canvas.is_vertical + 1]
    block = canvas.rectangle(0.0, FLOOR, width, height, facecolor=ink(), linewidth=0, gid=_gid(pad))
    is_forward = pad.velocity > 0
    tip = {"marker": canvas.tip(is_forward=is_forward), "markersize": 5, "markevery": [int(is_forward)]}
    style = {"color": ink(), "linewidth": 1, **tip}
    belt = canvas.line(gid=f"belt {pad.number}", **style) if pad.velocity else None

    def move(pose: Pose) -> None:
        x = side_position(arrangement, pose, pad.mass, 0)
        block.set_x(x - width / 2)
        if belt is not None:
            belt.set_data([x - 0.25, x + 0.25], [TRAVEL, TRAVEL])

    return move


def _pad_inside(canvas: Canvas, arrangement: Arrangement, pad: DrawnFriction) -> Move:
    """Draw the pad between a loose mass and its container."""
    width, height = INSIDE
    style = {"facecolor": ink(), "linewidth": 0, "zorder": 3.25, "gid": _gid(pad)}
    block = canvas.rectangle(0.0, CAVITY[0], width, height, **style)

    def move(pose: Pose) -> None:
        block.set_x(side_position(arrangement, pose, pad.mass, 0) - width / 2)

    return move


def _slider(canvas: Canvas, arrangement: Arrangement, pad: DrawnFriction, support: int) -> Move:
    """Draw two plates that overlap with a pad between them, in the row or as an arc above it."""
    left, right = sorted((pad.mass, support), key=lambda i: float(arrangement.home[i]))
    line = canvas.line(color=ink("0.25", "0.8"), linewidth=1.1, zorder=1, gid=f"slider {pad.number}")
    block = canvas.block(_gid(pad), zorder=1.1)

    def move(pose: Pose) -> None:
        if are_neighbours(arrangement, left, right):
            x = side_position(arrangement, pose, left, 1), side_position(arrangement, pose, right, -1)
            plates, corners = slider((x[0], _LOW), (x[1], _LOW))
        else:
            x = [
                side_position(arrangement, pose, i, 0) + end
                for i, end in zip((left, right), _ENDS, strict=True)
            ]
            plates, corners = slider((x[0], 1.0), (x[1], 1.0), rise_of_slider(pad))
        line.set_data(*plates)
        block.set_xy(corners.T)

    return move


def _gid(pad: DrawnFriction) -> str:
    return f"friction {pad.number}"
