"""Warning of motions that have not settled, with the time that they still take as far as their records show it.

Of a sweep the section alone decides, without the impacts and the machine of each point, which `vx.classify` looks at too.
"""

import warnings

import numpy as np
import xarray as xr

from .._jax.users_line import users_line
from .recurrence import TOLERANCES, Recurrence, periods_left, recurrence

# Fewest recorded periods of which a trend can be told; points at once.
_FEWEST, _BLOCK = 8, 1 << 14


def warn_of_unsettled(found: Recurrence, tolerance: float, record: int, by: str) -> None:
    """Warn how many motions still approach a cycle, and for how long; of nothing if none does.

    Args:
        found: their recurrence in `record` forcing periods.
        tolerance: distance from the cycle below which a motion is on it.
        record: the forcing periods that were compared.
        by: words for the arguments that make motions longer.
    """
    is_so = found.is_settling
    if not is_so.any():
        return
    periods = periods_left(found, tolerance, record)[is_so]
    is_unknown = np.isnan(periods)
    sentences = [f"{is_so.sum()} of {is_so.size} motions have not settled."]
    if not is_unknown.all():
        sentences.append(f"Run on for about {np.nanmax(periods):.0f} forcing periods more, by {by}.")
    if is_unknown.any():
        which = "The" if is_unknown.all() else f"For {is_unknown.sum()} of them the"
        sentences.append(
            f"{which} record of {record} forcing periods shows no rate of approach: record more."
        )
    warnings.warn(" ".join(sentences), stacklevel=users_line())


def warn_of_unsettled_points(ds: xr.Dataset) -> None:
    """Warn of the points of a sweep whose motions have not settled."""
    if "section_x" not in ds or ds.sizes["period"] < _FEWEST:
        return
    tolerance = TOLERANCES[ds["section_x"].dtype.itemsize]
    x, v = (_flat(ds[f"section_{name}"]) for name in ("x", "v"))
    w = 2 * np.pi / ds["forcing_period"].transpose(*_points(ds["section_x"])).values.ravel()
    blocks = [slice(k, k + _BLOCK) for k in range(0, len(x), _BLOCK)]
    found = [recurrence(_relative(w[block], x[block], v[block]), tolerance) for block in blocks]
    whole = Recurrence(*map(np.concatenate, zip(*found, strict=True)))
    warn_of_unsettled(whole, tolerance, ds.sizes["period"], "`transient`")


def _points(a: xr.DataArray) -> list[str]:
    """Dimensions of the points."""
    return [str(dim) for dim in a.dims if dim not in ("period", "mass")]


def _flat(a: xr.DataArray) -> np.ndarray:
    """States of all points, (points, period, mass)."""
    a = a.transpose(*_points(a), "period", "mass")
    return a.values.reshape(-1, *a.shape[-2:])


def _relative(w: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """States relative to the size of the motion, (points, period, states); 0 where a motion has failed."""
    # Points last, because NumPy is slow along short last axes.
    states = np.concatenate([w * x.T, v.T])
    size = np.abs(states).max(axis=(0, 1), initial=0)
    is_failed = ~np.isfinite(size)
    if is_failed.any():
        states[..., is_failed] = 0
    states /= np.where((size > 0) & ~is_failed, size, 1)
    return states.T
