"""Bifurcation diagrams: recorded impacts against a swept quantity, and the stability of the orbits they are of."""

from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._sweep.endings import warn_of_endings
from ._axes import check_index, column_of_axes, ink, label, legend_above, span_of_phase, swept_quantity
from ._contacts import name_of
from ._orbits import STABLE, UNKNOWN, UNSTABLE, Orbits, as_sweep, list_of, stability_of

ORDINATES = {
    "velocity": ("impact_velocity", "Velocity $v^-$ before impact\nat {} (length / time)"),
    "relative velocity": (
        "impact_relative_velocity",
        "Velocity before impact, relative\nto {} (length / time)",
    ),
    "phase": ("impact_phase", "Phase $\\varphi$ of impact\nat {} (rad)"),
}
_OF_CONTACT = "Speed of approach before impact\nat {} (length / time)"
# Drawn one over the other: where both agree, a dark point in a light one.
_DIRECTIONS = {
    "down": ("swept down", ("#f59b42", "#d9731a"), 4.0),
    "up": ("swept up", ("#10264f", "#bcd4ff"), 1.8),
}
_ONE_DIRECTION = ("swept", ("black", "white"), 2.0)
_OVER = ("", ("black", "white"), 3.0)  # orbits that are drawn over a sweep
# By the stability of the orbit: the marker, by how much it is larger, the width of its edge, and its words.
_MARKS = {
    UNKNOWN: (".", 1.0, 0.0, ""),
    STABLE: (".", 2.2, 0.0, "stable orbit"),
    UNSTABLE: ("o", 1.8, 0.7, "unstable orbit"),
}


