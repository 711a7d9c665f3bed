"""The motion at one point of a sweep, simulated again for the explorer, independent of the page."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr

from ..._flow.interface import AbstractFlow
from ..._flow.taylor import TaylorFlow
from ..._jax.arrays import is_single_precision
from ..._orbits.orbit import ORBIT_RESULTS, PeriodicOrbit
from ..._orbits.periodic_orbit import periodic_orbit
from ..._sections.classify import MOTIONS, classified
from ..._sweep.provenance import system_of
from ..._system.parameters import get_parameter, parameter_names, set_parameter
from ..._system.system import AnySystem, bound
from ..._trajectory.results import RESULTS
from ..._trajectory.simulate import simulate_all
from ..._trajectory.solution import Solution
from ...plot._labels import swept_paths
from ...plot._ordinates import ordinates

# Capacity of the event log of a trajectory, and of one cycle; one size each, so that nothing is compiled twice.
_EVENTS, EVENTS_OF_CYCLE = 4096, 256
# Least number of simulated periods, enough to classify a motion; most shown periods of one that does not repeat.
RECORD, _SHOWN = 8, 8


class PointMotion(NamedTuple):
    """The motion at a point.

    Attributes:
        system: the machine.
        solution: the trajectory over the recorded periods, from phase 0.
        shown: first and last time to show: one cycle if the motion repeats.
        kind: result of `vx.classify`.
        orbit: the periodic orbit, if one was found.
    """

    system: AnySystem
    solution: Solution
    shown: tuple[float, float]
    kind: xr.Dataset
    orbit: PeriodicOrbit | None

    @property
    def num_periods(self) -> int:
        """Forcing periods after which the motion repeats, 0 if it does not."""
        return int(self.kind["num_periods"])

    @property
    def words(self) -> str:
        """The kind of motion in words."""
        name = MOTIONS[int(self.kind["motion"])].replace("_", " ")
        if not self.num_periods:
            return name
        counts = [_count(m) for m in self.kind["num_impacts"].values.tolist()]
        periods = "period" if self.num_periods == 1 else "periods"
        at_stops = f", {' | '.join(counts)} impacts" if counts else ""
        return f"{name}{at_stops} in {self.num_periods} forcing {periods}"


def check(ds: xr.Dataset, ordinate: str) -> None:
    """Raise unless the dataset is a sweep with a known machine and this ordinate."""
    if "result" not in ds or not swept_paths(ds["result"]):
        raise ValueError("The explorer shows what `vx.sweep` returned, over one swept quantity or more.")
    if "duration" in ds.attrs:
        raise ValueError(
            "The explorer shows motions by their forcing periods, but this sweep follows them for a `duration`: draw it with "
            "`vx.plot.bifurcation`, and single motions with `vx.plot.time_series`."
        )
    system_of(ds)
    known = ["velocity", *(name for name in ordinates() if name in ds or name.startswith("section_"))]
    if ordinate not in known:
        raise ValueError(
            f"Argument `ordinate` must be one of {', '.join(known)}, but is {ordinate!r}: `vx.sweep` computes others with "
            "`quantities`."
        )


def point_at(ds: xr.Dataset, place: Mapping[str, Any]) -> xr.Dataset:
    """The point of a sweep nearest to given values of the swept quantities.

    Args:
        ds: result of `vx.sweep`.
        place: a value for each dimension of its points, "up" or "down" for `direction`.
    """
    for dim in swept_paths(ds["result"]):
        ds = nearest_value(ds, dim, place[dim])
    return (ds.sel(direction=place["direction"]) if "direction" in ds["result"].dims else ds).load()


def nearest_value(ds: xr.Dataset, dim: str, value: Any) -> xr.Dataset:
    """The part of a sweep at the nearest value of a swept quantity, whose values may be unsorted."""
    return ds.isel({dim: int(np.abs(ds[dim].values - value).argmin())})


def motion_at(
    ds: xr.Dataset, place: Mapping[str, Any], changes: Mapping[str, float] | None = None
) -> PointMotion:
    """Simulate the motion at a point of a sweep again, optionally with other parameters.

    It continues from the end state of the sweep, so it is the motion found by the sweep, also if several coexist. With
    other parameters, the transient of the sweep is simulated first.

    Args:
        ds: result of `vx.sweep`.
        place: a value for each dimension of its points; the nearest point is used.
        changes: new values of parameters of the machine by path.

    Raises:
        ValueError: if the machine is unknown, a path does not exist, or a value makes the machine invalid.
        RuntimeError: if the sweep has no motion here, or the simulation fails.
    """
    point = point_at(ds, place)
    x, v = point["x"].values, point["v"].values
    if not np.isfinite([x, v]).all():
        name = point["result"].attrs["flag_meanings"].split()[int(point["result"])]
        raise RuntimeError(f"The sweep has no motion here: {RESULTS[getattr(RESULTS, name)]}")
    system = bound(system_of(point))
    for path, value in (changes or {}).items():
        system = set_parameter(system, path, value)
    if changes:
        x, v = _settled(system, int(ds.attrs["transient"]), x, v)
    return motion_from(system, max(int(ds.attrs["record"]), RECORD), x, v)


def motion_from(system: AnySystem, record: int, x: np.ndarray, v: np.ndarray) -> PointMotion:
    """The motion from a state at phase 0, over `record` forcing periods."""
    period, flow = float(system.forcing.period), flow_of(system)
    sol = simulated(system, record * period, x, v)
    kind = classified(sol, last=record)
    n, orbit = int(kind["num_periods"]), None
    if n and not is_single_precision(system):
        found = periodic_orbit(system, x, v, n, flow=flow, max_events=EVENTS_OF_CYCLE, throw=False)
        orbit = found if found.result == ORBIT_RESULTS.successful else None
    known = min(record * period, float(sol.known_until))
    shown = (0.0, min(known, (n or min(_SHOWN, record)) * period))
    return PointMotion(system, sol, shown, kind, orbit)


def scalar_parameters(system: AnySystem) -> dict[str, float]:
    """Every scalar of a machine by path, without the off-diagonal entries of matrices."""
    found = {}
    for path in parameter_names(bound(system)):
        value = np.asarray(get_parameter(bound(system), path))
        for index in np.ndindex(value.shape):
            if path not in ("mass", "damping", "stiffness") or len(set(index)) == 1:
                found[path + "".join(f"[{i}]" for i in index)] = float(value[index])
    return found


def _settled(
    system: AnySystem, transient: int, x: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The state of all coordinates after the transient; masses beyond a rigid stop that was moved start on it."""
    sol = _run(system, transient * float(system.forcing.period), _between_stops(system, x), v)
    return np.asarray(sol.x1), np.asarray(sol.v1)


