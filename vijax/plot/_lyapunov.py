"""Lyapunov exponents over one or two swept quantities."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from ._axes import label, new_axes, of_curves
from ._plane import plane

_WORDS = "Lyapunov exponent $\\lambda$ (1 / time)"


def lyapunov(ds: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the Lyapunov exponents of a sweep: all over one swept quantity, the largest over two.

    Above the line at zero, or in red, motions are chaotic. Exponents of minus infinity, of directions that sticking
    erases, are left out. Bands are two standard errors wide to either side.

    Args:
        ds: what `vx.sweep` or `vx.chart` returned with `lyapunov=True`, for one or two swept quantities.
        ax: where to draw; new axes if left out.

    Returns:
        The axes.

    Raises:
        ValueError: if there are no exponents, or more or fewer quantities were swept.

    Example:
        ```python
        import numpy as np, vijax as vx
        values = {"forcing.frequency": np.linspace(1.4, 2.0, 61)}
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), values, record=200, lyapunov=True)
        ax = vx.plot.lyapunov(ds)
        ```
    """
    if "lyapunov_exponents" not in ds:
        raise ValueError("The dataset has no `lyapunov_exponents`: sweep with `lyapunov=True`.")
    paths = [str(dim) for dim in ds.lyapunov_exponents.dims if dim != "exponent"]
    if len(paths) not in (1, 2):
        raise ValueError(
            f"The picture needs one or two swept quantities, but there are {paths}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    ds = ds.sortby(paths)
    ax = new_axes() if ax is None else ax
    (_lines if len(paths) == 1 else _plane)(ds, paths, ax)
    ax.set_xlabel(label(paths[0]))
    return ax


def _lines(ds: xr.Dataset, paths: list[str], ax: Axes) -> None:
    exponents = ds.lyapunov_exponents.transpose("exponent", *paths).values
    error = ds.lyapunov_error.transpose("exponent", *paths).values
    exponents = np.where(np.isfinite(exponents), exponents, np.nan)
    at = ds[paths[0]].values
    for k, color in enumerate(of_curves(len(exponents))):
        low, high = exponents[k] - 2 * error[k], exponents[k] + 2 * error[k]
        ax.fill_between(at, low, high, color=color, alpha=0.25, linewidth=0)
        ax.plot(at, exponents[k], color=color, linewidth=1.2, label=f"$\\lambda_{{{k + 1}}}$")
    ax.axhline(0, color="0.5", linewidth=0.8, zorder=0)
    ax.set_xlim(at.min(), at.max())
    ax.set_ylabel(_WORDS)
    ax.legend(loc="best", ncols=2, frameon=False)


def _plane(ds: xr.Dataset, paths: list[str], ax: Axes) -> None:
    largest = ds.lyapunov_exponents.isel(exponent=0).transpose(*paths)
    plane(largest, words=_WORDS.replace("Lyapunov", "Largest Lyapunov"), center=0.0, ax=ax)
