"""Datasets as files, by their ending: NetCDF or Zarr."""

import os
import shutil
from importlib.util import find_spec
from pathlib import Path

import xarray as xr

from ..._system.files import SUFFIXES

# The engine by which xarray reads and writes them.
_ENGINES = {".nc": "h5netcdf", ".zarr": "zarr"}


def is_machine(file: Path) -> bool:
    """Whether a file is one of a machine, by its ending."""
    return file.suffix.lower() in SUFFIXES


def open_dataset(file: Path) -> xr.Dataset:
    """A dataset whose numbers are read when they are asked for."""
    engine = _engine(file)
    if not file.exists():
        raise ValueError(f"There is no {file}.")
    return xr.open_dataset(file, engine=engine)


def check_target(file: Path) -> None:
    """Refuse a place for a dataset before it is computed."""
    _engine(file)
    check_folder(file)


def check_folder(file: Path) -> None:
    """Refuse a file whose folder is not there, or may not be written to."""
    if not os.access(file.resolve().parent, os.W_OK):
        raise ValueError(f"{file} cannot be written: make the folder {file.resolve().parent} first.")


def write_dataset(ds: xr.Dataset, file: Path) -> None:
    """Write a dataset, and give it its name once it is whole: what had the name before is replaced."""
    part = file.with_name(f"{file.name}.part{file.suffix}")
    if _engine(file) == "zarr":
        ds.to_zarr(part, mode="w")
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
