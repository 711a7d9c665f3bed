"""Points anywhere in the space of parameters, run like those of a sweep."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
import xarray as xr

from .._contact.sticking import can_any_stick
from .._execution.points import Point, points_of_lanes
from .._execution.runner import Counts
from .._execution.settings import ExecutionSettings
from .._execution.threads import Threads
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .dataset import dataset
from .provenance import origin

POINT = "point"


def run_scattered(
    base: Point,
    swept: dict[str, np.ndarray],
    counts: Counts,
    flow: AbstractFlow | None,
    settings: ExecutionSettings,
    tell: Callable[[int], Any],
) -> xr.Dataset:
    """Run a machine at points of any parameter values.

    Args:
        base: the machine and start that hold where nothing is swept.
        swept: for each path one number a point, (points,).
        counts: what is asked of every point; whether a stop might hold its mass is found here.
        flow: the motion between events that was asked for.
        settings: sizes of queues and lanes.
        tell: called with the number of points done since the last call.

    Returns:
        As `sweep`, along `point`, the values of the paths as coordinates; no warnings.
    """
    dtype = base.system.mass.dtype
    size = len(next(iter(swept.values())))
    points = points_of_lanes(base, {path: a.astype(dtype) for path, a in swept.items()})
    points = jax.tree.map(lambda a: np.asarray(a, dtype), points)
    full = lambda a: np.array(np.broadcast_to(a, (base.system.num_masses, size)))  # noqa: E731
    points = Point(points.system, full(points.x0), full(points.v0))
    can_stick = can_any_stick(points.system, points.x0, points.v0)
    asked = Counts(**(vars(counts) | {"can_stick": can_stick}))
    motion = choose_flow(points.system, can_stick=can_stick, wanted=flow)
    found = Threads(motion, asked, settings).run(points, np.arange(size), tell)
    attributes = origin(base, asked, flow=type(motion).__name__, carry=None, goes_on=False)
    ds = dataset(points, {POINT: np.arange(size)}, (size,), asked, found, attributes)
    return ds.drop_vars(POINT).assign_coords({path: (POINT, a) for path, a in swept.items()})
