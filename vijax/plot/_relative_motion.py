"""Relative position limited by one contact, against time."""

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
from ._orbits import solution_of
from ._trajectories import draw_held, finish_time_axis, is_event, is_held_at, sample_times, span_of


def relative_motion(
    sol: Solution | PeriodicOrbit,
    contact: int = 0,
    *,
    span: tuple[float, float] | None = None,
    units: Units | None = None,
    ax: Axes | None = None,
    num_samples: int = 2000,
    **style: Any,
) -> Axes:
    """Draw the quantity that a contact limits, `row . x`, against time, with its limit.

    For a contact between two masses it is their distance along the row, for a stop the position of its mass. The dotted
    line is the limit, a disc is an impact; the line is thick where the contact holds.

    Args:
        sol: one trajectory, or one periodic orbit, drawn over one cycle.
        contact: the contact or stop, by its number in `ImpactSystem(..., stops=...)`.
        span: first and last time of a close-up; the whole trajectory if omitted.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        ax: the axes to draw into, over their content; new axes if omitted.
        num_samples: number of evenly spaced times to draw, beside those of the events.
        **style: properties of the curve for matplotlib's `plot`: `color`, `linewidth`, `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if the contact does not exist, the span lies outside the trajectory, or the orbit was not found.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.impact_damper(1.0), 0.0, 60.0)
        ax = vx.plot.relative_motion(sol, contact=1, span=(40.0, 60.0))
        ```

    References:
        S. F. Masri, "General motion of impact dampers", J. Acoustical Society of America 47 (1970) 229-237.
    """
    sol = solution_of(sol)
    check_index("contact", contact, sol.machine.contacts.num_stops)
    drawn = span_of(sol, span)
    t = sample_times(sol, drawn, num_samples)
    row, name = row_of(sol, contact), name_in(sol, contact)
    distance, limit = np.asarray(sol.evaluate(t)[0]) @ row, np.asarray(sol.evaluate_stops(t)[0])[:, contact]
    ax = create_axes() if ax is None else ax
    so_far = current_xlim(ax)
    look = merge_style(style, color=curve_colors(1)[0], linewidth=1.3, label=f"${in_symbols(row)}$")
    (line,) = ax.plot(t, distance, **look)
    ax.plot(t, limit, color=ink(), linestyle=":", linewidth=1.0, label=label_if_new(ax, name))
    is_held = is_held_at(sol, contact, t)
    if is_held.any():
        draw_held(ax, t, distance, is_held, line.get_color(), label_if_new(ax, f"held by {name}"))
    when, is_hit = np.asarray(sol.events.t), is_event(sol, [contact], IMPACT, drawn)
    if is_hit.any():
        # Evaluated at all events with their padding: one shape for all trajectories, so one compilation.
        where = np.asarray(sol.evaluate_stops(sol.events.t)[0])[is_hit, contact]
        look = {"color": ink(), "markersize": 4, "zorder": 3}
        ax.plot(when[is_hit], where, "o", label=label_if_new(ax, "impact"), **look)
    finish_time_axis(ax, drawn, so_far, units)
    ax.set_ylabel(with_unit(f"${in_symbols(row)}$", LENGTH, units))
    return ax
