"""Quantities of the motions of a sweep, computed from the finished tables of a part of it.

Most follow exactly from what is recorded anyway. Extremes and means of squares are observed while the motions are followed
(`observer.py`), by a program of its own: sweeps without them take no longer. To add a quantity, write a function of
`_Recorded` and list it in `_QUANTITIES`, and its meaning in `_dataset_attributes.py`.

An impact on a stop changes the velocity of its mass alone if the mass matrix is diagonal, by -(1 + r(u)) u, u the speed of
approach. So the recorded u determines its impulse and its loss of energy. Stops that share inertia, as contacts between
masses do, may be hit at the same instant, which the record does not resolve.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from .._execution.points import LaneInput
from .._execution.records import Column
from .._execution.runner import Counts
from .._system.restitution import coefficient
from .._system.stop import Stop
from .._system.system import ImpactSystem
from .._trajectory.observer import EXTREMES, OF_BASE
from .outcomes import code_of


class _Recorded(NamedTuple):
    """Machines and starts, lanes last; the arguments of their sweep; its variables, and what is observed, points first."""

    points: LaneInput
    counts: Counts
    tables: dict[str, np.ndarray]
    observed: dict[str, np.ndarray]

    @property
    def is_done(self) -> np.ndarray:
        """Flags of the points whose motion is known to the end, (points, 1)."""
        if self.counts.times is not None:
            reached = [code_of("successful"), code_of("max_impacts_reached")]
            return np.isin(self.tables["result"], reached)[:, None]
        return np.asarray(np.isfinite(self.tables["section_x"][:, -1]).all(axis=-1))[:, None]

    @property
    def num_parts(self) -> int:
        """Number of parts of the record: its periods, or one where none are counted."""
        return self.counts.record if self.counts.times is None else 1

    @property
    def part(self) -> np.ndarray:
        """Duration of a part, (points, 1)."""
        if self.counts.times is None:
            return self.tables["forcing_period"][:, None]
        v = self.tables["v"]
        return np.full((len(v), 1), self.counts.times[-1], v.dtype)

    @property
    def span(self) -> np.ndarray:
        """Time that is recorded, (points, 1)."""
        return self.num_parts * self.part


class _Impact(NamedTuple):
    """Impacts at one stop, (impacts,) each.

    Attributes:
        mass: the mass that hits.
        speed: speed of approach u.
        rebound: speed r(u) u after the impact.
        chatter: speed with which a complete chatter goes on, whose lighter impacts are not recorded; 0 elsewhere.
        light: coefficient r(0) of these.
        rubbing: sum of the coefficients of the friction of the stop; 0 without.
    """

    mass: np.ndarray
    speed: np.ndarray
    rebound: np.ndarray
    chatter: np.ndarray
    light: np.ndarray
    rubbing: np.ndarray


def checked_quantities(wanted: Sequence[str], system: ImpactSystem, counts: Counts) -> tuple[str, ...]:
    """Names of quantities without repetitions; refuse those that the record of these machines does not determine."""
    names = () if isinstance(wanted, str) else tuple(dict.fromkeys(wanted))
    unknown = [name for name in names if name not in _QUANTITIES]
    if unknown or isinstance(wanted, str):
        available = ", ".join(f'"{name}"' for name in _QUANTITIES)
        given = repr(wanted) if isinstance(wanted, str) else ", ".join(f'"{name}"' for name in unknown)
        raise ValueError(f"Argument `quantities` must be a list of some of {available}, but has {given}.")
    of_periods = [name for name in names if name.startswith("section_")]
    if counts.times is not None and of_periods:
        raise ValueError(
            f'The quantity "{of_periods[0]}" is a state at the end of a period, and motions of a `duration` have none: give `ts`.'
        )
    least = 2 if "mean_velocity" in names and counts.times is None else 1
    if names and counts.record < least:
        raise ValueError(
            f"Argument `record` must be {least} or more for these `quantities`, but is {counts.record}."
        )
    if "hysteresis_energy" in names and not system.hysteresis:
        raise ValueError(
            'The quantity "hysteresis_energy" is that of Jenkins elements, which this machine does not have: leave it out.'
        )
    of_impacts = [name for name in names if name in ("impulse", "dissipated_energy")]
    if of_impacts:
        _check_impacts(of_impacts[0], system, counts)
    return names


def _check_impacts(name: str, system: ImpactSystem, counts: Counts) -> None:
    rigid = [stop for stop in system.stops if not stop.is_compliant]
    is_other = not all(isinstance(stop, Stop) for stop in rigid) or (bool(system.stops) and not rigid)
    if system.has_full_mass or is_other:
        raise ValueError(
            f'The quantity "{name}" follows from the recorded impacts if every rigid stop is a `vx.Stop` and `mass` has shape (n,), '
            "which this machine does not fulfil: add up `sol.events.impulse` of `vx.simulate` instead."
        )
    if counts.max_impacts == 0:
        raise ValueError(f'The quantity "{name}" needs the impacts: let `max_impacts` be more than 0.')


def observed_for(wanted: Sequence[str]) -> tuple[str, ...]:
    """Names of the observations that some quantities need."""
    return tuple(sorted({one for name in wanted for one in _QUANTITIES[name].observed}))


def quantity_tables(
    wanted: Sequence[str],
    points: LaneInput,
    counts: Counts,
    tables: dict[str, np.ndarray],
    observed: dict[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """The wanted quantities, points first.

    Args:
        wanted: their names, checked.
        points: machines and starts, lanes last.
        counts: arguments of `sweep` for every point.
        tables: variables of the sweep, points first.
        observed: observed values, points first, see `observed_for`.
    """
    recorded = _Recorded(points, counts, tables, observed)
    return {name: _QUANTITIES[name].compute(recorded) for name in wanted}


def of_points(point: Column, a: np.ndarray) -> np.ndarray:
    """The numbers of some points, which one lane stands for if it is alone."""
    return a[..., point] if a.shape[-1] > 1 else a


def _impact_rate(recorded: _Recorded) -> np.ndarray:
    rate = recorded.tables["num_impacts"] / recorded.span
    return np.where(recorded.is_done, rate, np.nan).astype(recorded.part.dtype)


def _mean_velocity(recorded: _Recorded) -> np.ndarray:
    if recorded.counts.times is not None:
        mean = (recorded.tables["x"] - np.asarray(recorded.points.x0).T) / recorded.span
        return np.where(recorded.is_done, mean, np.nan)
    x = recorded.tables["section_x"]
    return (x[:, -1] - x[:, 0]) / (max(recorded.num_parts - 1, 1) * recorded.part)


def _extreme(name: str, recorded: _Recorded) -> np.ndarray:
    return np.where(recorded.is_done, recorded.observed[name], np.nan)


def _peak_to_peak(recorded: _Recorded) -> np.ndarray:
    return _extreme("max_position", recorded) - _extreme("min_position", recorded)


def _largest_size(names: tuple[str, str], recorded: _Recorded) -> np.ndarray:
    """Largest magnitude of a signal from its highest and its lowest value."""
    highest, lowest = (_extreme(name, recorded) for name in names)
    return np.maximum(highest, -lowest)


def _rms(square: str, recorded: _Recorded) -> np.ndarray:
    mean = recorded.observed[square] / recorded.span
    return np.where(recorded.is_done, np.sqrt(mean), np.nan)


def _hysteresis_energy(recorded: _Recorded) -> np.ndarray:
    return _extreme("hysteresis_energy", recorded) / recorded.counts.record


def _impulse(impact: _Impact) -> np.ndarray:
    """Impulse m (1 + r) u, and that of the rest of a chatter, m (1 + r) (u + r u + r^2 u + ...)."""
    rest = impact.chatter * (1 + impact.light) / (1 - np.where(impact.chatter > 0, impact.light, 0))
    return impact.mass * (impact.speed + impact.rebound + rest)


def _dissipated_energy(impact: _Impact) -> np.ndarray:
    """Energy m (1 - r^2) u^2 / 2 in the frame of the stop, and all that is left where a chatter ends.

    Friction of the stop takes energy from the sliding motion too, how much is not recorded.
    """
    # A difference of squares as a product: near r = 1 the squares would cancel.
    lost = (impact.speed - impact.rebound) * (impact.speed + impact.rebound)
    return np.where(impact.rubbing > 0, np.nan, impact.mass * (lost + impact.chatter**2) / 2)


def _summed(of_impact: Callable[[_Impact], np.ndarray], recorded: _Recorded) -> np.ndarray:
    """Sum over the impacts of each period at each stop, (points, periods, stops); NaN where some are not recorded.

    Where no periods are counted the sum is over the motion, (points, stops).
    """
    system, counts, tables = recorded.points.system, recorded.counts, recorded.tables
    stops, period = tables["impact_stop"], recorded.part
    num_points, num_stops, num_periods = len(stops), system.num_stops, recorded.num_parts
    found = np.zeros((num_points, num_periods, num_stops), tables["v"].dtype)
    for j in range(num_stops):
        if system.stops[j].is_compliant:  # a force without impacts
            found[..., j] = np.nan
            continue
        point, column = np.nonzero(stops == j)
        value = of_impact(_impacts_at(recorded, j, point, column))
        number = np.floor(tables["impact_time"][point, column] / period[point, 0]).astype(int)
        cell = point * num_periods + np.clip(number, 0, num_periods - 1)
        sums = np.bincount(cell, value, num_points * num_periods)
        found[..., j] = sums.reshape(num_points, num_periods)
    is_cut = tables["num_impacts"].sum(axis=1) > counts.max_impacts
    if counts.times is not None:
        return np.where(recorded.is_done & ~is_cut[:, None], found[:, 0], np.nan)
    is_known = np.isfinite(tables["section_x"]).all(axis=-1) & ~is_cut[:, None]
    return np.where(is_known[..., None], found, np.nan)


def _impacts_at(recorded: _Recorded, stop: int, point: np.ndarray, column: np.ndarray) -> _Impact:
    """Recorded impacts at a stop."""
    system, tables = recorded.points.system, recorded.tables
    velocity = tables.get("impact_relative_velocity", tables["impact_velocity"])
    one = system.stops[stop]
    assert isinstance(one, Stop)
    law = jax.tree.map(partial(of_points, point), one.restitution)
    speed = np.abs(velocity[point, column])
    rebound = np.asarray(coefficient(law, speed)) * speed
    goes_on = tables["impact_sticks"][point, column]
    # Friction slows a chatter down, by how much is not recorded.
    chatter = np.where(goes_on, np.nan if system.friction else rebound, 0)
    light = np.broadcast_to(np.asarray(of_points(point, np.asarray(one.light_restitution))), speed.shape)
    mass = np.broadcast_to(of_points(point, np.asarray(system.mass[one.mass])), speed.shape)
    of_stop = [one.slip for one in system.friction if one.contact == stop]
    rubbing = sum(np.broadcast_to(of_points(point, np.asarray(slip)), speed.shape) for slip in of_stop)
    return _Impact(mass, speed, rebound, chatter, light, np.asarray(rubbing))


class _Quantity(NamedTuple):
    """A quantity: its function, its dimensions besides those of the points, the names of the observations that it needs."""

    compute: Callable[[_Recorded], np.ndarray]
    dims: tuple[str, ...] = ("mass",)
    observed: tuple[str, ...] = ()


def _observed_extreme(name: str) -> _Quantity:
    return _Quantity(partial(_extreme, name), ("stop",) if name == "max_force" else ("mass",), (name,))


def _root_of_mean(square: str) -> _Quantity:
    return _Quantity(partial(_rms, square), observed=(square,))


_QUANTITIES = {
    "section_position": _Quantity(lambda recorded: recorded.tables["section_x"], ("period", "mass")),
    "section_velocity": _Quantity(lambda recorded: recorded.tables["section_v"], ("period", "mass")),
    **{name: _observed_extreme(name) for name in EXTREMES if name not in OF_BASE},
    "peak_to_peak": _Quantity(_peak_to_peak, observed=("max_position", "min_position")),
    "rms_position": _root_of_mean("square_position"),
    "rms_velocity": _root_of_mean("square_velocity"),
    "rms_acceleration": _root_of_mean("square_acceleration"),
    "max_absolute_acceleration": _Quantity(partial(_largest_size, OF_BASE), observed=OF_BASE),
    "impact_rate": _Quantity(_impact_rate, ("stop",)),
    "impulse": _Quantity(partial(_summed, _impulse), ("period", "stop")),
    "dissipated_energy": _Quantity(partial(_summed, _dissipated_energy), ("period", "stop")),
    "hysteresis_energy": _Quantity(_hysteresis_energy, ("hysteresis",), ("hysteresis_energy",)),
    "mean_velocity": _Quantity(_mean_velocity),
}
# Dimensions besides those of the points.
DIMS = {name: quantity.dims for name, quantity in _QUANTITIES.items()}
