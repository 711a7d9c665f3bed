"""Charts of the motions over a plane of two parameters, computed where they change.

Regions of one motion are wide and their boundaries thin. So a coarse grid is run first, and cells of it whose corners
differ are halved until they are as small as the grid asked for; the others are filled with the motion of their corners.
A region, or a tongue of one, thinner than the coarse grid may be missed where it touches none of its points.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from .._dataset_attributes import label
from .._execution.points import Point
from .._execution.runner import Counts
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._progress import tqdm
from .._sweep.grid import base_of, values_of
from .._sweep.zipped import START, sweep_zipped
from .._system.system import ImpactSystem, with_args
from .._types import Count, Numbers, whole_number
from .classify import classify

# Points that are run and judged at a time: their logs are in memory together.
_TOGETHER = 4096


def chart(
    system: ImpactSystem,
    values: Mapping[str, Numbers],
    *,
    stride: Count = 8,
    transient: Count = 100,
    record: Count = 20,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    args: object = None,
    flow: AbstractFlow | None = None,
    lyapunov: bool = False,
    tolerance: float | None = None,
    max_impacts: Count = 2048,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Say which motion is found where in a plane of two parameters, refined where the motion changes.

    What `vx.classify(vx.sweep(system, values))` finds on the whole grid, for a fraction of the points: first every
    `stride`-th point is run in both directions, then cells whose corners differ in motion, periods or impacts
    are halved until no smaller one is on the grid. The rest is filled with the motion of the corners. What is thinner
    than `stride` steps of the grid may be missed; `stride=1` runs every point.

    Args:
        system: the machine.
        values: two paths and their values, as for `vx.sweep`, in increasing or decreasing order.
        stride: steps of the grid between the first points.
        transient: as for `vx.sweep`.
        record: likewise.
        x0: likewise.
        v0: likewise.
        args: likewise.
        flow: likewise.
        lyapunov: likewise; only points that were run have exponents.
        tolerance: as for `vx.classify`.
        max_impacts: as for `vx.sweep`.
        executor: as for `vx.sweep`.
        progress: show a bar, of the points of each round of halving.
        settings: as for `vx.sweep`.

    Returns:
        Over both paths, `motion`, `num_periods` and `num_impacts` (..., stop) as `vx.classify` tells them, for
        `vx.plot.regions`; `is_computed`, whether the point was run; and with `lyapunov` the `lyapunov_exponents`
        (..., exponent) and `lyapunov_error`, NaN elsewhere.

    Raises:
        ValueError: for other than two paths of two values or more, or as `vx.sweep` does.

    Example:
        ```python
        import numpy as np, vijax as vx
        plane = {"forcing.frequency": np.linspace(0.4, 2, 129), "forcing.amplitude[0]": np.linspace(0.2, 1, 65)}
        ax = vx.plot.regions(vx.chart(vx.models.wagg_bishop_a(1.0), plane))
        ```
    """
    stride = whole_number("stride", stride, 1)
    axes = values_of(values)
    if len(axes) != 2 or any(axis.ndim != 1 or len(axis) < 2 for axis in axes.values()):
        raise ValueError(
            "A chart needs two paths with two numbers or more each, but has "
            + ", ".join(f"`{path}` of shape {axis.shape}" for path, axis in axes.items())
            + ": use `vx.sweep` for others."
        )
    counts = Counts(
        whole_number("transient", transient),
        whole_number("record", record, 2),
        whole_number("max_impacts", max_impacts),
        max_steps=None,
        can_stick=True,
        lyapunov=bool(lyapunov),
    )
    base = base_of(with_args(system, args), x0, v0)
    grid = _Grid(*(len(axis) for axis in axes.values()))

    def run(where: np.ndarray) -> Iterator[tuple[np.ndarray, xr.Dataset]]:
        with tqdm(total=len(where), unit="point", disable=not progress) as bar:
            for first in range(0, len(where), _TOGETHER):
                part = where[first : first + _TOGETHER]
                index = np.unravel_index(part, grid.shape)
                swept = {path: axis[i] for (path, axis), i in zip(axes.items(), index, strict=True)}
                yield part, _judged(base, swept, counts, flow, settings, executor, tolerance, bar.update)

    return _refined(grid, axes, stride, run)


class _Grid(NamedTuple):
    """How many points there are in both directions."""

    right: int
    up: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.right, self.up


def _judged(
    base: Point,
    swept: dict[str, np.ndarray],
    counts: Counts,
    flow: AbstractFlow | None,
    settings: ExecutionSettings,
    executor: object,
    tolerance: float | None,
    tell: Callable[[int], object],
) -> xr.Dataset:
    """What becomes of some points."""
    start = np.concatenate([base.x0, base.v0])
    states = np.broadcast_to(start, (len(next(iter(swept.values()))), len(start)))
    ds = sweep_zipped(base.system, swept, states, counts, flow, settings, executor, tell)
    motions = classify(ds, tolerance=tolerance)[["motion", "num_periods", "num_impacts"]]
    if counts.lyapunov:
        motions = motions.assign({name: ds[name] for name in ("lyapunov_exponents", "lyapunov_error")})
    return motions.transpose(START, ...)


