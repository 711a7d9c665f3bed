"""Starts of many motions of one machine: listed, on a grid, or drawn at random."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np

from .._execution.points import LaneInput
from .._jax.arrays import Numbers, as_float, as_numpy_float
from .._orbits.find_many import all_coordinates, given_states
from .._sweep.short_names import without_names
from .._sweep.zipped import START
from .._system.checks import is_past
from .._system.contact import AbstractLimit
from .._system.parameters import find_parameter
from .._system.system import AnySystem, ImpactSystem, machine_of
from .ensemble import Machines, rigid_stops

# Number of times that starts beyond stops are drawn again.
_TRIES = 200


class Starts(NamedTuple):
    """Starts, and the dimensions along which they lie.

    Attributes:
        states: (starts, 2 n).
        axes: values along each dimension; their product is all starts, the last varying fastest.
        names: short names of dimensions that have one.
    """

    states: np.ndarray
    axes: dict[str, np.ndarray]
    names: dict[str, str]


def grid_of_starts(
    system: AnySystem,
    values: Mapping[str, Numbers | tuple[str, Numbers]],
    x0: Numbers | None,
    v0: Numbers | None,
) -> Starts:
    """Product of the values of some start quantities; the others are those of `x0` and `v0`."""
    n, own = system.num_coordinates, system.num_masses
    base = np.zeros((2, n), as_numpy_float(0.0).dtype)
    for row, (name, given) in zip(base, (("x0", x0), ("v0", v0)), strict=True):
        if given is not None:
            known = as_numpy_float(given)
            if known.shape not in ((own,), (n,)):
                raise ValueError(f"Argument `{name}` must have shape ({own},), but has {known.shape}.")
            row[: len(known)] = known
    whole = LaneInput(system, as_float(np.zeros(n)), as_float(np.zeros(n)))
    by_path, names = without_names(values, whole, free=("x", "v"))
    axes = {path: as_numpy_float(a) for path, a in by_path.items()}
    if not axes:
        raise ValueError('The starts are empty: name start quantities, as in {"x0[0]": values}.')
    shape = tuple(len(a) if a.ndim == 1 else 0 for a in axes.values())
    grid = np.indices(shape).reshape(len(axes), -1)
    states = np.tile(base.reshape(-1), (grid.shape[1], 1))
    for (path, a), place in zip(axes.items(), grid, strict=True):
        if a.ndim != 1 or not a.size:
            raise ValueError(f"The values of `{path}` must have shape (points,), but have {a.shape}.")
        states[:, _column(whole, path, n)] = a[place]
    if v0 is None or len(np.asarray(v0)) == own < n:
        _set_stretches(system, states, {_column(whole, path, n) for path in axes})
    return Starts(states, axes, names)


def _set_stretches(system: AnySystem, states: np.ndarray, given: set[int]) -> None:
    """Let Jenkins elements start with their sliders, but for those whose stretches are given, by column."""
    n, own = system.num_coordinates, system.num_masses
    whole = all_coordinates(system, np.concatenate([states[:, :own], states[:, n : n + own]], axis=1))
    free = [column for column in range(n + own, 2 * n) if column not in given]
    states[:, free] = whole[:, free]


def _column(whole: LaneInput, path: str, n: int) -> int:
    """Index in a state of a quantity of the start."""
    index = find_parameter(whole, path).index
    if path.split("[")[0] not in ("x0", "v0") or len(index) != 1:
        raise ValueError(
            f"The path `{path}` is no entry of the start: name entries as `x0[0]` or `v0[1]`. "
            "For a quantity of the machine use `follow_attractors`."
        )
    return index[0] + (n if path.startswith("v0") else 0)


def listed_starts(system: ImpactSystem, starts: tuple[Numbers, Numbers] | Numbers) -> Starts:
    """Starts given one by one."""
    or_else = "a mapping of paths to values, or how many to draw, "
    states = given_states(starts, system, or_else)
    return Starts(states, {START: np.arange(len(states))}, {})


def drawn_starts(system: ImpactSystem, count: int, bounds: np.ndarray, rng: np.random.Generator) -> Starts:
    """Starts drawn uniformly between bounds, (2 n, 2), none of them beyond a rigid stop."""
    states = np.empty((count, len(bounds)), as_numpy_float(0.0).dtype)
    left, (low, high) = np.arange(count), bounds.T
    for _ in range(_TRIES):
        states[left] = rng.uniform(low, high, (len(left), len(bounds)))
        left = left[is_beyond(system, states[left])]
        if not left.size:
            return Starts(states, {START: np.arange(count)}, {})
    raise ValueError("Between the bounds hardly any start lies between the stops: name others in `bounds`.")


def bounds_of(machines: Machines, bounds: Numbers | None) -> np.ndarray:
    """The given bounds, or twice the motion from rest, as far as the stops let it.

    From as near to rest as the stops allow, the machine is run through its transient. The box holds the motion of the
    masses in the recorded periods, twice as large.
    """
    system = machine_of(machines.system)
    n, own = system.num_coordinates, system.num_masses
    reach = np.array([float(element.reach) for element in system.hysteresis])
    if bounds is not None:
        given = as_numpy_float(bounds)
        if (
            given.shape not in ((2 * own, 2), (2 * n, 2))
            or not (given[:, 0] <= given[:, 1]).all()
            or not np.isfinite(given).all()
        ):
            raise ValueError(
                f"Argument `bounds` must hold the lowest and highest position and velocity of each mass, ({2 * own}, 2), "
                f"lowest first, but has shape {given.shape} or is not in order."
            )
        if len(given) == 2 * n:
            return given
        stretches = np.stack([-reach, reach], axis=1)
        return np.concatenate([given[:own], 0 * stretches, given[own:], stretches])
    low, high = slots(system, system.stops)
    rest = np.concatenate([np.clip(np.zeros(n), low, high), np.zeros(n)])[None]
    zero = np.zeros(1, int)
    ds = machines.run(
        rest * machines.scale(zero), zero, machines.transient, machines.record, max_impacts=1 << 12
    )
    x, v = (np.nan_to_num(np.abs(ds[name].values)).max(axis=(0, 1)) for name in ("section_x", "section_v"))
    hits = np.nan_to_num(np.abs(ds["impact_velocity"].values)).max(initial=0.0)
    speed = max(float((machines.rate[0] * x).max()), float(v.max()), float(hits)) or 1.0
    away = 2 * speed / machines.rate[0]
    box = np.clip(np.stack([rest[0, :n] - away, rest[0, :n] + away]), low, high)
    fastest = np.full(n, 2 * speed)
    fastest[own:] = reach
    return np.concatenate([box, np.array([[-1.0], [1.0]]) * fastest], axis=1).T


def is_beyond(system: ImpactSystem, states: np.ndarray) -> np.ndarray:
    """True where states at phase 0, (points, 2 n), lie beyond a rigid stop of a machine, or of one each, lanes last."""
    x, beyond = states[:, : system.num_masses].T, np.zeros(len(states), bool)
    # Each operation on JAX's arrays would be a program.
    for stop in jax.tree.map(np.asarray, rigid_stops(system)):
        beyond |= np.asarray(is_past(stop, x, 0.0))
    return beyond


def slots(system: ImpactSystem, stops: Sequence[AbstractLimit]) -> tuple[np.ndarray, np.ndarray]:
    """Nearest of some stops on each side of each mass at phase 0, infinite where there are none, (n,) each; 0 of Jenkins elements."""
    ends = {
        side: np.full(system.num_coordinates, far) for side, far in (("lower", -np.inf), ("upper", np.inf))
    }
    for stop in stops:
        if stop.slot is not None:
            mass, side = stop.slot
            nearer = min if side == "upper" else max  # a rigid stop may stand behind a compliant one
            ends[side][mass] = nearer(ends[side][mass], float(np.asarray(stop.at(0.0))))
    for end in ends.values():
        end[system.num_masses :] = 0
    return ends["lower"], ends["upper"]
