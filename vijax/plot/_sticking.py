"""The sticking region in the phase plane of a mass that stays free while another one sticks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from .._hybrid.limits import RELEASE, STICK
from .._hybrid.sticking_region import StickingRegion
from .._orbits.orbit import PeriodicOrbit
from .._trajectory.solution import Solution
from ._axes import check_index, create_axes, label_if_new, label_phase_plane
from ._colors import ink, merge_style, ordered_colors
from ._contacts import name_in
from ._labels import Units
from ._legend import add_legend
from ._orbits import solution_of
from ._trajectories import draw_motion, held_within, is_event, span_of

_ALL_PHASES = np.linspace(0, 2 * np.pi, 721)
# Alternating line styles, so that neighbours in the legend differ in more than their shade.
_STYLES = ("-", (0, (6, 1.5)))


def sticking_region(
    sols: Solution | PeriodicOrbit | Sequence[Solution | PeriodicOrbit],
    stop: int,
    mass: int | None = None,
    *,
    span: tuple[float, float] | None = None,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    num_samples: int = 400,
    **style: Any,
) -> Axes:
    """Draw the motion of another mass while a stop holds its mass, up to the exit boundary of region S.

    A circle marks where the held mass sticks, a disc where it is released. The exit boundary, on which the contact
    force is zero, is drawn if the machine is linear and the force depends on no third mass. It has its equation in the
    legend, and region S beyond it is shaded. A load on the held mass moves the boundary: then it is drawn at each
    release. Only the motion is drawn for machines with contacts between masses, a full mass matrix, or differently
    moving stops of one mass.

    Args:
        sols: one or several trajectories or periodic orbits, of machines that differ in their load.
        stop: the stop that holds its mass.
        mass: the mass whose velocity is drawn against its position; if omitted, the other one of two.
        span: first and last time to draw; the whole of each trajectory if omitted.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into; new axes if omitted.
        num_samples: number of evenly spaced times to draw in each sticking interval, beside those of the events.
        **style: properties of the curves for matplotlib's `plot`: `color`, `linewidth`, `linestyle`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if the stop or mass does not exist, the mass is that of the stop, or the stop never holds its mass.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)
        ax = vx.plot.sticking_region(sol, stop=1)
        ```

    References:
        Wagg & Bishop (2004), Sec. 4.6.2 and Fig. 12.
    """
    many = [solution_of(sol) for sol in ([sols] if isinstance(sols, Solution | PeriodicOrbit) else sols)]
    if not many:
        raise ValueError("Argument `sols` is empty: give one trajectory or more.")
    mass = _mass_to_draw(many[0], stop, mass)
    held = [held_within(sol, stop, span_of(sol, span)) for sol in many]
    if not any(len(starts) for starts, _ in held):
        name = name_in(many[0], stop).capitalize()
        raise ValueError(f"{name} holds its mass at no time that is to be drawn.")
    ax = create_axes() if ax is None else ax
    names = [style.get("label", f"$\\Omega$ = {float(sol.machine.frequency):.4g}") for sol in many]
    style.pop("label", None)
    look = [
        merge_style(style, color=color, linestyle=_STYLES[k % 2], linewidth=1.2)
        for k, color in enumerate(ordered_colors(len(many)))
    ]
    colors = [one["color"] for one in look]
    for k, (sol, spans) in enumerate(zip(many, held, strict=True)):
        for interval in zip(*spans, strict=True):
            draw_motion(ax, sol, mass, interval, num_samples, look[k])
        _draw_ends(ax, sol, stop, mass, spans, colors[k])
    _draw_boundaries(ax, many, stop, mass, held, colors)
    label_phase_plane(ax, mass, units)
    for words, one in zip(names, look, strict=True):
        ax.plot([], [], label=words, **one)
    add_legend(ax, is_shown=legend)
    return ax


def _mass_to_draw(sol: Solution, stop: int, mass: int | None) -> int:
    machine, n = sol.machine, sol.x1.shape[-1]
    check_index("stop", stop, machine.contacts.num)
    others = [i for i in range(n) if i != machine.contacts.masses[stop]]
    if not others:
        raise ValueError(
            "The plane is that of a mass beside the one that is held, but the machine has no other."
        )
    if mass is None and len(others) != 1:
        raise ValueError(f"Argument `mass` must be one of {others}: name the mass that is to be drawn.")
    mass = others[0] if mass is None else mass
    check_index("mass", mass, n)
    if mass not in others:
        raise ValueError(f"Argument `mass` must be one of {others}, but {mass} is the mass of stop {stop}.")
    return mass


def _events_at(sol: Solution, stop: int, kind: int, times: np.ndarray) -> np.ndarray:
    """The times at which the stop has an event of the kind; the others are ends of the span."""
    is_it = is_event(sol, [stop], kind, (-np.inf, np.inf))
    return times[np.isin(times, np.asarray(sol.events.t)[is_it])]


def _draw_ends(
    ax: Axes, sol: Solution, stop: int, mass: int, spans: tuple[np.ndarray, np.ndarray], color: Any
) -> None:
    """Draw a circle where the held mass sticks, a disc where it is released."""
    marks = (STICK, "stick", ax.get_facecolor()), (RELEASE, "release", color)
    for times, (kind, words, face) in zip(spans, marks, strict=True):
        for t in _events_at(sol, stop, kind, times):
            x, v = (float(a[mass]) for a in sol.evaluate(t))
            common = {"color": color, "markerfacecolor": face, "markersize": 5, "zorder": 3}
            ax.plot(x, v, "o", label=label_if_new(ax, words), **common)


def _draw_boundaries(
    ax: Axes,
    sols: list[Solution],
    stop: int,
    mass: int,
    held: list[tuple[np.ndarray, np.ndarray]],
    colors: list,
) -> None:
    """Draw the exit boundary a x + b v = c: once if it is fixed and common to all, else at each release."""
    if any(sol.machine.extra is not None or sol.machine.contacts.is_coupled for sol in sols):
        return
    limits = ax.get_xlim(), ax.get_ylim()
    regions = [StickingRegion(sol.machine, (stop,)) for sol in sols]
    place = regions[0].free.index(mass)
    normals = np.array([[r.x_normal[0], r.v_normal[0]] for r in regions])
    if np.delete(normals, place, axis=2).any() or not normals.any(axis=(1, 2)).all():
        return
    normals = normals[:, :, place]
    levels = np.array([r.level(_ALL_PHASES)[:, 0] for r in regions])
    planes = np.stack([normals[:, :1] + 0 * levels, normals[:, 1:] + 0 * levels, levels])
    is_fixed = np.ptp(planes, axis=(1, 2)).max() <= 1e-12 * np.abs(planes).max()
    words = r"exit boundary $\partial S$"
    if is_fixed:
        equation = f"{words}:\n{_equation(normals[0], levels[0, 0], mass)}"
        _draw_line(ax, normals[0], levels[0, 0], color=ink(), label=equation, linewidth=2.0)
        x, v = np.meshgrid(*limits)
        force = normals[0, 0] * x + normals[0, 1] * v - levels[0, 0]
        shade = ink("0.92", "0.2")
        ax.contourf(x, v, force, levels=[0, max(force.max(), 1e-300)], colors=[shade], zorder=0)
        ax.fill([], [], facecolor=shade, edgecolor=ink("0.6", "0.5"), label="region $S$")
    else:
        for sol, region, normal, (_, ends), color in zip(sols, regions, normals, held, colors, strict=True):
            for t in _events_at(sol, stop, RELEASE, ends):
                level = float(region.level(float(sol.machine.frequency) * t)[0])
                _draw_line(ax, normal, level, color=color, linewidth=0.8)
        ax.plot([], [], color=ink(), linewidth=0.8, label=f"{words} at release")
    ax.set(xlim=limits[0], ylim=limits[1])


def _equation(normal: np.ndarray, level: float, mass: int) -> str:
    """Equation of the line, solved for the velocity, or for the position if the velocity has no coefficient."""
    a, b = map(float, normal)
    symbol = rf"\dot x_{{{mass}}}" if b else f"x_{{{mass}}}"
    slope, rest = (-a / b, level / b) if b else (0.0, level / a)
    terms = [f"{value:.4g}{name}" for value, name in ((slope, f" x_{{{mass}}}"), (rest, "")) if value]
    return f"${symbol} = {' + '.join(terms) or 0}$".replace("+ -", "- ")


def _draw_line(ax: Axes, normal: np.ndarray, level: float, **look: Any) -> None:
    """Draw the line a x + b v = level, with (a, b) the normal."""
    x, v = level * normal / (normal @ normal)
    a, b = normal
    ax.axline((x, v), (x - b, v + a), zorder=1, **look)
