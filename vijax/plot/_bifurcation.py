"""Bifurcation diagrams: recorded impacts against a swept quantity, and the stability of their orbits."""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple, overload

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._sweep.literals import ImpactOrdinate, Quantity
from .._sweep.outcomes import warn_of_endings
from .._sweep.short_names import with_paths
from ._axes import (
    Sweeps,
    check_index,
    column_of_axes,
    current_xlim,
    extend_xlim,
    label_if_new,
    legend_above,
    named_datasets,
    set_phase_axis,
    stops_to_draw,
)
from ._colors import curve_colors, faded, ink, lightness_of, merge_style, point_colors
from ._contacts import StopMasses, name_of
from ._grazing_lines import draw_grazing
from ._labels import ANGLE, VELOCITY, Units, swept_quantity, with_unit
from ._orbits import STABLE, UNKNOWN, UNSTABLE, OrbitsLike, as_sweep, list_of_orbits, stability_of
from ._ordinates import Labels, Ordinate, label_of, ordinate_of, ordinates
from ._resonances import draw_resonances

ORDINATES = {
    "velocity": ("impact_velocity", "Velocity $v^-$ before impact\nat {}", VELOCITY),
    "relative velocity": (
        "impact_relative_velocity",
        "Velocity before impact, relative\nto {}",
        VELOCITY,
    ),
    "phase": ("impact_phase", "Phase $\\varphi$ of impact\nat {}", ANGLE),
}
_OF_CONTACT = "Speed of approach before impact\nat {}"
# Marker sizes: sweep down, single sweep, sweep up, separate orbits.
_LARGE, _MIDDLE, _SMALL, _OVER = 4.0, 2.0, 1.8, 3.0
# Number of swept values whose points of these sizes join into a line, and the largest factor of the sizes for fewer.
_LINE, _LARGER = 400, 2.0
# Marker size of the points of a sweep in the legend.
_IN_LEGEND = 5.0
# Share left of a style colour in the sweep down, and the difference in lightness from the ink beyond which all is left.
_LEFT, _APART = 0.6, 0.3
# Stability of the orbit: marker, factor of its size, width of its edge, label.
_MARKS = {
    UNKNOWN: (".", 1.0, 0.0, ""),
    STABLE: (".", 2.2, 0.0, "stable orbit"),
    UNSTABLE: ("o", 1.8, 0.7, "unstable orbit"),
}


