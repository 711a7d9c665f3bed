"""Shared checks of results that are printed, labelled, and written to files."""

import html
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

# A title, and the lines that fit below it without scrolling.
MOST_LINES, MOST_COLUMNS = 11, 110
FILES = {
    "NetCDF by h5netcdf": (
        "h5netcdf",
        lambda ds, path: ds.to_netcdf(path, engine="h5netcdf"),
        xr.open_dataset,
    ),
    "Zarr, format 2": ("zarr", lambda ds, path: ds.to_zarr(path, zarr_format=2), xr.open_zarr),
    "Zarr, format 3": (
        "zarr",
        lambda ds, path: ds.to_zarr(path, zarr_format=3, consolidated=False),
        lambda path: xr.open_zarr(path, consolidated=False),
    ),
}


def show(thing: object) -> str:
    """Printed text, after a check of its size and of the table in notebooks."""
    text, table = repr(thing), thing._repr_html_()
    lines = text.splitlines()
    assert len(lines) <= MOST_LINES
    assert max(map(len, lines)) <= MOST_COLUMNS
    assert "color" not in table
    assert "background" not in table
    plain = html.unescape(re.sub(r"<[^>]*>", "", table))
    assert re.sub(r"\s", "", plain) == re.sub(r"\s", "", text)
    return text


def names_of(codes: xr.DataArray) -> list[str]:
    """Codes in words, from their attributes."""
    names = dict(zip(codes.attrs["flag_values"], codes.attrs["flag_meanings"].split(), strict=True))
    return [names[code] for code in codes.values.ravel()]


def assert_comes_back(ds: xr.Dataset, way: str, path: Path) -> xr.Dataset:
    """Write to a file, read it again, and compare, down to the kind and size of the numbers."""
    module, write, read = FILES[way]
    pytest.importorskip(module)
    write(ds, path)
    with read(path) as found:
        xr.testing.assert_identical(found, ds)
        for name, variable in ds.variables.items():
            assert (
                np.asarray(found[name]).dtype.kind == np.asarray(variable).dtype.kind or name == "direction"
            )
            assert found[name].dtype.itemsize == variable.dtype.itemsize or name == "direction"
    return found
