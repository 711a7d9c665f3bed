"""What all pictures share: new axes, labels with symbol and unit, colours."""

import re
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

_AXIS_LABELS = {
    "mass": ("Mass", "m", "units of mass"),
    "damping": ("Damping", "C", r"force $\times$ time / length"),
    "stiffness": ("Stiffness", "K", "force / length"),
    "forcing.amplitude": ("Forcing amplitude", "A", "units of force"),
    "forcing.frequency": ("Forcing frequency", r"\Omega", "rad / time"),
    "forcing.phase": ("Forcing phase", r"\varphi", "rad"),
    "forcing.mean": ("Constant force", "F", "units of force"),
    "stops.position": ("Stop position", "s", "units of length"),
    "stops.restitution": ("Restitution", "r", "ratio"),
    "stops.motion.amplitude": ("Travel of the stop", "A", "units of length"),
    "stops.motion.phase": ("Phase of the stop", r"\varphi", "rad"),
    "stops.motion.mean": ("Stop position", "s", "units of length"),
    "x0": ("Start position", "x", "units of length"),
    "v0": ("Start velocity", r"\dot x", "length / time"),
}


def new_axes() -> Axes:
    """Axes in a figure of their own."""
    return plt.subplots(layout="constrained")[1]


def figure_of(artist: Artist) -> Figure:
    """The figure that axes, or words, are in, be it by way of a part of it."""
    return artist.figure.figure  # pyright: ignore[reportOptionalMemberAccess, reportReturnType]


def column_of_axes(ax: Axes | Sequence[Axes] | np.ndarray | None, rows: int) -> np.ndarray:
    """The axes given, one a row, or new ones."""
    if ax is None:
        size = (6.4, max(4.8, 1.0 + 2.4 * rows))
        return plt.subplots(rows, sharex=True, squeeze=False, figsize=size, layout="constrained")[1][:, 0]
    given = np.ravel(np.asarray(ax, object))
    if given.size != rows:
        raise ValueError(f"Argument `ax` must hold {rows} axes, but holds {given.size}.")
    return given


def shades(count: int, first: float = 0.0, last: float = 0.75) -> np.ndarray:
    """Colours from dark to light, so that curves and points differ in print as well."""
    return plt.get_cmap("viridis")(np.linspace(first, last, count))


def of_curves(count: int) -> np.ndarray:
    """The same, from light to dark where the background is dark."""
    return shades(count, 1.0, 0.4) if _is_dark() else shades(count)


def ink(on_light: str = "black", on_dark: str = "white") -> str:
    """A colour that is seen on the background of the style in use."""
    return on_dark if _is_dark() else on_light


def _is_dark() -> bool:
    return bool(np.mean(to_rgb(plt.rcParams["axes.facecolor"])) < 0.5)


def label(path: str) -> str:
    """The words, symbol and unit of a swept quantity; its path where there are none."""
    name, indices = re.sub(r"\[.*?\]", "", path), re.findall(r"\[(\d+)\]", path)
    if name not in _AXIS_LABELS:
        return path
    words, symbol, unit = _AXIS_LABELS[name]
    subscript = f"_{{{','.join(indices)}}}" if indices else ""
    return f"{words} ${symbol}{subscript}$ ({unit})"


def swept_quantity(points: xr.DataArray, picture: str) -> str:
    """The path along which the points of a sweep lie, up and down or in one direction."""
    swept = [str(dim) for dim in points.dims if dim != "direction"]
    if len(swept) != 1:
        raise ValueError(
            f"{picture} needs one swept quantity, but there are {swept}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    return swept[0]


def span_of_phase(set_limits, set_ticks) -> None:
    """Let an axis show a whole forcing period, with ticks at its quarters."""
    set_limits(0, 2 * np.pi)
    set_ticks(np.pi / 2 * np.arange(5), ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"])


def legend_beside(ax: Axes, **options) -> None:
    """A legend to the right of the axes, where it hides nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, **options)


def legend_above(ax: Axes, *, markerscale: float) -> None:
    """A legend of points in a row above the axes, the points large enough to be told apart."""
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, ncols=4, markerscale=markerscale)


def check_index(name: str, index: int, count: int) -> None:
    """Refuse a stop or a mass that is not there."""
    if not count:
        raise ValueError(f"Argument `{name}` is {index}, but the machine has none.")
    if not 0 <= index < count:
        raise ValueError(f"Argument `{name}` must lie in 0 to {count - 1}, but is {index}.")
