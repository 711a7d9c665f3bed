"""Results of a sweep as a labelled dataset."""

from collections.abc import Sequence
from functools import partial

import jax
import numpy as np
import xarray as xr

from .._dataset_attributes import flags, variable_attributes
from .._execution.points import LaneInput
from .._execution.records import Column, Impact, selected_rows
from .._execution.runner import Counts, PointResults
from .._system.contact import AbstractLimit
from .._system.parameters import axis_names
from .._system.system import ImpactSystem
from .._trajectory.lyapunov_loop import exponents, in_blocks
from .._trajectory.results import RESULTS
from .outcomes import code_of
from .quantities import DIMS, of_points, quantity_tables

# Padding of variables along `impact`; the others are padded with NaN.
FILL = {"impact_stop": -1, "impact_sticks": False}
# Impacts processed at a time: the columns of millions of points would take more memory than the tables.
_ROWS = 1 << 20
_OF_STOPS = ("num_impacts", "num_sticks", "stuck")
_DIMS = dict.fromkeys(_OF_STOPS, ("stop",)) | {
    "x": ("mass",),
    "v": ("mass",),
    "section_x": ("period", "mass"),
    "section_v": ("period", "mass"),
    "held_time": ("period", "stop"),
    "num_friction_sticks": ("friction",),
    "sticking": ("friction",),
    "num_slider_sticks": ("hysteresis",),
    "sticking_time": ("period", "friction"),
    "lyapunov_exponents": ("exponent",),
    "lyapunov_error": ("exponent",),
    "xs": ("time", "mass"),
    "vs": ("time", "mass"),
    **DIMS,
}


def dataset(
    points: LaneInput,
    axes: dict[str, np.ndarray],
    shape: tuple[int, ...],
    counts: Counts,
    found: PointResults,
    attributes: dict[str, str | int | float],
    quantities: Sequence[str] = (),
) -> xr.Dataset:
    """Label the results of a sweep.

    Args:
        points: machines and starts.
        axes: values of every swept quantity.
        shape: the points as a grid; with one more dimension than `axes` if they were visited up and down.
        counts: arguments of `sweep` for every point.
        found: results of the points; its sections are removed, so that memory does not hold them twice.
        attributes: attributes of the dataset, see `origin`.
        quantities: names of quantities to add, see `quantity_tables`.
    """
    # Text of variable length: Zarr has no standard form of NumPy's text of fixed length, and xarray before 2026.9 does not
    # write NumPy's own type of variable length.
    names = np.array(["up", "down"], object)
    directions = {"direction": names} if len(shape) > len(axes) else {}
    dims = (*directions, *axes)
    sections = (_section_table if counts.times is None else _time_table)(counts, found, points.system)
    impacts = _impact_table(points, counts, found)
    own = dict.fromkeys(impacts, ("impact",)) | _DIMS
    if counts.times is not None:  # one motion in place of its periods
        own = {name: tuple(dim for dim in of if dim != "period") for name, of in own.items()}
    variables = {}
    tables = impacts | sections | _end_table(points, counts, found)
    if counts.lyapunov:
        tables |= _exponents_table(counts, found, tables["forcing_period"])
    observed = {name: found.ends[name].T for name in counts.observed}
    tables |= quantity_tables(quantities, points, counts, tables, observed)
    for name, a in tables.items():
        variables[name] = ((*dims, *own.get(name, ())), a.reshape(*shape, *a.shape[1:]))
    coordinates = directions | coordinates_of(points.system, axes, counts)
    ds = labelled(xr.Dataset(variables, coords=coordinates, attrs=attributes))
    ds["steps"].attrs["lane_steps"] = found.lane_steps
    ds["result"].attrs |= flags(list(RESULTS._name_to_item))
    return ds


def labelled(ds: xr.Dataset) -> xr.Dataset:
    """Set the meaning of every variable in its attributes and return the dataset."""
    for name, variable in ds.variables.items():
        variable.attrs = variable_attributes(str(name))
    return ds


def saved_times(counts: Counts) -> dict[str, np.ndarray]:
    """Times at which states are saved, as a coordinate; empty if there are none."""
    times = () if counts.times is None else counts.times[:-1]
    return {"time": np.asarray(times, float)} if times else {}


def coordinates_of(
    system: ImpactSystem, axes: dict[str, np.ndarray], counts: Counts
) -> dict[str, tuple | np.ndarray]:
    """Coordinates of the stops, of saved times, and of the swept values; values that are arrays are numbered."""
    masses = [stop.slot[0] if stop.slot else -1 for stop in system.stops]
    coordinates: dict[str, tuple | np.ndarray] = {"stop_mass": ("stop", np.array(masses, int))}
    coordinates |= saved_times(counts)
    for path, axis in axes.items():
        coordinates[path] = axis if axis.ndim == 1 else np.arange(len(axis))
        if axis.ndim > 1:
            coordinates[f"{path}.values"] = ((path, *axis_names(path, axis.ndim - 1)), axis)
    return coordinates


def _impact_table(points: LaneInput, counts: Counts, found: PointResults) -> dict[str, np.ndarray]:
    """Impacts of every point in a row, padded to the longest, (points, impacts)."""
    impacts = found.impacts
    longest = min(int(found.ends["num_impacts"].sum(axis=0).max(initial=0)), counts.max_impacts)
    shape = points.x0.shape[-1], longest
    has_phases = counts.times is None
    none = _impact_columns(points, selected_rows(impacts, slice(0)), has_phases=has_phases)
    tables = {name: np.full(shape, FILL.get(name, np.nan), a.dtype) for name, a in none.items()}
    for first in range(0, len(impacts.point), _ROWS):
        rows = selected_rows(impacts, slice(first, first + _ROWS))
        place = rows.point.astype(np.intp) * longest + rows.number  # one index for all tables
        for name, column in _impact_columns(points, rows, has_phases=has_phases).items():
            tables[name].reshape(-1)[place] = column
    return tables


