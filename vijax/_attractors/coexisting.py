"""Which attractor each of many motions ends on.

The motions are run once, without their impacts, and judged by their stroboscopic section:

1. Those that repeat are put into cells of the state space by their end states. One of each cell is polished into its
   cycle; cycles that are one up to a shift by whole periods are one attractor. All others must lie on one
   of the cycles found, to the tolerance; what does not is put into cells again. So no motion is trusted to its cell, and few are polished.
2. Motions that hit nothing, and are proved to hit nothing any more, share the response of their linear machine.
3. Of the rest some, spread evenly, are run on for long: they settle, or show that they are chaotic. Chaotic ones are one
   attractor if the clouds of their section points mix, see `mixes`. A motion of the rest belongs to a stable cycle if it keeps
   close to it, period for period, and comes closer; to a cloud if its last points lie as near to it as its own.

Labels by numbers of impacts alone would join attractors that differ; labels by end states alone would split cycles
visited at different phases, and tell nothing of chaos.
"""

from typing import NamedTuple

import numpy as np

from .distances import nearest, reach
from .machines import Ends, Machines
from .motions import Motion, cloud_of, cycles_from, place_of

# Width of a cell, relative to the size of the motion; cells that are polished in a round, of each machine.
_CELL, _MOST_CELLS = 1e-3, 64
_ROUNDS = 6
# Motions of each machine that are run on in a round, how much longer, and the recorded periods.
_SAMPLE, _LONGER, _LONG_RECORD = 32, 10, 512
# A motion is on a cycle within this many times the tolerance; it approaches one from this distance on, relative to its size.
_SLACK, _NEAR = 10, 1e-2
# Last points that are compared with a cloud, and of how many of its points neighbourhoods may be smaller than they are far.
_LAST, _MOST = 3, 0.95
# Points compared at once.
_BLOCK = 1 << 13


class Coexisting(NamedTuple):
    """Attractors of some machines, and where motions end.

    Attributes:
        motions: the attractors.
        label: the number of the attractor of each motion, -1 where it is not known.
    """

    motions: list[Motion]
    label: np.ndarray


def coexisting(machines: Machines, ends: Ends, known: list[Motion] | None = None) -> Coexisting:
    """Find the attractors on which motions end.

    Args:
        machines: whose motions they are.
        ends: of the motions.
        known: attractors that are known already, which keep their numbers.
    """
    motions = list(known or [])
    label = _settled(machines, motions, ends)
    for _ in range(_ROUNDS):
        left = np.flatnonzero((label < 0) & ~ends.is_failed)
        sample = left[_first_of_each(ends.machine[left], _SAMPLE, spread=True)]
        if not sample.size:
            break
        num_known = len(motions)
        label[sample] = _run_on(machines, motions, ends.last[sample], ends.machine[sample])
        left = left[label[left] < 0]
        label[left] = _approached(motions, ends, left)
        left = left[label[left] < 0]
        label[left] = _in_clouds(motions, ends, left)
        if len(motions) == num_known and (label[sample] < 0).any():
            break  # more of the same would tell no more
    return Coexisting(motions, label)


def _settled(machines: Machines, motions: list[Motion], ends: Ends) -> np.ndarray:
    """Labels of the motions that repeat; new cycles are added to `motions`."""
    label = np.full(len(ends.machine), -1)
    for _ in range(_ROUNDS):
        left = np.flatnonzero((label < 0) & (ends.num_periods > 0))
        label[left] = _on_cycles(motions, ends, left, _SLACK * machines.tolerance)
        left = left[label[left] < 0]
        cells = _one_of_each_cell(ends, left)
        if not cells.size:
            break
        of_cells = (a[cells] for a in (ends.last, ends.machine, ends.num_periods, ends.is_quiet))
        for k, motion in zip(cells, cycles_from(machines, *of_cells), strict=True):
            label[k] = place_of(motions, motion, machines.tolerance)
            if ends.is_quiet[k]:
                label[ends.is_quiet & (ends.machine == ends.machine[k])] = label[k]
    return label


def _one_of_each_cell(ends: Ends, left: np.ndarray) -> np.ndarray:
    """Of the motions in each cell the first, of the cells with the most motions."""
    states = ends.last[left]
    size = np.abs(states).max(axis=1, keepdims=True)
    cell = np.rint(states / (_CELL * 2.0 ** np.rint(np.log2(np.where(size == 0, 1, size))))).astype(np.int64)
    cell[ends.is_quiet[left]] = 0
    columns = [ends.machine[left], ends.num_periods[left], *cell.T]
    odd = np.random.default_rng(0).integers(1 << 62, size=len(columns)) * 2 + 1
    with np.errstate(over="ignore"):
        key = sum(a.astype(np.int64) * b for a, b in zip(columns, odd, strict=True))
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    order = np.lexsort((first, -count))
    cells = left[first[order]]
    return cells[_first_of_each(ends.machine[cells], _MOST_CELLS)]


