"""Checks that a dataset, which may come from any file, holds what a function reads of it."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from ._jax.arrays import check_type

# Kinds of the types of real numbers and flags in NumPy, and columns of complex numbers.
_REAL, _COMPLEX = "biuf", ("multipliers",)
# Columns that motions followed for a `duration` do not have.
_OF_PERIODS = {
    "forcing_period",
    "impact_phase",
    "section_x",
    "section_v",
    "section_position",
    "section_velocity",
}
# Dimensions along which there may be nothing.
_MAY_BE_EMPTY = {"stop", "impact", "event", "attractor", "section"}


def check_is_dataset(ds: Any, argument: str, source: str) -> None:
    """Reject what is no dataset; `source` is the function that makes such, as the user calls it."""
    check_type(argument, ds, xr.Dataset, f"a dataset, what {source} returned")


def check_columns(ds: xr.Dataset, source: str, columns: Mapping[str, tuple[str, ...]]) -> None:
    """Reject a dataset without these columns of numbers, or with columns that lack these dimensions; they may have others.

    `source` is the function that makes such datasets, as the user calls it.
    """
    for name, dims in columns.items():
        if name not in ds.variables and name in _OF_PERIODS and "duration" in ds.attrs:
            raise ValueError(
                f"The dataset is of motions followed for a `duration`, without forcing periods, so it has no `{name}`: pass one of "
                f"{source} with `transient` and `record`."
            )
        if name not in ds.variables:
            clause = f"has no `{name}`"
        elif missing := set(dims) - set(ds[name].dims):
            clause = f"has no dimension `{min(missing)}` of `{name}`"
        elif empty := [dim for dim in ds[name].dims if not (ds.sizes[dim] or dim in _MAY_BE_EMPTY)]:
            clause = f"has nothing along `{empty[0]}`"
        elif ds[name].dtype.kind not in _REAL + "c" * (name in _COMPLEX):
            clause = f"has a `{name}` that holds no numbers"
        else:
            continue
        raise ValueError(f"The dataset {clause}: pass one of {source}, with all its columns.")


def parsed_attribute(ds: xr.Dataset, name: str) -> Any:
    """Value of an attribute that is a text of JSON; None if it is missing or another text."""
    try:
        return json.loads(ds.attrs[name])
    except (KeyError, TypeError, ValueError):
        return None


def finite_attribute(ds: xr.Dataset, name: str) -> float | None:
    """Value of an attribute that is a finite number; None if it is missing or something else."""
    value = ds.attrs.get(name)
    if not isinstance(value, int | float | np.integer | np.floating):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) else None
