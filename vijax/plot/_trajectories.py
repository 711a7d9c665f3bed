"""Time series and phase portraits of one trajectory or orbit."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from .._hybrid.limits import IMPACT, RELEASE, STICK
from .._orbits.orbit import PeriodicOrbit
from .._sections.record import held_intervals
from .._trajectory.solution import Solution
from ._axes import (
    check_index,
    create_axes,
    current_xlim,
    extend_xlim,
    label_if_new,
    label_phase_plane,
)
from ._colors import curve_colors, curve_styles, ink, merge_style
from ._contacts import is_rigid, masses_of, name_in, place_on_axis
from ._labels import LENGTH, TIME, Units, with_unit
from ._legend import add_legend
from ._orbits import solution_of

HELD = "#f59b42"
# Differences of velocities below this, relative to the largest, are no jumps.
_ROUNDING = 1e-9

Span = tuple[float, float]


def time_series(
    sol: Solution | PeriodicOrbit,
    *,
    span: tuple[float, float] | None = None,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    num_samples: int = 2000,
    **style: Any,
) -> Axes:
    """Draw the positions of all masses against time, with their stops.

    A dotted line is a stop, in the colour of its mass; a disc is an impact. A line is thick where a stop holds the
    mass, a compliant stop pushes it, or friction makes it stick, both lines where a contact of two masses does. Contacts
    have no line of their own: see `relative_motion`.

    Args:
        sol: one trajectory, or one periodic orbit, drawn over one cycle.
        span: first and last time of a close-up; the whole trajectory if omitted.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into, over their content; new axes if omitted.
        num_samples: number of evenly spaced times to draw, beside those of the events.
        **style: properties of the curves for matplotlib's `plot`: `color`, `linewidth`, `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if the span lies outside the trajectory, or the orbit was not found.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)
        ax = vx.plot.time_series(sol, span=(70.0, 80.0))
        ```

    References:
        Wagg & Bishop (2004), Figs. 5, 8, 10 and 11.
    """
    sol = solution_of(sol)
    drawn = span_of(sol, span)
    t = sample_times(sol, drawn, num_samples)
    x = np.asarray(sol.evaluate(t)[0])
    ax = create_axes() if ax is None else ax
    so_far = current_xlim(ax)
    colors = _draw_positions(ax, t, x, style)
    for j in range(sol.machine.contacts.num - sol.num_sliders):
        _draw_limit(ax, sol, j, t, x, colors)
    _mark_impacts(ax, sol, t, x)
    finish_time_axis(ax, drawn, so_far, units)
    ax.set_ylabel(with_unit("Position $x_i$", LENGTH, units))
    add_legend(ax, is_shown=legend)
    return ax


def _draw_positions(ax: Axes, t: np.ndarray, x: np.ndarray, style: dict[str, Any]) -> list:
    """Draw the curves of the masses; return their colours."""
    whole = f"{style.pop('label')}, " if "label" in style else ""
    drawn = []
    for i, (color, stroke) in enumerate(curve_styles(x.shape[1], style)):
        look = merge_style(style, color=color, linestyle=stroke, linewidth=1.3)
        drawn += ax.plot(t, x[:, i], label=f"{whole}$x_{{{i}}}$", **look)
    return [line.get_color() for line in drawn]


def _draw_limit(ax: Axes, sol: Solution, number: int, t: np.ndarray, x: np.ndarray, colors: list) -> None:
    """Draw a stop in the colour of its mass, and the intervals in which it, or a contact, holds."""
    masses, place = masses_of(sol, number), place_on_axis(sol, number, t)
    if place is not None:
        words = label_if_new(ax, f"{name_in(sol, number)}, of $x_{{{masses[0]}}}$")
        ax.plot(t, place[0], color=colors[masses[0]], linestyle=":", linewidth=1.0, label=words)
    is_held = is_held_at(sol, number, t)
    if is_held.any():
        words = f"{', '.join(f'$x_{{{i}}}$' for i in masses)} {_hold_in_words(sol, number)}"
        for i in masses:
            draw_held(ax, t, x[:, i], is_held, colors[i], label_if_new(ax, words))


def _hold_in_words(sol: Solution, number: int) -> str:
    """Effect of a stop, contact or friction element on its masses while it holds, in a word."""
    if number >= sol.machine.contacts.num_stops:
        return "sticks"
    return "held" if is_rigid(sol, number) else "pushed"


def _mark_impacts(ax: Axes, sol: Solution, t: np.ndarray, x: np.ndarray) -> None:
    """Draw a disc on the curve of every mass hit; the times `t` of the curves include those of the impacts."""
    found = []
    for j in range(sol.machine.contacts.num - sol.num_sliders):
        hits = np.asarray(sol.events.t)[is_event(sol, [j], IMPACT, (t[0], t[-1]))]
        found += [(hits, x[np.searchsorted(t, hits), i]) for i in masses_of(sol, j)]
    at, where = np.concatenate([np.empty((2, 0)), *map(np.array, found)], axis=1)
    if at.size:
        ax.plot(at, where, "o", color=ink(), markersize=2.6, zorder=3, label=label_if_new(ax, "impact"))


def phase_portrait(
    sol: Solution | PeriodicOrbit,
    mass: int = 0,
    *,
    span: tuple[float, float] | None = None,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    num_samples: int = 2000,
    **style: Any,
) -> Axes:
    """Draw the velocity of one mass against its position.

    A periodic orbit is a closed curve. Jumps at impacts are dashed. A grey line is a fixed stop, or the curve of a
    moving one. On it a circle marks where the mass sticks, a dot where it is released. In between the mass is held: a
    thick orange line, or an orange disc on a fixed stop. A contact with another mass is not a line in this plane: its
    circles, dots and orange lines lie on the curve of the motion.

    Args:
        sol: one trajectory, or one periodic orbit, drawn over one cycle.
        mass: index of the mass.
        span: first and last time to draw, to omit a transient; the whole trajectory if omitted.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into, over their content; new axes if omitted.
        num_samples: number of evenly spaced times to draw, beside those of the events.
        **style: properties of the curves for matplotlib's `plot`: `color`, `linewidth`, `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if the mass does not exist, the span lies outside the trajectory, or the orbit was not found.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.wagg_bishop_b(0.8)
        sol = vx.simulate(system, 0.0, 50 * system.forcing.period)
        orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
        ax = vx.plot.phase_portrait(orbit, mass=1)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2.
    """
    sol = solution_of(sol)
    check_index("mass", mass, sol.x1.shape[-1])
    drawn = span_of(sol, span)
    ax = create_axes() if ax is None else ax
    look = merge_style(style, color=curve_colors(1)[0], linewidth=1.0)
    draw_motion(ax, sol, mass, drawn, num_samples, look, "impact")
    for j in range(sol.machine.contacts.num - sol.num_sliders):
        if mass in masses_of(sol, j):
            _draw_contact(ax, sol, j, mass, sample_times(sol, drawn, num_samples))
    _draw_ends(ax, sol, mass, drawn)
    label_phase_plane(ax, mass, units)
    add_legend(ax, is_shown=legend)
    return ax


def span_of(sol: Solution, span: Span | None) -> Span:
    """First and last time to draw; raise if the span lies outside the trajectory."""
    t0, t1 = float(sol.t0), float(sol.t1)
    begin, end = (t0, t1) if span is None else map(float, span)
    if not (t0 <= begin < end <= t1 or span is None):
        raise ValueError(f"Argument `span` must be two times in order within [{t0}, {t1}], but is {span}.")
    return begin, end


def sample_times(sol: Solution, span: Span, num_samples: int) -> np.ndarray:
    """Evenly spaced times and those of the events, sorted and clipped to the span."""
    # The padding of the log is kept, as copies of the end: one shape for all trajectories, so one compilation.
    events = np.nan_to_num(np.asarray(sol.events.t), nan=span[1])
    return np.sort(np.concatenate([np.linspace(*span, num_samples), events])).clip(*span)


def finish_time_axis(ax: Axes, span: Span, so_far: tuple[float, ...], units: Units | None) -> None:
    """Set the x axis to span the times, with its label."""
    extend_xlim(ax, np.array(span), so_far)
    ax.xaxis.set_major_locator(MaxNLocator(steps=[1, 2, 5, 10]))
    ax.set_xlabel(with_unit("Time $t$", TIME, units))


def draw_motion(
    ax: Axes, sol: Solution, mass: int, span: Span, num_samples: int, look: dict[str, Any], words: str = ""
) -> None:
    """Draw the velocity of a mass against its position, with dashed jumps at its impacts, labelled by `words`."""
    t = sample_times(sol, span, num_samples)
    x, v = (np.asarray(a)[:, mass] for a in sol.evaluate(t))
    when, where, minus, plus = _impacts(sol, mass, span)
    gap = np.full_like(when, np.nan)
    # Order at an impact: the state before, a gap in the line, the state after.
    order = np.lexsort(
        (np.repeat([2, 0, 1], [len(t), len(when), len(when)]), np.concatenate([t, when, when]))
    )
    curve = (np.concatenate(parts)[order] for parts in ([x, where, gap], [v, minus, gap]))
    (line,) = ax.plot(*curve, **look)
    label = label_if_new(ax, words) if len(where) else None
    style = {"color": line.get_color(), "linestyles": "dashed", "linewidth": 0.8}
    ax.vlines(where, minus, plus, label=label or "", **style)


def held_within(sol: Solution, stop: int, span: Span) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends of the intervals in which a stop holds its mass, clipped to the span."""
    starts, ends = held_intervals(sol, stop)
    is_inside = (starts < span[1]) & (ends > span[0])
    return starts[is_inside].clip(*span), ends[is_inside].clip(*span)


