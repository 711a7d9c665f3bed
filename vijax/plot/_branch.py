"""Branches of periodic orbits: the velocities of their impacts against the parameter."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, overload

import jax
import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._branches.branch import Branch
from .._branches.kinds import End, Kind
from .._hybrid.limits import IMPACT
from .._sweep.short_names import with_paths
from .._system.description import build_from
from .._system.force_description import NAMED_FORCE
from .._system.parameters import is_of_force, set_parameter
from .._system.system import ImpactSystem
from ._axes import column_of_axes, current_xlim, extend_xlim, label_if_new, legend_beside, stops_to_draw
from ._bifurcation import bifurcation, label_of_impacts
from ._colors import curve_colors, faded, ink, merge_style
from ._contacts import masses_of_stops, name_of
from ._impact_lines import OrbitImpacts, impact_lines
from ._labels import Units, axis_label, swept_paths

_STABILITY = {True: ("-", "stable"), False: ((0, (3.0, 1.5)), "unstable")}
MARKERS: dict[str, str] = {
    Kind.FOLD: "o",
    Kind.PERIOD_DOUBLING: "D",
    Kind.NEIMARK_SACKER: "p",
    Kind.BRANCH_POINT: "*",
    Kind.GRAZING: "v",
    Kind.DOUBLE_IMPACT: "d",
    Kind.FORCE_ZERO: "^",
    Kind.CHATTER_COMPLETION: "s",
}
OTHER = "h"
# Sweep under the branches: remaining share of its colours, and factor of its marker size.
_LIGHT, _LARGER = 0.6, 1.4


@overload
def branch(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
    ds: xr.Dataset | None = None,
    stop: int = 0,
    *,
    units: Units | None = None,
    ax: Axes | None = None,
    **style: Any,
) -> Axes: ...
@overload
def branch(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
    ds: xr.Dataset | None = None,
    *,
    stop: None,
    units: Units | None = None,
    ax: Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> np.ndarray: ...
def branch(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
    ds: xr.Dataset | None = None,
    stop: int | None = 0,
    *,
    units: Units | None = None,
    ax: Axes | Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> Axes | np.ndarray:
    """Draw branches of periodic orbits: the velocities before the impacts of their orbits against the parameter.

    Each impact of the cycle is a line from the grazing at which it appears to the grazing at which it disappears, solid
    where the orbits are stable and dashed where they are unstable. Bifurcations are marked on every line. Orbits
    without impacts at the stop have no lines.

    Args:
        branches: what `vx.continuation` returned, one or several along one parameter; several are told apart by their
            colours. Their names in the legend are those of a dict, as in `{"1 in 2": one, "2 in 2": other}`.
        ds: what `vx.sweep` returned for the same parameter, to draw its impacts under the branches, light.
        stop: the stop whose impacts are drawn; None for all, one panel a stop.
        units: of `length` and `time`, as in `{"length": "mm", "time": "s"}`; none are written if left out.
        ax: where to draw, also over what is there; for `stop=None` one axes for each stop; new axes if left out.
        **style: of the lines, as matplotlib's `plot` takes them: `color`, `linewidth`, `label`, ...

    Returns:
        The axes; an array of them for `stop=None`.

    Raises:
        ValueError: if there is no branch, the stop does not exist, no orbit has an impact there, or branches and sweep
            do not follow one parameter of one machine.

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
    several, names = _named(branches)
    ds = None if ds is None else with_paths(ds)
    path, num_stops = _common(several, ds)
    stops = stops_to_draw(stop, num_stops)
    masses = masses_of_stops(_system(several[0].points))
    curves = {j: [_curves(one, j) for one in several] for j in stops}
    if not any(one.lines for of_stop in curves.values() for one in of_stop):
        where = "any stop" if stop is None else name_of(stop, masses)
        raise ValueError(f"There are no impacts at {where} to draw.")
    column = column_of_axes(ax, len(stops))
    values = [one.values for one in several] + ([] if ds is None else [ds[path].values.ravel()])
    for j, panel in zip(stops, column, strict=True):
        so_far = current_xlim(panel)
        panel.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        if ds is not None:
            _draw_light(ds, j, panel)
        _draw_curves(curves[j], names, panel, style)
        _draw_marks(curves[j], panel)
        extend_xlim(panel, np.concatenate(values), so_far)
        panel.set_xlabel(axis_label(path, units) if panel is column[-1] else "")
        panel.set_ylabel(label_of_impacts("velocity", j, masses, units))
    _draw_legend(column)
    return column if stop is None else column[0]


