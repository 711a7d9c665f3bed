"""Sections of the impact maps: phase and velocity of every impact."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._hybrid.limits import IMPACT
from .._orbits.orbit import PeriodicOrbit
from .._sweep.outcomes import warn_of_endings
from .._sweep.short_names import with_paths
from .._trajectory.solution import Solution
from ._axes import break_long_labels, check_one_machine, create_axes, set_phase_axis, stops_to_draw
from ._cloud import Cloud, draw_clouds, name_clouds
from ._contacts import name_of
from ._labels import ANGLE, VELOCITY, Units, with_unit
from ._orbits import solution_of

MotionLike = Solution | PeriodicOrbit | xr.Dataset

# Least phase interval without impacts between two sets of them, in radians; if the interval at 0 has this share of
# the longest one, the axis begins at 0.
_APART, _ENOUGH = 0.2, 0.5


def impact_map(
    sol_or_ds: MotionLike | Mapping[str, MotionLike],
    stop: int | None = 0,
    *,
    origin: float | None = None,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the impacts in the plane of forcing phase and velocity before impact.

    This is the section on which the map of a stop, P_i, takes one impact to the next; with `stop=None` it is that of
    the global map P_g, and the stops differ in colour. For a contact between masses, the velocity is their speed of
    approach. Thousands of impacts are drawn transparent, so places with many are darker.

    Args:
        sol_or_ds: a trajectory, a periodic orbit, or one machine selected from the result of `vx.sweep`; impacts from
            several starts are all drawn. Several motions are given by name and differ in colour, as in
            `{"from rest": ds, "orbit": orbit}`.
        stop: the stop or contact whose impacts are drawn; None for all.
        origin: the phase at which the axis begins, in radians. If omitted, 0, or, if 0 would split a set of impacts, a
            phase in the longest part of the forcing period without impacts.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into, over their content; new axes if omitted.
        **style: point properties for matplotlib's `plot`: `color`, `marker`, `markersize`, `alpha`, `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if the stop does not exist or has no impacts, or the dataset holds several machines.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.3), 0.0, 300.0)
        ax = vx.plot.impact_map(sol, stop=1)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2 and Fig. 9.
    """
    clouds, words = _clouds(sol_or_ds, stop)
    phases = np.concatenate([one.x for one in clouds])
    begin = _origin(phases) if origin is None else float(origin)
    ax = create_axes() if ax is None else ax
    turned = [one._replace(x=begin + np.mod(one.x - begin, 2 * np.pi)) for one in clouds]
    draw_clouds(ax, turned, style)
    ax.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    set_phase_axis(ax.set_xlim, ax.set_xticks, begin)
    ax.set_xlabel(with_unit(r"Phase $\varphi$ of impact", ANGLE, units))
    ax.set_ylabel(with_unit(words, VELOCITY, units))
    break_long_labels([ax])
    name_clouds(ax, turned, style, is_shown=legend)
    return ax


def _clouds(motions: MotionLike | Mapping[str, MotionLike], stop: int | None) -> tuple[list[Cloud], str]:
    """Phases and velocities to draw, and the label of the velocity axis."""
    is_one = isinstance(motions, MotionLike)
    if not is_one and not isinstance(motions, Mapping):
        raise ValueError(
            "Argument `sol_or_ds` must be a trajectory, a periodic orbit or a sweep, or several by their names in a dict, but is a "
            f"{type(motions).__name__}."
        )
    named = {"": motions} if is_one else dict(motions)
    if not named:
        raise ValueError("There is no motion to draw: give one, or several by their names.")
    clouds, words = [], ""
    for name, motion in named.items():
        if isinstance(motion, xr.Dataset):
            warn_of_endings(motion, "max_impacts_reached")
        masses, phase, velocity, of_stop = _impacts(motion)
        drawn = stops_to_draw(stop, len(masses))
        if not np.isin(of_stop, drawn).any():
            where = "any stop" if stop is None else name_of(stop, masses)
            raise ValueError(f"There are no impacts at {where} to draw.")
        for j in drawn:
            is_it = of_stop == j
            label = _name(name, name_of(j, masses), stop is None)
            clouds.append(Cloud(label, phase[is_it], velocity[is_it]))
        quantity = "Speed of approach" if (masses[drawn] < 0).all() else "Velocity $v^-$"
        words = f"{quantity} before impact" + ("" if stop is None else f" at {name_of(stop, masses)}")
    return clouds, words


def _name(motion: str, stop: str, are_several: bool) -> str:
    """Legend label of the impacts of a motion at a stop; `are_several` flags several stops."""
    return f"{motion}, {stop}" if motion and are_several else motion or stop


def _origin(phase: np.ndarray) -> float:
    """Phase at which the axis begins, chosen so that no set of impacts is split by its ends."""
    ordered = np.sort(phase)
    lengths = np.diff(ordered, append=ordered[0] + 2 * np.pi)
    longest = int(np.argmax(lengths))
    if lengths[longest] < _APART or lengths[-1] >= _ENOUGH * lengths[longest]:
        return 0.0
    middle = ordered[longest] + lengths[longest] / 2
    quarter = np.pi / 2 * np.round(2 * middle / np.pi)
    # Prefer a multiple of a quarter period if it lies between the sets too.
    is_between = abs(quarter - middle) < lengths[longest] / 2 - _APART / 4
    return float(quarter if is_between else middle) - 2 * np.pi


def _impacts(motion: MotionLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mass of each stop, and phase, velocity and stop of each impact."""
    if isinstance(motion, xr.Dataset):
        check_one_machine(dict(with_paths(motion.result).sizes), "An impact map", ("direction",))
        columns = (motion.impact_phase, motion.impact_velocity, motion.impact_stop)
        return motion["stop_mass"].values, *(column.values.ravel() for column in columns)
    sol = solution_of(motion)
    log = sol.events
    is_impact = np.asarray(log.kind) == IMPACT
    t, velocity, stop = (np.asarray(a)[is_impact] for a in (log.t, log.velocity_minus, log.stop))
    phase = np.mod(float(sol.machine.frequency) * t, 2 * np.pi)
    return np.array(sol.machine.contacts.masses, int), phase, velocity, stop