@overload
def bifurcation(
    ds: Sweeps,
    stop: int = 0,
    *,
    ordinate: ImpactOrdinate | Quantity = "velocity",
    mass: int = 0,
    orbits: OrbitsLike | None = None,
    resonances: bool = False,
    grazing: bool = False,
    units: Units | None = None,
    labels: Labels | None = None,
    xlim: tuple[float, float] | None = None,
    ax: Axes | None = None,
    **style: Any,
) -> Axes: ...
@overload
def bifurcation(
    ds: Sweeps,
    stop: None,
    *,
    ordinate: ImpactOrdinate | Quantity = "velocity",
    mass: int = 0,
    orbits: OrbitsLike | None = None,
    resonances: bool = False,
    grazing: bool = False,
    units: Units | None = None,
    labels: Labels | None = None,
    xlim: tuple[float, float] | None = None,
    ax: Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> np.ndarray: ...
def bifurcation(
    ds: Sweeps,
    stop: int | None = 0,
    *,
    ordinate: ImpactOrdinate | Quantity = "velocity",
    mass: int = 0,
    orbits: OrbitsLike | None = None,
    resonances: bool = False,
    grazing: bool = False,
    units: Units | None = None,
    labels: Labels | None = None,
    xlim: tuple[float, float] | None = None,
    ax: Axes | Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> Axes | np.ndarray:
    """Draw a bifurcation diagram: the velocities of the recorded impacts against the swept quantity.

    For a sweep up and down (`carry="both"`) the points of the sweep up are small and dark, over large and light ones of
    the sweep down: where both agree, dark lies in light. A warning reports points with unrecorded impacts.

    With `orbits`, the impacts of stable orbits are larger discs, those of unstable orbits are rings.

    For a contact between masses the velocity is the speed of approach, positive.

    Args:
        ds: result of `vx.sweep` over one quantity; of several, select all but one first. Several sweeps of that quantity
            are given by name, as in `{"r = 0.7": one, "r = 0.8": other}`, and differ in colour.
        stop: the stop whose impacts are drawn; None for all, one panel a stop.
        ordinate: "velocity" before the impacts, "relative velocity" where stops move, counted from theirs, or
            the "phase" of the impacts in the forcing period; or a quantity by its name in `vx.sweep`, as "max_position",
            that the sweep has: of a mass, in one panel for all stops, or of the stop. Every sweep has "section_position"
            and "section_velocity".
        mass: the mass whose quantity is drawn.
        orbits: result of `vx.periodic_orbits(ds)`, to mark the points of the sweep that it polished; or orbits of the
            machine at any values of the swept quantity, as from `vx.find_periodic_orbits`, to draw over them.
        resonances: draw the natural frequencies of the machine without dampers and impacts, along "forcing.frequency".
        grazing: draw where the steady motion without impacts just reaches a stop, for linear machines.
        units: of `length` and `time`, as in `{"length": "mm", "time": "s"}`; none are written if left out.
        labels: words of the axes, by the path of the swept quantity and the name of the ordinate, as in
            `{"force.mu": "Friction", "max_position": "Amplitude"}`.
        xlim: ends of the x axis; those of the swept values if left out.
        ax: where to draw, also over what is there; for `stop=None` one axes for each stop; new axes if left out.
        **style: of the points of the sweep, as matplotlib's `plot` takes them: `color`, `marker`, `markersize`, `label`, ...

    Returns:
        The axes; an array of them for `stop=None`.

    Raises:
        ValueError: unless one quantity is swept, the stop or the mass exists, the sweep has the ordinate, and the orbits
            belong to the sweep or its machine; for single orbits over a quantity.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system, frequency = vx.models.wagg_bishop_b(1.0), np.arange(0.3, 2.1, 0.01)
        ds = vx.sweep(system, {"forcing.frequency": frequency}, carry="both")
        top, bottom = vx.plot.bifurcation(ds, stop=None, orbits=vx.periodic_orbits(ds))
        ```

    References:
        Wagg & Bishop (2004), Figs. 4 and 7.
    """
    sweeps = named_datasets(ds, style)
    path, num_stops = _common(list(sweeps.values()), ordinate)
    one = next(iter(sweeps.values()))
    quantity = None if ordinate in ORDINATES else ordinate_of(ordinate, one)
    if quantity is None:
        numbers = stops_to_draw(stop, num_stops)
    else:
        _check_quantity(quantity, mass, min(ds.sizes["mass"] for ds in sweeps.values()), orbits)
        numbers = stops_to_draw(stop, num_stops) if quantity.axis == "stop" else [mass]
    layers = _layers(sweeps, path, [] if orbits is None else orbits)
    column = column_of_axes(ax, len(numbers))
    for j, panel in zip(numbers, column, strict=True):
        so_far = current_xlim(panel)
        for layer in layers:
            _draw_layer(layer, path, j, quantity or ordinate, panel, style)
        panel.set_ylabel(
            (labels or {}).get(ordinate) or _label(ordinate, quantity, j, one["stop_mass"].values, units)
        )
        if ordinate == "phase":
            set_phase_axis(panel.set_ylim, panel.set_yticks)
        elif quantity is None or quantity.has_sign:
            panel.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        values = np.concatenate([layer.ds[path].values.ravel() for layer in layers])
        extend_xlim(panel, values, so_far)
        if xlim is not None:
            panel.set_xlim(xlim)
        if resonances:
            draw_resonances(panel, one, path)
    if grazing:
        draw_grazing(column, one, path)
    _draw_legend(layers, column[0], has_lines=resonances or grazing)
    column[-1].set_xlabel(label_of(path, labels, units))
    return column if stop is None else column[0]


def _common(sweeps: list[xr.Dataset], ordinate: str) -> tuple[str, int]:
    """The common swept quantity, and the number of stops."""
    paths = {swept_quantity(ds.result, "A bifurcation diagram") for ds in sweeps}
    counts = {ds.sizes["stop"] for ds in sweeps}
    if len(paths) > 1 or len(counts) > 1:
        raise ValueError(
            f"Sweeps are drawn together that sweep one quantity of machines with as many stops, but these sweep "
            f"{sorted(paths)} of machines with {sorted(counts)} stops."
        )
    path, num_stops = paths.pop(), counts.pop()
    if ordinate not in ORDINATES:
        _check_known(sweeps, ordinate)
        return path, num_stops
    if any(ORDINATES[ordinate][0] not in ds for ds in sweeps):
        raise ValueError(
            'Argument `ordinate` must be "velocity" where no stop moves: there it is the relative one.'
        )
    for ds in sweeps:
        warn_of_endings(ds, "max_impacts_reached")
    if not any(ds["num_impacts"].values.any() for ds in sweeps):
        warnings.warn(
            "The diagram is empty: no impact on a rigid stop was recorded. "
            '`ordinate="section_position"` shows the motion, as do the `quantities` of `vx.sweep`.',
            stacklevel=3,
        )
    return path, num_stops


def _check_known(sweeps: list[xr.Dataset], ordinate: str) -> None:
    """Refuse an ordinate that is none, or that a sweep does not have."""
    if ordinate not in ordinates():
        names = ", ".join(f'"{name}"' for name in (*ORDINATES, *ordinates()))
        raise ValueError(f'Argument `ordinate` must be one of {names}, but is "{ordinate}".')
    quantity = ordinate_of(ordinate, sweeps[0])
    if quantity is None or any(quantity.variable not in ds for ds in sweeps):
        raise ValueError(
            f'Argument `ordinate` is "{ordinate}", which the sweep does not have: give `vx.sweep` '
            f'`quantities=["{ordinate}"]`.'
        )


def _check_quantity(quantity: Ordinate, mass: int, num_masses: int, orbits: OrbitsLike | None) -> None:
    if quantity.axis == "mass":
        check_index("mass", mass, num_masses)
    if orbits is not None and not isinstance(orbits, xr.Dataset):
        raise ValueError(
            "Argument `orbits` marks the points of a section or of another quantity if it is what "
            "`vx.periodic_orbits(ds)` returned; single orbits are drawn at their impacts only: leave them out, or choose "
            "another `ordinate`."
        )


def _label(
    ordinate: str, quantity: Ordinate | None, number: int, stop_masses: StopMasses, units: Units | None
) -> str:
    """Label of the y axis, for a stop or a mass."""
    if quantity is None:
        return label_of_impacts(ordinate, number, stop_masses, units)
    return quantity.label(number, stop_masses, units)


def label_of_impacts(ordinate: str, stop: int, stop_masses: StopMasses, units: Units | None) -> str:
    """Label of the y axis; at a contact every velocity is its speed of approach."""
    _, words, unit = ORDINATES[ordinate]
    words = _OF_CONTACT if stop_masses[stop] < 0 and ordinate != "phase" else words
    return with_unit(words.format(name_of(stop, stop_masses)), unit, units)


class _Layer(NamedTuple):
    """Impacts in one colour: `ds` has the variables of a sweep, and the `stability` of their orbits."""

    ds: xr.Dataset
    words: str
    color: Any
    size: float
    is_swept: bool = True


def _layers(sweeps: dict[str, xr.Dataset], path: str, orbits: OrbitsLike) -> list[_Layer]:
    """All layers, in drawing order from the lowest."""
    if isinstance(orbits, xr.Dataset):
        if len(sweeps) > 1:
            raise ValueError(
                "Argument `orbits` is of one sweep, but several are drawn: mark them one by one."
            )
        ((name, ds),) = sweeps.items()
        sweeps, over = {name: ds.assign(stability=stability_of(ds, with_paths(orbits)))}, []
    else:
        found = list_of_orbits(orbits)
        num_stops = next(iter(sweeps.values())).sizes["stop"]
        over = [_Layer(as_sweep(found, path, num_stops), "", ink(), _OVER, False)] if found else []
        sweeps = {
            name: ds.assign(stability=xr.full_like(ds["result"], UNKNOWN)) for name, ds in sweeps.items()
        }
    colors = point_colors(len(sweeps)) if len(sweeps) > 1 else [ink()]
    colored = zip(sweeps.items(), colors, strict=True)
    return [one for (name, ds), color in colored for one in _layers_of_sweep(ds, path, name, color)] + over


def _layers_of_sweep(ds: xr.Dataset, path: str, name: str, color: Any) -> list[_Layer]:
    """The layers of one sweep: two if it runs up and down."""
    larger = float(np.clip(_LINE / ds["result"].sizes[path], 1.0, _LARGER))
    if "direction" not in ds["result"].dims:
        return [_Layer(ds, name or "swept", color, larger * _MIDDLE)]
    pale = faded(color, 0.5) if name else _beside_ink()
    # Drawing order: the small points of the sweep up over the large ones of the sweep down, dark in light where both agree.
    looks = {"down": (pale, larger * _LARGE), "up": (color, larger * _SMALL)}
    before = f"{name}, " if name else ""
    return [_Layer(ds.sel(direction=way), f"{before}swept {way}", *look) for way, look in looks.items()]


def _beside_ink() -> str:
    """A colour of the style that differs from the ink in greyscale too."""
    color = curve_colors(2)[1][:3]
    far = abs(lightness_of(color) - lightness_of(ink())) > _APART
    return faded(color, 1.0 if far else _LEFT)


def _draw_layer(
    layer: _Layer, path: str, number: int, ordinate: Ordinate | str, ax: Axes, style: dict[str, Any]
) -> None:
    """Draw the impacts of a layer at a stop, or a quantity of a stop or a mass."""
    if isinstance(ordinate, Ordinate):
        shown = layer.ds[ordinate.variable]
        shown = shown.isel({ordinate.axis: number}) if ordinate.axis else shown
        is_ours = shown.notnull()
    else:
        shown = layer.ds[ORDINATES[ordinate][0]]
        is_ours = layer.ds["impact_stop"] == number
    together = xr.broadcast(layer.ds[path], shown, is_ours, layer.ds["stability"])
    swept, drawn, is_ours, stability = (a.values for a in together)
    for known in _MARKS:
        is_it = is_ours & (stability == known)
        if known == UNKNOWN or is_it.any():
            words = layer.words if known == UNKNOWN else ""
            look = style if layer.is_swept else {}
            _draw_points(ax, swept[is_it], drawn[is_it], known, layer, look, words)


def _draw_points(
    ax: Axes, x: np.ndarray, y: np.ndarray, stability: int, layer: _Layer, style: dict[str, Any], words: str
) -> None:
    marker, larger, edge, _ = _MARKS[stability]
    color = merge_style(style).get("color", layer.color)
    own = {
        "linestyle": "none",
        "marker": marker,
        "markersize": larger * layer.size,
        "markeredgewidth": edge,
        "markerfacecolor": "none" if edge else color,
        "color": color,
        "rasterized": True,
    }
    ax.plot(x, y, label=words, **merge_style(style, **own))


def _draw_legend(layers: list[_Layer], ax: Axes, *, has_lines: bool) -> None:
    """Add the legend of the colours, and of the stability markers present at any stop; `has_lines` if of lines too."""
    present = np.concatenate([layer.ds["stability"].values.ravel() for layer in layers])
    sample = layers[0]._replace(color=ink(), size=min(layer.size for layer in layers if layer.is_swept))
    for stability in (STABLE, UNSTABLE):
        if stability in present and (words := label_if_new(ax, _MARKS[stability][-1])):
            _draw_points(ax, np.empty(0), np.empty(0), stability, sample, {}, words)
    if len(ax.get_legend_handles_labels()[0]) > (0 if has_lines else 1):
        legend_above(ax, markerscale=_IN_LEGEND / sample.size)