def is_held_at(sol: Solution, stop: int, t: np.ndarray) -> np.ndarray:
    """Flags of the times `t`, sorted, at which a stop holds its mass."""
    starts, ends = held_within(sol, stop, (t[0], t[-1]))
    return np.any((t[:, None] >= starts) & (t[:, None] <= ends), axis=1)


def draw_held(
    ax: Axes, t: np.ndarray, x: np.ndarray, is_held: np.ndarray, color: Any, label: str | None
) -> None:
    """Draw a thick line where a stop holds: its butt caps end at the release, other caps extend beyond it."""
    band = {"linestyle": "-", "linewidth": 6, "alpha": 0.5, "solid_capstyle": "butt"}
    ax.plot(t, np.where(is_held, x, np.nan), color=color, label=label, **band)


def _draw_contact(ax: Axes, sol: Solution, number: int, mass: int, t: np.ndarray) -> None:
    """Draw a fixed stop as a vertical line, a moving one as its curve, and the parts where any contact holds."""
    grey, name = ink("0.8", "0.4"), name_in(sol, number)
    is_held, place = is_held_at(sol, number, t), place_on_axis(sol, number, t)
    x, v = place if place is not None else (np.asarray(a)[:, mass] for a in sol.evaluate(t))
    is_fixed = place is not None and not v.any()
    if is_held.any() and place is not None and not is_rigid(sol, number):
        # A compliant stop is passed: its line stands still, and what it pushes lies on the motion.
        ax.axvline(x[0], color=grey, linewidth=4, zorder=0, label=label_if_new(ax, name))
        is_fixed, place, (x, v) = False, None, (np.asarray(a)[:, mass] for a in sol.evaluate(t))
    if is_fixed:
        ax.axvline(x[0], color=grey, linewidth=4, zorder=0, label=label_if_new(ax, name))
    elif place is not None:
        ax.plot(x, v, color=grey, linewidth=4, zorder=0, label=label_if_new(ax, name))
    if is_held.any():
        mark = (x[0], 0, "o") if is_fixed else (np.where(is_held, x, np.nan), v, "-")
        words = f"held by {name}" if is_rigid(sol, number) else f"at {name}"
        ax.plot(*mark, color=HELD, linewidth=4, zorder=4, label=label_if_new(ax, words))


