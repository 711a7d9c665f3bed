"""Parts of a sweep joined into one dataset."""

from collections.abc import Sequence
from typing import Any, cast

import xarray as xr

from .._dataset_checks import parsed_attribute
from .._execution.store import difference
from .dataset import FILL
from .short_names import path_of

# Attributes that affect no bit of the results.
_OF_NO_WEIGHT = ("numpy_version", "python_version")


def combine(datasets: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join sweeps over parts of a grid into the sweep over all of it.

    The parts tile the grid: their values follow one another along one swept quantity, or several. Records of impacts
    are padded to the longest of all. Datasets that are read lazily are joined lazily.

    Args:
        datasets: datasets that `vx.sweep` returned for the parts, in any order.

    Returns:
        One dataset, with the values of each swept quantity in the direction in which the parts have them.

    Raises:
        ValueError: if the parts are of different machines, were run with other arguments, or do not tile a grid.

    Example:
        ```python
        import numpy as np, vijax as vx
        system, values = vx.models.wagg_bishop_b(1.0), np.arange(0.3, 2.1, 0.01)
        parts = [vx.sweep(system, {"forcing.frequency": part}) for part in np.array_split(values, 4)]
        ds = vx.combine(parts)
        ```
    """
    datasets = list(datasets)
    if not datasets or not all(isinstance(ds, xr.Dataset) for ds in datasets):
        raise ValueError(
            "Argument `datasets` must be a list of one dataset or more, as `vx.sweep` returns them."
        )
    first = _provenance_of(datasets[0], 0)
    for number, ds in enumerate(datasets):
        clause = difference(first, _provenance_of(ds, number)) or _other_variables(datasets[0], ds)
        if clause is not None:
            raise ValueError(
                f"Argument `datasets` must hold parts of one sweep, but number {number} differs from number 0: {clause}."
            )
    refusal = (
        "Argument `datasets` must tile a grid without a gap: along a swept quantity their values must follow one another, all up or "
        "all down, and none may stand in two of them. "
    )
    # `exact` refuses entries that one part lacks, which would be filled with NaN otherwise.
    options: dict[str, Any] = {"data_vars": "all", "coords": "minimal", "compat": "equals", "join": "exact"}
    try:
        found = cast(xr.Dataset, xr.combine_by_coords(_padded(datasets), **options, combine_attrs="override"))
    except ValueError as error:
        raise ValueError(f"{refusal}{error}") from error
    twice = [str(name) for name, index in found.indexes.items() if not index.is_unique]
    if twice:
        raise ValueError(f"{refusal}Values of `{twice[0]}` stand in two.")
    if "steps" in found and "lane_steps" in found["steps"].attrs:
        found["steps"].attrs["lane_steps"] = sum(ds["steps"].attrs["lane_steps"] for ds in datasets)
    return found


def _provenance_of(ds: xr.Dataset, number: int) -> dict[str, Any]:
    """Attributes that determine the results of a dataset, besides the swept values."""
    if "system" not in ds.attrs:
        raise ValueError(
            "Argument `datasets` must hold datasets with the attributes of `vx.sweep`, but number "
            f"{number} has no `system`."
        )
    of_json = {
        name: parsed_attribute(ds, name)
        for name in ("system", "family", "force_parameters")
        if name in ds.attrs
    }
    damaged = [name for name, a in of_json.items() if a is None]
    if damaged:
        raise ValueError(f"The attribute `{damaged[0]}` of dataset {number} cannot be read as JSON.")
    return {name: a for name, a in ds.attrs.items() if name not in _OF_NO_WEIGHT} | of_json


def _other_variables(first: xr.Dataset, ds: xr.Dataset) -> str | None:
    """The first difference of two datasets in their variables or dimensions, as a clause."""
    there, here = (
        {str(name): f"{a.dims}{path_of(one, name)}" for name, a in one.variables.items()}
        for one in (first, ds)
    )
    return difference(there, here)


def _padded(datasets: list[xr.Dataset]) -> list[xr.Dataset]:
    """All datasets with room for as many impacts as the longest."""
    longest = max(ds.sizes.get("impact", 0) for ds in datasets)
    return [
        ds.pad(
            impact=(0, longest - ds.sizes["impact"]),
            constant_values={name: FILL.get(str(name), float("nan")) for name in ds.data_vars},
        )
        if "impact" in ds.dims
        else ds
        for ds in datasets
    ]
