"""Sweeps over a list of machines and starts, instead of a product grid."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from .._dataset_attributes import check_column
from .._execution.cluster import choose_runner
from .._execution.points import LaneInput, points_of_lanes
from .._execution.runner import Counts
from .._execution.settings import ExecutionSettings
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._hybrid.sticking import can_any_stick
from .._system.system import AnySystem
from .dataset import dataset
from .provenance import name_of_flow, origin
from .quantities import observed_for

START = "start"


def sweep_zipped(
    system: AnySystem,
    values: Mapping[str, np.ndarray],
    states: np.ndarray,
    counts: Counts,
    flow: AbstractFlow | None,
    settings: ExecutionSettings,
    executor: object,
    tell: Callable[[int], Any],
    beside: int = 0,
    along: str = START,
    quantities: Sequence[str] = (),
) -> xr.Dataset:
    """Run machine k from start k.

    Args:
        system: the machine, its force bound to its arguments, or a family.
        values: swept quantities by their paths, one value a point.
        states: positions and velocities of the starts in one row each, (points, 2 n).
        counts: arguments of `sweep` for every point; `can_stick` is determined here.
        flow: as for `vx.sweep`.
        settings: as for `vx.sweep`.
        executor: as for `vx.sweep`.
        tell: called with the number of points done since the last call.
        beside: number of points of another such sweep. Sweeps of many and of few points are two programs: to save a
            compilation this one is run as a part of as many, if they are more.
        along: name of the dimension of the points.
        quantities: as for `vx.sweep`, checked.

    Returns:
        The dataset of `vx.sweep`, with the points along one dimension.

    Raises:
        ValueError: for a path that names nothing, values that make no valid machine, or a start beyond a stop.
    """
    x0, v0 = np.split(states, 2, axis=1)
    starts = {"x0": x0, "v0": v0}
    zero = np.zeros(x0.shape[1], np.asarray(system.mass).dtype)
    base = LaneInput(system, zero, zero)
    given = dict(values) | starts
    counts_periods = counts.times is None
    points = points_of_lanes(base, given, counts_periods=counts_periods)
    for path in values:
        check_column(path)
    can_stick = can_any_stick(points.system, points.x0, points.v0)
    own_counts = replace(counts, can_stick=can_stick, observed=observed_for(quantities))
    motion = choose_flow(points.system, can_stick=can_stick, wanted=flow, for_many=True)
    attributes = origin(base, own_counts, flow=name_of_flow(motion, flow), carry=None, goes_on=False)
    runner = choose_runner(motion, own_counts, settings, executor)
    filled = np.resize(np.arange(len(states)), max(len(states), beside))
    repeated = {path: np.asarray(a)[filled] for path, a in given.items()}
    whole = points_of_lanes(base, repeated, counts_periods=counts_periods)
    found = runner.run(whole, np.arange(len(states)), tell)
    numbers = {along: np.arange(len(states))}
    ds = dataset(points, numbers, (len(states),), own_counts, found, attributes, quantities)
    coordinates = {path: ((along,), a) for path, a in values.items()}
    # A start of the masses alone is completed by the stretches of Jenkins elements.
    coordinates |= {path: ((along, "mass"), getattr(points, path).T) for path in starts}
    return ds.assign_coords(coordinates)
