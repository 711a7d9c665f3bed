"""Branches of periodic orbits: the velocities of their impacts against the parameter."""

from collections.abc import Mapping, Sequence
from typing import Any, cast, overload

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import same_color

from .._branches.branch import Branch
from .._branches.kinds import MONITOR, Kind
from .._dataset_checks import check_columns
from .._sweep.literals import Quantity
from .._sweep.short_names import with_paths
from ._axes import (
    break_long_labels,
    check_index,
    column_of_axes,
    current_xlim,
    extend_xlim,
    label_if_new,
    let_beyond,
    stops_to_draw,
)
from ._bifurcation import bifurcation, label_of_impacts
from ._branch_lines import (
    MARKERS,
    STABILITY,
    BranchLines,
    joined,
    lines_at,
    places_of_marks,
    system_of_points,
)
from ._branch_names import checked_ordinate, named_branches
from ._coincidence import hidden_under
from ._colors import colors_apart, ink, merge_style
from ._contacts import masses_of_stops, name_of
from ._grazing_lines import draw_grazing
from ._labels import Units, swept_paths
from ._legend import add_legend
from ._ordinates import Labels, Ordinate, label_of
from ._resonances import draw_resonances

OTHER = "h"
# Factor of the marker size of a sweep under the branches.
_LARGER = 1.4
# Greys of a sweep under the branches: first its sweep down, then its sweep up.
_GREYS = (("0.8", "0.35"), ("0.62", "0.55"))
# Number of markers in a panel above which they are half as large.
_MANY_MARKS = 60


