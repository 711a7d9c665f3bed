"""Starts of branches: given orbits, or the orbits found from the points of a sweep, in one form."""

from collections.abc import Hashable, Iterable, Iterator, Sequence as Many
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr

from .._dataset_attributes import check_column
from .._execution.points import LaneInput, with_values
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._flow.taylor import TaylorFlow
from .._jax.arrays import Reals
from .._jax.concrete import is_traced
from .._machine.numbers import MachineNumbers, numbers_of
from .._orbits.autonomous import with_unit
from .._orbits.orbit import PeriodicOrbit
from .._orbits.rigid_modes import free_drifts, free_shifts
from .._sweep.provenance import varied_of
from .._system.family import Family
from .._system.parameters import Location, find_parameter, get_parameter, moved_arrays
from .._system.system import AnySystem, machine_of, unbound, varied
from .parameter_family import ParameterFamily
from .tolerances import SMALL_ORBIT

# Initial room for events of a cycle other than impacts.
_OTHERS = 32


class Start(NamedTuple):
    """An orbit of a machine.

    Attributes:
        system: the machine, or the family that has the parameters.
        args: arguments of its force.
        flow: requested flow by which it was found, or None.
        num_periods: n; 0 where no load sets the period.
        phase: phase of the load at its start, in radians.
        state: positions and velocities at its start, (2 n,).
        num_events: room for its events.
        is_admissible: True if the machine follows it.
        multipliers: Floquet multipliers, (2 n,); where no load sets the period without the 1 along the cycle, but with a 0.
        period: the period.
    """

    system: AnySystem
    args: object
    flow: AbstractFlow | None
    num_periods: int
    phase: float
    state: np.ndarray
    num_events: int
    is_admissible: bool
    multipliers: np.ndarray
    period: float = np.nan

    @property
    def is_autonomous(self) -> bool:
        """True where no load sets the period."""
        return self.num_periods == 0


def starting_orbits(source: PeriodicOrbit | Many[PeriodicOrbit] | xr.Dataset) -> list[Start]:
    """Starts of all orbits of a list, or of a dataset from `vx.periodic_orbits`."""
    if isinstance(source, xr.Dataset):
        return list(_of_dataset(source))
    given = [source] if isinstance(source, PeriodicOrbit) else source
    orbits: list[Any] = [*given] if isinstance(given, Iterable) else [None]
    if not all(isinstance(one, PeriodicOrbit) for one in orbits):
        raise ValueError(
            "Argument `orbit` must be a periodic orbit, a list of such, or what `vx.periodic_orbits` returned, but is a "
            f"{type(source).__name__}."
        )
    if is_traced(orbits):
        raise ValueError("Branches need known numbers: call this outside of `jax.jit` and `jax.vmap`.")
    return [
        Start(
            system=orbit.system,
            args=orbit.args,
            flow=orbit.flow,
            num_periods=orbit.num_periods,
            phase=float(orbit.phase),
            state=np.concatenate([np.asarray(orbit.x0), np.asarray(orbit.v0)]),
            num_events=int(np.count_nonzero(np.asarray(orbit.events.kind) >= 0)),
            is_admissible=bool(orbit.is_admissible),
            multipliers=_across(orbit),
            period=float(orbit.period),
        )
        for orbit in orbits
    ]


def _across(orbit: PeriodicOrbit) -> np.ndarray:
    """Multipliers of an orbit; without load those across it, a 0 in place of the 1 along it."""
    multipliers = np.array(orbit.multipliers)
    if orbit.num_periods == 0:
        multipliers[np.argmin(np.abs(multipliers - 1))] = 0
    return multipliers


def _of_dataset(ds: xr.Dataset) -> Iterator[Start]:
    """Starts of the converged points of a dataset."""
    missing = {"converged", "x0", "v0", "num_periods", "num_impacts", "multipliers"} - set(ds.variables)
    if missing:
        raise ValueError(
            f"Argument `orbits` must be what `vx.periodic_orbits` returned, but has no {', '.join(sorted(missing))}."
        )
    dims = ds["converged"].dims
    column = lambda name, *own: ds[name].transpose(*dims, *own).values[ds["converged"].values]  # noqa: E731
    states = np.concatenate([column("x0", "mass"), column("v0", "mass")], axis=1)
    num_periods, num_impacts = column("num_periods"), column("num_impacts", "stop").sum(axis=1)
    multipliers = column("multipliers", "multiplier")
    machines = varied_of(ds, dims, np.flatnonzero(ds["converged"].values))
    for k, state in enumerate(states):
        yield Start(
            system=unbound(jax.tree.map(lambda a, k=k: a[..., min(k, a.shape[-1] - 1)], machines)),
            args=None,
            flow=None,
            num_periods=int(num_periods[k]),
            phase=0.0,
            state=state,
            num_events=int(num_impacts[k]) + _OTHERS,
            is_admissible=True,
            multipliers=multipliers[k],
        )


@lru_cache(maxsize=64)
def _location(structure: Hashable, shapes: tuple[tuple[int, ...], ...], path: str) -> Location:
    """Location of a parameter in all machines of a structure: to find it takes as long as a step along a branch."""
    return find_parameter(jax.tree.unflatten(structure, [np.zeros(shape) for shape in shapes]), path)


