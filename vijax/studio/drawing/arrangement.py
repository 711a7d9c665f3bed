"""Places of the masses, stops and contacts of a drawing, at rest and in a pose.

A box is 1 wide and high; boxes at rest are `PITCH` apart. A container is wider, with its loose mass in it.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .scheme import DrawnLimit, Scheme

PITCH = 2.3
# Half of the width of a box, of a container and of a loose mass in it; distance of walls from the outermost boxes.
HALF, OUTSIDE, LOOSE = 0.5, 1.0, 0.3
END = 1.25
# Length of the spring of a compliant stop at rest.
YIELDING = 0.35


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


def arrangement_of(scheme: Scheme) -> Arrangement:
    """Place the masses in a row, each container with its loose mass in it."""
    inside, every = scheme.containers, range(scheme.num_masses)
    half = np.array([LOOSE if i in inside else HALF for i in every])
    for loose, container in inside.items():
        is_yielding = any(scheme.is_compliant[limit.number] for limit in scheme.limits if limit.mass == loose)
        half[container] = OUTSIDE + is_yielding * YIELDING
    row = [i for i in every if i not in inside]
    home, space = np.zeros(scheme.num_masses), PITCH - 2 * HALF
    for before, i in itertools.pairwise(row):
        home[i] = home[before] + half[before] + space + half[i]
    for loose, container in inside.items():
        home[loose] = home[container]
    return Arrangement(home, half, row, inside)


def side_position(arrangement: Arrangement, pose: Pose, mass: int, side: int) -> float:
    """Position of a side of a box: -1 left, 0 middle, 1 right."""
    return float(arrangement.home[mass] + pose.x[mass] + arrangement.half[mass] * side)


def place_of_limit(arrangement: Arrangement, pose: Pose, limit: DrawnLimit) -> float:
    """Position of a wall or plate."""
    return side_position(arrangement, pose, limit.mass, limit.side) + limit.side * float(
        pose.gap[limit.number]
    )


def are_neighbours(arrangement: Arrangement, mass: int, other: int) -> bool:
    """True where two masses stand side by side, so that a link of them lies in the row."""
    return (mass, other) in itertools.pairwise(arrangement.row)


def wall_beside(arrangement: Arrangement, mass: int) -> int:
    """Side of a mass with room for a wall: -1 for the first, 1 for the last, 0 for others."""
    return -1 if mass == arrangement.row[0] else int(mass == arrangement.row[-1])


def wall_at(arrangement: Arrangement, mass: int) -> float:
    """Position of the wall beside the first or last mass of the row."""
    side = wall_beside(arrangement, mass)
    return float(arrangement.home[mass] + side * (arrangement.half[mass] + END))
