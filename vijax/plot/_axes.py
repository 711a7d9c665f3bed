"""Helpers of all pictures: new axes, labels for legends, the phase axis, limits of axes that already have content."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox, TransformedBbox

from .._jax.arrays import a_kind_of, whole_number
from .._sweep.short_names import with_paths
from ._labels import LENGTH, VELOCITY, Units, with_unit

# Mark of figures that a picture made.
_OWN = "vijax"
# Room for markers beyond the limits, as a share of the axes.
_BEYOND = 0.03

Sweeps = xr.Dataset | Mapping[str, xr.Dataset]


def create_axes() -> Axes:
    """Create axes in a new figure."""
    return plt.subplots(layout="constrained", gid=_OWN)[1]


def is_own(ax: Axes) -> bool:
    """True for axes in a figure that a picture made, whose size it chooses."""
    return figure_of(ax).get_gid() == _OWN


def figure_of(artist: Artist) -> Figure:
    """The figure of axes or a text, also inside a subfigure."""
    return artist.figure.figure  # pyright: ignore[reportOptionalMemberAccess, reportReturnType]


def column_of_axes(ax: Axes | Sequence[Axes] | np.ndarray | None, rows: int) -> np.ndarray:
    """The given axes, one per row, or new ones."""
    if ax is None:
        size = (6.4, max(4.8, 1.0 + 2.4 * rows))
        return plt.subplots(rows, sharex=True, squeeze=False, figsize=size, layout="constrained", gid=_OWN)[
            1
        ][:, 0]
    given = np.ravel(np.asarray(ax, object))
    if given.size != rows:
        raise ValueError(f"Argument `ax` must hold {rows} axes, but holds {given.size}.")
    return given


def named_datasets(ds: Sweeps, style: dict[str, Any]) -> dict[str, xr.Dataset]:
    """The datasets to draw by name, their quantities by path; a single one is named by the `label` of the style."""
    if not isinstance(ds, xr.Dataset | Mapping) or not all(
        isinstance(one, xr.Dataset) for one in ([] if isinstance(ds, xr.Dataset) else ds.values())
    ):
        raise ValueError(
            "Argument `ds` must be what `vx.sweep` returned, or several such by their names, as in "
            f'`{{"up": one, "down": other}}`, but is {a_kind_of(ds)}.'
        )
    named = {style.pop("label", ""): ds} if isinstance(ds, xr.Dataset) else dict(ds)
    if not named:
        raise ValueError("There is no dataset to draw: give one, or several by their names.")
    return {name: with_paths(one) for name, one in named.items()}


def label_if_new(ax: Axes, words: str) -> str | None:
    """A label for the legend; None if the legend has it already."""
    return None if words in ax.get_legend_handles_labels()[1] else words


def label_phase_plane(ax: Axes, mass: int, units: Units | None) -> None:
    """Label the axes with the position and the velocity of a mass."""
    ax.set_xlabel(with_unit(f"Position $x_{{{mass}}}$", LENGTH, units))
    ax.set_ylabel(with_unit(f"Velocity $\\dot x_{{{mass}}}$", VELOCITY, units))


def current_xlim(ax: Axes) -> tuple[float, ...]:
    """Limits of the x axis; empty if the axes have no data."""
    return ax.get_xlim() if ax.has_data() else ()


def extend_xlim(ax: Axes, values: np.ndarray, so_far: tuple[float, ...]) -> None:
    """Set the x axis to span the values and its earlier limits."""
    first, last = min([*so_far, values.min()]), max([*so_far, values.max()])
    if first < last:
        ax.set_xlim(first, last)


def let_beyond(marks: Line2D, ax: Axes) -> None:
    """Let markers at the limits of the axes be drawn whole, also when the limits change later."""
    share = _BEYOND
    marks.set_clip_box(TransformedBbox(Bbox([[-share, -share], [1 + share, 1 + share]]), ax.transAxes))


def break_long_labels(column: Iterable[Axes]) -> None:
    """Break labels of y axes into two lines where they are longer than low axes are high."""
    for ax in column:
        _break_long_label(ax)


def _break_long_label(ax: Axes) -> None:
    label = ax.yaxis.label
    if label.get_window_extent().height <= ax.get_window_extent().height:
        return
    words = label.get_text().replace("\n", " ").split(" ")
    is_open = np.cumsum([word.count("$") % 2 for word in words]) % 2  # no break within a formula
    breaks = [k for k in range(1, len(words)) if not is_open[k - 1]]
    lines = [[" ".join(words[:k]), " ".join(words[k:])] for k in breaks]
    if lines:
        label.set_text("\n".join(min(lines, key=lambda pair: max(map(len, pair)))))


def set_phase_axis(set_limits, set_ticks, origin: float = 0.0) -> None:
    """Set an axis to span one forcing period, with ticks at its quarters."""
    set_limits(origin, origin + 2 * np.pi)
    quarters = np.arange(np.ceil(2 * origin / np.pi - 1e-9), np.floor(2 * origin / np.pi + 4 + 1e-9) + 1)
    set_ticks(np.pi / 2 * quarters, [_in_pi(int(k)) for k in quarters])


def _in_pi(quarters: int) -> str:
    """Label of a number of quarter turns, in units of pi."""
    if quarters == 0:
        return "0"
    sign, count = "-" if quarters < 0 else "", abs(quarters)
    whole, below = (count // 2, "") if count % 2 == 0 else (count, "/2")
    return f"${sign}{'' if whole == 1 else whole}\\pi{below}$"


def check_index(name: str, index: int, count: int) -> None:
    """Raise if a stop or mass does not exist."""
    if not isinstance(index, int | np.integer):
        whole_number(name, index)
    if not count:
        raise ValueError(f"Argument `{name}` is {index}, but the machine has none.")
    if not 0 <= index < count:
        raise ValueError(f"Argument `{name}` must lie in 0 to {count - 1}, but is {index}.")


def stops_to_draw(stop: int | None, count: int) -> list[int]:
    """The given stop, or all for None; raise if it does not exist."""
    check_index("stop", 0 if stop is None else stop, count)
    return list(range(count)) if stop is None else [stop]


def check_one_machine(sizes: Mapping[Any, int], picture: str, own: Sequence[str]) -> None:
    """Raise if dimensions other than starts and the variable's `own` ones have several values."""
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
