"""The impacts of a trajectory or a sweep in one form: a flat list, without padding."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr

from .._dataset_checks import check_columns
from .._hybrid.limits import CLOSE, IMPACT, OPEN, RELEASE, SLIP, STICK
from .._jax.arrays import check_type
from .._machine.kinds import COMPLIANT
from .._machine.machine import Machine
from .._sweep.provenance import machines_of
from .._system.force_description import NAMED_FORCE
from .._system.system import ImpactSystem, is_linear as is_linear_system
from .._trajectory.solution import Solution
from .section_side import machines_of_lanes

# Events at which an element begins to hold, or a compliant one to push, and at which it ends.
_BEGIN, _END = (STICK, CLOSE), (RELEASE, SLIP, OPEN)


class Impacts(NamedTuple):
    """The impacts of all points, grouped by point and in order of time.

    Attributes:
        point: index of the point, counted through the grid; 0 for a trajectory.
        time: time since the start of a trajectory, or since the end of the transient of a sweep.
        phase: W t mod 2 pi.
        velocity: signed, before the impact.
        stop: index of the stop.
        sticks: true where a complete chatter ends here, its last, lightest bounces left out.
    """

    point: np.ndarray
    time: np.ndarray
    phase: np.ndarray
    velocity: np.ndarray
    stop: np.ndarray
    sticks: np.ndarray


def impacts_of(source: Solution | xr.Dataset) -> Impacts:
    """List all impacts in the log."""
    return _of_trajectory(source) if isinstance(source, Solution) else _of_sweep(source)


def dims_of(source: Solution | xr.Dataset) -> dict[str, int]:
    """Dimensions of the points and their sizes; none for a trajectory."""
    if isinstance(source, Solution):
        return {}
    check_columns(source, "`vx.sweep`", {"result": ()})
    return {str(name): source.sizes[name] for name in source["result"].dims}


def flattened_points(source: Solution | xr.Dataset, a: xr.DataArray, *own: str) -> np.ndarray:
    """Values of an array with the points of the grid in a row, (points, *own)."""
    grid = dims_of(source)
    return a.transpose(*grid, *own).values.reshape((math.prod(grid.values()), *(a.sizes[dim] for dim in own)))


def labelled(
    source: Solution | xr.Dataset, columns: dict[str, tuple[tuple[str, ...], np.ndarray]]
) -> xr.Dataset:
    """Label arrays over points, (points, ...), given with the names of their other dimensions."""
    grid = dims_of(source)
    variables = {
        name: ((*grid, *own), a.reshape((*grid.values(), *a.shape[1:]))) for name, (own, a) in columns.items()
    }
    used = {*grid, *(dim for own, _ in columns.values() for dim in own)}
    trajectory = {"stop_mass": xr.DataArray(stop_masses(source), dims="stop")}
    coordinates = trajectory if isinstance(source, Solution) else source.coords
    return xr.Dataset(variables, coords={name: c for name, c in coordinates.items() if used >= set(c.dims)})


def check_source(source: Any) -> None:
    """Reject what is neither a solution nor a dataset."""
    check_type("source", source, (Solution, xr.Dataset), "what `vx.simulate` or `vx.sweep` returned")


def stop_masses(source: Solution | xr.Dataset) -> np.ndarray:
    """Mass of each stop, (stops,)."""
    if isinstance(source, Solution):
        contacts = source.machine.contacts
        return np.array(contacts.masses[: contacts.num_stops], int)
    check_source(source)
    check_columns(source, "`vx.sweep`", {"stop_mass": ("stop",)})
    return source["stop_mass"].values


def forcing_periods(source: Solution | xr.Dataset) -> np.ndarray:
    """Forcing period of every point, (points,)."""
    check_source(source)
    if isinstance(source, xr.Dataset):
        check_columns(source, "`vx.sweep`", {"forcing_period": ()})
        return flattened_points(source, source["forcing_period"])
    if np.ndim(source.t0):
        raise ValueError("Argument `source` holds several trajectories: pass one, or use `vx.sweep`.")
    if not source.machine.is_periodic:
        raise ValueError("The load does not repeat, so there is no forcing period to compare with.")
    if not source.machine.frequency > 0:
        raise ValueError("The load has no frequency, so there is no forcing period to compare with.")
    return np.array([source.machine.period], float)


def machines(source: Solution | xr.Dataset, which: np.ndarray) -> tuple[Machine | None, float]:
    """Machines of some points, lanes last, None if not stored, and the phase of the load at the ends of periods.

    Those of a dataset are without their force, which does not affect impacts and need not be imported.
    """
    if isinstance(source, Solution):
        angle = float(source.machine.frequency) * float(source.t0)
        return jax.tree.map(lambda a: np.asarray(a)[..., None], source.machine), angle
    try:
        system = machines_of(source, tuple(dims_of(source)), which, force=NAMED_FORCE)
    except ValueError:  # no machine in the attributes
        return None, 0.0
    return machines_of_lanes(system), 0.0


def _is_so(
    source: Solution | xr.Dataset,
    of_machine: Callable[[Machine], bool],
    of_system: Callable[[ImpactSystem], bool],
) -> bool:
    """Answer of one of two functions about the machine; False where it is not stored."""
    if isinstance(source, Solution):
        return of_machine(source.machine)
    try:
        return of_system(machines_of(source, force=NAMED_FORCE))
    except ValueError:  # as in `machines`
        return False


def has_full_mass(source: Solution | xr.Dataset) -> bool:
    """True if an impact of one mass may change the velocities of others, as far as the machine is stored."""
    return _is_so(source, lambda machine: machine.inverse_mass.ndim > 1, lambda system: system.has_full_mass)


def has_tied_friction(source: Solution | xr.Dataset) -> bool:
    """True if impacts have friction, as far as the machine is stored."""
    of_system = lambda system: any(element.is_tied for element in system.friction)  # noqa: E731
    return _is_so(source, lambda machine: machine.has_tied_friction, of_system)


def is_linear(source: Solution | xr.Dataset) -> bool:
    """True if the machine is stored and linear between impacts: without a force, friction and compliant stops."""
    return _is_so(source, lambda machine: machine.is_linear, is_linear_system)


def held_intervals(sol: Solution, stop: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends of the intervals in which a stop holds its mass, as far as they are logged.

    For a compliant stop those in which it pushes; for friction, numbered after the stops, those in which it sticks.
    """
    is_ours = np.asarray(sol.events.stop) == stop
    t, kind = np.asarray(sol.events.t)[is_ours], np.asarray(sol.events.kind)[is_ours]
    begins, finishes = np.isin(kind, _BEGIN), np.isin(kind, _END)
    starts, ends, turns = t[begins], t[finishes], finishes[begins | finishes]
    if turns[0] if turns.size else _is_always_held(sol, stop):
        starts = np.append(float(sol.t0), starts)
    if len(starts) > len(ends):
        ends = np.append(ends, min(float(sol.t1), float(sol.known_until)))
    return starts, ends