def _first_of_each(machine: np.ndarray, most: int, *, spread: bool = False) -> np.ndarray:
    """Places of at most so many points of each machine: the first, or spread evenly."""
    chosen = []
    for each in np.unique(machine):
        places = np.flatnonzero(machine == each)
        count = min(most, len(places))
        chosen.append(
            places[np.linspace(0, len(places) - 1, count).astype(int)] if spread else places[:count]
        )
    return np.concatenate(chosen) if chosen else np.zeros(0, int)


def _run_on(machines: Machines, motions: list[Motion], states: np.ndarray, machine: np.ndarray) -> np.ndarray:
    """Labels of motions that are run on for long; new attractors are added to `motions`."""
    ds = machines.run(states, machine, _LONGER * machines.transient, _LONG_RECORD)
    ends = machines.ends(ds, machine)
    label = _settled(machines, motions, ends)
    left = np.flatnonzero((label < 0) & ~ends.is_failed)
    label[left] = _approached(motions, ends, left)
    for k in np.flatnonzero((label < 0) & (ends.num_periods == 0) & ~ends.is_settling & ~ends.is_failed):
        label[k] = place_of(motions, cloud_of(machines, int(machine[k]), ends.section[k]), machines.tolerance)
    return label


class _Points(NamedTuple):
    """Section points of several attractors, one after another.

    Attributes:
        states: (points, 2 n).
        owner: the number of the attractor of each.
        size: of its attractor.
        after: the place of the point one period later.
    """

    states: np.ndarray
    owner: np.ndarray
    size: np.ndarray
    after: np.ndarray


def _points_of(motions: list[Motion], numbers: list[int]) -> _Points:
    count = [len(motions[k].points) for k in numbers]
    begin = np.cumsum([0, *count])[:-1]
    after = [b + np.roll(np.arange(c), -1) for b, c in zip(begin, count, strict=True)]
    return _Points(
        np.concatenate([motions[k].points for k in numbers]),
        np.repeat(numbers, count),
        np.repeat([motions[k].size for k in numbers], count),
        np.concatenate(after),
    )


def _by_machine(ends: Ends, left: np.ndarray, motions: list[Motion], *, cycles: bool):
    """For each machine, and each block of its points that are left, these and the attractors of the machine."""
    for each in np.unique(ends.machine[left]):
        numbers = [k for k, m in enumerate(motions) if m.machine == each and bool(m.num_periods) == cycles]
        places = np.flatnonzero(ends.machine[left] == each)
        for k in range(0, len(places) if numbers else 0, _BLOCK):
            yield places[k : k + _BLOCK], numbers


def _on_cycles(motions: list[Motion], ends: Ends, left: np.ndarray, within: float) -> np.ndarray:
    """Labels of motions that end on a cycle."""
    label = np.full(len(left), -1)
    for block, numbers in _by_machine(ends, left, motions, cycles=True):
        points = _points_of(motions, numbers)
        place, distance = nearest(ends.last[left[block]], points.states)
        label[block] = np.where(distance <= within * points.size[place], points.owner[place], -1)
    return label


def _approached(motions: list[Motion], ends: Ends, left: np.ndarray) -> np.ndarray:
    """Labels of motions that come closer and closer to a stable cycle."""
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
    """Whether motions keep near a cycle all the time, period for period, and nearer at the end than at the beginning."""
    before = np.empty_like(points.after)
    before[points.after] = np.arange(len(points.after))
    distance, at = np.empty(section.shape[:2]), place
    for k in range(section.shape[1] - 1, -1, -1):
        distance[:, k] = np.abs(section[:, k] - points.states[at]).max(axis=1)
        at = before[at]
    third = max(1, section.shape[1] // 3)
    is_near = distance.max(axis=1) <= _NEAR * points.size[place]
    return is_near & (distance[:, -third:].max(axis=1) < distance[:, :third].max(axis=1))


def _in_clouds(motions: list[Motion], ends: Ends, left: np.ndarray) -> np.ndarray:
    """Labels of motions whose last points lie in a cloud."""
    label = np.full(len(left), -1)
    radius = {k: np.quantile(reach(m.points), _MOST) for k, m in enumerate(motions) if not m.num_periods}
    for block, numbers in _by_machine(ends, left, motions, cycles=False):
        section = ends.section[left[block], -_LAST:]
        rows = section.reshape(-1, section.shape[2])
        far = [nearest(rows, motions[k].points)[1].reshape(len(block), -1) / radius[k] for k in numbers]
        ratio = np.median(np.stack(far), axis=2)
        best = ratio.argmin(axis=0)
        label[block] = np.where(ratio.min(axis=0) <= 1, np.array(numbers)[best], -1)
    return label
