"""One quantity over a plane of two swept ones."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize, TwoSlopeNorm

from .._sweep.short_names import with_paths
from ._axes import create_axes, figure_of
from ._colors import ordered_colors
from ._labels import Units
from ._mesh import check_plane, draw_mesh

# Largest number of whole values with a colour each; with more, a continuous scale is used.
_MOST_COUNTS = 12


def plane(
    values: xr.DataArray,
    *,
    words: str | None = None,
    center: float | None = None,
    units: Units | None = None,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw one quantity over a plane of two swept ones: a largest multiplier, an exponent, a number of attractors.

    Whole numbers have a colour each, real numbers a continuous scale. Points of unknown (non-finite) value stay empty.

    Args:
        values: numbers or flags over two swept quantities, the first on the x axis, the second on the y axis.
        words: label of the colour bar; the array's `long_name`, or its name, if omitted.
        center: centre of a diverging colour scale, red above and blue below; none if omitted.
        units: units of the swept quantities, as in `{"time": "s"}`; labels show none if omitted.
        ax: the axes to draw into; new axes if omitted.
        **style: properties of the plane for matplotlib's `pcolormesh`: `cmap`, `norm`, ...

    Returns:
        The axes.

    Raises:
        ValueError: unless there are two dimensions of two values or more, or if the values are complex.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        plane = {"forcing.frequency": np.linspace(0.7, 1, 33), "forcing.amplitude[0]": np.linspace(0.2, 0.4, 17)}
        chart = vx.chart(vx.models.wagg_bishop_a(1.0), plane, multipliers=True)
        ax = vx.plot.plane(abs(chart.multipliers).max("multiplier"), words="Largest multiplier")
        ```
    """
    check_plane(values, "A picture of a plane")
    if np.iscomplexobj(values):
        raise ValueError("The values are complex: draw their magnitude, as `abs(values)`.")
    values = with_paths(values)
    values = values.sortby(list(values.dims))
    ax = create_axes() if ax is None else ax
    numbers = np.ma.masked_invalid(values.values)
    cmap, norm = _colors(numbers, center)
    mesh = draw_mesh(ax, values, numbers, units, style, cmap=cmap, norm=norm)
    name = str(values.attrs.get("long_name", values.name or ""))
    ticks = np.unique(numbers.compressed()) if isinstance(norm, BoundaryNorm) else None
    figure_of(ax).colorbar(
        mesh, ax=ax, ticks=ticks, label=(name[:1].upper() + name[1:]) if words is None else words
    )
    return ax


def _colors(numbers: np.ma.MaskedArray, center: float | None) -> tuple[str | Colormap, Normalize]:
    """Colour map and norm of the numbers."""
    known = numbers.compressed()
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    count = int(high - low) + 1
    if not np.issubdtype(numbers.dtype, np.inexact) and count <= _MOST_COUNTS:
        edges = low - 0.5 + np.arange(count + 1)
        return ListedColormap(list(ordered_colors(count))), BoundaryNorm(edges, count)
    if center is None:
        return plt.rcParams["image.cmap"], Normalize(low, high)
    reach = max(abs(low - center), abs(high - center), np.finfo(float).tiny)
    return "RdBu_r", TwoSlopeNorm(center, center - reach, center + reach)
