"""Springs and dampers between masses and to the ground, and the ground of the masses."""

from ...plot._colors import ink
from .arrangement import Arrangement, Move, Pose, are_neighbours, side_position, wall_at, wall_beside
from .canvas import FLOOR, HATCHED, Canvas
from .scheme import Link
from .symbols import damper, spring

# Coordinates across of springs and dampers, and of the ground of masses within the row.
_SPRING, _DAMPER, CEILING = 0.82, 0.56, 1.55


def draw_link(canvas: Canvas, arrangement: Arrangement, link: Link, thin: float, *, is_spring: bool) -> Move:
    """Draw a spring or damper, dashed if its strength is negative."""
    symbol, height = (spring, _SPRING) if is_spring else (damper, _DAMPER)
    style = "-" if link.strength > 0 else (0, (2, 1))
    line = canvas.line(color=ink("0.25", "0.8"), linestyle=style, linewidth=1.1 * thin, zorder=1)
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
    if j is None and (side := wall_beside(arrangement, i)):
        wall = wall_at(arrangement, i)
        return (wall, height), (side_position(arrangement, pose, i, side), height), 0.0
    if j is None:
        top = float(arrangement.home[i]) + aside, CEILING
        return top, (side_position(arrangement, pose, i, 0) + aside, 1.0), 0.0
    if are_neighbours(arrangement, i, j):
        return (
            (side_position(arrangement, pose, i, 1), height),
            (side_position(arrangement, pose, j, -1), height),
            0.0,
        )
    start, end = side_position(arrangement, pose, i, 0) + 0.25, side_position(arrangement, pose, j, 0) + 0.05
    return (start, 1.0), (end, 1.0), rise_of(link, is_spring=height == _SPRING)


def draw_ground(canvas: Canvas, arrangement: Arrangement, mass: int) -> None:
    """Draw the ground of a mass: a wall at the end of the row, or a ceiling above its box."""
    side, x = wall_beside(arrangement, mass), float(arrangement.home[mass])
    if side:
        x = wall_at(arrangement, mass)
        canvas.hatch(x if side > 0 else x - HATCHED, FLOOR, HATCHED, 1.1 - FLOOR)
        canvas.line([x, x], [FLOOR, 1.1], color=ink(), linewidth=1.2)
    else:
        canvas.hatch(x - 0.52, CEILING, 0.46, HATCHED)
        canvas.line([x - 0.52, x - 0.06], [CEILING, CEILING], color=ink(), linewidth=1.2)


def rise_of(link: Link, *, is_spring: bool) -> float:
    """Rise of an arc above the boxes."""
    span = 1 if link.other is None else link.other - link.mass
    return 0.6 * span**0.5 + (0.0 if is_spring else 0.25)
