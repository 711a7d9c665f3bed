"""Assignment of each of many motions to the attractor on which it ends.

The motions are run once, without their impacts, and judged by their stroboscopic section:

1. Motions that repeat are sorted into cells of the state space by their end states. One of each cell is polished into
   its cycle; cycles that agree up to a shift by whole periods are one attractor. All others must lie on one of the
   cycles found, to the tolerance; those that do not are sorted into cells again. So no motion is assigned by its cell
   alone, and few are polished.
2. Motions that hit nothing, and are proved never to hit anything, share the response of their linear machine.
3. Of the rest a sample, spread evenly, is run on for long: these settle, or show that they are chaotic. Chaotic ones
   are one attractor if the clouds of their section points mix, see `mixes`. A motion of the rest belongs to a stable
   cycle if it stays close to it in every period and comes closer; to a cloud if its last points lie as near to it as
   its own.
4. A cloud from which one of these left for a cycle is no attractor, but a chaotic transient. Motions leave such a set
   at a constant rate, and its mean lifetime may be some thousand periods. All that may be in it are run on, twice as
   long in every round; those that are then not settled stay unknown.

Labels by numbers of impacts alone would join different attractors. Labels by end states alone would split cycles
visited at different phases, and say nothing of chaos.
"""

from typing import NamedTuple

import numpy as np

from .assignment import approached, in_clouds, on_cycles
from .attractor import Attractor, attractor_index, cloud_of, cycles_from
from .ensemble import Endpoints, Machines

# `_CELL`: width of a cell, relative to the size of the motion.
# `_MOST_CELLS`: cells of each machine that are polished in a round.
_CELL, _MOST_CELLS = 1e-3, 64
_ROUNDS = 6
# `_SAMPLE`: motions of each machine that are run on in a round.
# `_LONGER`: number of transients for which they are run on.
# `_LONG_RECORD`: least number of periods that are then recorded.
_SAMPLE, _LONGER, _LONG_RECORD = 32, 10, 1024


class Coexisting(NamedTuple):
    """Attractors of some machines, and the assignment of motions to them.

    Attributes:
        motions: the attractors, and chaotic transients among them.
        label: index of the attractor of each motion, -1 where it is unknown.
    """

    motions: list[Attractor]
    label: np.ndarray


def coexisting(machines: Machines, ends: Endpoints, known: list[Attractor] | None = None) -> Coexisting:
    """Find the attractors on which motions end; those in `known` keep their indices."""
    motions = list(known or [])
    label = _settled(machines, motions, ends)
    for times in 2 ** np.arange(_ROUNDS):
        left = np.flatnonzero((label < 0) & ~ends.is_failed)
        sample = left[_first_of_each(ends.machine[left], _SAMPLE, spread=True)]
        if not sample.size:
            break
        num_known = len(motions)
        label[sample], later = _run_on(machines, motions, ends.last[sample], ends.machine[sample])
        for k in _transient_clouds(motions, ends, sample, label[sample]):
            motions[k] = motions[k]._replace(is_lasting=False)
        ends = _run_transients_on(machines, motions, _replaced(ends, sample, later), label, int(times))
        for belongs in (approached, in_clouds):
            unknown = left[label[left] < 0]
            label[unknown] = belongs(motions, ends, unknown)
        has_news = len(motions) > num_known or (label[left] >= 0).any()
        if not has_news and len(left) > _SAMPLE:
            break  # a full sample brought nothing new; where few are left, one may still leave a transient
    return Coexisting(motions, label)


def lasting(motions: list[Attractor]) -> tuple[list[Attractor], np.ndarray]:
    """The attractors among motions, and the new index of each motion, -1 for transients and, last, for no attractor."""
    number = np.full(len(motions) + 1, -1)
    kept = [k for k, motion in enumerate(motions) if motion.is_lasting]
    number[kept] = np.arange(len(kept))
    return [motions[k] for k in kept], number