def simulated(system: AnySystem, end: float, x: np.ndarray, v: np.ndarray) -> Solution:
    """The trajectory from a state at phase 0, also one whose log is full; raise if it failed."""
    return _run(system, end, x, v).of_masses


def _run(system: AnySystem, end: float, x: np.ndarray, v: np.ndarray) -> Solution:
    """The same with coordinates of Jenkins elements."""
    sol = simulate_all(system, 0.0, end, x, v, flow=flow_of(system), max_events=_EVENTS, throw=False)
    if not (sol.result == RESULTS.successful or sol.result == RESULTS.max_events_reached):
        raise RuntimeError(RESULTS[sol.result])
    return sol


def flow_of(system: AnySystem) -> AbstractFlow | None:
    """The flow: one kind for all linear machines, so that a changed number never needs another compilation.

    Rejected: the modal flow, the default of sweeps, which changed dampers would compile again.
    """
    return TaylorFlow() if system.force is None else None


def _between_stops(system: AnySystem, x: np.ndarray) -> np.ndarray:
    """Positions with every mass beyond a rigid stop moved onto it."""
    x = np.array(x, float)
    for stop in system.stops:
        gap = float(stop.gap(jnp.asarray(x), jnp.asarray(0.0)))
        if stop.slot is not None and not stop.is_compliant and gap < 0:
            x[stop.slot[0]] += stop.sign * gap
    return x


def _count(impacts: float) -> str:
    return "∞" if np.isinf(impacts) else "?" if np.isnan(impacts) else f"{impacts:.0f}"