def _draw_ends(ax: Axes, sol: Solution, mass: int, span: Span) -> None:
    """Draw a circle where a mass sticks, a smaller disc where it is released: both are visible on a fixed stop."""
    ours = [j for j in range(sol.machine.contacts.num - sol.num_sliders) if mass in masses_of(sol, j)]
    for kind, words, face, size, zorder in (
        (STICK, "stick", ax.get_facecolor(), 9, 3),
        (RELEASE, "release", ink(), 3, 5),
    ):
        t = np.asarray(sol.events.t)[is_event(sol, ours, kind, span)]
        if t.size:
            x, v = (np.asarray(a)[:, mass] for a in sol.evaluate(t))
            common = {"color": ink(), "markerfacecolor": face, "markersize": size, "zorder": zorder}
            ax.plot(x, v, "o", label=label_if_new(ax, words), **common)


def _impacts(sol: Solution, mass: int, span: Span) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions, and velocities before and after, of the impacts that change the velocity of a mass."""
    contacts, log = sol.machine.contacts, sol.events
    is_it = is_event(sol, list(range(contacts.num)), IMPACT, span)
    t, stop, minus, plus = (
        np.asarray(a)[is_it] for a in (log.t, log.stop, log.velocity_minus, log.velocity_plus)
    )
    x, after = (np.asarray(a)[:, mass] for a in sol.evaluate(t))
    # At its own stops the log has the velocities of the mass. At others, evaluate at the largest float below t.
    before = np.asarray(sol.evaluate(np.nextafter(t, -np.inf).clip(float(sol.t0)))[1])[:, mass]
    is_own = np.array(contacts.masses, int)[stop] == mass
    # What acts on others jumps too: by the mass matrix, friction of the contact, or contacts that rest.
    jumps = is_own | (np.abs(after - before) > _ROUNDING * np.abs([before, after]).max(initial=0))
    before, after = np.where(is_own, minus, before), np.where(is_own, plus, after)
    return t[jumps], x[jumps], before[jumps], after[jumps]


def is_event(sol: Solution, stops: list[int], kind: int, span: Span) -> np.ndarray:
    """Flags of the rows of the log that are events of a kind at given stops within the span."""
    log, t = sol.events, np.asarray(sol.events.t)
    return (np.asarray(log.kind) == kind) & np.isin(log.stop, stops) & (t >= span[0]) & (t <= span[1])
