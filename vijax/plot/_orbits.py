"""Periodic orbits in the forms accepted by pictures."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from .._hybrid.limits import IMPACT
from .._orbits.orbit import ORBIT_RESULTS, PeriodicOrbit
from .._system.parameters import get_parameter, is_parameter
from .._system.system import varied, with_args
from .._trajectory.solution import Solution

OrbitsLike = xr.Dataset | PeriodicOrbit | Sequence[PeriodicOrbit]

# Codes of the stability of the orbit of an impact; unknown if there is no orbit.
UNKNOWN, STABLE, UNSTABLE = 0, 1, 2


def solution_of(motion: Solution | PeriodicOrbit) -> Solution:
    """The trajectory to draw; one cycle of an orbit."""
    if isinstance(motion, PeriodicOrbit):
        return _checked_orbit(motion).solution()
    if not isinstance(motion, Solution):
        raise ValueError(
            "The motion to draw must be one trajectory, what `vx.simulate` returned, or one periodic orbit, but is a "
            f"{type(motion).__name__}."
        )
    return motion


def list_of_orbits(orbits: PeriodicOrbit | Sequence[PeriodicOrbit]) -> list[PeriodicOrbit]:
    """One orbit or several, as a list."""
    given = [orbits] if isinstance(orbits, PeriodicOrbit) else orbits
    several: list[Any] = [*given] if isinstance(given, Iterable) else [None]
    if not all(isinstance(one, PeriodicOrbit) for one in several):
        raise ValueError(
            "Argument `orbits` must be a periodic orbit, a list of such, or what `vx.periodic_orbits` returned, but is a "
            f"{type(orbits).__name__}."
        )
    return [_checked_orbit(orbit) for orbit in several]


def stability_of(ds: xr.Dataset, orbits: xr.Dataset) -> xr.DataArray:
    """Stability code of every point of a sweep.

    Args:
        ds: the sweep.
        orbits: result of `vx.periodic_orbits` for it.
    """
    missing = [name for name in ("converged", "is_stable") if name not in orbits]
    if missing:
        raise ValueError(
            f"Argument `orbits` must be what `vx.periodic_orbits(ds)` returned, but has no {missing}."
        )
    ours, theirs = ds["result"], orbits["converged"]
    others = [dim for dim in (*ours.dims, *theirs.dims) if (dim in ours.dims) != (dim in theirs.dims)]
    differ = others or [
        name
        for name, a in ours.coords.items()
        if name not in theirs.coords or not theirs.coords[name].variable.equals(a.variable)
    ]
    if differ:
        raise ValueError(
            f"Argument `orbits` must be of the points that are drawn, but differs from them in {differ}: select "
            "the same part of both, or call `vx.periodic_orbits` with what is drawn."
        )
    return xr.where(theirs, xr.where(orbits["is_stable"], STABLE, UNSTABLE), UNKNOWN)


def as_sweep(orbits: list[PeriodicOrbit], path: str, num_stops: int) -> xr.Dataset:
    """The impacts of orbits as a dataset along `impact`, with the variable names of a sweep.

    Args:
        orbits: orbits of one machine at several values of a parameter.
        path: path of the parameter.
        num_stops: number of stops of the machine.
    """
    names = (
        path,
        "stability",
        "impact_stop",
        "impact_phase",
        "impact_velocity",
        "impact_relative_velocity",
    )
    rows = [_impacts(orbit, path, num_stops) for orbit in orbits]
    columns = np.concatenate([np.empty((0, len(names))), *rows]).T
    return xr.Dataset({name: ("impact", column) for name, column in zip(names, columns, strict=True)})


def _impacts(orbit: PeriodicOrbit, path: str, num_stops: int) -> np.ndarray:
    """Parameter, stability, stop, phase, velocity and relative velocity of each impact of an orbit, (impacts, 6)."""
    system, log = with_args(orbit.system, orbit.args), orbit.events
    own = varied(orbit.system, orbit.args)
    values = np.unique(get_parameter(own, path)) if is_parameter(own, path) else np.empty(0)
    if values.size != 1 or system.num_stops != num_stops:
        raise ValueError(
            f"Argument `orbits` must be of the machine that was swept, with {num_stops} stops, and `{path}` one "
            f"number of it, at which they are drawn; here it has {system.num_stops} stops and {values.size} such numbers."
        )
    is_impact, frequency = np.asarray(log.kind) == IMPACT, float(system.forcing.frequency)
    t, stop, velocity = (np.asarray(a)[is_impact] for a in (log.t, log.stop, log.velocity_minus))
    angle = frequency * t
    hit = [system.stops[j] for j in stop]
    # The log of a contact has relative velocities already.
    slopes = [float(one.slope_at(a)) if one.slot else 0.0 for one, a in zip(hit, angle, strict=True)]
    relative = velocity - frequency * np.asarray(slopes, float)
    known = (values[0], STABLE if orbit.is_stable else UNSTABLE)
    columns = (*(np.full(t.shape, a) for a in known), stop, angle % (2 * np.pi), velocity, relative)
    return np.stack(columns, axis=1)


def _checked_orbit(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """The orbit itself; raise for a batch, or if the search failed."""
    if orbit.period.ndim:
        raise ValueError(
            f"Orbits are drawn one by one, but this is a batch of shape {orbit.period.shape}: draw its parts."
        )
    if orbit.result != ORBIT_RESULTS.successful:
        raise ValueError(f"Only an orbit that was found can be drawn. {ORBIT_RESULTS[orbit.result]}")
    return orbit
