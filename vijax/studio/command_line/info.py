"""The command `info`."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..._branches.branch import Branch
from ..._descriptions import Description, as_text
from ..._sweep.provenance import system_of
from ..._system.files import look_at, read_table
from ..._system.force_description import NAMED_FORCE
from .datasets import is_machine, open_dataset

_HOW = ("transient", "record", "duration", "carry", "carry_from", "flow", "dtype", "vijax_version")


def add_to(commands: Any) -> None:
    """Add the command and its options."""
    about = (
        "Describe the content of a file: a machine, a sweep and its settings, a branch of periodic orbits."
    )
    parser = commands.add_parser("info", help="describe the content of a file", description=about)
    parser.add_argument("file", type=Path, help="a machine, .toml or .json, or a dataset, .nc or .zarr")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Print a description of a file."""
    words = (
        words_of_machine(args.file) if is_machine(args.file) else words_of_dataset(open_dataset(args.file))
    )
    print(words)  # noqa: T201


def words_of_machine(file: Path) -> str:
    """A machine, and the `sweep` table of its file."""
    table = read_table(file)
    words = repr(look_at(table, file))
    return f"{words}\nsweep\n  {table['sweep']}" if "sweep" in table else words


def words_of_dataset(ds: xr.Dataset) -> str:
    """A branch, or a sweep: machine, swept quantities, results of the points, settings."""
    if "arclength" in ds:
        return repr(Branch(ds.load()))
    return as_text(_describe_sweep, ds) if "result" in ds else repr(ds)


def _describe_sweep(ds: xr.Dataset) -> Description:
    points = ds["result"]
    rows = [(str(dim), _span(ds[dim])) for dim in points.dims]
    codes = points.values
    names = dict(zip(points.attrs["flag_values"], points.attrs["flag_meanings"].split(), strict=True))
    rows += [(names[code], f"{np.count_nonzero(codes == code)} points") for code in np.unique(codes)]
    rows += [("impacts", f"{int(ds['num_impacts'].sum())}, {ds.sizes['impact']} at most recorded of a point")]
    rows += [(name.replace("_", " "), str(ds.attrs[name])) for name in _HOW if name in ds.attrs]
    return Description(f"Sweep of {points.size} points\n  {_machine(ds)}", rows)


def _span(values: xr.DataArray) -> str:
    """Summary of the values along a dimension."""
    if values.dtype.kind not in "iuf":
        return ", ".join(map(str, values.values))
    count = f"{values.size} value{'s' if values.size > 1 else ''}"
    return f"{count} from {values.values.min():.9g} to {values.values.max():.9g}"


def _machine(ds: xr.Dataset) -> str:
    """The machine, or the reason why it is unknown."""
    try:
        return repr(system_of(ds, force=NAMED_FORCE)).replace("\n", "\n  ")
    except ValueError as error:
        return str(error)
