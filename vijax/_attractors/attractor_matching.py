"""Matching of attractors at one value of a parameter with those at the next."""

import numpy as np

from .attractor import Attractor
from .coexisting import Coexisting, coexisting
from .distances import set_distance
from .ensemble import Machines
from .starts import is_beyond


def seeded(machines: Machines, found: Coexisting) -> tuple[list[Attractor], dict[int, int]]:
    """Start at each value from the attractors at the value before.

    New attractors are started from in turn, until none is new.

    Returns:
        All attractors, and for each of them, by its index, that at the next value on which its motion ends, -1 if
        unknown.
    """
    motions, goes_to = found.motions, {}
    last = len(machines.rate) - 1
    while due := [k for k, m in enumerate(motions) if k not in goes_to and m.machine < last]:
        before = np.array([motions[k].machine for k in due])
        # W may change from one value to the next.
        physical = np.stack([motions[k].points[0] for k in due]) / machines.scale(before)
        goes_to |= dict.fromkeys(due, -1)
        # Stops that have moved past a state carry it along.
        states = machines.onto_stops(physical * machines.scale(before + 1), before + 1)
        sound = np.flatnonzero(~is_beyond(machines.lanes(before + 1), states / machines.scale(before + 1)))
        if not sound.size:
            continue
        machine = before[sound] + 1
        ds = machines.run(states[sound], machine, machines.transient, machines.record, goes_on=True)
        ends = machines.ends(ds, machine)
        motions, labels = coexisting(machines, ends, motions)
        goes_to |= {due[k]: int(label) for k, label in zip(sound, labels, strict=True)}
    return motions, goes_to


def branch_numbers(motions: list[Attractor], num_values: int, threshold: float) -> np.ndarray:
    """Number the attractors along the parameter, (motions,): an attractor that continues keeps its number.

    Numbers are given in the order in which attractors begin.
    """
    name = np.full(len(motions), -1)
    here, count = [], 0
    for value in range(num_values):
        before, here = here, [k for k, m in enumerate(motions) if m.machine == value]
        pairs = [(*_distance(motions[j], motions[k]), j, k) for j in before for k in here]
        is_left = dict.fromkeys([*before, *here], True)
        for _, distance, j, k in sorted(pairs):
            if distance <= threshold and is_left[j] and is_left[k]:
                name[k] = name[j]
                is_left[j] = is_left[k] = False
        for k in here:
            if is_left[k]:
                name[k], count = count, count + 1
    return name


def _distance(ours: Attractor, theirs: Attractor) -> tuple[bool, float]:
    """Flag of different events, and distance of two attractors relative to their size."""
    rates = [m.num_impacts / max(1, m.num_periods) for m in (ours, theirs)]
    is_other = not np.array_equal(*rates, equal_nan=True) or (ours.num_periods == 0) != (
        theirs.num_periods == 0
    )
    return is_other, set_distance(ours.points, theirs.points) / max(ours.size, theirs.size)
