"""Lyapunov exponents over one or two swept quantities."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._dataset_checks import check_columns
from ._axes import Sweeps, create_axes, current_xlim, extend_xlim, named_datasets
from ._colors import curve_colors, curve_styles, merge_style
from ._labels import RATE, Units, axis_label, with_unit
from ._legend import add_legend
from ._plane import plane

_WORDS = "Lyapunov exponent $\\lambda$"


def lyapunov(
    ds: Sweeps, *, units: Units | None = None, legend: bool = True, ax: Axes | None = None, **style: Any
) -> Axes:
    """Draw the Lyapunov exponents of a sweep: all over one swept quantity, the largest over two.

    Motions are chaotic above the line at zero, or in red. Exponents of minus infinity, of directions erased by
    sticking, are not drawn. Bands extend two standard errors to either side.

    Args:
        ds: result of `vx.sweep` or `vx.chart` with `lyapunov=True`, for one or two swept quantities. Several of one
            quantity by their names, as in `{"r = 0.7": one, "r = 0.8": other}`, differ in colour, their exponents
            by their strokes.
        units: of `time` and swept quantities, as in `{"time": "s"}`; none are written if left out.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: where to draw, also over what is there; new axes if left out.
        **style: of the curves, as matplotlib's `plot` takes them, or of the plane, as `pcolormesh` does: `linewidth`, `cmap`,
            `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if there are no exponents, or not one or two quantities were swept.

    Example:
        ```python
        import numpy as np, vijax as vx
        values = {"forcing.frequency": np.linspace(1.4, 2.0, 61)}
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), values, record=200, lyapunov=True)
        ax = vx.plot.lyapunov(ds)
        ```
    """
    sweeps = named_datasets(ds, style)
    paths = [_paths(one) for one in sweeps.values()]
    if len(sweeps) > 1 and (len(paths[0]) > 1 or any(path != paths[0] for path in paths)):
        raise ValueError(f"Exponents are drawn together over one quantity, but these are over {paths}.")
    ax = create_axes() if ax is None else ax
    if len(paths[0]) == 1:
        _lines(sweeps, paths[0][0], ax, style)
        ax.set_ylabel(with_unit(_WORDS, RATE, units))
    else:
        _plane(next(iter(sweeps.values())), paths[0], ax, units, style)
    ax.set_xlabel(axis_label(paths[0][0], units, next(iter(sweeps.values()))))
    add_legend(ax, is_shown=legend and len(paths[0]) == 1)
    return ax


def _paths(ds: xr.Dataset) -> list[str]:
    """Paths of the swept quantities; raise unless there are one or two."""
    if "lyapunov_exponents" not in ds:
        raise ValueError("The dataset has no `lyapunov_exponents`: sweep with `lyapunov=True`.")
    check_columns(ds, "`vx.sweep`", dict.fromkeys(("lyapunov_exponents", "lyapunov_error"), ("exponent",)))
    paths = [str(dim) for dim in ds.lyapunov_exponents.dims if dim != "exponent"]
    if len(paths) not in (1, 2):
        raise ValueError(
            f"The picture needs one or two swept quantities, but there are {paths}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    return paths


def _lines(sweeps: dict[str, xr.Dataset], path: str, ax: Axes, style: dict[str, Any]) -> None:
    """Draw a curve for each exponent of each sweep."""
    so_far, values = current_xlim(ax), []
    for k, (name, ds) in enumerate(sweeps.items()):
        ordered = ds.sortby(path)
        exponents, error = (
            ordered[one].transpose("exponent", path).values
            for one in ("lyapunov_exponents", "lyapunov_error")
        )
        values.append(ordered[path].values)
        of_sweep = {"color": curve_colors(len(sweeps))[k]} if len(sweeps) > 1 else {}
        for i, (color, stroke) in enumerate(curve_styles(len(exponents), of_sweep | style)):
            words = ", ".join(filter(None, (name, f"$\\lambda_{{{i + 1}}}$")))
            look = merge_style(style, color=color, linestyle=stroke, linewidth=1.2, label=words)
            known = np.where(np.isfinite(exponents[i]), exponents[i], np.nan)
            (line,) = ax.plot(values[-1], known, **look)
            band = {"color": line.get_color(), "alpha": 0.25, "linewidth": 0}
            ax.fill_between(values[-1], known - 2 * error[i], known + 2 * error[i], **band)
    ax.axhline(0, color="0.5", linewidth=0.8, zorder=0)
    extend_xlim(ax, np.concatenate(values), so_far)


def _plane(ds: xr.Dataset, paths: list[str], ax: Axes, units: Units | None, style: dict[str, Any]) -> None:
    """Draw the largest exponent as a colour."""
    largest = ds.lyapunov_exponents.isel(exponent=0).transpose(*paths)
    words = with_unit(_WORDS.replace("Lyapunov", "Largest Lyapunov"), RATE, units)
    plane(largest, words=words, center=0.0, units=units, ax=ax, **style)