def _transient_clouds(
    motions: list[Attractor], ends: Endpoints, sample: np.ndarray, label: np.ndarray
) -> set[int]:
    """Clouds that motions left for a cycle, which therefore are no attractors."""
    is_on_cycle = np.array([motion.num_periods > 0 for motion in motions] + [False])[label]
    # A motion that came closer to its cycle all the time may have done so in the midst of a cloud.
    gone = sample[is_on_cycle & (approached(motions, ends, sample) < 0)]
    return {*in_clouds(motions, ends, gone, ends.section.shape[1]).tolist()} - {-1}


def _run_transients_on(
    machines: Machines, motions: list[Attractor], ends: Endpoints, label: np.ndarray, times: int
) -> Endpoints:
    """Run on all motions that may be in a transient; their labels change in place."""
    passing = [k for k, motion in enumerate(motions) if not motion.is_lasting]
    label[np.isin(label, passing)] = -1
    of_machine = np.isin(ends.machine, [motions[k].machine for k in passing])
    which = np.flatnonzero((label < 0) & of_machine & ~ends.is_failed)
    if not which.size:
        return ends
    transient = times * _LONGER * machines.transient
    ds = machines.run(ends.last[which], ends.machine[which], transient, machines.record, goes_on=True)
    later = machines.ends(ds, ends.machine[which])
    label[which] = _settled(machines, motions, later)
    return _replaced(ends, which, later)


def _replaced(ends: Endpoints, which: np.ndarray, later: Endpoints) -> Endpoints:
    """The ends with those of some motions replaced by later ones, cut to as many last periods."""
    later = later._replace(section=later.section[:, -ends.section.shape[1] :])
    ends = Endpoints(*(a.copy() for a in ends))
    for whole, part in zip(ends, later, strict=True):
        whole[which] = part
    return ends


def _settled(machines: Machines, motions: list[Attractor], ends: Endpoints) -> np.ndarray:
    """Labels of the motions that repeat; new cycles are added to `motions`."""
    label = np.full(len(ends.machine), -1)
    for _ in range(_ROUNDS):
        left = np.flatnonzero((label < 0) & (ends.num_periods > 0))
        label[left] = on_cycles(motions, ends, left, machines.tolerance)
        left = left[label[left] < 0]
        cells = _one_of_each_cell(ends, left)
        if not cells.size:
            break
        of_cells = (a[cells] for a in (ends.last, ends.machine, ends.num_periods, ends.is_quiet))
        for k, motion in zip(cells, cycles_from(machines, *of_cells), strict=True):
            label[k] = attractor_index(motions, motion, machines.tolerance)
            if ends.is_quiet[k]:
                label[ends.is_quiet & (ends.machine == ends.machine[k])] = label[k]
    return label


def _one_of_each_cell(ends: Endpoints, left: np.ndarray) -> np.ndarray:
    """The first motion in each cell, of the cells with the most motions."""
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
    """Indices of at most `most` points of each machine: the first, or spread evenly."""
    chosen = []
    for each in np.unique(machine):
        places = np.flatnonzero(machine == each)
        count = min(most, len(places))
        chosen.append(
            places[np.linspace(0, len(places) - 1, count).astype(int)] if spread else places[:count]
        )
    return np.concatenate(chosen) if chosen else np.zeros(0, int)


def _run_on(
    machines: Machines, motions: list[Attractor], states: np.ndarray, machine: np.ndarray
) -> tuple[np.ndarray, Endpoints]:
    """Run motions on for long: their labels, and their ends; new attractors are added to `motions`."""
    record = max(_LONG_RECORD, machines.record)
    ds = machines.run(states, machine, _LONGER * machines.transient, record, goes_on=True)
    ends = machines.ends(ds, machine)
    label = _settled(machines, motions, ends)
    left = np.flatnonzero((label < 0) & ~ends.is_failed)
    label[left] = approached(motions, ends, left)
    for k in np.flatnonzero((label < 0) & (ends.num_periods == 0) & ~ends.is_settling & ~ends.is_failed):
        label[k] = attractor_index(
            motions, cloud_of(machines, int(machine[k]), ends.section[k]), machines.tolerance
        )
    return label, ends