@overload
def branch(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
    ds: xr.Dataset | None = None,
    stop: int = 0,
    *,
    ordinate: Quantity | str = "velocity",
    mass: int = 0,
    resonances: bool = False,
    grazing: bool = False,
    units: Units | None = None,
    labels: Labels | None = None,
    xlim: tuple[float, float] | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes: ...
@overload
def branch(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
    ds: xr.Dataset | None = None,
    *,
    stop: None,
    ordinate: Quantity | str = "velocity",
    mass: int = 0,
    resonances: bool = False,
    grazing: bool = False,
    units: Units | None = None,
    labels: Labels | None = None,
    xlim: tuple[float, float] | None = None,
    legend: bool = True,
    ax: Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> np.ndarray: ...
def branch(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
    ds: xr.Dataset | None = None,
    stop: int | None = 0,
    *,
    ordinate: Quantity | str = "velocity",
    mass: int = 0,
    resonances: bool = False,
    grazing: bool = False,
    units: Units | None = None,
    labels: Labels | None = None,
    xlim: tuple[float, float] | None = None,
    legend: bool = True,
    ax: Axes | Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> Axes | np.ndarray:
    """Draw branches of periodic orbits: the velocities before their impacts, or a quantity, against the parameter.

    Each impact of the cycle is a line from the grazing at which it appears to the grazing at which it disappears, solid
    where the orbits are stable and dashed where they are unstable. Bifurcations are marked on every line. Orbits
    without impacts at the stop have no lines.

    Args:
        branches: result of `vx.continuation`, one or several along one parameter; several differ in colour. Their names in the legend are those of a dict, as in `{"1 in 2": one, "2 in 2": other}`. Of more than
            eight without names, those of one motion share a colour: "2 in 3" has two impacts in three periods.
        ds: result of `vx.sweep` over the same parameter, drawn light under the branches.
        stop: the stop whose impacts are drawn; None for all, one panel a stop.
        ordinate: "velocity" of the impacts, or a column that `quantities` of `vx.continuation` requested: of a mass, as
            "max_position", one panel whatever the stop; of the stop; or a number of the user's own.
        mass: the mass whose quantity is drawn.
        resonances: draw the natural frequencies of the machine without dampers and impacts, along "forcing.frequency".
        grazing: draw where the steady motion without impacts just reaches a stop, for linear machines under harmonics of one frequency.
        units: of `length` and `time`, as in `{"length": "mm", "time": "s"}`; none are written if left out.
        labels: words of the axes, by the path of the parameter and the name of the ordinate, as in
            `{"force.mu": "Friction", "max_position": "Amplitude"}`.
        xlim: ends of the x axis; those of the branches if left out.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: where to draw, also over what is there; for `stop=None` one axes for each stop; new axes if left out.
        **style: of the lines, as matplotlib's `plot` takes them: `color`, `linewidth`, `label`, ...

    Returns:
        The axes; an array of them for `stop=None`.

    Raises:
        ValueError: if there is no branch, the stop or the mass does not exist, no orbit has an impact there, a branch lacks
            the ordinate, or branches and sweep do not follow one parameter of one machine.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])
        ax = vx.plot.branch(vx.continuation(orbit, "forcing.frequency", (0.7, 1.0)), stop=0)
        ```

    References:
        Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, Sec. 10.2.
    """
    several, names = named_branches(branches)
    ds = None if ds is None else with_paths(ds)
    path = _common(several, ds)
    quantity = checked_ordinate(several, ordinate)
    numbers = _numbers(quantity, stop, mass, several[0].points.sizes)
    masses = masses_of_stops(system_of_points(several[0].points))
    curves = {j: [lines_at(one, j, ordinate, quantity) for one in several] for j in numbers}
    if not any(one.lines for of_number in curves.values() for one in of_number):
        where = "any stop" if stop is None else name_of(stop, masses)
        what = (
            f"There are no impacts at {where}" if quantity is None else f'There are no values of "{ordinate}"'
        )
        raise ValueError(f"{what} to draw.")
    column = column_of_axes(ax, len(numbers))
    values = [one.values for one in several] + ([] if ds is None else [ds[path].values.ravel()])
    for j, panel in zip(numbers, column, strict=True):
        so_far = current_xlim(panel)
        if quantity is None or quantity.has_sign:
            panel.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        if ds is not None:
            _draw_light(ds, j, quantity, ordinate, panel)
        _draw_curves(curves[j], names, panel, style)
        _draw_marks(curves[j], panel)
        extend_xlim(panel, np.concatenate(values), so_far)
        if xlim is not None:
            panel.set_xlim(xlim)
        if resonances:
            draw_resonances(panel, several[0].points, path)
        panel.set_xlabel(label_of(path, labels, units, several[0].points) if panel is column[-1] else "")
        own = quantity.label(j, masses, units) if quantity else label_of_impacts("velocity", j, masses, units)
        panel.set_ylabel((labels or {}).get(ordinate) or own)
    if grazing:
        draw_grazing(column, several[0].points, path)
    break_long_labels(column)
    if legend:
        _draw_legend(column)
    return column if stop is None else column[0]


def _numbers(quantity: Ordinate | None, stop: int | None, mass: int, sizes: Mapping[Any, int]) -> list[int]:
    """The stops to draw, or the mass."""
    if quantity is None or quantity.axis == "stop":
        return stops_to_draw(stop, sizes["stop"])
    if quantity.axis == "mass":
        check_index("mass", mass, sizes["mass"])
    return [mass]


def label_of_kind(kind: str) -> str:
    """Legend label of a kind of bifurcation or special point."""
    if kind.startswith(MONITOR):
        return f"{kind.removeprefix(MONITOR)} = 0"
    return Kind(kind).words if kind in MARKERS else kind.replace("_", " ").replace("+", " and ")


def _common(branches: list[Branch], ds: xr.Dataset | None) -> str:
    """The path of the common parameter."""
    if not branches:
        raise ValueError("Argument `branches` is empty: give one or more.")
    columns = dict.fromkeys(("event_kind", "event_stop", "flight", "impact_speed"), ("point", "event"))
    for one in branches:
        check_columns(one.points, "`branch.points`", {**columns, "num_impacts": ("point", "stop")})
    paths = {one.path for one in branches}
    if len(paths) > 1:
        raise ValueError(
            f"Branches along one parameter can be drawn together, but these follow {sorted(paths)}."
        )
    path = paths.pop()
    if ds is not None and path not in ds["result"].dims:
        swept = swept_paths(ds["result"])
        raise ValueError(f"Argument `ds` must sweep what the branches follow, `{path}`, but sweeps {swept}.")
    drawn = [one.points for one in branches] + ([] if ds is None else [ds])
    counts = {one.sizes["stop"] for one in drawn}
    if len(counts) > 1:
        raise ValueError(f"Branches and sweep must be of one machine, but have {sorted(counts)} stops.")
    return path


def _draw_curves(curves: list[BranchLines], names: list[str], ax: Axes, style: dict[str, Any]) -> None:
    """Draw all lines, solid where orbits are stable, and their legend entries."""
    kinds = list(dict.fromkeys(names)) if any(names) else range(len(curves))
    colors = colors_apart(ax, len(kinds)) if len(curves) > 1 else [ink()]
    color_of = dict(zip(kinds, colors, strict=True))
    shown = hidden_under([[joined(one, True), joined(one, False)] for one in curves], names)
    label = style.get("label", "")
    style = {key: value for key, value in style.items() if key != "label"}
    for k, (one, name) in enumerate(zip(curves, names, strict=True)):
        look = merge_style(style, color=color_of[name if any(names) else k], linewidth=1.2)
        words = label_if_new(ax, ", ".join(filter(None, (label, shown[k]))))
        if words:
            ax.plot([], [], label=words, **look)
        for is_stable, (stroke, _) in STABILITY.items():
            ax.plot(*joined(one, is_stable), **{"linestyle": stroke} | look)
    for is_stable, (stroke, words) in STABILITY.items():
        if any(joined(one, is_stable)[0].size for one in curves) and (words := label_if_new(ax, words)):
            ax.plot([], [], linestyle=stroke, color=ink(), linewidth=1.2, label=words)


def _draw_marks(curves: list[BranchLines], ax: Axes) -> None:
    """Draw the markers of the bifurcations on all lines."""
    found = places_of_marks(curves)
    size = 6.0 if sum(map(len, found.values())) <= _MANY_MARKS else 3.0
    for kind, places in found.items():
        marker = MARKERS.get(kind, OTHER)
        draw_special(ax, np.array(places), kind, marker=marker, markersize=size, markeredgewidth=size / 6)


def draw_special(ax: Axes, places: np.ndarray, kind: str, **look: Any) -> None:
    """Draw the markers of bifurcations or special points of a kind at given places, (points, 2)."""
    own = {"linestyle": "none", "markerfacecolor": ink("white", "black"), "color": ink(), "zorder": 3}
    (marks,) = ax.plot(*places.T, label=label_if_new(ax, label_of_kind(kind)), **own, **look)
    let_beyond(marks, ax)


def _draw_light(ds: xr.Dataset, number: int, quantity: Ordinate | None, ordinate: str, ax: Axes) -> None:
    """Draw the impacts or the quantity of a sweep below everything else."""
    others = list(ax.lines)
    is_of_mass = quantity is not None and quantity.axis == "mass"
    stop, mass = (0, number) if is_of_mass else (number, 0)
    bifurcation(ds, stop, ordinate=cast(Any, ordinate), mass=mass, legend=False, ax=ax)
    # Grey, which no branch is; pale instead of transparent: many overlapping transparent points would be dark again.
    greys = dict(zip(("swept down", "swept up"), _GREYS, strict=True))
    for line in ax.lines:
        if line not in others and line.get_marker() != "None":
            way = "swept up" if same_color(line.get_color(), ink()) else "swept down"
            grey = ink(*greys[way])
            face = line.get_markerfacecolor()
            own = {} if isinstance(face, str) and face == "none" else {"markerfacecolor": grey}
            line.set(color=grey, markersize=_LARGER * line.get_markersize(), zorder=1, **own)


def _draw_legend(column: np.ndarray) -> None:
    """Add one legend of all panels, each label once."""
    found = {}
    for ax in column:
        for handle, words in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(words, handle)
        if ax is not column[0] and ax.get_legend():
            ax.get_legend().remove()
    add_legend(column[0], handles=list(found.values()), labels=list(found))
