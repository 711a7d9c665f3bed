"""The drawing of a machine, which can be moved: all of it but the words follows one pose.

A box is 1 wide and high, boxes at rest are `PITCH` apart. Displacements are scaled to at most `ROOM`, so that
neither boxes nor walls ever meet but where the machine says so.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from ._axes import ink, of_curves
from ._contacts import name_of
from ._scheme import Limit, Link, Scheme
from ._symbols import circles, damper, spring

PITCH, ROOM = 2.3, 0.5
# Heights: of springs and dampers in a row, of walls and the plates of contacts, of the floor.
_SPRING, _DAMPER, _WALL, _PLATE, _WHEEL = 0.82, 0.56, 0.2, 0.32, 0.1
_FLOOR = -2 * _WHEEL
# Where springs to the ground end: above boxes, or at the walls at both ends of the row.
_CEILING, _END, _HATCHED = 1.55, 1.75, 0.14
# What is seen beside the outermost boxes where there is no wall.
_BESIDE = 1.25
_FONT = 9
# Inches that 1 takes in a figure of its own, and of the whole figure.
_INCHES, _WIDEST = 1.1, 10.0


class Pose(NamedTuple):
    """Where everything is, in lengths of the drawing.

    Attributes:
        x: displacements of the masses, (n,).
        gap: of all stops and contacts, (stops,).
        load: the length of the arrows, (n,).
    """

    x: np.ndarray
    gap: np.ndarray
    load: np.ndarray


Move = Callable[[Pose], None]


class Drawing(NamedTuple):
    """What was drawn.

    Attributes:
        move: puts it into a pose.
        size: width and height in inches at which it is drawn well.
        boxes: of the masses.
    """

    move: Move
    size: tuple[float, float]
    boxes: list[Rectangle]


def draw(ax: Axes, scheme: Scheme, pose: Pose, gaps: np.ndarray | None, *, fits_axes: bool) -> Drawing:
    """Draw a machine.

    Args:
        ax: where.
        scheme: the machine.
        pose: its first one.
        gaps: of the stops and contacts, to be named; None to leave them out.
        fits_axes: whether the axes keep their size, so that words must be fitted into it.
    """
    ax.set_axis_off()
    ax.set_aspect("equal")
    home = PITCH * np.arange(scheme.num_masses)
    ends = _ends(scheme, home)
    given = ax.get_window_extent().width / ax.get_figure().dpi if fits_axes else _WIDEST
    scale = min(_INCHES, given / float(np.ptp(ends)))
    thin = min(1.0, 2 * scale)  # lines of a small drawing
    boxes, moves = _boxes(ax, scheme, home, thin)
    moves += [_link(ax, home, link, thin, is_spring=is_spring) for link, is_spring in scheme.links]
    moves += [_limit(ax, scheme, home, limit) for limit in scheme.limits]
    loaded = [i for i in range(scheme.num_masses) if scheme.load_in_words(i)]
    moves += [_arrow(ax, home, i) for i in loaded]

    def move(pose: Pose) -> None:
        for one in moves:
            one(pose)

    move(pose)
    ax.plot(ends, [_FLOOR, _FLOOR], color=ink("0.6", "0.5"), linewidth=1, zorder=0)
    size = _write(ax, scheme, home, pose, loaded, gaps, ends, scale, fits_axes)
    return Drawing(move, size, boxes)


def face_of(home: np.ndarray, pose: Pose, mass: int, side: int) -> float:
    """Where a side of a box is, 0 for its middle."""
    return home[mass] + pose.x[mass] + 0.5 * side


def _ends(scheme: Scheme, home: np.ndarray) -> np.ndarray:
    """What is seen of the floor."""
    at_walls = {link.mass for link, _ in scheme.links if link.other is None}
    left = _END if 0 in at_walls else _BESIDE
    right = _END if len(home) > 1 and len(home) - 1 in at_walls else _BESIDE
    return np.array([home[0] - left - 0.2, home[-1] + right + 0.2])


def _boxes(ax: Axes, scheme: Scheme, home: np.ndarray, thin: float) -> tuple[list[Rectangle], list[Move]]:
    """The masses with their numbers, on wheels, in the colours of their curves in other pictures."""
    colors = of_curves(scheme.num_masses)
    boxes = [
        ax.add_patch(
            Rectangle(
                (0, 0), 1, 1, facecolor=ax.get_facecolor(), edgecolor=color, linewidth=2.2 * thin, zorder=3
            )
        )
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
    """A spring or damper, dashed where its force has the wrong sign."""
    symbol, height = (spring, _SPRING) if is_spring else (damper, _DAMPER)
    style = "-" if link.strength > 0 else (0, (2, 1))
    (line,) = ax.plot([], [], color=ink("0.25", "0.8"), linestyle=style, linewidth=1.1 * thin, zorder=1)
    line.set_gid("spring" if is_spring else "damper")
    place = _way_of(ax, home, link, height, -0.4 if is_spring else -0.18)

    def move(pose: Pose) -> None:
        line.set_data(*symbol(*place(pose)))

    return move


def _way_of(
    ax: Axes, home: np.ndarray, link: Link, height: float, aside: float
) -> Callable[[Pose], tuple[tuple[float, float], tuple[float, float], float]]:
    """From where to where a spring or damper goes, and how far it rises between."""
    i, j, last = link.mass, link.other, len(home) - 1
    at = lambda pose, mass, side: face_of(home, pose, mass, side)  # noqa: E731
    if j is None and i in (0, last):
        side = 1 if i == last and last else -1
        wall = float(home[i] + side * _END)
        _hatch(ax, wall if side > 0 else wall - _HATCHED, _FLOOR, _HATCHED, 1.1 - _FLOOR)
        ax.plot([wall, wall], [_FLOOR, 1.1], color=ink(), linewidth=1.2)
        return lambda pose: ((wall, height), (at(pose, i, side), height), 0.0)
    if j is None:
        x = float(home[i] + aside)
        _hatch(ax, home[i] - 0.52, _CEILING, 0.46, _HATCHED)
        ax.plot([home[i] - 0.52, home[i] - 0.06], [_CEILING, _CEILING], color=ink(), linewidth=1.2)
        return lambda pose: ((x, _CEILING), (at(pose, i, 0) + aside, 1.0), 0.0)
    if j == i + 1:
        return lambda pose: ((at(pose, i, 1), height), (at(pose, j, -1), height), 0.0)
    rise = _rise(link) + (0.0 if height == _SPRING else 0.25)
    return lambda pose: ((at(pose, i, 0) + 0.25, 1.0), (at(pose, j, 0) + 0.05, 1.0), rise)


def _rise(link: Link) -> float:
    """How far an arc rises above the boxes."""
    return 0.0 if link.other is None else 0.6 * (link.other - link.mass) ** 0.5


def _hatch(ax: Axes, x: float, y: float, width: float, height: float) -> Rectangle:
    """A piece of the ground."""
    return ax.add_patch(
        Rectangle(
            (x, y), width, height, facecolor="none", edgecolor=ink("0.35", "0.7"), hatch="/////", linewidth=0
        )
    )


def _limit(ax: Axes, scheme: Scheme, home: np.ndarray, limit: Limit) -> Move:
    """A wall on the floor, or the plate of a contact with the arm that bears it."""
    (line,) = ax.plot([], [], color=ink(), linewidth=1.8, zorder=2)
    line.set_gid(f"limit {limit.number}")
    wall = _hatch(ax, 0, _FLOOR, _HATCHED, _WALL - _FLOOR) if limit.support is None else None
    arrow = None
    if scheme.is_moving[limit.number]:
        arrow = ax.plot([], [], color=ink(), linewidth=1, marker="$<$", markersize=5, markevery=[0])[0]
        other = ax.plot([], [], color=ink(), linewidth=0, marker="$>$", markersize=5)[0]
    under = -0.06 - 0.07 * (limit.number % 2)

    def move(pose: Pose) -> None:
        x = face_of(home, pose, limit.mass, limit.side) + limit.side * pose.gap[limit.number]
        if wall is not None:
            wall.set_x(x if limit.side > 0 else x - _HATCHED)
            line.set_data([x, x], [_FLOOR, _WALL])
        elif limit.mass == limit.support + 1 and limit.side < 0:
            root = face_of(home, pose, limit.support, 1)
            line.set_data([root, x, np.nan, x, x], [_PLATE, _PLATE, np.nan, _PLATE - 0.1, _PLATE + 0.1])
        else:
            root = face_of(home, pose, limit.support, 0) + 0.4
            line.set_data([root, root, x, x], [0.0, under, under, _PLATE + 0.1])
        if arrow is not None:
            y = _FLOOR - 0.14
            arrow.set_data([x - 0.25, x + 0.25], [y, y])
            other.set_data([x + 0.25], [y])

    return move


def _arrow(ax: Axes, home: np.ndarray, mass: int) -> Move:
    """The load on a mass, along the top of its box."""
    (line,) = ax.plot([], [], color=ink(), linewidth=1.6, zorder=4)
    (tip,) = ax.plot([], [], color=ink(), linestyle="none", markersize=6, zorder=4)
    line.set_gid(f"load {mass}")

    def move(pose: Pose) -> None:
        root, length = face_of(home, pose, mass, 0) + 0.15, pose.load[mass]
        line.set_data([root, root + length], [1.15, 1.15])
        tip.set_data([root + length], [1.15])
        tip.set_marker(">" if length >= 0 else "<")

    return move


def _write(
    ax: Axes,
    scheme: Scheme,
    home: np.ndarray,
    pose: Pose,
    loaded: Sequence[int],
    gaps: np.ndarray | None,
    ends: np.ndarray,
    scale: float,
    fits_axes: bool,
) -> tuple[float, float]:
    """All words, where they do not overlap; the size in inches that the drawing then takes."""
    style = {"fontsize": _FONT, "color": ink(), "zorder": 5}
    ground = {"facecolor": ax.get_facecolor(), "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
    loads = [
        ax.text(home[i] + 0.15, 0, scheme.load_in_words(i), va="bottom", bbox=ground, **style) for i in loaded
    ]
    below = [_name_limit(ax, scheme, home, pose, limit, gaps, style) for limit in scheme.limits]
    note = ax.text(float(ends[0]), 0, "\n".join(scheme.notes), va="top", **style)
    found = [link for link, _ in scheme.links]
    inner = [k for k in found if k.other is None and 0 < k.mass < scheme.num_masses - 1]
    arcs = [1.3 + _rise(k) for k in found if k.other is not None and k.other > k.mass + 1]
    top = max([1.35, *arcs, *([_CEILING + _HATCHED] if inner else [])])
    width, box, dpi = float(np.ptp(ends)), ax.get_window_extent(), ax.get_figure().dpi
    # Words keep their size, so the smaller the drawing, the more lines they take, and so on.
    for _ in range(6):
        high = _stack(loads, scale, 1.3, up=True)
        low = _stack(below, scale, _FLOOR - (0.3 if scheme.is_moving.any() else 0.1), up=False)
        note.set_y(low)
        if scheme.notes:
            low -= _inches(note)[1] / scale
        low, high = low - 0.05, max(high, top) + 0.05
        if fits_axes:
            scale = min(scale, box.width / dpi / width, box.height / dpi / (high - low))
    spans = [ends, *(_span(text, scale) for text in [*loads, *below, note])]
    left, right = np.min(spans), np.max(spans)
    ax.set_xlim(left, right)
    ax.set_ylim(low, high)
    return float(scale * (right - left)), float(scale * (high - low))


def _name_limit(
    ax: Axes, scheme: Scheme, home: np.ndarray, pose: Pose, limit: Limit, gaps: np.ndarray | None, style: dict
) -> Text:
    j = limit.number
    gap = [] if gaps is None else [f"gap {gaps[j]:.3g}"]
    words = "\n".join([name_of(j, scheme.masses), *gap, f"$r$ = {scheme.restitution[j]:.3g}"])
    x = face_of(home, pose, limit.mass, limit.side) + limit.side * pose.gap[j]
    return ax.text(float(x), 0, words, ha="center", va="top", linespacing=1.1, **style)


def _stack(texts: Sequence[Text], scale: float, start: float, *, up: bool) -> float:
    """Put words into the first line from `start` on in which they overlap no others; where the last line ends."""
    reached: list[float] = []
    height = (max((_inches(text)[1] for text in texts), default=0.0) + 0.05) / scale
    for text in sorted(texts, key=lambda text: text.get_position()[0]):
        left, right = _span(text, scale)
        line = next((k for k, end in enumerate(reached) if end <= left), len(reached))
        reached[line : line + 1] = [right]
        text.set_y(start + (line if up else -line) * height)
    return start + (len(reached) if up else -len(reached)) * height


def _span(text: Text, scale: float) -> tuple[float, float]:
    """From where to where words go, with some space."""
    x, width = text.get_position()[0], (_inches(text)[0] + 0.08) / scale
    left = x - (width / 2 if text.get_ha() == "center" else 0.0)
    return left, left + width


def _inches(text: Text) -> tuple[float, float]:
    if not text.get_text():
        return 0.0, 0.0
    box = text.get_window_extent()
    return box.width / text.get_figure().dpi, box.height / text.get_figure().dpi
