"""Integrity of attractors along a parameter: how their basins are eroded."""

import jax
import numpy as np

from .attractor import Attractor
from .ensemble import Machines
from .integrity import integrity_columns
from .integrity_measures import window_of
from .starts import Starts
from .table import ATTRACTOR

# Starts along each side of a box of the basin entropy.
BOX = 5


def check_grid(starts: Starts) -> None:
    """Raise unless the starts are a grid on which integrity can be measured."""
    sizes = [len(a) for a in starts.axes.values()]
    if len(sizes) < 2 or min(sizes) < BOX:
        raise ValueError(
            "With `integrity` the starts must be a grid of two start quantities or more, as "
            f'{{"x0[0]": values, "v0[0]": values}}, with {BOX} values of each at least.'
        )


def erosion_columns(
    machines: Machines, motions: list[Attractor], name: np.ndarray, labels: np.ndarray, starts: Starts
) -> dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]:
    """The variables of `vx.integrity` at every value of the parameter.

    Args:
        machines: one for each value.
        motions: the attractors at all values.
        name: the number of each along the parameter.
        labels: indices of the motions to which the starts lead, those of one value after another.
        starts: the grid of starts.
    """
    ((path, along),) = machines.values.items()
    count, shape = int(name.max(initial=-1)) + 1, tuple(len(a) for a in starts.axes.values())
    grids = np.append(name, -1)[labels].reshape(len(along), *shape)
    rows = []
    for value, label in enumerate(grids):
        system = jax.tree.map(lambda a: np.asarray(a)[..., 0], machines.lanes(np.array([value])))
        window, order = window_of(starts.axes, {}, system)
        sections = [np.zeros((0, starts.states.shape[1]))] * count
        for motion, k in zip(motions, name, strict=True):
            if motion.machine == value:
                sections[k] = motion.points / machines.scale(np.full(len(motion.points), value))
        columns = integrity_columns(window, label[np.ix_(*order)], sections, BOX)
        is_found = np.array([len(points) > 0 for points in sections])
        rows.append(
            {
                key: (dims, np.where(is_found, a, np.nan) if dims else a, words)
                for key, (dims, a, words) in columns.items()
                if key != "center" and "share" not in key
            }
        )
    return {
        key: ((path, *dims), np.stack([row[key][1] for row in rows]), words)
        for key, (dims, _, words) in rows[0].items()
        if dims in ((), (ATTRACTOR,))
    }
