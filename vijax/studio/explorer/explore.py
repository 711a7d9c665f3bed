"""Entry of the explorer, which imports its page on the first call."""

import xarray as xr

from ..._sweep.literals import Quantity
from .motion import check


def explore(ds: xr.Dataset, *, ordinate: Quantity | str = "velocity", dark: bool = False):
    """Explore a sweep: its diagram, and the motion at the clicked point.

    The diagram is the bifurcation diagram over one swept quantity, and the chart of motions over two; sliders set the
    values of further quantities. Beside it is the motion at the point: its kind and Floquet multipliers, time series,
    phase portrait, impact map, and an animation of the machine. Further sliders change numbers of the machine, and the
    motion is at once continued from there. "orbit here" finds the periodic orbit near the motion, "continue from here"
    draws its branch over the diagram, "save all" keeps pictures, events and code. Everything runs in this process. In a notebook, the object as last line
    of a cell shows the page; `python -m vijax explore sweep.nc` opens it in the browser. A notebook loads the
    JavaScript libraries from the internet; with `PANEL_INLINE=1` in the environment it contains them.

    Needs the extra: `pip install 'vijax[studio]'`.

    Args:
        ds: result of `vx.sweep`, or a part of it.
        ordinate: quantity that the diagram over one swept quantity shows at first: "velocity" of the impacts, or a quantity that the
            sweep has, as "max_position".
        dark: whether the page is light on dark.

    Returns:
        The page, an object of Panel: `.servable()`, `.show()` serve it.

    Raises:
        ValueError: if the dataset is not a sweep or lacks the ordinate, or its machine is unknown, see `vx.system_of`.
        ImportError: without the extra.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        page = vx.explore(ds)
        ```
    """
    check(ds, ordinate)
    try:
        from .serve import page_of
    except ImportError as error:
        raise ImportError(
            f"The explorer needs Panel, HoloViews and datashader: pip install 'vijax[studio]'. {error}"
        ) from error
    return page_of(ds, dark=dark, ordinate=ordinate)
