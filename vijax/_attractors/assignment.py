"""Assignment of motions to attractors that are already found."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .attractor import Attractor
from .distances import nearest, reach
from .ensemble import Endpoints

# `_SLACK`: a motion is on a cycle within this many tolerances.
# `_NEAR`: a motion approaches a cycle from within this distance, relative to the size of the cycle.
_SLACK, _NEAR = 10, 1e-2
# `_LAST`: last points of a motion that are compared with a cloud.
# `_MOST`: quantile of the neighbourhood radii of a cloud's points within which a motion belongs to the cloud.
_LAST, _MOST = 3, 0.95
# Points compared at once.
_BLOCK = 1 << 13


class _Points(NamedTuple):
    """Section points of several attractors, one after another.

    Attributes:
        states: (points, 2 n).
        owner: index of the attractor of each point.
        size: size of that attractor.
        after: index of the point one period later.
    """

    states: np.ndarray
    owner: np.ndarray
    size: np.ndarray
    after: np.ndarray


def _points_of(motions: list[Attractor], numbers: list[int]) -> _Points:
    count = [len(motions[k].points) for k in numbers]
    begin = np.cumsum([0, *count])[:-1]
    after = [b + np.roll(np.arange(c), -1) for b, c in zip(begin, count, strict=True)]
    return _Points(
        np.concatenate([motions[k].points for k in numbers]),
        np.repeat(numbers, count),
        np.repeat([motions[k].size for k in numbers], count),
        np.concatenate(after),
    )


def _by_machine(
    ends: Endpoints, left: np.ndarray, motions: list[Attractor], *, cycles: bool
) -> Iterator[tuple[np.ndarray, list[int]]]:
    """Blocks of the remaining motions of each machine, with the lasting cycles or clouds of that machine."""
    for each in np.unique(ends.machine[left]):
        numbers = [
            k
            for k, m in enumerate(motions)
            if m.machine == each and bool(m.num_periods) == cycles and m.is_lasting
        ]
        places = np.flatnonzero(ends.machine[left] == each)
        for k in range(0, len(places) if numbers else 0, _BLOCK):
            yield places[k : k + _BLOCK], numbers


def on_cycles(motions: list[Attractor], ends: Endpoints, left: np.ndarray, tolerance: float) -> np.ndarray:
    """Labels of motions that end on a cycle, -1 for the others."""
    label = np.full(len(left), -1)
    for block, numbers in _by_machine(ends, left, motions, cycles=True):
        points = _points_of(motions, numbers)
        place, distance = nearest(ends.last[left[block]], points.states)
        label[block] = np.where(distance <= _SLACK * tolerance * points.size[place], points.owner[place], -1)
    return label


def approached(motions: list[Attractor], ends: Endpoints, left: np.ndarray) -> np.ndarray:
    """Labels of motions that approach a stable cycle, -1 for the others."""
    label = np.full(len(left), -1)
    for block, numbers in _by_machine(ends, left, motions, cycles=True):
        points = _points_of(motions, numbers)
        is_stable = np.array([motion.is_stable for motion in motions])[points.owner]
        section = ends.section[left[block]]
        place, distance = nearest(section[:, -1], points.states)
        near = np.flatnonzero(is_stable[place] & (distance <= _NEAR * points.size[place]))
        label[block[near]] = np.where(
            _comes_closer(section[near], points, place[near]), points.owner[place[near]], -1
        )
    return label


def _comes_closer(section: np.ndarray, points: _Points, place: np.ndarray) -> np.ndarray:
    """True where a motion stays near a cycle in every period, and ends nearer to it than it began."""
    before = np.empty_like(points.after)
    before[points.after] = np.arange(len(points.after))
    distance, at = np.empty(section.shape[:2]), place
    for k in range(section.shape[1] - 1, -1, -1):
        distance[:, k] = np.abs(section[:, k] - points.states[at]).max(axis=1)
        at = before[at]
    third = max(1, section.shape[1] // 3)
    is_near = distance.max(axis=1) <= _NEAR * points.size[place]
    return is_near & (distance[:, -third:].max(axis=1) < distance[:, :third].max(axis=1))


def in_clouds(motions: list[Attractor], ends: Endpoints, left: np.ndarray, last: int = _LAST) -> np.ndarray:
    """Labels of motions whose last points lie in a lasting cloud, -1 for the others."""
    label = np.full(len(left), -1)
    for block, numbers in _by_machine(ends, left, motions, cycles=False):
        section, clouds = ends.section[left[block], -last:], [motions[k].points for k in numbers]
        rows = section.reshape(-1, section.shape[2])
        far = [nearest(rows, a)[1].reshape(len(block), -1) / np.quantile(reach(a), _MOST) for a in clouds]
        ratio = np.median(np.stack(far), axis=2)
        best = ratio.argmin(axis=0)
        label[block] = np.where(ratio.min(axis=0) <= 1, np.array(numbers)[best], -1)
    return label