def value_of(system: AnySystem, path: str) -> float:
    """Value of a parameter that is one number, or for a path with a star the same number everywhere.

    Raises:
        ValueError: for any other parameter.
    """
    leaves, structure = jax.tree.flatten(system)
    place = _location(structure, tuple(np.shape(a) for a in leaves), path)
    if "*" in path:
        values = np.asarray(get_parameter(system, path))
    else:
        values = np.asarray(np.asarray(leaves[place.leaves[0]])[place.index])
    if "*" in path and values.ndim == 1:
        if np.any(values != values[0]):
            raise ValueError(
                f"The path `{path}` names {values.tolist()}: numbers that vary together must be equal, as one value is "
                "given to all."
            )
        values = values[0]
    if values.ndim:
        raise ValueError(
            f"The path `{path}` names an array of shape {values.shape}: name one number in it, as in `{path}[0]`."
        )
    return float(values)


def families_of(
    starts: Many[Start], path: str, low: float, high: float, tolerance: float = 0.0
) -> list[ParameterFamily]:
    """Families of the machines of orbits along a parameter; what machines of one structure share is computed once.

    Raises:
        ValueError: as `family_of`.
    """
    groups: dict[object, list[int]] = {}
    for k, start in enumerate(starts):
        leaves, structure = jax.tree.flatten(start.system)
        is_alone = (
            "*" in path
            or isinstance(start.system, Family)
            or start.args is not None
            or start.flow is not None
            or start.system.force is not None
            or start.is_autonomous
        )
        make = k if is_alone else (structure, *(np.shape(a) for a in leaves))
        groups.setdefault(make, []).append(k)
    found: dict[int, ParameterFamily] = {}
    for group in groups.values():
        own = (
            _families_side_by_side([starts[k] for k in group], path, (low, high), tolerance)
            if len(group) > 1
            else None
        )
        own = own or [family_of(starts[k], path, low, high, tolerance) for k in group]
        found.update(zip(group, own, strict=True))
    return [found[k] for k in range(len(starts))]


def _families_side_by_side(
    starts: Many[Start], path: str, bounds: tuple[float, float], tolerance: float
) -> list[ParameterFamily] | None:
    """Families of machines of one structure; None if their springs, dampers and masses differ."""
    value_of(starts[0].system, path)  # raises if the path names no number
    systems = [jax.tree.map(np.asarray, start.system) for start in starts]
    whole = jax.tree.map(_lanes_last, *systems)
    place, num = find_parameter(systems[0], path), len(starts)
    values = np.broadcast_to(jax.tree.leaves(whole)[place.leaves[0]][place.index], num)
    for start, value in zip(starts, values, strict=True):
        _check_start(start, path, float(value), bounds)
    flow, numbers = _flow_of(whole, path, bounds, None), numbers_of(whole)
    matrices = numbers.mass, numbers.damping, numbers.stiffness, numbers.rows
    if any(np.shape(a)[-1] > 1 for a in (*matrices, *jax.tree.leaves(flow))):
        return None
    flow = jax.tree.map(lambda a: np.asarray(a)[..., 0], flow)
    free = _free_of(numbers_of(systems[0]))
    states = np.stack([start.state for start in starts])
    sizes = np.asarray(numbers.frequency), *_lengths_of(numbers)
    scales = _scales(states, *(np.broadcast_to(size, num) for size in sizes))
    return [
        _family(start, system, flow, scale, free, path=path, bounds=bounds, tolerance=tolerance)
        for start, system, scale in zip(starts, systems, scales, strict=True)
    ]


def _family(
    start: Start,
    system: AnySystem,
    flow: AbstractFlow,
    scale: np.ndarray,
    free: tuple[np.ndarray, Any],
    *,
    path: str,
    bounds: tuple[float, float],
    tolerance: float,
) -> ParameterFamily:
    """Family of the machine of an orbit, from its flow, the sizes of the orbit and what `_free_of` gives."""
    numbers = start.num_periods or 1, start.phase / (2 * np.pi), bounds[1] - bounds[0], tolerance
    num_periods, phase, span, small = (np.asarray(a, scale.dtype) for a in numbers)
    own = {"path": path, "is_autonomous": start.is_autonomous}
    return ParameterFamily(system, flow, num_periods, phase, scale, span, small, *free, **own)


def _free_of(numbers: MachineNumbers) -> tuple[np.ndarray, Any]:
    """Projections onto the rigid shifts and drifts of a machine, see `ParameterFamily`."""
    return np.asarray(free_shifts(numbers)), jax.tree.map(np.asarray, free_drifts(numbers))


def _lanes_last(*arrays: np.ndarray) -> np.ndarray:
    """Arrays stacked along a last axis of lanes, a single lane if all are equal."""
    whole = np.stack(arrays, axis=-1)
    return whole[..., :1] if np.all(whole == whole[..., :1]) else whole