def _named(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
) -> tuple[list[Branch], list[str]]:
    """The branches and their names; a single one that is not named has none."""
    if isinstance(branches, Mapping):
        return list(branches.values()), list(branches)
    several = [branches] if isinstance(branches, Branch) else list(branches)
    return several, [f"branch {k}" if len(several) > 1 else "" for k in range(len(several))]


def label_of_kind(kind: str) -> str:
    """Legend label of a kind of bifurcation or special point."""
    return Kind(kind).words if kind in MARKERS else kind.replace("_", " ").replace("+", " and ")


def _common(branches: list[Branch], ds: xr.Dataset | None) -> tuple[str, int]:
    """The path of the common parameter, and the number of stops."""
    if not branches:
        raise ValueError("Argument `branches` is empty: give one or more.")
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
    return path, counts.pop()


def _system(points: xr.Dataset) -> ImpactSystem:
    """The machine of a branch as its attributes describe it, its force by name only."""
    return build_from(points.attrs, force=NAMED_FORCE)  # only the stops are needed


class _Curves(NamedTuple):
    """The lines of a branch at one stop.

    Attributes:
        values: parameter at the points of the branch, (points,).
        kinds: bifurcation at each point, empty for none, (points,).
        is_stable: whether the branch is stable up to the next point, (points - 1,).
        lines: of each impact, the point numbers and its velocities there.
    """

    values: np.ndarray
    kinds: np.ndarray
    is_stable: np.ndarray
    lines: list[tuple[np.ndarray, np.ndarray]]


def _curves(branch: Branch, stop: int) -> _Curves:
    """The lines of a branch at a stop."""
    points = branch.points
    if branch.ends == (End.CLOSED, End.CLOSED):  # repeat the first point at the end
        points = points.isel(point=[*range(len(branch)), 0])
    kinds = points["bifurcation"].values.astype(str)
    # At a multiplier on the unit circle `is_stable` is decided by rounding: the other end of the segment decides.
    is_stable = points["is_stable"].values | np.isin(kinds, [str(kind) for kind in Kind if kind.is_critical])
    sign = _system(points).stops[stop].sign
    found = impact_lines(_impacts(points, stop), kinds, points.attrs["num_periods"])
    lines = [(np.array(numbers), sign * np.array(velocities)) for numbers, velocities in found]
    return _Curves(points[branch.path].values, kinds, is_stable[:-1] & is_stable[1:], lines)


def _impacts(points: xr.Dataset, stop: int) -> list[OrbitImpacts]:
    """The impacts of each orbit of a branch at a stop."""
    system, path = _system(points), points.attrs["path"]
    times = points.attrs["phase"] + np.cumsum(points["flight"].values, axis=1)

    def carried(value: jax.Array, angles: jax.Array) -> jax.Array:
        machine = system if is_of_force(path) else set_parameter(system, path, value)
        at = machine.stops[stop]
        if at.slot is None:  # a contact has no velocity of its own
            return 0 * angles
        return at.sign * machine.forcing.frequency * jax.vmap(at.slope_at)(angles)

    of_stop = np.asarray(jax.vmap(carried)(points[path].values, 2 * np.pi * times))
    is_hit = (points["event_kind"].values == IMPACT) & (points["event_stop"].values == stop)
    columns = (times, points["impact_speed"].values, of_stop)
    return [OrbitImpacts(*(column[k][hits] for column in columns)) for k, hits in enumerate(is_hit)]