class _Cells(NamedTuple):
    """Cells of the grid, by the numbers of their first and last rows and columns, (cells,) each."""

    left: np.ndarray
    right: np.ndarray
    bottom: np.ndarray
    top: np.ndarray

    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the corners, (4, cells)."""
        rows = np.stack([self.left, self.left, self.right, self.right])
        return rows, np.stack([self.bottom, self.top, self.bottom, self.top])

    def chosen(self, which: np.ndarray) -> "_Cells":
        return _Cells(*(a[which] for a in self))

    def halved(self) -> "_Cells":
        """The parts of all cells, halved in every direction in which there is a point between."""
        parts = []
        for across in _halves(self.left, self.right):
            parts += [_Cells(*across, *along) for along in _halves(self.bottom, self.top)]
        whole = _Cells(*(np.concatenate(a) for a in zip(*parts, strict=True)))
        return whole.chosen((whole.right > whole.left) & (whole.top > whole.bottom))


def _halves(first: np.ndarray, last: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Both halves of intervals; the first is empty where an interval has no point inside."""
    middle = (first + last) // 2
    return [(first, middle), (middle, last)]


def _refined(
    grid: _Grid,
    axes: dict[str, np.ndarray],
    stride: int,
    run: Callable[[np.ndarray], Iterator[tuple[np.ndarray, xr.Dataset]]],
) -> xr.Dataset:
    """Run the coarse grid, and halve cells whose corners differ until all is known."""
    is_known, columns, attributes = np.zeros(grid.shape, bool), {}, {}
    kinds: dict[tuple, int] = {}
    kind = np.full(grid.shape, -1)
    source = np.full(grid.shape, -1)  # the point whose motion each has
    cells = _coarse(grid, stride)
    while cells.left.size:
        rows, cols = cells.corners()
        due = np.unique(np.ravel_multi_index((rows.ravel(), cols.ravel()), grid.shape))
        for part, found in run(due[~is_known.ravel()[due]]):
            is_known.ravel()[part] = True
            kind.ravel()[part], source.ravel()[part] = _kinds(found, kinds), part
            for name, a in found.data_vars.items():
                if name not in columns:
                    columns[name] = (a.dims[1:], np.zeros((is_known.size, *a.shape[1:]), a.dtype))
                    attributes[name] = a.attrs
                columns[name][1][part] = a.values
        corners = kind[rows, cols]
        is_one = (corners == corners[0]).all(axis=0)
        _fill(source, is_known, cells.chosen(is_one))
        is_small = (cells.right - cells.left <= 1) & (cells.top - cells.bottom <= 1)
        cells = cells.chosen(~is_one & ~is_small).halved()
    return _dataset(axes, is_known, source, columns, attributes)


def _coarse(grid: _Grid, stride: int) -> _Cells:
    """All cells between points `stride` steps apart, and the last row and column."""
    edges = [np.append(np.arange(0, size - 1, stride), size - 1) for size in grid.shape]
    first = np.meshgrid(*(edge[:-1] for edge in edges), indexing="ij")
    last = np.meshgrid(*(edge[1:] for edge in edges), indexing="ij")
    return _Cells(first[0].ravel(), last[0].ravel(), first[1].ravel(), last[1].ravel())


def _kinds(found: xr.Dataset, kinds: dict[tuple, int]) -> np.ndarray:
    """A number for each kind of motion, the same from round to round."""
    impacts = np.nan_to_num(found.num_impacts.values, nan=-2, posinf=-1)
    rows = np.column_stack([found.motion.values, found.num_periods.values, impacts]).astype(int)
    own, of_point = np.unique(rows, axis=0, return_inverse=True)
    numbers = np.array([kinds.setdefault(tuple(row), len(kinds)) for row in own.tolist()])
    return numbers[of_point.ravel()]


def _fill(source: np.ndarray, is_known: np.ndarray, cells: _Cells) -> None:
    """Give all points of cells, but those that were run, the motion of the nearest corner, in place."""
    across, along = cells.right - cells.left, cells.top - cells.bottom
    for width, height in np.unique(np.stack([across, along]), axis=1).T:
        own = cells.chosen((across == width) & (along == height))
        i, j = np.arange(width + 1)[:, None], np.arange(height + 1)[None]
        rows, cols = (own.left[:, None, None] + i, own.bottom[:, None, None] + j)
        rows, cols = np.broadcast_arrays(rows, cols)
        corner_row = np.where(2 * i > width, own.right[:, None, None], own.left[:, None, None])
        corner_col = np.where(2 * j > height, own.top[:, None, None], own.bottom[:, None, None])
        nearest = np.broadcast_to(np.ravel_multi_index((corner_row, corner_col), source.shape), rows.shape)
        is_free = ~is_known[rows, cols]
        source[rows[is_free], cols[is_free]] = nearest[is_free]


def _dataset(
    axes: dict[str, np.ndarray],
    is_known: np.ndarray,
    source: np.ndarray,
    columns: dict[str, tuple[tuple[str, ...], np.ndarray]],
    attributes: dict[str, dict],
) -> xr.Dataset:
    variables = {}
    for name, (own, a) in columns.items():
        filled = a[source.ravel()]
        if name.startswith("lyapunov"):
            filled = np.where(is_known.reshape(-1, *(1,) * (a.ndim - 1)), filled, np.nan)
        variables[name] = ((*axes, *own), filled.reshape(*is_known.shape, *a.shape[1:]), attributes[name])
    ds = xr.Dataset(variables | {"is_computed": (tuple(axes), is_known)}, coords=axes)
    for path in axes:
        ds[path].attrs = label(path)
    ds["is_computed"].attrs = label("is_computed")
    return ds
