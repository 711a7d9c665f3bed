"""The sections of the impact maps: phase and velocity of every impact."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._orbits.orbit import PeriodicOrbit
from .._sweep.endings import warn_of_endings
from .._trajectory.event_log import IMPACT
from .._trajectory.solution import Solution
from ._axes import check_index, ink, legend_above, new_axes, of_curves, span_of_phase
from ._contacts import name_of
from ._orbits import solution_of

# Few points are drawn large, the thousands of a chaotic attractor small.
_SIZES = ((100, 7.0), (1000, 4.0), (np.inf, 1.5))
_MARKERS = "os^Dv"


def impact_map(
    sol_or_ds: Solution | PeriodicOrbit | xr.Dataset, stop: int | None = 0, *, ax: Axes | None = None
) -> Axes:
    """Draw the impacts in the plane of forcing phase and velocity before impact.

    That is the section on which the map of a stop, P_i, takes one impact to the next; with
    `stop=None` it is that of the global map P_g, the stops told apart. Of a contact between masses it is their speed of
    approach that is drawn.

    Args:
        sol_or_ds: a trajectory, a periodic orbit, or what `vx.sweep` returned, of which one machine is selected; from
            several starts all impacts are drawn.
        stop: the stop or contact whose impacts are drawn; None for all.
        ax: where to draw; new axes if left out.

    Returns:
        The axes.

    Raises:
        ValueError: if there is no such stop, it has no impacts, or the dataset is of several machines.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.3), 0.0, 300.0)
        ax = vx.plot.impact_map(sol, stop=1)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2 and Fig. 9.
    """
    if isinstance(sol_or_ds, xr.Dataset):
        warn_of_endings(sol_or_ds, "max_impacts_reached")
    masses, phase, velocity, of_stop = _impacts(sol_or_ds)
    num_stops = len(masses)
    check_index("stop", 0 if stop is None else stop, num_stops)
    drawn = list(range(num_stops)) if stop is None else [stop]
    counts = [np.count_nonzero(of_stop == j) for j in drawn]
    if not sum(counts):
        where = "any stop" if stop is None else name_of(stop, masses)
        raise ValueError(f"There are no impacts at {where} to draw.")
    size = next(size for most, size in _SIZES if sum(counts) <= most)
    ax = new_axes() if ax is None else ax
    for j, color in zip(drawn, of_curves(num_stops) if stop is None else [ink()], strict=True):
        ax.plot(
            phase[of_stop == j],
            velocity[of_stop == j],
            linestyle="none",
            marker=_MARKERS[j % len(_MARKERS)] if stop is None else "o",
            markersize=size,
            markeredgewidth=0,
            color=color,
            label=name_of(j, masses),
            rasterized=True,
        )
    ax.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    span_of_phase(ax.set_xlim, ax.set_xticks)
    ax.set_xlabel(r"Phase $\varphi$ of impact (rad)")
    words = "Speed of approach" if (masses[drawn] < 0).all() else "Velocity $v^-$"
    at_stop = "" if stop is None else f" at {name_of(stop, masses)}"
    ax.set_ylabel(f"{words} before impact{at_stop} (length / time)")
    if stop is None:
        legend_above(ax, markerscale=7 / size)
    return ax


def _impacts(
    sol_or_ds: Solution | PeriodicOrbit | xr.Dataset,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The masses of the stops, and phase, velocity and stop of every impact."""
    if isinstance(sol_or_ds, xr.Dataset):
        ds = sol_or_ds
        several = [
            str(dim)
            for dim in ds.result.dims
            if ds.sizes[dim] > 1 and not str(dim).startswith(("x0", "v0", "direction"))
        ]
        if several:
            raise ValueError(
                f"An impact map is of one machine, but {several} are swept: select one value of each, "
                "as in `ds.sel({path: value})`."
            )
        columns = (ds.impact_phase, ds.impact_velocity, ds.impact_stop)
        return ds["stop_mass"].values, *(column.values.ravel() for column in columns)
    sol = solution_of(sol_or_ds)
    log = sol.events
    is_impact = np.asarray(log.kind) == IMPACT
    t, velocity, stop = (np.asarray(a)[is_impact] for a in (log.t, log.velocity_minus, log.stop))
    phase = np.mod(float(sol.machine.frequency) * t, 2 * np.pi)
    return np.array(sol.machine.contacts.masses, int), phase, velocity, stop
