"""Warnings about points that did not end successfully."""

import warnings

import numpy as np
import xarray as xr

from .._dataset_checks import check_columns
from .._jax.users_line import users_line
from .._trajectory.results import RESULTS

_NAMES = list(RESULTS._name_to_item)


def warn_of_endings(ds: xr.Dataset, *names: str) -> None:
    """Warn, once for each of these members of `RESULTS`, how many points have it.

    The message of the member says what to do.
    """
    check_columns(ds, "`vx.sweep`", {"result": ()})
    if ds.attrs.get("max_impacts") == 0:  # no log was requested
        names = tuple(name for name in names if name != "max_impacts_reached")
    results = ds["result"].values
    for name in names:
        count = np.count_nonzero(results == code_of(name))
        if count:
            message = RESULTS[getattr(RESULTS, name)]
            warnings.warn(f"{count} of {results.size} points ended with {message}", stacklevel=users_line())


def warn_of_unsettled(count: int, of: int, transient: int) -> None:
    """Warn that the attractor of `count` of `of` starts is not known."""
    if count:
        warnings.warn(
            f"{count} of {of} starts have not settled, even run on for many times the transient: they may be in "
            f"chaos that dies out slowly, or near a bifurcation. Increase `transient`, now {transient}.",
            stacklevel=users_line(),
        )


def warn_of_starts_beyond(count: int, of: int) -> None:
    """Warn that `count` of the `of` starts of a grid are no starts."""
    if count:
        warnings.warn(
            f"{count} of {of} starts of the grid lie beyond a stop: they were not run, and their label is -1.",
            stacklevel=users_line(),
        )


def code_of(name: str) -> int:
    """Code of a result in a dataset."""
    return _NAMES.index(name)
