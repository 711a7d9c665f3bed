"""Shocks of a machine on one of its attractors: where motions go that start beside it."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._dataset_checks import check_is_dataset
from .._execution.settings import ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, whole_number
from .._sweep.provenance import machines_of
from .._sweep.short_names import with_paths
from .._system.system import machine_of
from .attractor import Attractor
from .attractors import machines_of_one
from .coexisting import coexisting
from .ensemble import Machines
from .starts import is_beyond


@dataclass(frozen=True)
class Shocks:
    """A machine, its attractors, and the state on one of them that is shocked.

    Attributes:
        machines: the single machine.
        motions: its attractors.
        number: index of the one that is shocked.
        state: its state (W x, v) at the shock, (2 n,).

    Shocks are those of masses: Jenkins elements keep their forces.
    """

    machines: Machines
    motions: list[Attractor]
    number: int
    state: np.ndarray

    @property
    def scale(self) -> np.ndarray:
        """Factors that turn shocks (dx, dv) into (W dx, dv), (2 masses,)."""
        return np.repeat([self.machines.rate[0], 1.0], self.machines.system.num_masses)

    def of_masses(self, kicks: np.ndarray) -> np.ndarray:
        """Shocks (W x, v) of all coordinates, (..., 2 n), from those of the masses, (..., 2 masses)."""
        none = [(0, 0)] * (kicks.ndim - 1) + [(0, len(self.machines.system.hysteresis))]
        return np.concatenate([np.pad(a, none) for a in np.split(kicks, 2, axis=-1)], axis=-1)

    def is_beyond(self, kicks: np.ndarray) -> np.ndarray:
        """True where a shock (W x, v), (points, 2 n), would throw a mass beyond a rigid stop."""
        return is_beyond(machine_of(self.machines.system), self.states(kicks))

    def states(self, kicks: np.ndarray) -> np.ndarray:
        """States (x, v) after shocks, (points, 2 n)."""
        return (self.state + kicks) / self.machines.scale(np.zeros(len(kicks), int))

    def labels(self, kicks: np.ndarray, *, progress: bool = False) -> np.ndarray:
        """The attractor to which each shock leads, -1 where none of the known ones is reached.

        Where a mass would be thrown beyond a rigid stop, there is no such shock, and the label is that of the attractor.
        """
        label = np.full(len(kicks), self.number)
        which = np.flatnonzero(~self.is_beyond(kicks))
        if which.size:
            one = np.zeros(len(which), int)
            transient, record = self.machines.transient, self.machines.record
            ds = self.machines.run(self.state + kicks[which], one, transient, record, progress=progress)
            ends = self.machines.ends(ds, one)
            found = coexisting(self.machines, ends, self.motions).label
            label[which] = np.where(found < len(self.motions), found, -1)
        return label


def shocks_of(
    who: str,
    found: xr.Dataset,
    attractor: Count,
    period: Count,
    flow: AbstractFlow | None,
    executor: object,
    settings: ExecutionSettings,
) -> Shocks:
    """Shocks of an attractor of a dataset, checked; `who` is the function that asks, for messages."""
    check_is_dataset(found, "found", "`vx.attractors` or `vx.basins`")
    if not {"section_x", "section_v", "residual"} <= {*found} or found["section_x"].ndim != 3:
        raise ValueError("Argument `found` must be what `vx.attractors` or `vx.basins` returned.")
    number = whole_number("attractor", attractor)
    if number >= found.sizes["attractor"]:
        raise ValueError(
            f"Argument `attractor` must be less than {found.sizes['attractor']}, the number of attractors, but is {number}."
        )
    machine = jax.tree.map(lambda a: jnp.asarray(a[..., 0]), machines_of(with_paths(found)[[]]))
    counts = int(found.attrs["transient"]), int(found.attrs["record"])
    max_steps = found.attrs["max_steps"]
    max_steps = None if max_steps == "default" else int(max_steps)
    one = machines_of_one(who, machine, None, *counts, None, flow, max_steps, settings, executor)
    # The program of many starts, which `basins` has used, serves few too.
    machines = one.for_sweep_of(settings.lanes + 1)
    motions = _motions(machines, found)
    points, step = motions[number].points, whole_number("period", period)
    return Shocks(machines, motions, number, points[step % len(points)])


def _motions(machines: Machines, found: xr.Dataset) -> list[Attractor]:
    """The attractors of a dataset."""
    section = np.concatenate([found["section_x"].values, found["section_v"].values], axis=2)
    motions = []
    for k in range(found.sizes["attractor"]):
        rows = section[k][~np.isnan(section[k]).any(axis=1)]
        points = rows * machines.scale(np.zeros(len(rows), int))
        motions.append(
            Attractor(
                machine=0,
                points=points,
                size=float(np.abs(points).max()) or 1.0,
                num_periods=int(found["num_periods"][k]),
                kind=int(found["motion"][k]),
                num_impacts=found["num_impacts"].values[k],
                held_time=found["held_time"].values[k],
                multipliers=found["multipliers"].values[k],
                residual=float(found["residual"][k]),
            )
        )
    return motions
