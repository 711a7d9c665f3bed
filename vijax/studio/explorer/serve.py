"""The page as an object of Panel, and its server."""

import socket

import panel as pn
import xarray as xr

from .diagram import IMPACTS
from .look import DARK, FONT, LIGHT
from .motion import check
from .page import Explorer

_TITLE = "vijax"


def page_of(ds: xr.Dataset, *, dark: bool, ordinate: str = IMPACTS, file: str = "") -> pn.viewable.Viewable:
    """Build the page of a sweep, see `vx.explore`."""
    pn.extension(theme="dark" if dark else "default")
    return Explorer(ds, DARK if dark else LIGHT, ordinate, file).view()


def serve(ds: xr.Dataset, *, port: int, show: bool, dark: bool, ordinate: str, file: str) -> None:
    """Serve the page of a sweep until Ctrl-C, a separate one for every browser."""
    check(ds, ordinate)
    look = DARK if dark else LIGHT
    pn.config.raw_css = [f"body {{ background: {look.page}; font-family: {FONT}; margin: 0 }}"]
    port = port or _free_port()
    print(f"http://localhost:{port}/ shows {file}; Ctrl-C ends it.", flush=True)  # noqa: T201
    pn.serve(
        lambda: page_of(ds, dark=dark, ordinate=ordinate, file=file),
        port=port,
        show=show,
        title=_TITLE,
        verbose=False,
    )


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("localhost", 0))
        return free.getsockname()[1]
