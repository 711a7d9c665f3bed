"""A grid that is run where its kind of motion changes.

Every `stride`-th point is run in both directions. Then cells whose corners differ are halved until no smaller one is
on the grid. Every other point lies in a cell whose corners are of one kind. A kind or a count is filled in from the
nearest corner, a quantity that varies within one kind as the mean of all four, weighted by distance.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr

from .._dataset_attributes import variable_attributes


class _Cells(NamedTuple):
    """Cells of the grid, by the indices of their first and last rows and columns, of one shape each."""

    left: np.ndarray
    right: np.ndarray
    bottom: np.ndarray
    top: np.ndarray

    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the corners, (4, ...)."""
        rows = np.stack([self.left, self.left, self.right, self.right])
        return rows, np.stack([self.bottom, self.top, self.bottom, self.top])

    def chosen(self, which: np.ndarray) -> "_Cells":
        return _Cells(*(a[which] for a in self))

    def halved(self) -> "_Cells":
        """The parts of all cells, halved in every direction in which a point lies between."""
        parts = []
        for across in _halves(self.left, self.right):
            parts += [_Cells(*across, *along) for along in _halves(self.bottom, self.top)]
        whole = _Cells(*(np.concatenate(a) for a in zip(*parts, strict=True)))
        return whole.chosen((whole.right > whole.left) & (whole.top > whole.bottom))


def _halves(first: np.ndarray, last: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Both halves of intervals; the first is empty where an interval has no point inside."""
    middle = (first + last) // 2
    return [(first, middle), (middle, last)]


def refined(
    axes: dict[str, np.ndarray],
    stride: int,
    run: Callable[[np.ndarray], Iterator[tuple[np.ndarray, xr.Dataset]]],
    kind_by: tuple[str, ...],
) -> xr.Dataset:
    """Run the coarse grid, and halve cells whose corners differ until every point is run or filled.

    Args:
        axes: the values along both directions.
        stride: steps of the grid between the first points.
        run: computes the variables at points, given by their indices in the whole grid, one part after another.
        kind_by: the variables by which corners differ.
    """
    shape = tuple(len(axis) for axis in axes.values())
    is_known, columns = np.zeros(shape, bool), {}
    kinds: dict[tuple, int] = {}
    kind = np.full(shape, -1)
    # The cell from which each point is filled; for points that were run it is a single point.
    within = _Cells(*(np.zeros(shape, np.int32) for _ in range(4)))
    cells = _coarse(shape, stride)
    while cells.left.size:
        rows, cols = cells.corners()
        due = np.unique(np.ravel_multi_index((rows.ravel(), cols.ravel()), shape))
        for part, found in run(due[~is_known.ravel()[due]]):
            is_known.ravel()[part] = True
            kind.ravel()[part] = _kinds(found, kinds, kind_by)
            row, col = np.unravel_index(part, shape)
            for a, own in zip(within, (row, row, col, col), strict=True):
                a[row, col] = own
            for name, a in found.data_vars.items():
                if name not in columns:
                    columns[name] = (a.dims[1:], np.zeros((is_known.size, *a.shape[1:]), a.dtype), a.attrs)
                columns[name][1][part] = a.values
        corners = kind[rows, cols]
        is_one = (corners == corners[0]).all(axis=0)
        _fill(within, is_known, cells.chosen(is_one))
        is_small = (cells.right - cells.left <= 1) & (cells.top - cells.bottom <= 1)
        cells = cells.chosen(~is_one & ~is_small).halved()
    variables = {
        str(name): ((*axes, *own), _interpolated(within, a), attributes)
        for name, (own, a, attributes) in columns.items()
    }
    is_computed = tuple(axes), is_known, variable_attributes("is_computed")
    return xr.Dataset(
        variables | {"is_computed": is_computed},
        coords={path: (path, axis, variable_attributes(path)) for path, axis in axes.items()},
    )


def _coarse(shape: tuple[int, ...], stride: int) -> _Cells:
    """All cells between points `stride` steps apart, including the last row and column."""
    edges = [np.append(np.arange(0, size - 1, stride), size - 1) for size in shape]
    first = np.meshgrid(*(edge[:-1] for edge in edges), indexing="ij")
    last = np.meshgrid(*(edge[1:] for edge in edges), indexing="ij")
    return _Cells(first[0].ravel(), last[0].ravel(), first[1].ravel(), last[1].ravel())


def _kinds(found: xr.Dataset, kinds: dict[tuple, int], kind_by: tuple[str, ...]) -> np.ndarray:
    """A number for each kind of motion, the same in every round."""
    columns = [np.nan_to_num(found[name].values, nan=-2, posinf=-1) for name in kind_by]
    rows = np.column_stack(columns).astype(int)
    own, of_point = np.unique(rows, axis=0, return_inverse=True)
    numbers = np.array([kinds.setdefault(tuple(row), len(kinds)) for row in own.tolist()])
    return numbers[of_point.ravel()]


def _fill(within: _Cells, is_known: np.ndarray, cells: _Cells) -> None:
    """Record, in place, the cell of every point in some cells that was not run."""
    across, along = cells.right - cells.left, cells.top - cells.bottom
    for width, height in np.unique(np.stack([across, along]), axis=1).T:
        own = cells.chosen((across == width) & (along == height))
        i, j = np.arange(width + 1)[:, None], np.arange(height + 1)[None]
        rows, cols = np.broadcast_arrays(own.left[:, None, None] + i, own.bottom[:, None, None] + j)
        is_free = ~is_known[rows, cols]
        for a, edge in zip(within, own, strict=True):
            a[rows[is_free], cols[is_free]] = np.broadcast_to(edge[:, None, None], rows.shape)[is_free]


def _interpolated(within: _Cells, a: np.ndarray) -> np.ndarray:
    """Values at all points, (right, up, ...), from those at the points that were run, (points, ...).

    Whole numbers are those of the nearest corner. Floats are linear between the corners in both directions where all
    are finite. Complex numbers are linear in magnitude, by which they are sorted, and have the angle of the nearest
    corner.
    """
    shape = within.left.shape
    ours = a.reshape(*shape, -1)
    row, col = np.arange(shape[0])[:, None], np.arange(shape[1])[None]
    width, height = within.right - within.left, within.top - within.bottom
    of_right, of_top = row - within.left, col - within.bottom
    nearest = (
        np.where(2 * of_right > width, within.right, within.left),
        np.where(2 * of_top > height, within.top, within.bottom),
    )
    near = ours[nearest]
    if np.issubdtype(a.dtype, np.inexact):
        u, v = of_right / np.maximum(width, 1), of_top / np.maximum(height, 1)
        weights = np.stack([(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v])[..., None]
        size = np.abs(ours) if np.iscomplexobj(a) else ours
        with np.errstate(invalid="ignore"):  # infinity times a weight of zero is not used
            mean = (weights * size[within.corners()]).sum(axis=0)
        if np.iscomplexobj(a):
            mean = mean * np.exp(1j * np.angle(near))
        is_between = np.isfinite(mean) & (width + height > 0)[..., None]
        near = np.where(is_between, mean, near).astype(a.dtype)
    return near.reshape(*shape, *a.shape[1:])
