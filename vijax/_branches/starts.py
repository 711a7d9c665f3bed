"""Starts of branches: given orbits, or the orbits found from the points of a sweep, in one form."""

from collections.abc import Iterator, Sequence as Many
from typing import NamedTuple

import jax
import numpy as np
import xarray as xr

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._flow.taylor import TaylorFlow
from .._jax.concrete import is_traced
from .._machine.numbers import numbers_of
from .._orbits.orbit import PeriodicOrbit
from .._orbits.rigid_modes import free_drifts, free_shifts
from .._orbits.sequence import empty_sequence
from .._sweep.provenance import machines_of
from .._system.parameters import get_parameter
from .._system.system import ImpactSystem, unbound, with_args
from .follow import point_at_orbit
from .kernels import room_for
from .parameter_family import Family
from .point import BranchPoint
from .scheduler import drive

# Distance from 1 below which a multiplier is 1. At a fold without losses a double one keeps half the digits: it is not.
_ONE = 1e-10
# Initial room for events of a cycle other than impacts.
_OTHERS = 32


class Start(NamedTuple):
    """An orbit of a machine.

    Attributes:
        system: the machine.
        args: arguments of its force.
        flow: requested flow by which it was found, or None.
        num_periods: n.
        phase: phase of the load at its start, in radians.
        state: positions and velocities at its start, (2 n,).
        num_events: room for its events.
        is_admissible: True if the machine follows it.
        multipliers: Floquet multipliers, (2 n,).
    """

    system: ImpactSystem
    args: object
    flow: AbstractFlow | None
    num_periods: int
    phase: float
    state: np.ndarray
    num_events: int
    is_admissible: bool
    multipliers: np.ndarray


def starting_orbits(source: PeriodicOrbit | Many[PeriodicOrbit] | xr.Dataset) -> list[Start]:
    """Starts of all orbits of a list, or of a dataset from `vx.periodic_orbits`."""
    if isinstance(source, xr.Dataset):
        return list(_of_dataset(source))
    orbits = [source] if isinstance(source, PeriodicOrbit) else list(source)
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
            multipliers=np.asarray(orbit.multipliers),
        )
        for orbit in orbits
    ]


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
    machines = machines_of(ds, dims, np.flatnonzero(ds["converged"].values))
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


def value_of(system: ImpactSystem, path: str) -> float:
    """Value of a parameter that is one number, or for a path with a star the same number everywhere.

    Raises:
        ValueError: for any other parameter.
    """
    values = np.asarray(get_parameter(system, path))
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


def family_of(start: Start, path: str, low: float, high: float) -> Family:
    """Family of the machine of an orbit along a parameter.

    Raises:
        ValueError: for a path that names no single number, bounds that exclude the orbit, an inadmissible orbit.
    """
    system = jax.tree.map(np.asarray, with_args(start.system, start.args))
    value = value_of(system, path)
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
    numbers, (x, v) = numbers_of(system), np.split(start.state, 2)
    sizes = np.abs(x).max(), np.abs(v).max() / numbers.frequency, np.abs(numbers.limit).max(initial=0)
    length = max(float(max(sizes)), np.finfo(x.dtype).tiny)
    return Family(
        system=system,
        flow=jax.tree.map(np.asarray, _flow_of(system, path, (low, high), start.flow)),
        num_periods=np.asarray(start.num_periods, x.dtype),
        phase=np.asarray(start.phase / (2 * np.pi), x.dtype),
        scale=np.repeat(length * np.array([1.0, float(numbers.frequency)]), len(x)).astype(x.dtype),
        span=np.asarray(high - low, x.dtype),
        shifts=np.asarray(free_shifts(numbers)),
        drift=jax.tree.map(np.asarray, free_drifts(numbers)),
        path=path,
    )


def _flow_of(
    system: ImpactSystem, path: str, bounds: tuple[float, float], wanted: AbstractFlow | None
) -> AbstractFlow:
    """Flow of all machines of a family: exact unless they have a `force`."""
    if system.force is not None:
        flow = choose_flow(system, can_stick=True, wanted=wanted)
        if type(flow).flow_map is AbstractFlow.flow_map:
            raise ValueError(
                f"The orbit was found with {type(flow).__name__} as `flow`, which has no `flow_map`."
            )
        return flow
    # Modes need concrete matrices, and lose digits near a resonance.
    changes_modes = path.startswith(("mass", "damping", "stiffness"))
    band = bounds if path == "forcing.frequency" else None
    return TaylorFlow() if changes_modes else choose_flow(system, can_stick=True, band=band)


def points_of(starts: list[Start], families: list[Family]) -> list[BranchPoint | None]:
    """Points at which the branches begin; None for a start that is no orbit of its machine, or not isolated."""
    tasks, which = [], [k for k, start in enumerate(starts) if is_isolated(start, families[k])]
    for start, family in ((starts[k], families[k]) for k in which):
        room_for(start.num_events)  # raises if there are too many
        size = len(start.system.stops) + len(start.system.friction)
        room = empty_sequence(start.num_events, size, is_switching=start.system.is_switching)
        p = float(value_of(family.system, family.path) / family.span)
        tasks.append(point_at_orbit(jax.tree.map(np.asarray, room), start.state, p))
    found = dict(zip(which, drive([families[k] for k in which], tasks, lambda: None), strict=True))
    return [found.get(k) for k in range(len(starts))]


def is_isolated(start: Start, family: Family) -> bool:
    """True if no neighbour of an orbit, except for rigid shifts, is an orbit at the same parameter.

    At a fold one multiplier is 1, and the branch continues. Where two are, as at a resonance of a vibration without
    losses, Newton's method converges to any of the neighbours.
    """
    num_ones = np.count_nonzero(np.abs(start.multipliers - 1) < _ONE)
    drift = 0 if family.drift is None else np.trace(family.drift)
    return bool(num_ones < 2 + 2 * np.trace(family.shifts) + drift)


def refuse_start(number: int, start: Start, family: Family) -> None:
    """Raise the reason why no branch begins at an orbit."""
    if is_isolated(start, family):
        raise ValueError(
            f"Orbit {number} is no periodic orbit of its machine: find one by `vx.periodic_orbit`."
        )
    raise ValueError(
        f"Orbit {number} is not isolated: two of its multipliers are exactly +1, as at a resonance without damping, where all "
        "its neighbours repeat as well, and no branch is told among them. Add damping, or begin at a frequency off the resonance."
    )