def _joined(curves: _Curves, is_stable: bool) -> tuple[np.ndarray, np.ndarray]:
    """Parameters and velocities of all stable or all unstable segments, separated by NaN."""
    found = [np.empty((2, 0))]
    for numbers, velocities in curves.lines:
        pieces = curves.is_stable[numbers[:-1]]
        ends = np.flatnonzero(np.diff(pieces)) + 1
        for part in np.split(np.arange(len(pieces)), ends):
            if len(part) and pieces[part[0]] == is_stable:
                whole = np.append(part, part[-1] + 1)
                drawn = np.stack([curves.values[numbers[whole]], velocities[whole]])
                found += [drawn, np.full((2, 1), np.nan)]
    x, y = np.concatenate(found, axis=1)
    return x, y


def _draw_curves(curves: list[_Curves], names: list[str], ax: Axes, style: dict[str, Any]) -> None:
    """Draw all lines, solid where orbits are stable, and their legend entries."""
    colors = curve_colors(len(curves)) if len(curves) > 1 else [ink()]
    label = style.get("label", "")
    style = {key: value for key, value in style.items() if key != "label"}
    for one, name, color in zip(curves, names, colors, strict=True):
        look = merge_style(style, color=color, linewidth=1.2)
        words = ", ".join(filter(None, (label, name)))
        if words:
            ax.plot([], [], label=words, **look)
        for is_stable, (stroke, _) in _STABILITY.items():
            ax.plot(*_joined(one, is_stable), **{"linestyle": stroke} | look)
    for is_stable, (stroke, words) in _STABILITY.items():
        if any(_joined(one, is_stable)[0].size for one in curves) and (words := label_if_new(ax, words)):
            ax.plot([], [], linestyle=stroke, color=ink(), linewidth=1.2, label=words)


def _draw_marks(curves: list[_Curves], ax: Axes) -> None:
    """Draw the markers of the bifurcations on all lines."""
    found: dict[str, list[tuple[float, float]]] = {kind: [] for kind in MARKERS}
    for one in curves:
        for numbers, velocities in one.lines:
            for value, velocity, kind in zip(
                one.values[numbers], velocities, one.kinds[numbers], strict=True
            ):
                if kind:
                    found.setdefault(str(kind), []).append((float(value), float(velocity)))
    for kind, places in found.items():
        if places:
            marker = MARKERS.get(kind, OTHER)
            draw_special(ax, np.array(places), kind, marker=marker, markersize=6.0, markeredgewidth=1.0)


def draw_special(ax: Axes, places: np.ndarray, kind: str, **look: Any) -> None:
    """Draw the markers of bifurcations or special points of a kind at given places, (points, 2)."""
    own = {"linestyle": "none", "markerfacecolor": ink("white", "black"), "color": ink(), "zorder": 3}
    ax.plot(*places.T, label=label_if_new(ax, label_of_kind(kind)), **own, **look)


def _draw_light(ds: xr.Dataset, stop: int, ax: Axes) -> None:
    """Draw the impacts of a sweep below everything else."""
    others = list(ax.lines)
    bifurcation(ds, stop, ax=ax)
    # Pale instead of transparent: many overlapping transparent points would be dark again.
    for line in ax.lines:
        if line not in others:
            pale = faded(line.get_color(), _LIGHT)
            line.set(color=pale, markerfacecolor=pale, markersize=_LARGER * line.get_markersize(), zorder=1)


def _draw_legend(column: np.ndarray) -> None:
    """Add one legend of all panels, each label once."""
    found = {}
    for ax in column:
        for handle, words in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(words, handle)
        if ax.get_legend():
            ax.get_legend().remove()
    legend_beside(column[0], handles=list(found.values()), labels=list(found))