@overload
def bifurcation(
    ds: xr.Dataset,
    stop: int = 0,
    *,
    ordinate: str = "velocity",
    orbits: Orbits | None = None,
    ax: Axes | None = None,
) -> Axes: ...
@overload
def bifurcation(
    ds: xr.Dataset,
    stop: None,
    *,
    ordinate: str = "velocity",
    orbits: Orbits | None = None,
    ax: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray: ...
def bifurcation(
    ds: xr.Dataset,
    stop: int | None = 0,
    *,
    ordinate: str = "velocity",
    orbits: Orbits | None = None,
    ax: Axes | Sequence[Axes] | np.ndarray | None = None,
) -> Axes | np.ndarray:
    """Draw a bifurcation diagram: the velocities of the recorded impacts against the swept quantity.

    Of a sweep up and down (`carry="both"`) the points of the way up are small and dark, those of the way
    down large and light, below them: where both ways agree, a dark point in a light one. A warning tells of
    points not all of whose impacts were recorded.

    With `orbits`, the impacts of stable orbits are larger discs, those of unstable ones rings.

    Of a contact between masses the velocity is the speed of approach, positive.

    Args:
        ds: what `vx.sweep` returned for one swept quantity; of several, select all but one first.
        stop: the stop whose impacts are drawn; None for all, one panel a stop.
        ordinate: "velocity" before the impacts, "relative velocity" where stops move, counted from theirs, or
            the "phase" of the impacts in the forcing period.
        orbits: what `vx.periodic_orbits(ds)` returned, to mark the points of the sweep that it polished; or orbits of the
            machine at any values of the swept quantity, as from `vx.find_periodic_orbits`, to draw over them.
        ax: where to draw, for `stop=None` one axes for each stop; new axes if left out.

    Returns:
        The axes; an array of them for `stop=None`.

    Raises:
        ValueError: if not exactly one quantity is swept, there is no such stop, or the orbits are of another sweep, or of
            machines that have no place in it.

    Example:
        ```python
        import numpy as np, vijax as vx
        system, frequency = vx.models.wagg_bishop_b(1.0), np.arange(0.3, 2.1, 0.01)
        ds = vx.sweep(system, {"forcing.frequency": frequency}, carry="both")
        top, bottom = vx.plot.bifurcation(ds, stop=None, orbits=vx.periodic_orbits(ds))
        ```

    References:
        Wagg & Bishop (2004), Figs. 4 and 7.
    """
    path = swept_quantity(ds.result, "A bifurcation diagram")
    if ordinate not in ORDINATES:
        names = " or ".join(f'"{name}"' for name in ORDINATES)
        raise ValueError(f'Argument `ordinate` must be {names}, but is "{ordinate}".')
    if ORDINATES[ordinate][0] not in ds:
        raise ValueError(
            'Argument `ordinate` must be "velocity" where no stop moves: there it is the relative one.'
        )
    check_index("stop", 0 if stop is None else stop, ds.sizes["stop"])
    stops = range(ds.sizes["stop"]) if stop is None else [stop]
    warn_of_endings(ds, "max_impacts_reached")
    layers = _layers(ds, path, [] if orbits is None else orbits)
    column = column_of_axes(ax, len(stops))
    for j, panel in zip(stops, column, strict=True):
        for layer in layers:
            _draw_impacts(layer, path, j, ordinate, panel)
        panel.set_ylabel(label_of_impacts(ordinate, j, ds["stop_mass"].values))
        if ordinate == "phase":
            span_of_phase(panel.set_ylim, panel.set_yticks)
        else:
            panel.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        values = np.concatenate([layer.ds[path].values.ravel() for layer in layers])
        panel.set_xlim(values.min(), values.max())
    _draw_legend(layers, column[0])
    column[-1].set_xlabel(label(path))
    return column if stop is None else column[0]


def label_of_impacts(ordinate: str, stop: int, stop_masses: np.ndarray) -> str:
    """What is drawn of the impacts at a stop; of a contact, every velocity is its speed of approach."""
    is_speed = stop_masses[stop] < 0 and ordinate != "phase"
    return (_OF_CONTACT if is_speed else ORDINATES[ordinate][1]).format(name_of(stop, stop_masses))


class _Layer(NamedTuple):
    """Impacts in one colour: `ds` has them as a sweep does, and the `stability` of the orbits they are of."""

    ds: xr.Dataset
    words: str
    colors: tuple[str, str]
    size: float


def _layers(ds: xr.Dataset, path: str, orbits: Orbits) -> list[_Layer]:
    """All that is drawn, the lowest first."""
    if isinstance(orbits, xr.Dataset):
        ds, over = ds.assign(stability=stability_of(ds, orbits)), []
    else:
        found = list_of(orbits)
        over = [_Layer(as_sweep(found, path, ds.sizes["stop"]), *_OVER)] if found else []
        ds = ds.assign(stability=xr.full_like(ds["result"], UNKNOWN))
    if "direction" in ds["result"].dims:
        return [_Layer(ds.sel(direction=way), *style) for way, style in _DIRECTIONS.items()] + over
    return [_Layer(ds, *_ONE_DIRECTION), *over]


def _draw_impacts(layer: _Layer, path: str, stop: int, ordinate: str, ax: Axes) -> None:
    """The impacts of a layer at a stop."""
    names = (path, ORDINATES[ordinate][0], "impact_stop", "stability")
    swept, drawn, of_stop, stability = (a.values for a in xr.broadcast(*(layer.ds[name] for name in names)))
    for known in _MARKS:
        is_it = (of_stop == stop) & (stability == known)
        if known == UNKNOWN or is_it.any():
            words = layer.words if known == UNKNOWN else ""
            _draw_points(ax, swept[is_it], drawn[is_it], known, ink(*layer.colors), layer.size, words)


def _draw_points(
    ax: Axes, x: np.ndarray, y: np.ndarray, stability: int, color: str, size: float, words: str
) -> None:
    marker, larger, edge, _ = _MARKS[stability]
    ax.plot(
        x,
        y,
        linestyle="none",
        marker=marker,
        markersize=larger * size,
        markeredgewidth=edge,
        markerfacecolor="none" if edge else color,
        color=color,
        label=words,
        rasterized=True,
    )


def _draw_legend(layers: list[_Layer], ax: Axes) -> None:
    """What the colours mean, and the marks that there are at any stop."""
    present = np.concatenate([layer.ds["stability"].values.ravel() for layer in layers])
    known, (_, colors, size) = [k for k in (STABLE, UNSTABLE) if k in present], _ONE_DIRECTION
    for stability in known:
        _draw_points(ax, np.empty(0), np.empty(0), stability, ink(*colors), size, _MARKS[stability][-1])
    if known or len(layers) > 1:
        legend_above(ax, markerscale=2.5)
