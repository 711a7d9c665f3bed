"""Attractors of a symmetric machine with their mirror images as one.

A symmetry maps attractors to attractors, see `_system/symmetry.py`. The section at phase 0 of an image is the image of the section a
share of a period later, so all points of a section are run on for that share first.
"""

import numpy as np

from .._execution.runner import Counts
from .._sweep.zipped import sweep_zipped
from .._system.symmetry import Symmetry
from .._system.system import machine_of
from .attractor import Attractor, attractor_index, is_same
from .distances import nearest
from .ensemble import Machines

# Distance of two starts, relative to all of them, below which they are one.
_SAME_START = 1e-9


def folded(
    machines: Machines, motions: list[Attractor], labels: np.ndarray
) -> tuple[list[Attractor], np.ndarray]:
    """Join attractors that are images of each other.

    Args:
        machines: the single machine.
        motions: its attractors, those that most starts lead to first.
        labels: index of the attractor of each start, -1 where it is unknown.

    Returns:
        The first of each set of images, with the number of different images, and the labels among these.
    """
    symmetries = machine_of(machines.system).symmetries()
    kept: list[Attractor] = []
    number = np.full(len(motions) + 1, -1)
    for k, motion in enumerate(motions):
        if number[k] >= 0:
            continue
        images = [motion]
        for symmetry in symmetries:
            attractor_index(images, _image(machines, motion, symmetry), machines.tolerance)
        for j in range(k, len(motions)):
            if any(is_same(image, motions[j], machines.tolerance) for image in images):
                number[j] = len(kept)
        kept.append(motion._replace(num_images=len(images)))
    return kept, number[labels]


def first_images(machines: Machines, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts at phase 0 of which no image comes before them, and for each start the number of its image among these.

    Images at another phase of the load are no starts, so symmetries with a shift in time do not count.
    """
    first = np.arange(len(states))
    size = np.abs(states).max(axis=0, initial=0) + (np.abs(states).max(initial=0) == 0)
    size = np.where(size > 0, size, 1)
    for symmetry in machine_of(machines.system).symmetries():
        if symmetry.shift:
            continue
        which, away = nearest(_images(symmetry, states) / size, states / size)
        first = np.where(away <= _SAME_START, np.minimum(first, which), first)
    while not np.array_equal(first, first[first]):
        first = first[first]
    return np.unique(first, return_inverse=True)


def _images(symmetry: Symmetry, states: np.ndarray) -> np.ndarray:
    """Images of states (x, v), (points, 2 n), without the shift in time."""
    image = lambda state: np.concatenate(symmetry.image(*np.split(state, 2)))  # noqa: E731
    origin = image(np.zeros(states.shape[1]))
    matrix = np.stack([image(unit) - origin for unit in np.eye(states.shape[1])])
    return states @ matrix + origin


def _image(machines: Machines, motion: Attractor, symmetry: Symmetry) -> Attractor:
    """Image of an attractor."""
    machine = np.full(len(motion.points), motion.machine)
    scale = machines.scale(machine)
    later = _later(machines, motion.points, machine, float(symmetry.shift)) / scale
    points = machines.after_impacts(_images(symmetry, later) * scale, machine)
    if motion.num_periods:
        points = np.roll(points, -int(points[:, 0].argmin()), axis=0)
    stops = list(symmetry.stops)
    return motion._replace(
        points=points, num_impacts=motion.num_impacts[stops], held_time=motion.held_time[stops]
    )


def _later(machines: Machines, states: np.ndarray, machine: np.ndarray, share: float) -> np.ndarray:
    """States (W x, v) a share of a period after phase 0."""
    if not share:
        return states
    span = share * 2 * np.pi / float(machines.rate[machine[0]])
    counts = Counts(0, 1, 0, machines.max_steps, can_stick=True, times=(span,))
    starts = machines.onto_stops(states, machine, float(np.sqrt(np.finfo(states.dtype).eps)))
    where = machines.settings, machines.executor
    ds = sweep_zipped(
        machines.system, {}, starts / machines.scale(machine), counts, machines.flow, *where, lambda _: None
    )
    return np.concatenate([ds["x"].values, ds["v"].values], axis=1) * machines.scale(machine)