def _is_always_held(sol: Solution, stop: int) -> bool:
    """True if an element without events holds from the start."""
    is_at_rest = bool(np.concatenate([sol.stuck1, sol.sticking1])[stop])
    if is_at_rest or sol.machine.contacts.kinds[stop] != COMPLIANT:
        return is_at_rest
    return bool(np.asarray(sol.contact_force(sol.t1))[stop] > 0)


def _of_sweep(ds: xr.Dataset) -> Impacts:
    names = ("time", "phase", "velocity", "stop", "sticks")
    check_columns(ds, "`vx.sweep`", {f"impact_{name}": ("impact",) for name in names})
    columns = [flattened_points(ds, ds[f"impact_{name}"], "impact") for name in names]
    columns[3] = columns[3].astype(int)
    if columns[3].max(initial=-1) >= ds.sizes.get("stop", 0):
        raise ValueError(
            "The dataset has impacts at stops that its machine does not have: pass one of `vx.sweep`."
        )
    columns[4] = columns[4].astype(bool)
    point, column = np.nonzero(columns[3] >= 0)
    return Impacts(point, *(a[point, column] for a in columns))


def _of_trajectory(sol: Solution) -> Impacts:
    forcing_periods(sol)  # raises unless this is a single trajectory with a forcing period
    log, n = sol.events, int(sol.num_events)
    t, kind, stop, velocity = (np.asarray(a)[:n] for a in (log.t, log.kind, log.stop, log.velocity_minus))
    sticks = np.zeros(n, bool)
    for j in range(sol.machine.contacts.num):
        ours = np.flatnonzero(stop == j)
        # A mass that sticks at once, r = 0, has no chatter: it sticks at the time of its impact.
        is_end = (kind[ours[1:]] == STICK) & (kind[ours[:-1]] == IMPACT) & (t[ours[1:]] > t[ours[:-1]])
        sticks[ours[:-1][is_end]] = True
    hit = kind == IMPACT
    phase = np.mod(float(sol.machine.frequency) * t[hit], 2 * np.pi)
    point = np.zeros(np.count_nonzero(hit), int)
    return Impacts(point, t[hit] - float(sol.t0), phase, velocity[hit], stop[hit], sticks[hit])
