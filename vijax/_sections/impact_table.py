"""The recorded impacts of a sweep as a table, a row an impact."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from .._dataset_checks import check_columns, check_is_dataset
from .._sweep.outcomes import warn_of_endings
from .record import dims_of, flattened_points

if TYPE_CHECKING:
    import pandas as pd

# Columns after those of the swept quantities, and the variables of the dataset that they come from.
_COLUMNS = {
    "stop": "impact_stop",
    "time": "impact_time",
    "phase": "impact_phase",
    "velocity": "impact_velocity",
    "relative_velocity": "impact_relative_velocity",
}


def impacts(ds: xr.Dataset) -> "pd.DataFrame":
    """List the recorded impacts of a sweep in a table with one row per impact.

    Args:
        ds: result of `vx.sweep`, or a part of it, over any number of swept quantities.

    Returns:
        `pandas.DataFrame` with a column for every swept quantity, by its name in the dataset; for a sweep up and down
        also `direction`; then `stop`, its index; `time` since the end of the transient; `phase` W t mod 2 pi, radians, where
        periods are counted; signed `velocity` before the impact; and where stops move `relative_velocity`, counted from theirs. Rows are
        ordered by point, then by time; points without impacts have none. A warning reports points with unrecorded
        impacts.

    Raises:
        ValueError: if the dataset has no recorded impacts, as that of another function.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_b(0.8), {"forcing.frequency": np.linspace(0.5, 1.0, 20)})
        table = vx.impacts(ds)
        mean_speed = table.velocity.abs().groupby([table["forcing.frequency"], table.stop]).mean()
        ```
    """
    import pandas as pd  # slow to import

    check_is_dataset(ds, "ds", "`vx.sweep`")
    missing = [name for name in ("result", *_COLUMNS.values()) if name not in ds]
    phase = {"impact_phase"} if "duration" in ds.attrs else set()
    if set(missing) - {"impact_relative_velocity"} - phase:
        raise ValueError(f"Argument `ds` must be what `vx.sweep` returned, but has no {', '.join(missing)}.")
    there = [name for name in _COLUMNS.values() if name in ds]
    check_columns(ds, "`vx.sweep`", {"result": (), **dict.fromkeys(there, ("impact",))})
    warn_of_endings(ds, "max_impacts_reached")
    of_stop = flattened_points(ds, ds["impact_stop"], "impact")
    point, number = np.nonzero(of_stop >= 0)
    columns = {name: values[point] for name, values in _swept_columns(ds).items()}
    for name, variable in _COLUMNS.items():
        if variable in ds:
            columns[name] = flattened_points(ds, ds[variable], "impact")[point, number]
    return pd.DataFrame(columns)


def _swept_columns(ds: xr.Dataset) -> dict[str, np.ndarray]:
    """Values of every quantity that has one at a point, selected ones included, (points,)."""
    grid = dims_of(ds)
    shape = ds["result"].transpose(*grid)
    of_points = {name: a for name, a in ds.coords.items() if set(a.dims) <= set(grid) and name != "stop_mass"}
    names = [*(dim for dim in grid if dim in of_points), *(name for name in of_points if name not in grid)]
    values = {
        str(name): of_points[name].broadcast_like(shape).transpose(*grid).values.ravel() for name in names
    }
    # Pandas has no columns of NumPy's text of variable length.
    return {name: a if a.dtype.kind in "fiub" else a.astype(object) for name, a in values.items()}