def _impact_columns(points: LaneInput, rows: Impact, *, has_phases: bool) -> dict[str, np.ndarray]:
    """Variables of some impacts, each (impacts,)."""
    stops, point = points.system.stops, rows.point
    frequency = np.broadcast_to(points.system.forcing.frequency, points.x0.shape[-1])[point]
    phase = np.mod(frequency * rows.time, 2 * np.pi)
    own = rows.velocity - frequency * _slopes(stops, rows.stop, point, phase)
    is_moving = any(one.motion is not None for one in stops)
    phases = {"impact_phase": phase} if has_phases else {}
    return ({"impact_relative_velocity": own} if is_moving else {}) | {
        "impact_time": rows.time,
        "impact_velocity": rows.velocity,
        **phases,
        "impact_stop": rows.stop,
        "impact_sticks": rows.chatter > 0,
    }


def _slopes(stops: tuple[AbstractLimit, ...], stop: Column, point: Column, phase: np.ndarray) -> np.ndarray:
    """Derivative of the stop's position by the phase at every impact, (impacts,); contacts have relative velocities."""
    slopes = np.zeros_like(phase)
    for j, one in enumerate(stops):
        if one.motion is not None and one.slot:
            ours = stop == j
            slopes[ours] = jax.tree.map(partial(of_points, point[ours]), one).slope_at(phase[ours])
    return slopes


def _section_table(counts: Counts, found: PointResults, system: ImpactSystem) -> dict[str, np.ndarray]:
    """State of every point at the end of each recorded period; NaN for periods that it did not reach."""
    # Points are last until the tables are done, as NumPy is slow along short last axes.
    is_reached = np.arange(counts.record)[:, None] < found.ends["periods"] - counts.transient
    x, v, held_time = (
        np.where(is_reached, found.ends.pop(f"section_{name}"), np.nan).T for name in ("x", "v", "held_time")
    )
    for k in range(counts.record - 1, 0, -1):  # in place: `np.diff` takes memory for two more tables
        held_time[:, k] -= held_time[:, k - 1]
    return {"section_x": x, "section_v": v} | of_stops_and_friction(
        system, "held_time", "sticking_time", held_time
    )


def _time_table(counts: Counts, found: PointResults, system: ImpactSystem) -> dict[str, np.ndarray]:
    """State of every point at the given times, NaN where it did not get there, and for how long elements held."""
    is_reached = (np.arange(counts.record) < found.ends["periods"][:, None])[..., None]
    x, v, held_time = (found.ends.pop(f"section_{name}").T for name in ("x", "v", "held_time"))
    saved = {"xs": x[:, :-1], "vs": v[:, :-1]} if counts.record > 1 else {}
    tables = {name: np.where(is_reached[:, :-1], a, np.nan) for name, a in saved.items()}
    whole = np.where(is_reached[:, -1], held_time[:, -1], np.nan)
    return tables | of_stops_and_friction(system, "held_time", "sticking_time", whole)


def of_stops_and_friction(
    system: ImpactSystem, name: str, of_friction: str, both: np.ndarray
) -> dict[str, np.ndarray]:
    """Variables of the stops, and of the friction elements if there are any, from one with stops first, (..., elements)."""
    num_stops, end = system.num_stops, system.num_stops + len(system.friction)
    parts = {name: both[..., :num_stops]}
    return parts | {of_friction: both[..., num_stops:end]} if system.friction else parts


def _exponents_table(counts: Counts, found: PointResults, period: np.ndarray) -> dict[str, np.ndarray]:
    """Lyapunov exponents of every point and their errors; NaN where it did not reach the end."""
    means = exponents(in_blocks(found.ends["section_growth"]), counts.record, period)
    is_done = (found.ends["periods"] >= counts.transient + counts.record)[:, None]
    kept = [np.where(is_done, a.T, np.nan) for a in means]
    return dict(zip(("lyapunov_exponents", "lyapunov_error"), kept, strict=True))


def _end_table(points: LaneInput, counts: Counts, found: PointResults) -> dict[str, np.ndarray]:
    """End of every point's trajectory, points first."""
    ends = found.ends
    is_full = ends["num_impacts"].sum(axis=0) > counts.max_impacts
    is_done = ends["periods"] >= counts.transient + counts.record
    code = np.where(is_full, code_of("max_impacts_reached"), code_of("successful"))
    code = np.where(is_done, code, code_of("max_steps_reached"))
    code = np.where(ends["is_finite"], code, code_of("non_finite"))
    if any(element.is_tied for element in points.system.friction):
        # A motion that stopped at finite numbers had no choice left that agrees with the laws.
        is_bounded = np.isfinite(ends["x"]).all(axis=0) & np.isfinite(ends["v"]).all(axis=0)
        code = np.where(~ends["is_finite"] & is_bounded, code_of("friction_paradox"), code)
    num_stops = points.system.num_stops
    kept = {name: ends[name].T for name in ("x", "v", "steps")} | {
        "num_impacts": ends["num_impacts"][:num_stops].T
    }
    sticks = ends["num_sticks"].T
    kept |= of_stops_and_friction(points.system, "num_sticks", "num_friction_sticks", sticks)
    if points.system.hysteresis:
        kept["num_slider_sticks"] = sticks[..., -len(points.system.hysteresis) :]
    kept |= of_stops_and_friction(points.system, "stuck", "sticking", ends["held"].T)
    kept |= {"result": code.astype(np.int8)}
    if counts.times is not None:
        return kept
    period = 2 * np.pi / np.broadcast_to(points.system.forcing.frequency, code.shape)
    return kept | {"forcing_period": period}
