"""The machines whose attractors are searched for: runs from many states, and the polishing of cycles."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._execution.points import LaneInput, with_values
from .._execution.runner import Counts
from .._execution.settings import ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import as_numpy_float
from .._orbits.many import Orbits
from .._orbits.sweep_orbits import search_orbits
from .._progress import tqdm
from .._sections.lyapunov import lyapunov_exponents
from .._sections.non_impacting_proof import prove_non_impacting
from .._sections.section_side import after_impacts, machines_of_lanes, padded_to_power_of_two
from .._sweep.recurrence import recurrence
from .._sweep.zipped import sweep_zipped
from .._system.contact import AbstractLimit
from .._system.system import AnySystem, ImpactSystem, machine_of

# Room for the events of a cycle that is polished.
_MAX_EVENTS = 256
# `_SETTLING`: forcing periods before the growth of perturbations is averaged.
# `_AVERAGED`: forcing periods of the average.
_SETTLING, _AVERAGED = 20, 2000
# An impact falls into phase 0 if its gap is within this many rounding errors.
_HAIR = 4096
# Last periods of a record that are searched for a repetition.
_COMPARED = 128


class Endpoints(NamedTuple):
    """Ends of motions, points first, states as (W x, v).

    Attributes:
        section: the state at the end of each recorded period, (points, periods, 2 n); 0 where the motion failed.
        machine: index of the machine of each point.
        num_periods: n, 0 where the motion does not repeat.
        is_settling: true where it approaches a cycle.
        is_quiet: true where it is proved to settle on the response of its machine without another impact; then n = 1.
        is_failed: true where it is unknown.
    """

    section: np.ndarray
    machine: np.ndarray
    num_periods: np.ndarray
    is_settling: np.ndarray
    is_quiet: np.ndarray
    is_failed: np.ndarray

    @property
    def last(self) -> np.ndarray:
        """The end states, (points, 2 n)."""
        return self.section[:, -1]


@dataclass(frozen=True)
class Machines:
    """Machines that differ by the values of some quantities, or a single one.

    Attributes:
        system: the machine, its force bound to its arguments.
        values: quantities by their paths, one value for each machine; empty for a single machine.
        rate: W of each, (machines,).
        transient: forcing periods before a motion is recorded.
        record: forcing periods that are recorded.
        tolerance: largest distance of a motion from the cycle on which it settles, relative to its size.
        flow: the flow between events.
        max_steps: as for `vx.sweep`.
        settings: likewise.
        executor: likewise.
        is_wide: true if the first sweep has more points than lanes.
    """

    system: AnySystem
    values: dict[str, np.ndarray]
    rate: np.ndarray
    transient: int
    record: int
    tolerance: float
    flow: AbstractFlow | None
    max_steps: int | None
    settings: ExecutionSettings
    executor: object
    is_wide: bool

    def for_sweep_of(self, num_points: int) -> "Machines":
        """The same machines, for runs that share the program of a sweep of `num_points` points."""
        return replace(self, is_wide=num_points > self.settings.lanes)

    def of_plane(self, values: dict[str, np.ndarray], num_machines: int) -> "Machines":
        """`num_machines` machines that differ by some quantities, one value for each."""
        return replace(self, values=values, rate=frequencies_at(self.system, values, num_machines))

    def scale(self, machine: np.ndarray) -> np.ndarray:
        """Factors that turn states (x, v) into (W x, v), (points, 2 n)."""
        rate = self.rate[machine]
        return np.repeat(np.stack([rate, np.ones_like(rate)], axis=1), self.system.num_coordinates, axis=1)

    def run(
        self,
        states: np.ndarray,
        machine: np.ndarray,
        transient: int,
        record: int,
        *,
        max_impacts: int = 0,
        goes_on: bool = False,
        progress: bool = False,
    ) -> xr.Dataset:
        """Sweep over starts (W x, v), (points, 2 n), of some machines; with `goes_on` they are ends of motions."""
        if goes_on:
            states = self.onto_stops(states, machine, float(np.sqrt(np.finfo(states.dtype).eps)))
        of_point = {path: a[machine] for path, a in self.values.items()}
        counts = Counts(transient, record, max_impacts, self.max_steps, can_stick=True)
        starts, where = states / self.scale(machine), (self.settings, self.executor)
        beside = self.settings.lanes + 1 if self.is_wide else 0
        with tqdm(total=len(states), unit="point", disable=not progress) as bar:
            return sweep_zipped(self.system, of_point, starts, counts, self.flow, *where, bar.update, beside)

    def lanes(self, machine: np.ndarray) -> ImpactSystem:
        """The machine of each point, lanes last."""
        return _lanes_at(self.system, {path: a[machine] for path, a in self.values.items()})

    def onto_stops(self, states: np.ndarray, machine: np.ndarray, within: float = float("inf")) -> np.ndarray:
        """Move states (W x, v), (points, 2 n), back onto the stops beyond which they lie.

        They may lie there where an impact falls into phase 0, or where stops have moved. `within` bounds the overlap
        that is moved, relative to the terms of the gap.
        """
        scale = self.scale(machine)
        x, v = np.split(states / scale, 2, axis=1)
        for stop in rigid_stops(self.lanes(machine)):
            size, gap = _size_and_gap(stop, x)
            beyond = np.where((gap < 0) & (gap >= -within * size), gap, 0)
            row = stop.coefficients
            square = sum(np.asarray(a) ** 2 for a in row.values())
            for i, a in row.items():
                x[:, i] += beyond * np.asarray(a) / square
        return np.concatenate([x, v], axis=1) * scale

    def after_impacts(self, states: np.ndarray, machine: np.ndarray) -> np.ndarray:
        """States (W x, v), (points, 2 n), after the impacts that fall into phase 0 to rounding."""
        x = states[:, : self.system.num_coordinates] / self.rate[machine, None]
        # Few of what may be millions of states have an impact there; the others stay as they are.
        judged = (_size_and_gap(stop, x) for stop in self.lanes(machine).stops)
        closed = [np.abs(gap) <= _HAIR * np.finfo(x.dtype).eps * size for size, gap in judged]
        which = np.flatnonzero(np.logical_or.reduce(closed)) if closed else np.zeros(0, int)
        if not which.size:
            return states
        which = padded_to_power_of_two(which)
        scale, lanes = self.scale(machine[which]), machines_of_lanes(self.lanes(machine[which]))
        before = np.split(states[which] / scale, 2, axis=1)
        after = after_impacts(lanes, 0.0, (before[0], before[1]), np.stack([a[which] for a in closed]))
        states = states.copy()
        states[which] = np.concatenate(after, axis=1) * scale
        return states

    def ends(self, ds: xr.Dataset, machine: np.ndarray) -> Endpoints:
        """Judge the ends of the motions of a sweep."""
        x, v = (ds[f"section_{name}"].values for name in "xv")
        section = np.concatenate([x * self.rate[machine, None, None].astype(x.dtype), v], axis=2)
        is_failed = np.isnan(section.sum(axis=(1, 2)))
        section[is_failed] = 0
        each = np.repeat(machine, section.shape[1])
        section = self.after_impacts(section.reshape(len(each), -1), each).reshape(section.shape)
        found = recurrence(_relative(section[:, -_COMPARED:]), self.tolerance)
        is_touched = (ds["num_impacts"].values > 0).any(axis=1) | (ds["held_time"].values > 0).any(
            axis=(1, 2)
        )
        last = section[:, -1] / self.scale(machine)
        candidates = np.flatnonzero(~is_failed & ~is_touched)
        is_quiet = prove_non_impacting(ds, candidates, *np.split(last, 2, axis=1))[0]
        n = np.where(is_failed, 0, np.where(is_quiet, 1, found.num_periods))
        return Endpoints(section, machine, n, found.is_settling & (n == 0), is_quiet, is_failed)

    def polish(self, states: np.ndarray, machine: np.ndarray, num_periods: np.ndarray) -> Orbits:
        """Search for the cycles near states (W x, v) that nearly repeat."""
        # With a frequency each: this shares the program of the orbits of a sweep over the frequency.
        lanes = eqx.tree_at(lambda s: s.forcing.frequency, self.lanes(machine), self.rate[machine])
        starts = states / self.scale(machine)
        return search_orbits(lanes, num_periods, starts, _MAX_EVENTS, lambda _: None, self.flow)

    def exponents(self, state: np.ndarray, machine: int) -> tuple[np.ndarray, np.ndarray]:
        """Lyapunov exponents of a machine from a state (W x, v), and their errors; NaN where the motion fails."""
        which = np.array([machine])
        system = jax.tree.map(lambda a: jnp.asarray(a[..., 0]), self.lanes(which))
        x, v = np.split(state / self.scale(which)[0], 2)
        options = {
            "transient": _SETTLING,
            "num_periods": _AVERAGED,
            "max_steps": self.max_steps,
            "flow": self.flow,
        }
        found = lyapunov_exponents(system, x, v, **options, with_error=True, throw=False, progress=False)
        return np.asarray(found[0]), np.asarray(found[1])


def frequencies_at(system: AnySystem, values: dict[str, np.ndarray], num_machines: int) -> np.ndarray:
    """W of machines that differ by some quantities, (machines,)."""
    return np.array(np.broadcast_to(_lanes_at(system, values).forcing.frequency, num_machines))


def rigid_stops(system: ImpactSystem) -> list[AbstractLimit]:
    """The stops beyond which no state lies: a compliant one yields."""
    return [stop for stop in system.stops if not stop.is_compliant]


def _lanes_at(system: AnySystem, values: dict[str, np.ndarray]) -> ImpactSystem:
    zero = np.zeros(system.num_coordinates, as_numpy_float(0.0).dtype)
    return machine_of(with_values(LaneInput(system, zero, zero), values).system)


def _size_and_gap(stop: AbstractLimit, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Magnitudes of the terms of the gaps at phase 0, which set their rounding errors, and the gaps, (points,) each."""
    known = jax.tree.map(np.asarray, stop)  # with JAX's arrays every operation would compile a program
    return np.asarray(known.reach(0.0) + known.size(x.T)), np.asarray(known.gap(x.T, 0.0))


def _relative(section: np.ndarray) -> np.ndarray:
    size = np.abs(section).max(axis=(1, 2), keepdims=True)
    return section / np.where(size == 0, 1, size).astype(float)
