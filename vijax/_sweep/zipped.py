"""Sweeps over a list of machines and starts, instead of a product grid."""

from collections.abc import Mapping

import equinox as eqx
import numpy as np
import xarray as xr

from .._contact.sticking import can_any_stick
from .._execution.points import Point, points_of_lanes
from .._execution.runner import Counts
from .._execution.settings import ExecutionSettings
from .._execution.threads import Threads
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._progress import tqdm
from .._system.system import ImpactSystem
from .dataset import dataset
from .provenance import origin

START = "start"


def sweep_zipped(
    system: ImpactSystem,
    values: Mapping[str, np.ndarray],
    states: np.ndarray,
    counts: tuple[int, int, int],
    *,
    max_steps: int | None,
    flow: AbstractFlow | None,
    progress: bool,
    settings: ExecutionSettings,
) -> xr.Dataset:
    """Run machines from starts, one of each to every point.

    Args:
        system: the machine, its force bound to its arguments.
        values: swept quantities by their paths, one value a point.
        states: positions and velocities of the starts side by side, (points, 2 n).
        counts: `transient`, `record` and `max_impacts` as for `vx.sweep`.
        max_steps: likewise.
        flow: likewise.
        progress: likewise.
        settings: likewise.

    Returns:
        The dataset of `vx.sweep`, with the points along `start`.

    Raises:
        ValueError: for a path that names nothing, values that make no machine, or a start beyond a stop.
    """
    x0, v0 = np.split(states, 2, axis=1)
    starts = {"x0": x0, "v0": v0}
    zero = np.zeros(system.num_masses, np.asarray(system.mass).dtype)
    base = Point(system, zero, zero)
    points = points_of_lanes(base, dict(values) | starts)
    can_stick = can_any_stick(points.system, points.x0, points.v0)
    asked = Counts(*counts, max_steps, can_stick)
    motion = choose_flow(points.system, can_stick=can_stick, wanted=flow)
    name = type(motion).__name__ if flow is None else eqx.tree_pformat(flow, width=10**6)
    attributes = origin(base, asked, flow=name, carry=None, goes_on=False)
    with tqdm(total=len(states), unit="point", disable=not progress) as bar:
        found = Threads(motion, asked, settings).run(points, np.arange(len(states)), bar.update)
    ds = dataset(points, {START: np.arange(len(states))}, (len(states),), asked, found, attributes)
    coordinates = {path: ((START,), a) for path, a in values.items()}
    coordinates |= {path: ((START, "mass"), a) for path, a in starts.items()}
    return ds.assign_coords(coordinates)
