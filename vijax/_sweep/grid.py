"""Points of a sweep: given values, and all their combinations."""

from collections.abc import Mapping

import jax
import numpy as np

from .._dataset_attributes import check_column
from .._execution.points import LaneInput, points_of_lanes
from .._jax.arrays import Numbers, as_float
from .._system.system import AnySystem, ImpactSystem


def values_of(values: Mapping[str, Numbers]) -> dict[str, np.ndarray]:
    """Values of every swept quantity, at least one, (points, ...)."""
    axes = {path: np.asarray(as_float(v, path)) for path, v in values.items()}
    if not axes:
        raise ValueError("Argument `values` is empty: name a quantity to sweep, or use `simulate`.")
    if "mass" in axes:
        raise ValueError(
            "The path `mass` names a dimension already: sweep `mass[0]`, `mass[1]`, ... instead, or give the value of a family "
            "another name."
        )
    for path, axis in axes.items():
        if axis.ndim == 0 or len(axis) == 0:
            raise ValueError(f"The values of `{path}` must have shape (points, ...), but have {axis.shape}.")
    return axes


def base_of(system: AnySystem, x0: Numbers | None, v0: Numbers | None) -> LaneInput:
    """Machine, or family, and start where nothing is swept."""
    n = system.num_masses
    given = {"x0": x0, "v0": v0}
    starts = (np.zeros(n) if a is None else np.asarray(as_float(a, name)) for name, a in given.items())
    base = LaneInput(system, *starts)
    for name in ("x0", "v0"):
        if getattr(base, name).shape not in ((n,), (system.num_coordinates,)):
            raise ValueError(
                f"Argument `{name}` must have shape ({n},), but has {getattr(base, name).shape}."
            )
    return base


def grid_points(
    base: LaneInput, axes: dict[str, np.ndarray], *, twice: bool = False, counts_periods: bool = True
) -> LaneInput[ImpactSystem]:
    """Machines and starts of a product grid; of two grids, one after the other, if `twice`.

    `counts_periods` is true where the load must have a period.
    """
    dtype = base.system.mass.dtype
    grid = np.indices([len(axis) for axis in axes.values()]).reshape(len(axes), -1)
    grid = np.tile(grid, 2 if twice else 1)
    values = {path: axis.astype(dtype) for path, axis in axes.items()}
    places = dict(zip(axes, grid, strict=True))
    points = points_of_lanes(base, values, places, counts_periods=counts_periods)
    points = jax.tree.map(lambda a: np.asarray(a, dtype), points)
    for path in axes:
        check_column(path)
    full = lambda a: np.array(np.broadcast_to(a, (len(a), grid.shape[1])))  # noqa: E731
    return LaneInput(points.system, full(points.x0), full(points.v0))
