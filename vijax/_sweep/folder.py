"""A folder in Zarr's format to which a sweep is written block by block.

A block is a part of the grid and a chunk of every array: to write it touches no file of another block. The length of
its longest impact record is written last, into an array of its own, and marks the block as done. The number of its
files is written just before: Zarr makes no file for a chunk that equals the fill value, so a file that was lost, by a
copy cut short or where old files are deleted, would read as points not run. Zarr gives a file its name when it is
whole. The arrays have room for as many impacts as any point may have; unwritten parts take no disk space. At the end
the room is cut to what is used.
"""

import contextlib
import os
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
import xarray as xr

from .._execution.store import read_manifest
from .._writing import naming_argument
from .dataset import FILL

# Impacts of a point in one file.
_COLUMNS = 64
# _BLOCKS: group whose attributes hold the manifest.
# _LONGEST: longest impact record of every block, -1 where it is not done.
# _FILES: number of files of every block, -1 where it is not done.
# _MANIFEST: file of these attributes.
_BLOCKS, _LONGEST, _FILES, _MANIFEST = "blocks", "blocks/longest", "blocks/files", "blocks/zarr.json"
# Fill values of points that are not run yet; other floats are NaN, other numbers 0.
_NOT_RUN = {"result": -1} | FILL


@dataclass(frozen=True)
class Folder:
    """Folder to which a sweep is written.

    Attributes:
        path: the folder.
        shape: number of points of the whole sweep along each path.
        block: number of points of one block along each path; the last block may have fewer.
        max_impacts: room for the impacts of one point.
    """

    path: Path
    shape: tuple[int, ...]
    block: tuple[int, ...]
    max_impacts: int

    @property
    def blocks(self) -> tuple[int, ...]:
        """Number of blocks along each path."""
        return tuple(-(-size // part) for size, part in zip(self.shape, self.block, strict=True))

    def slices(self, number: int) -> tuple[slice, ...]:
        """Place of a block in the grid."""
        place = np.unravel_index(number, self.blocks)
        return tuple(
            slice(k * part, (k + 1) * part) for k, part in zip(map(int, place), self.block, strict=True)
        )

    def done(self) -> Callable[[int], bool]:
        """Predicate of block numbers: true if the block is written and all its files exist at the time of the call."""
        group = _group(self.path)
        # Once a block is done all arrays have been made, so they are looked up once.
        arrays = cache(lambda: dict(group.arrays()))

        def is_done(number: int) -> bool:
            longest = int(group[_LONGEST][number])
            return longest >= 0 and self._num_files(arrays(), number, longest) == int(group[_FILES][number])

        return is_done

    def write(self, number: int, ds: xr.Dataset) -> None:
        """Write the results of a block."""
        group = _group(self.path)
        room = -(-ds.sizes["impact"] // _COLUMNS) * _COLUMNS
        for name, variable in ds.data_vars.items():
            own, a = variable.dims[len(self.shape) :], variable.values
            if name not in group:
                self._create(group, str(name), variable)
            region = (*self.slices(number), *(slice(None) for _ in own))
            if "impact" in own:
                missing = [(0, 0)] * len(self.shape) + [(0, room - a.shape[-1])]
                a = np.pad(a, missing, constant_values=_not_run(str(name), a.dtype))
                region = (*region[:-1], slice(0, room))
            group[name][region] = a
        group[_FILES][number] = self._num_files(dict(group.arrays()), number, ds.sizes["impact"])
        group[_LONGEST][number] = ds.sizes["impact"]

    def _num_files(self, arrays: dict[str, Any], number: int, longest: int) -> int:
        """Number of files that exist of a block."""
        place, count = tuple(map(int, np.unravel_index(number, self.blocks))), 0
        for name, a in arrays.items():
            own = a.metadata.dimension_names[len(self.shape) :]
            if a.shape[: len(self.shape)] != self.shape or a.chunks[: len(self.shape)] != self.block:
                continue  # the swept values
            columns = -(-longest // _COLUMNS) if own[-1:] == ("impact",) else 1
            chunks = [(*place, *(0,) * (len(own) - 1), *((k,) if own else ())) for k in range(columns)]
            count += sum((self.path / name / a.metadata.encode_chunk_key(chunk)).exists() for chunk in chunks)
        return count

    def _create(self, group: Any, name: str, variable: xr.DataArray) -> None:
        """Make an array for the whole sweep, unless another process does at this moment."""
        own = {
            dim: (size, size)
            for dim, size in variable.sizes.items()
            if dim not in variable.dims[: len(self.shape)]
        }
        if "impact" in own:
            own["impact"] = -(-self.max_impacts // _COLUMNS) * _COLUMNS, _COLUMNS
        attributes = {
            key: a.tolist() if isinstance(a, np.ndarray) else a for key, a in variable.attrs.items()
        }
        attributes.pop("lane_steps", None)  # of this block alone
        with contextlib.suppress(_exists()):
            group.create_array(
                name,
                shape=(*self.shape, *(whole for whole, _ in own.values())),
                chunks=(*self.block, *(max(part, 1) for _, part in own.values())),
                dtype=variable.dtype,
                fill_value=_not_run(name, variable.dtype),
                dimension_names=[str(dim) for dim in variable.dims],
                attributes=attributes,
            )

    def open(self) -> xr.Dataset:
        """Open the dataset lazily, its room for impacts cut to the longest record."""
        group = _group(self.path)
        longest = int(np.max(group[_LONGEST][...]))
        room = -(-longest // _COLUMNS) * _COLUMNS
        for name, a in group.arrays():
            if a.metadata.dimension_names[-1:] == ("impact",) and a.shape[-1] > room:
                group[name].resize((*a.shape[:-1], room))
        return xr.open_zarr(self.path, consolidated=False).isel(impact=slice(0, longest))


def open_folder(folder: Folder, coordinates: xr.Dataset, manifest: dict[str, Any]) -> Folder:
    """Begin a folder, or continue one that holds the same sweep.

    The folder is made under a temporary name and renamed when it is whole: one process, the first, begins it.

    Args:
        folder: the folder to begin; if it exists already, its blocks may be others.
        coordinates: swept values, and attributes of the dataset.
        manifest: description of the sweep, see `describe_sweep`.

    Returns:
        The folder with the blocks that it has.

    Raises:
        ValueError: if the path holds something else.
    """
    path = folder.path
    if not (path / _MANIFEST).exists():
        if path.exists() and not (path.is_dir() and not any(path.iterdir())):
            raise ValueError(
                f"Argument `out` must name a new or empty folder, or one of the same sweep, but {path} is neither."
            )
        part = path.with_name(f"{path.name}.{uuid.uuid4().hex}.part")
        try:
            with naming_argument("out", path):
                coordinates.to_zarr(part, zarr_format=3, consolidated=False)
                for name in (_LONGEST, _FILES):
                    _group(part).create_array(
                        name, shape=(int(np.prod(folder.blocks)),), chunks=(1,), dtype=np.int32, fill_value=-1
                    )
                _group(part)[_BLOCKS].attrs.update({"block": folder.block, "sweep": manifest})
            with contextlib.suppress(OSError):  # another process was first
                os.replace(part, path)
        finally:
            rmtree(part, ignore_errors=True)
    block = read_manifest(
        path, _MANIFEST, manifest, lambda recorded: tuple(map(int, recorded["block"])), "attributes"
    )
    return Folder(path, folder.shape, block, folder.max_impacts)


def _group(path: Path) -> Any:
    from zarr import open_group  # slow to import, and rarely needed

    return open_group(path, mode="r+")


def _exists() -> type[Exception]:
    from zarr.errors import ContainsArrayError

    return ContainsArrayError


def _not_run(name: str, dtype: np.dtype) -> Any:
    """Fill value of a point that is not run yet."""
    return _NOT_RUN.get(name, np.nan if dtype.kind == "f" else dtype.type(0).item())
