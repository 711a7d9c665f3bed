"""Coloured cells over a plane of two quantities."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection, QuadMesh

from .._jax.arrays import check_type
from ._colors import ink, merge_style
from ._labels import Units, axis_label


def check_plane(values: xr.DataArray, picture: str, quantities: str = "swept") -> None:
    """Raise unless the array spans two quantities of two values or more."""
    check_type("values", values, xr.DataArray, "an array of the dataset, as `ds[name]`")
    dims, shape = list(values.dims), values.shape
    if len(dims) != 2:
        raise ValueError(
            f"{picture} needs two {quantities} quantities, but there are {dims}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    if min(shape) < 2:
        raise ValueError(f"{picture} needs two values or more of each quantity, but has {shape}.")


def draw_mesh(
    ax: Axes,
    values: xr.DataArray,
    numbers: np.ndarray,
    units: Units | None,
    style: dict[str, Any],
    **own: Any,
) -> QuadMesh:
    """Draw numbers as colours, the first dimension of an array on the x axis, the second on the y axis.

    Args:
        ax: the axes.
        values: array over two quantities, both sorted.
        numbers: the number to draw for each of its entries.
        units: units of the quantities.
        style: properties from the user.
        own: default properties, such as the colours of the numbers.
    """
    right, up = map(str, values.dims)
    look = merge_style(style, QuadMesh, shading="nearest", rasterized=True, **own)
    mesh = ax.pcolormesh(values[right].values, values[up].values, numbers.T, **look)
    ax.set(xlabel=axis_label(right, units, values), ylabel=axis_label(up, units, values))
    return mesh


def hatch(ax: Axes, mesh: QuadMesh, which: np.ndarray, strokes: str) -> None:
    """Hatch some cells of a mesh; vertically adjacent cells become one rectangle.

    Args:
        ax: the axes of the mesh.
        mesh: result of `draw_mesh`.
        which: flags of the cells, (up, right).
        strokes: hatch pattern of matplotlib.
    """
    corners, boxes = np.asarray(mesh.get_coordinates()), []
    for k, column in enumerate(which.T):
        edges = np.flatnonzero(np.diff(column.astype(int), prepend=0, append=0))
        x = corners[0, [k, k + 1], 0]
        for bottom, top in corners[edges.reshape(-1, 2), 0, 1]:
            boxes.append([(x[0], bottom), (x[1], bottom), (x[1], top), (x[0], top)])
    if boxes:
        look = {"facecolor": "none", "edgecolor": ink(), "linewidth": 0, "hatch": strokes}
        ax.add_collection(PolyCollection(boxes, **look), autolim=False)
