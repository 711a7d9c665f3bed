"""Pictures of sweeps and trajectories.

Every function draws into the axes it is given, or into new ones, and returns them. Units are those
in which the machine was described, so the axes name the kind of unit alone.
"""

import re

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ._log import RELEASE, STICK
from ._solution import Solution

_AXIS_LABELS = {
    "mass": ("Mass", "m", "units of mass"),
    "damping": ("Damping", "C", r"force $\times$ time / length"),
    "stiffness": ("Stiffness", "K", "force / length"),
    "forcing.amplitude": ("Forcing amplitude", "A", "units of force"),
    "forcing.frequency": ("Forcing frequency", r"\Omega", "rad / time"),
    "forcing.phase": ("Forcing phase", r"\varphi", "rad"),
    "forcing.mean": ("Constant force", "F", "units of force"),
    "stops.position": ("Stop position", "s", "units of length"),
    "stops.restitution": ("Restitution", "r", "ratio"),
    "x0": ("Start position", "x", "units of length"),
    "v0": ("Start velocity", r"\dot x", "length / time"),
}


def bifurcation(ds: xr.Dataset, stop: int = 0, *, ax: Axes | None = None) -> Axes:
    """Draw a bifurcation diagram: the velocities of the recorded impacts against the swept quantity.

    Args:
        ds: what `vx.sweep` returned for one swept quantity; of several, select all but one first.
        stop: the stop whose impacts are drawn.
        ax: where to draw; new axes if left out.

    Returns:
        The axes.

    Raises:
        ValueError: if not exactly one quantity is swept, or there is no such stop.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        ax = vx.plot.bifurcation(ds, stop=1)
        ```

    References:
        Wagg & Bishop (2004), Figs. 4 and 7.
    """
    if ds.result.ndim != 1:
        raise ValueError(
            f"A bifurcation diagram needs one swept quantity, but there are {list(ds.result.dims)}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    if not 0 <= stop < ds.sizes["stop"]:
        raise ValueError(f"Argument `stop` must lie in 0 to {ds.sizes['stop'] - 1}, but is {stop}.")
    (path,) = ds.result.dims
    swept, velocity, of_stop = xr.broadcast(ds[path], ds.impact_velocity, ds.impact_stop)
    is_drawn = (of_stop == stop).values
    ax = _new_axes() if ax is None else ax
    ax.plot(
        swept.values[is_drawn],
        velocity.values[is_drawn],
        linestyle="none",
        marker=".",
        markersize=2,
        markeredgewidth=0,
        color="black",
        rasterized=True,
    )
    ax.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    ax.set_xlim(ds[path].values.min(), ds[path].values.max())
    ax.set_xlabel(_label(str(path)))
    ax.set_ylabel(f"Velocity $v^-$ before impact\nat stop {stop} (length / time)")
    return ax


def time_series(sol: Solution, *, ax: Axes | None = None, num_samples: int = 2000) -> Axes:
    """Draw the positions of all masses against time, with their stops.

    A dotted line is a stop, in the colour of its mass; where it is thick the stop holds the mass.

    Args:
        sol: one trajectory.
        ax: where to draw; new axes if left out.
        num_samples: evenly spaced times to draw, beside those of the events.

    Returns:
        The axes.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)
        ax = vx.plot.time_series(sol)
        ```

    References:
        Wagg & Bishop (2004), Figs. 5, 8, 10 and 11.
    """
    t0, t1 = float(sol.t0), float(sol.t1)
    # The padding of the log is kept, at t1: one shape for all trajectories, so one compilation.
    events = np.nan_to_num(np.asarray(sol.events.t), nan=t1)
    t = np.sort(np.concatenate([np.linspace(t0, t1, num_samples), events])).clip(t0, t1)
    x = np.asarray(sol.evaluate(t)[0])
    ax = _new_axes() if ax is None else ax
    # Dark to light, so that the curves differ in print as well.
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 0.75, x.shape[1]))
    for i, color in enumerate(colors):
        ax.plot(t, x[:, i], color=color, linewidth=1.3, label=f"$x_{{{i}}}$")
    for j, mass in enumerate(sol.machine.masses):
        position = float(sol.machine.position[j])
        ax.axhline(
            position, color=colors[mass], linestyle=":", linewidth=1.0, label=f"stop {j}, of $x_{{{mass}}}$"
        )
        starts, ends = _held_intervals(sol, j)
        held = ax.hlines(
            np.full(len(starts), position), starts, ends, color=colors[mass], linewidth=6, alpha=0.5
        )
        if len(starts):
            held.set_label(f"$x_{{{mass}}}$ held")
    ax.set_xlim(t0, t1)
    ax.xaxis.set_major_locator(MaxNLocator(steps=[1, 2, 5, 10]))
    ax.set_xlabel("Time $t$ (units of time)")
    ax.set_ylabel("Position $x_i$ (units of length)")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return ax


def _held_intervals(sol: Solution, stop: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends of the intervals in which a stop holds its mass."""
    is_ours = np.asarray(sol.events.stop) == stop
    t, kind = np.asarray(sol.events.t)[is_ours], np.asarray(sol.events.kind)[is_ours]
    starts, ends = t[kind == STICK], t[kind == RELEASE]
    turns = kind[(kind == STICK) | (kind == RELEASE)]
    if turns[0] == RELEASE if turns.size else bool(sol.stuck1[stop]):
        starts = np.append(float(sol.t0), starts)
    if len(starts) > len(ends):
        ends = np.append(ends, min(float(sol.t1), float(sol.known_until)))
    return starts, ends


def _label(path: str) -> str:
    """The words, symbol and unit of a swept quantity; its path where there are none."""
    name, indices = re.sub(r"\[.*?\]", "", path), re.findall(r"\[(\d+)\]", path)
    if name not in _AXIS_LABELS:
        return path
    words, symbol, unit = _AXIS_LABELS[name]
    subscript = f"_{{{','.join(indices)}}}" if indices else ""
    return f"{words} ${symbol}{subscript}$ ({unit})"


def _new_axes() -> Axes:
    return plt.subplots(layout="constrained")[1]
