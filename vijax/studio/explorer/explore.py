"""The explorer, which imports its page when it is asked for."""

import xarray as xr

from .motion import check


def explore(ds: xr.Dataset, *, dark: bool = False):
    """Look at a sweep: its diagram, and the motion at the point that is clicked.

    Over one swept quantity it is the bifurcation diagram, over two the chart of motions; of others a slider chooses
    the value. Beside it stand the motion of the point: its kind and Floquet multipliers, time series, phase portrait,
    impact map, and the machine moving. Another slider changes a parameter of the machine, and the motion that goes
    on from there is followed at once. All runs in this process. In a notebook the last line of a cell shows it,
    `python -m vijax explore sweep.nc` a page in the browser. A notebook loads what draws it from the net; with `PANEL_INLINE=1` in the
    environment it has all in itself.

    Needs the extra: `pip install 'vijax[explore]'`.

    Args:
        ds: what `vx.sweep` returned, or a part of it.
        dark: light on dark.

    Returns:
        The page, an object of Panel: `.servable()`, `.show()` serve it.

    Raises:
        ValueError: for a dataset of no sweep, or whose machine is not known, see `vx.system_of`.
        ImportError: without the extra.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        page = vx.explore(ds)
        ```
    """
    check(ds)
    try:
        from .page import page_of
    except ImportError as error:
        raise ImportError(
            f"The explorer needs Panel, HoloViews and datashader: pip install 'vijax[explore]'. {error}"
        ) from error
    return page_of(ds, dark=dark)
