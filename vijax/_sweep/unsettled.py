"""Word of the points of a sweep whose motions have not settled, in a line above the progress bar.

The section alone decides, without the impacts and the machine of each point, which `vx.classify` looks at too.
"""

import sys

import numpy as np
import xarray as xr

from .._progress import tqdm
from .recurrence import TOLERANCES, periods_left, recurrence

# Fewest recorded periods of which a trend can be told; points at once.
_FEWEST, _BLOCK = 8, 1 << 14


def say_unsettled(ds: xr.Dataset, who: str) -> None:
    """Print on stderr how many motions still approach a cycle, and for how long; nothing if none does. `who` runs them."""
    if "section_x" not in ds or ds.sizes["period"] < _FEWEST:
        return
    tolerance = TOLERANCES[ds["section_x"].dtype.itemsize]
    x, v = (_flat(ds[f"section_{name}"]) for name in ("x", "v"))
    w = 2 * np.pi / ds["forcing_period"].transpose(*_points(ds["section_x"])).values.ravel()
    blocks = [slice(k, k + _BLOCK) for k in range(0, len(x), _BLOCK)]
    found = [recurrence(_relative(w[block], x[block], v[block]), tolerance) for block in blocks]
    is_settling, error, contraction = (
        np.concatenate([getattr(one, name) for one in found])
        for name in ("is_settling", "error", "contraction")
    )
    if is_settling.any():
        periods = periods_left(error[is_settling], contraction[is_settling], tolerance)
        by = "" if periods is None else f" by about {periods} forcing periods"
        count = f"{is_settling.sum()} of {is_settling.size} motions"
        tqdm.write(f"{who}: {count} have not settled; increase `transient`{by}", file=sys.stderr)


def _points(a: xr.DataArray) -> list[str]:
    """Dimensions of the points."""
    return [str(dim) for dim in a.dims if dim not in ("period", "mass")]


def _flat(a: xr.DataArray) -> np.ndarray:
    """States of all points, (points, period, mass)."""
    a = a.transpose(*_points(a), "period", "mass")
    return a.values.reshape(-1, *a.shape[-2:])


def _relative(w: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """States relative to the size of the motion, (points, period, states); 0 where a motion has failed."""
    states = np.concatenate([w[:, None, None] * x, v], axis=2)
    states = np.where(np.isfinite(states).all(axis=(1, 2), keepdims=True), states, 0)
    size = np.abs(states).max(axis=(1, 2), keepdims=True, initial=0)
    return states / np.where(size > 0, size, 1)
