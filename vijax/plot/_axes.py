"""What all pictures share: new axes, legends, the axis of phases, what is drawn into axes that hold something."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Sweeps = xr.Dataset | Mapping[str, xr.Dataset]


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


def by_name(ds: Sweeps, style: dict[str, Any]) -> dict[str, xr.Dataset]:
    """The datasets to draw, several with their names, one with the `label` that the style has for it, if any."""
    named = {style.pop("label", ""): ds} if isinstance(ds, xr.Dataset) else dict(ds)
    if not named:
        raise ValueError("There is no dataset to draw: give one, or several by their names.")
    return named


def once(ax: Axes, words: str) -> str | None:
    """Words for the legend, unless it has them already."""
    return None if words in ax.get_legend_handles_labels()[1] else words


def span_so_far(ax: Axes) -> tuple[float, ...]:
    """What the axis to the right spans, of axes that hold something."""
    return ax.get_xlim() if ax.has_data() else ()


def span_of_values(ax: Axes, values: np.ndarray, so_far: tuple[float, ...]) -> None:
    """Let the axis to the right span the values, and what it spanned before they were drawn."""
    first, last = min([*so_far, values.min()]), max([*so_far, values.max()])
    if first < last:
        ax.set_xlim(first, last)


def span_of_phase(set_limits, set_ticks, origin: float = 0.0) -> None:
    """Let an axis show a whole forcing period, with ticks at its quarters."""
    set_limits(origin, origin + 2 * np.pi)
    quarters = np.arange(np.ceil(2 * origin / np.pi - 1e-9), np.floor(2 * origin / np.pi + 4 + 1e-9) + 1)
    set_ticks(np.pi / 2 * quarters, [_in_pi(int(k)) for k in quarters])


def _in_pi(quarters: int) -> str:
    """A number of quarters of a turn, as part of pi."""
    if quarters == 0:
        return "0"
    sign, count = "-" if quarters < 0 else "", abs(quarters)
    whole, below = (count // 2, "") if count % 2 == 0 else (count, "/2")
    return f"${sign}{'' if whole == 1 else whole}\\pi{below}$"


def legend_beside(ax: Axes, **options) -> None:
    """A legend to the right of the axes, where it hides nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, **options)


def legend_above(ax: Axes, *, markerscale: float) -> None:
    """A legend of points in a row above the axes, the points large enough to be told apart."""
    legend = ax.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, ncols=4, markerscale=markerscale
    )
    for handle in legend.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)  # points are faint where they are many


def check_index(name: str, index: int, count: int) -> None:
    """Refuse a stop or a mass that is not there."""
    if not count:
        raise ValueError(f"Argument `{name}` is {index}, but the machine has none.")
    if not 0 <= index < count:
        raise ValueError(f"Argument `{name}` must lie in 0 to {count - 1}, but is {index}.")


def check_one_machine(sizes: Mapping[Any, int], picture: str, own: Sequence[str]) -> None:
    """Refuse what is of several machines; several starts of one are welcome, and dimensions of its own."""
    several = [
        str(dim)
        for dim, size in sizes.items()
        if size > 1 and dim not in own and not str(dim).startswith(("x0", "v0"))
    ]
    if several:
        raise ValueError(
            f"{picture} is of one machine, but {several} are swept: select one value of each, "
            "as in `ds.sel({path: value})`."
        )