def _lengths_of(numbers: MachineNumbers) -> tuple[Reals, Reals]:
    """Position of the farthest stop, and the length by which the load moves free masses; lanes last."""
    load = np.abs(numbers.mean) + np.hypot(numbers.waves.cosine, numbers.waves.sine).sum(axis=0)
    for table in numbers.tables or ():
        load = load + np.abs(table.rows[:, 0]).max(axis=0)
    mass, stiffness = np.asarray(numbers.mass), np.asarray(numbers.stiffness)
    if mass.ndim == stiffness.ndim:
        mass = np.einsum("ii...->i...", mass)
    resistance = np.abs(np.einsum("ii...->i...", stiffness)) + mass * np.asarray(numbers.frequency) ** 2
    return np.abs(numbers.limit).max(axis=0, initial=0), (load / resistance).max(axis=0)


def _scales(states: np.ndarray, frequency: np.ndarray, limit: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Sizes of positions and velocities of orbits, (orbits, 2 n); an orbit may be at rest at 0."""
    x, v = np.split(np.abs(states), 2, axis=1)
    lengths = np.max([x.max(axis=1), v.max(axis=1) / frequency, limit], axis=0)
    lengths = np.where(lengths < SMALL_ORBIT * free, free, lengths)
    lengths = np.where(lengths > 0, lengths, 1)
    scales = lengths[:, None] * np.stack([np.ones_like(frequency), frequency], axis=1)
    return np.repeat(scales, x.shape[1], axis=1).astype(states.dtype)


def _check_start(start: Start, path: str, value: float, bounds: tuple[float, float]) -> None:
    """Check that an orbit, its machine with this value of the parameter, can begin a branch.

    Raises:
        ValueError: if it cannot.
    """
    low, high = bounds
    if not -np.inf < low < high < np.inf:
        raise ValueError(f"Argument `bounds` must be a lower and a higher value, but is ({low}, {high}).")
    if not low <= value <= high:
        raise ValueError(
            f"The orbit has {value} for `{path}`, which does not lie within the bounds {low} and {high}."
        )
    if not start.is_admissible:
        raise ValueError(
            "A branch begins with an orbit that the machine follows, but this one is not admissible."
        )


def family_of(start: Start, path: str, low: float, high: float, tolerance: float = 0.0) -> ParameterFamily:
    """Family of the machine of an orbit along a parameter.

    Raises:
        ValueError: for a path that names no single number, bounds that exclude the orbit, an inadmissible orbit.
    """
    machine = start.system
    if start.is_autonomous and isinstance(machine, Family):
        raise ValueError(
            "A cycle that nothing drives is followed along a path of a machine: find it for `family.system`, not for the family."
        )
    if start.is_autonomous:
        if path.startswith("forcing") and not path.startswith("forcing.mean"):
            raise ValueError(f"The path `{path}` names a number of the load, but nothing drives the machine.")
        machine = with_unit(machine_of(machine), start.period)
    system = jax.tree.map(np.asarray, varied(machine, start.args))
    _check_start(start, path, value_of(system, path), (low, high))
    if isinstance(machine, Family):
        check_column(path)
    numbers = numbers_of(machine_of(system))
    sizes = np.asarray(numbers.frequency), *_lengths_of(numbers)
    (scale,) = _scales(start.state[None], *(size[None] for size in sizes))
    flow = TaylorFlow() if start.is_autonomous else _flow_of(system, path, (low, high), start.flow)
    free, along = _free_of(numbers), {"path": path, "bounds": (low, high), "tolerance": tolerance}
    return _family(start, system, jax.tree.map(np.asarray, flow), scale, free, **along)


def _flow_of(
    system: AnySystem, path: str, bounds: tuple[float, float], wanted: AbstractFlow | None
) -> AbstractFlow:
    """Flow of all machines of a family: exact unless they have a `force`."""
    machine = machine_of(system)
    if machine.force is not None:
        flow = choose_flow(machine, can_stick=True, wanted=wanted)
        if type(flow).flow_map is AbstractFlow.flow_map:
            raise ValueError(
                f"The orbit was found with {type(flow).__name__} as `flow`, which has no `flow_map`."
            )
        return flow
    # Modes need concrete matrices, and lose digits near a resonance.
    moved = moved_arrays(system, path)
    changes_modes = any(name.startswith(("mass", "damping", "stiffness")) for name in moved)
    band = _band(system, path, bounds) if "forcing.frequency" in moved else None
    return TaylorFlow() if changes_modes else choose_flow(machine, can_stick=True, band=band)


# Values of a parameter between its bounds at which the frequency of the load is computed.
_TRIED = 65


def _band(system: AnySystem, path: str, bounds: tuple[float, float]) -> tuple[float, float]:
    """Lowest and highest frequency of the load between bounds of a parameter that moves it."""
    if not isinstance(system, Family):
        return bounds
    zero = np.zeros(system.num_coordinates, np.asarray(system.mass).dtype)
    lanes = with_values(LaneInput(system, zero, zero), {path: np.linspace(*bounds, _TRIED)})
    frequency = np.asarray(machine_of(lanes.system).forcing.frequency)
    return float(frequency.min()), float(frequency.max())
