"""Quantities of the orbits of a branch, as columns of its points.

The machine runs once through every orbit that it follows, all of them as lanes of a sweep: so names mean what they mean
there, and the program of a sweep serves. Orbits that it does not follow have NaN. So has an orbit so unstable that the
run leaves it within its period.

An impact that grazes turns a rounding error into its square root, so a run leaves a cycle that grazes several times. It is
repeated with the stops that the cycle does not hit, or all of them, away by `EXACT` sizes of the motion: then what grazes passes.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._dataset_attributes import is_taken, variable_attributes
from .._execution.runner import Counts
from .._execution.settings import DEFAULT_SETTINGS
from .._flow.interface import AbstractFlow
from .._hybrid.limits import IMPACT
from .._jax.xla import padding_allowed
from .._orbits.autonomous import with_unit
from .._orbits.orbit import PeriodicOrbit
from .._sweep.quantities import checked_quantities
from .._sweep.zipped import START, sweep_zipped
from .._system.contact import AbstractRigidLimit
from .._system.parameters import machine_at
from .._system.system import AnySystem, ImpactSystem, machine_of
from .._trajectory.results import RESULTS
from .._trajectory.simulate import simulate_all
from .._trajectory.solution import Solution
from .branch import Branch
from .tolerances import EXACT, NEGLIGIBLE, ROUNDED

# A quantity: one by its name, or a function of one cycle.
Quantity = str | Callable[[Solution], Any]
Quantities = Sequence[str] | Mapping[str, Quantity]
_FREQUENCY = "forcing.frequency"
# Room for events in a cycle beside those of the branch: a run may have other bounces of a chatter.
_SPARE = 64


def checked_cycle_quantities(wanted: Quantities, system: AnySystem) -> dict[str, Quantity]:
    """The wanted quantities by the names of their columns.

    Raises:
        ValueError: for a name that is unknown or does not follow for this machine, or one that a column has already.
    """
    # The start of a cycle is known too, so one period has a mean velocity.
    counts, system = _counts(2, 1), machine_of(system)
    if not isinstance(wanted, Mapping):
        return {name: name for name in checked_quantities(wanted, system, counts)}
    pairs = dict(wanted)
    checked_quantities([one for one in pairs.values() if isinstance(one, str)], system, counts)
    for name, one in pairs.items():
        if not isinstance(one, str) and not callable(one):
            raise ValueError(
                f"Argument `quantities` must give for `{name}` the name of a quantity or a function of one cycle, "
                f"but gives {one!r}."
            )
    checked_names("quantities", {name: one for name, one in pairs.items() if name != one})
    return pairs


def checked_names(argument: str, named: Iterable[str]) -> None:
    """Refuse names of columns that are none, or that points of a branch have already.

    Raises:
        ValueError: for such a name.
    """
    for name in named:
        if not name.isidentifier():
            raise ValueError(
                f"Argument `{argument}` must have names like those of variables, but has `{name}`."
            )
        if is_taken(name):
            raise ValueError(
                f"Argument `{argument}` must have names of its own, but points of a branch have a `{name}`."
            )


def _counts(num_periods: int, num_events: int) -> Counts:
    return Counts(0, num_periods, max_impacts=num_events + _SPARE, max_steps=None, can_stick=True)


@padding_allowed
def with_quantities(branch: Branch, wanted: Mapping[str, Quantity], flow: AbstractFlow | None) -> Branch:
    """The branch with columns for some quantities.

    Args:
        branch: the branch, with its machine.
        wanted: quantities by the names of their columns, checked.
        flow: requested motion between events, or None.
    """
    assert branch.system is not None
    which = np.flatnonzero(branch.points["is_admissible"].values)
    own = branch.points.isel(point=which)
    cycles = _Cycles(branch.system, own, flow)
    named = {name: one for name, one in wanted.items() if isinstance(one, str)}
    found: dict[str, tuple[tuple[Any, ...], np.ndarray]] = {}
    if named and len(which):
        run = cycles.run(list(dict.fromkeys(named.values())))
        found = {name: (run[one].dims[1:], run[one].values) for name, one in named.items()}
    for name, one in wanted.items():
        if not isinstance(one, str) and len(which):
            values = cycles.values_of(one)
            found[name] = tuple(f"{name}_axis{k}" for k in range(values.ndim - 1)), values
    columns = {}
    for name, (dims, values) in found.items():
        whole = np.full((len(branch), *values.shape[1:]), np.nan)
        whole[which] = values
        columns[name] = (("point", *dims), whole, _attributes(str(wanted[name])))
    return Branch(branch.points.assign(columns), branch.system)


def _attributes(name: str) -> dict[str, str]:
    """Attributes of a quantity, whose sweep has recorded the cycle."""
    found = variable_attributes(name)
    words = found.get("long_name", "").replace(" in the recorded periods", " in the cycle")
    for whole in (
        " over the recorded periods",
        " from the end of the first recorded period to that of the last",
    ):
        words = words.replace(whole, " over the cycle")
    return found | ({"long_name": words} if words else {})


def run_of_cycle(
    system: ImpactSystem,
    num_periods: int,
    phase: float,
    start: np.ndarray,
    flow: AbstractFlow | None,
    num_events: int,
) -> Solution | None:
    """Run of a machine through one cycle from its start, (2 n,); None if it leaves the cycle, or its log is too short."""
    t0, t1 = phase / system.forcing.frequency, num_periods * system.forcing.period
    room = 4 * num_events + _SPARE
    sol = simulate_all(system, t0, t0 + t1, *np.split(start, 2), flow=flow, max_events=room, throw=False)
    end = np.concatenate([sol.x1, sol.v1])
    is_whole = bool(sol.result == RESULTS.successful)
    return sol.of_masses if is_whole and _stays(system, start[None], end[None])[0] else None


def _stays(system: ImpactSystem, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """True where a run from a start, (cycles, 2 n), has come back to it."""
    gap, size = np.abs(ends - starts), np.abs(starts).max(axis=1, keepdims=True)
    drifts = system.num_masses - np.linalg.matrix_rank(np.asarray(system.stiffness))
    if drifts:  # masses without a spring to the ground may move on by the same distance in every cycle
        gap = gap[:, system.num_coordinates :]
    return (gap <= NEGLIGIBLE * np.maximum(size, np.finfo(float).tiny)).all(axis=1)


def _without_touches(system: ImpactSystem, orbit: PeriodicOrbit) -> ImpactSystem:
    """The machine with stops that an orbit touches, but does not hit, a little away, or all stops if there is none."""
    log = orbit.events
    impulses, is_impact = np.abs(np.asarray(log.impulse)), np.asarray(log.kind) == IMPACT
    is_hard = is_impact & (impulses > ROUNDED * impulses.max(where=is_impact, initial=0))
    rigid = [j for j, stop in enumerate(system.stops) if isinstance(stop, AbstractRigidLimit)]
    away = sorted(set(rigid) - set(np.asarray(log.stop)[is_hard].tolist())) or rigid
    size, positions = np.abs(orbit.x0).max(), lambda system: [system.stops[j].position for j in away]
    further = [
        at + system.stops[j].sign * EXACT * (size + abs(at))
        for j, at in zip(away, positions(system), strict=True)
    ]
    return eqx.tree_at(positions, system, further) if away else system


class _Cycles:
    """Orbits at the points of a branch that the machine follows."""

    def __init__(self, system: AnySystem, points: xr.Dataset, flow: AbstractFlow | None):
        self.branch = Branch(points, system)
        self.points, self.flow, self.path = points, flow, points.attrs["path"]
        self.is_autonomous = points.attrs["num_periods"] == 0
        # A cycle without load is run as one forcing period, under a load that is constant.
        self.system = with_unit(machine_of(system), 1.0) if self.is_autonomous else system
        self.num_periods = int(points.attrs["num_periods"]) or 1
        self.phase = 2 * np.pi * float(points.attrs["phase"])
        self.num_events = points.sizes["event"]

    def run(self, names: list[str]) -> xr.Dataset:
        """Quantities of all cycles, points first; NaN where the run leaves the orbit."""
        starts = self._starts()
        values = {self.path: self.points[self.path].values}
        if self.is_autonomous:
            values[_FREQUENCY] = 2 * np.pi / self.points["period"].values
        found, stays = self._swept(self.system, values, starts, names)
        for k in np.flatnonzero(self._grazes & ~stays).tolist():
            passes = _without_touches(self._machine(values[self.path][k]), self.branch.orbit(k))
            unit = {path: a[[k]] for path, a in values.items() if path != self.path}
            one, stays[[k]] = self._swept(passes, unit, starts[[k]], names)
            for name in names:
                found[name].values[k] = one[name].values[0]
        return found.where(xr.DataArray(stays, dims=START))

    @property
    def _grazes(self) -> np.ndarray:
        """Flags of the points at a grazing, (points,)."""
        return self.points["bifurcation"].values == "gr"

    def _swept(
        self, system: AnySystem, values: dict[str, np.ndarray], starts: np.ndarray, names: list[str]
    ) -> tuple[xr.Dataset, np.ndarray]:
        """Quantities of the runs from some starts, and flags of those that come back."""
        counts, quiet = _counts(self.num_periods, self.num_events), lambda _: None
        run = sweep_zipped(
            system, values, starts, counts, self.flow, DEFAULT_SETTINGS, None, quiet, quantities=names
        )
        ends = np.concatenate([run["section_x"][:, -1], run["section_v"][:, -1]], axis=1)
        n = self.system.num_coordinates
        if "mean_velocity" in names:
            span = self.num_periods * run["forcing_period"].values[:, None]
            run["mean_velocity"].values[:] = (ends[:, :n] - starts[:, :n]) / span
        return run[names], _stays(machine_of(self.system), starts, ends)

    def values_of(self, function: Callable[[Solution], Any]) -> np.ndarray:
        """Values of a function of one cycle, points first; NaN where the run leaves the orbit."""
        runs = [self._solution(k) for k in range(self.points.sizes["point"])]
        values = [None if sol is None else np.asarray(function(sol), float) for sol in runs]
        shape = next((one.shape for one in values if one is not None), ())
        return np.stack([np.full(shape, np.nan) if one is None else one for one in values])

    def _solution(self, k: int) -> Solution | None:
        """Solution of one cycle; None where the run leaves the orbit."""
        point = self.points.isel(point=k)
        start = np.concatenate([point["x0"].values, point["v0"].values])
        system = self._machine(point[self.path].values)
        if self.is_autonomous:
            system = with_unit(system, float(point["period"]))
        run = partial(run_of_cycle, flow=self.flow, num_events=self.num_events)
        found = run(system, self.num_periods, self.phase, start)
        if found is None and self._grazes[k]:
            found = run(_without_touches(system, self.branch.orbit(k)), self.num_periods, self.phase, start)
        return found

    def _machine(self, value: Any) -> ImpactSystem:
        return machine_at(jax.tree.map(jnp.asarray, self.system), self.path, value)

    def _starts(self) -> np.ndarray:
        """States of the cycles at the beginning of a forcing period, (points, 2 n)."""
        x, v = self.points["x0"].values, self.points["v0"].values
        if self.phase == 0:
            return np.concatenate([x, v], axis=1)

        def at_begin(value: Any, x: Any, v: Any) -> Any:
            system = self._machine(value)
            t0, t1 = self.phase / system.forcing.frequency, system.forcing.period
            sol = simulate_all(system, t0, t1, x, v, flow=self.flow, max_events=1, throw=False)
            return jnp.concatenate([sol.x1, sol.v1])

        return np.asarray(eqx.filter_jit(jax.vmap(at_begin))(self.points[self.path].values, x, v))
