"""Relative position limited by one contact, or by several on both sides, against time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from .._hybrid.limits import IMPACT
from .._orbits.orbit import PeriodicOrbit
from .._trajectory.solution import Solution
from ._axes import check_index, create_axes, current_xlim, label_if_new
from ._colors import curve_colors, ink, merge_style
from ._contacts import in_symbols, name_in, row_of
from ._labels import LENGTH, Units, with_unit
from ._legend import add_legend
from ._orbits import solution_of
from ._trajectories import draw_held, finish_time_axis, is_event, is_held_at, sample_times, span_of

# Strokes of the limits; rounding of the entries of rows that are multiples of each other.
LIMITS, _PARALLEL = (":", "-.", (0, (5, 1))), 1e-12


def relative_motion(
    sol: Solution | PeriodicOrbit,
    contact: int | Sequence[int] = 0,
    *,
    span: tuple[float, float] | None = None,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    num_samples: int = 2000,
    **style: Any,
) -> Axes:
    """Draw the quantity that a contact limits, `row . x`, against time, with its limit.

    For a contact between two masses it is their distance along the row, for a stop the position of its mass. The dotted
    line is the limit, a disc is an impact; the line is thick where the contact holds.

    Args:
        sol: one trajectory, or one periodic orbit, drawn over one cycle.
        contact: the contact or stop, by its number in `ImpactSystem(..., stops=...)`; or several that limit the same
            distance, as both walls of a container, `contact=[0, 1]`: drawn along the row of the first.
        span: first and last time of a close-up; the whole trajectory if omitted.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into, over their content; new axes if omitted.
        num_samples: number of evenly spaced times to draw, beside those of the events.
        **style: properties of the curve for matplotlib's `plot`: `color`, `linewidth`, `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if a contact does not exist, several limit different distances, the span lies outside the trajectory, or the orbit was not found.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.impact_damper(1.0), 0.0, 60.0)
        ax = vx.plot.relative_motion(sol, contact=[0, 1], span=(40.0, 60.0))
        ```

    References:
        S. F. Masri, "General motion of impact dampers", J. Acoustical Society of America 47 (1970) 229-237.
    """
    sol = solution_of(sol)
    numbers = [contact] if isinstance(contact, int) else list(contact)
    if not numbers:
        raise ValueError("Argument `contact` is empty: give the number of one contact or more.")
    for number in numbers:
        check_index("contact", number, sol.machine.contacts.num_stops)
    row, drawn = row_of(sol, numbers[0]), span_of(sol, span)
    factors = [_factor(row_of(sol, number), row, number, numbers[0]) for number in numbers]
    t = sample_times(sol, drawn, num_samples)
    distance, limits = np.asarray(sol.evaluate(t)[0]) @ row, np.asarray(sol.evaluate_stops(t)[0])
    # Evaluated at all events with their padding: one shape for all trajectories, so one compilation.
    when, at_events = np.asarray(sol.events.t), np.asarray(sol.evaluate_stops(sol.events.t)[0])
    ax = create_axes() if ax is None else ax
    so_far = current_xlim(ax)
    look = merge_style(style, color=curve_colors(1)[0], linewidth=1.3, label=f"${in_symbols(row)}$")
    (line,) = ax.plot(t, distance, **look)
    for k, (number, factor) in enumerate(zip(numbers, factors, strict=True)):
        name, stroke = name_in(sol, number), LIMITS[k % len(LIMITS)]
        place = factor * limits[:, number]
        ax.plot(t, place, color=ink(), linestyle=stroke, linewidth=1.0, label=label_if_new(ax, name))
        is_held = is_held_at(sol, number, t)
        if is_held.any():
            draw_held(ax, t, distance, is_held, line.get_color(), label_if_new(ax, f"held by {name}"))
    for number, factor in zip(numbers, factors, strict=True):
        is_hit = is_event(sol, [number], IMPACT, drawn)
        if is_hit.any():
            mark = {"color": ink(), "markersize": 4, "zorder": 3, "label": label_if_new(ax, "impact")}
            ax.plot(when[is_hit], factor * at_events[is_hit, number], "o", **mark)
    finish_time_axis(ax, drawn, so_far, units)
    ax.set_ylabel(with_unit(f"Relative position ${in_symbols(row)}$", LENGTH, units))
    add_legend(ax, is_shown=legend)
    return ax


def _factor(row: np.ndarray, first: np.ndarray, number: int, other: int) -> float:
    """Factor from positions along the row of a contact to those along another; raise unless they are parallel."""
    factor = float(row @ first / (row @ row))
    if not np.allclose(factor * row, first, rtol=_PARALLEL, atol=0.0):
        raise ValueError(
            f"Argument `contact` must name limits of one distance, but {other} limits ${in_symbols(first)}$ and {number} "
            f"${in_symbols(row)}$: draw them in axes of their own."
        )
    return factor
