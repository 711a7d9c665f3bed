"""Bifurcation diagrams: recorded impacts against a swept quantity, and the stability of their orbits."""

import warnings
from collections.abc import Sequence
from typing import Any, overload

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._dataset_checks import check_columns
from .._jax.users_line import users_line
from .._sweep.literals import ImpactOrdinate, Quantity
from .._sweep.outcomes import warn_of_endings
from ._axes import (
    Sweeps,
    break_long_labels,
    check_index,
    column_of_axes,
    current_xlim,
    extend_xlim,
    named_datasets,
    set_phase_axis,
    stops_to_draw,
)
from ._bifurcation_layers import draw_layer, draw_legend, layers_of
from ._contacts import StopMasses, name_of
from ._grazing_lines import draw_grazing
from ._labels import ANGLE, VELOCITY, Units, swept_quantity, with_unit
from ._orbits import OrbitsLike
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
    legend: bool = True,
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
    legend: bool = True,
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
    legend: bool = True,
    ax: Axes | Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> Axes | np.ndarray:
    """Draw a bifurcation diagram: the velocities of the recorded impacts against the swept quantity.

    For a sweep up and down (`carry="both"`) the points of the sweep up are small and dark, over large and light ones of
    the sweep down: where both agree, dark lies in light. A warning reports points with unrecorded impacts.

    Many points of chaotic motions are drawn by their density: more transparent where they overlap, larger where they
    stand alone. `alpha` and `markersize` in `style` replace that.

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
        grazing: draw where the steady motion without impacts just reaches a stop, for linear machines under harmonics of one frequency.
        units: of `length` and `time`, as in `{"length": "mm", "time": "s"}`; none are written if left out.
        labels: words of the axes, by the path of the swept quantity and the name of the ordinate, as in
            `{"force.mu": "Friction", "max_position": "Amplitude"}`.
        xlim: ends of the x axis; those of the swept values if left out.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
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
        _warn_if_empty(list(sweeps.values()), numbers)
    else:
        _check_quantity(quantity, mass, min(ds.sizes["mass"] for ds in sweeps.values()), orbits)
        numbers = stops_to_draw(stop, num_stops) if quantity.axis == "stop" else [mass]
    drawn = layers_of(sweeps, path, [] if orbits is None else orbits)
    column = column_of_axes(ax, len(numbers))
    for j, panel in zip(numbers, column, strict=True):
        so_far = current_xlim(panel)
        for layer in drawn:
            draw_layer(layer, path, j, quantity or ORDINATES[ordinate][0], panel, style, xlim)
        panel.set_ylabel(
            (labels or {}).get(ordinate) or _label(ordinate, quantity, j, one["stop_mass"].values, units)
        )
        if ordinate == "phase":
            set_phase_axis(panel.set_ylim, panel.set_yticks)
        elif quantity is None or quantity.has_sign:
            panel.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        values = np.concatenate([layer.ds[path].values.ravel() for layer in drawn])
        extend_xlim(panel, values, so_far)
        if xlim is not None:
            panel.set_xlim(xlim)
        if resonances:
            draw_resonances(panel, one, path)
    if grazing:
        draw_grazing(column, one, path)
    column[-1].set_xlabel(label_of(path, labels, units, one))
    break_long_labels(column)
    if legend:
        draw_legend(drawn, column[0], has_lines=resonances or grazing)
    return column if stop is None else column[0]


def _common(sweeps: list[xr.Dataset], ordinate: str) -> tuple[str, int]:
    """The common swept quantity, and the number of stops."""
    needed = {"result": (), "stop_mass": ("stop",)}
    needed |= {"impact_stop": ("impact",)} if ordinate in ORDINATES else {}
    for ds in sweeps:
        check_columns(ds, "`vx.sweep`", needed)
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
    return path, num_stops


def _warn_if_empty(sweeps: list[xr.Dataset], stops: Sequence[int]) -> None:
    """Warn where no impact was recorded at the stops that are drawn."""
    counts = [ds["num_impacts"].transpose("stop", ...).values for ds in sweeps if "num_impacts" in ds]
    if len(counts) == len(sweeps) and not any(count[list(stops)].any() for count in counts):
        where = f"at stop {stops[0]}" if len(stops) == 1 else "at any stop"
        warnings.warn(
            f"The diagram is empty: no impact {where} was recorded, and compliant stops have none. "
            '`ordinate="section_position"` shows the motion, as do the `quantities` of `vx.sweep`.',
            stacklevel=users_line(),
        )


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
