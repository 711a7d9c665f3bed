"""Datasets as files: NetCDF or Zarr, by suffix."""

import os
import shutil
from importlib.util import find_spec
from pathlib import Path

import xarray as xr

from ..._system.files import SUFFIXES

# Engines of xarray by suffix.
_ENGINES = {".nc": "h5netcdf", ".zarr": "zarr"}


def is_machine(file: Path) -> bool:
    """True where the suffix is that of a machine file."""
    return file.suffix.lower() in SUFFIXES


def open_dataset(file: Path) -> xr.Dataset:
    """Open a dataset whose values are read on access."""
    engine = _engine(file)
    if not file.exists():
        raise ValueError(f"There is no {file}.")
    # Consolidated metadata are no part of the format, and Zarr warns of them.
    own = {"consolidated": False} if engine == "zarr" else None
    return xr.open_dataset(file, engine=engine, backend_kwargs=own)


def check_target(file: Path) -> None:
    """Raise if a dataset cannot be written to a file, before it is computed."""
    _engine(file)
    check_folder(file)


def check_folder(file: Path) -> None:
    """Raise if the folder of a file does not exist or is not writable."""
    if not os.access(file.resolve().parent, os.W_OK):
        raise ValueError(f"{file} cannot be written: make the folder {file.resolve().parent} first.")


def write_dataset(ds: xr.Dataset, file: Path) -> None:
    """Write a dataset under a temporary name, then rename it over any earlier file."""
    part = file.with_name(f"{file.name}.part{file.suffix}")
    if _engine(file) == "zarr":
        ds.to_zarr(part, mode="w", consolidated=False)
        shutil.rmtree(file, ignore_errors=True)
    else:
        ds.to_netcdf(part, engine="h5netcdf")
    part.replace(file)


def _engine(file: Path) -> str:
    engine = _ENGINES.get(file.suffix.lower())
    if engine is None:
        raise ValueError(f"Files of datasets end in .nc (NetCDF) or .zarr (Zarr), but this is {str(file)!r}.")
    if find_spec(engine) is None:
        raise ValueError(f"Files in {file.suffix} need the package {engine}: pip install 'vijax[io]'.")
    return engine
