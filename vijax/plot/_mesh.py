"""Colours over a plane of two quantities."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection, QuadMesh

from ._colors import ink, styled
from ._labels import Units, axis_label


def check_plane(values: xr.DataArray, picture: str, quantities: str = "swept") -> None:
    """Refuse what does not lie over two quantities of two values or more."""
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
    """Draw numbers as colours, the first quantity of an array to the right and its second upwards.

    Args:
        ax: where.
        values: over the quantities, in the order of both.
        numbers: one for each of them.
        units: of the quantities.
        style: the user's.
        own: which colours the numbers have.
    """
    right, up = map(str, values.dims)
    look = styled(style, QuadMesh, shading="nearest", rasterized=True, **own)
    mesh = ax.pcolormesh(values[right].values, values[up].values, numbers.T, **look)
    ax.set(xlabel=axis_label(right, units), ylabel=axis_label(up, units))
    return mesh


def hatch(ax: Axes, mesh: QuadMesh, which: np.ndarray, strokes: str) -> None:
    """Hatch some cells of a mesh, those on one another as one.

    Args:
        ax: where the mesh is.
        mesh: what `draw_mesh` drew.
        which: the cells, rows upwards, (up, right).
        strokes: as matplotlib names them.
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
