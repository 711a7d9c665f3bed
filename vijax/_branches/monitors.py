"""Monitors of branches: functions of one cycle whose zeros are located, and conditions that end a branch.

Both are evaluated in Python at every new point, after each round of the scheduler, so they change no compiled kernel. A
zero is located by corrected cycles between two points, as the events of a step are, and kept beside the points of the
walk: what follows the branch never meets it.
"""

from collections.abc import Callable, Mapping, Sequence as Many
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._flow.interface import AbstractFlow
from .._orbits.autonomous import with_unit
from .._system.parameters import machine_at
from .._system.system import AnySystem
from .._trajectory.solution import Solution
from .branch import Branch, branch_of
from .cycle_quantities import checked_names, run_of_cycle
from .kinds import MONITOR, STOP, EndKind, Kind, PublicKind, public_kind
from .padding import room_for
from .parameter_family import ParameterFamily
from .point import BranchPoint, DirectedBranch, PlainPoint
from .requests import Requests
from .scheduler import drive
from .sequence_edits import are_alike
from .zero_between import zero_between

# Monitors by name, and conditions: kinds of special points, or functions of the branch so far.
Monitors = Mapping[str, Callable[[Solution], Any]]
Stop = PublicKind | str | Many[PublicKind | str] | Mapping[str, str | Callable[[Branch], Any]]


class Watched(NamedTuple):
    """Checked monitors and conditions.

    Attributes:
        monitors: functions of one cycle, by name.
        stops: kinds of special points or functions of the branch so far, by name.
    """

    monitors: dict[str, Callable[[Solution], Any]]
    stops: dict[str, str | Callable[[Branch], Any]]


def checked_monitors(monitor: Monitors | None, stop: Stop | None) -> Watched:
    """Monitors and conditions by name.

    Raises:
        ValueError: if one of them is of another form.
    """
    monitors = dict(monitor or {})
    checked_names("monitor", monitors)
    for name, one in monitors.items():
        if not callable(one):
            raise ValueError(
                f"Argument `monitor` must give for `{name}` a function of one cycle, but gives {one!r}."
            )
    kinds = sorted({public_kind(kind) for kind in Kind}) + [MONITOR + name for name in monitors]
    named = {stop: stop} if isinstance(stop, str) else stop or {}
    pairs = named.items() if isinstance(named, Mapping) else [(one, one) for one in named]
    stops: dict[str, str | Callable[[Branch], Any]] = dict(pairs)
    for name, one in stops.items():
        if not callable(one) and one not in kinds:
            raise ValueError(
                f"Argument `stop` must be kinds of special points, or a dict of names and functions of the branch so far, but "
                f"has {one!r} for `{name}`. The kinds are {', '.join(kinds)}."
            )
    return Watched(monitors, stops)


@dataclass
class WatchedWalk:
    """One direction of a branch with its monitors and stop conditions.

    Attributes:
        watched: monitors and conditions.
        walk: the walk.
        family: its machines.
        flow: requested motion between events, or None.
        start: its first point.
        num_seen: number of points evaluated so far.
        last: the last of these.
        values: of the monitors there.
        reason: end of the walk where a condition holds, which ends as full.
    """

    watched: Watched
    walk: DirectedBranch
    family: ParameterFamily
    flow: AbstractFlow | None
    start: BranchPoint
    num_seen: int = 0
    last: BranchPoint | None = None
    values: dict[str, float] = field(default_factory=dict)
    reason: str = ""

    def update(self) -> None:
        """Evaluate the new points of the walk, and end it where a condition holds."""
        if self.last is None:
            self.last, self.values = self.start, self._values(self.start)
        self.num_seen = min(self.num_seen, len(self.walk.points))
        while self.num_seen < len(self.walk.points) and self.walk.last is None:
            point = self.walk.points[self.num_seen]
            self._pass(point.alone() if isinstance(point, PlainPoint) else point)
            self.num_seen += 1
        if self.reason:
            self.walk.end = self.reason
        elif self.walk.end == EndKind.CLOSED and self.walk.points:
            self._close()

    def _pass(self, point: BranchPoint) -> None:
        """Locate the zeros between the last point and a new one, and test whether the branch ends there."""
        assert self.last is not None
        values = self._values(point)
        for zero in self._zeros(self.last, point, values):
            self.walk.monitored.append(zero)
            if self._ends_at(zero):
                return
        self.last, self.values = point, values
        self._ends_at(point)

    def _close(self) -> None:
        """Locate the zeros between the last point of a closed walk and its start."""
        assert self.last is not None
        if not are_alike(self.last.sequence, self.start.sequence):
            return
        s = (self.start.place.along(self.last.tangent)) - self.last.place.along(self.last.tangent)
        if s > 0:
            end = self.start._replace(arc=self.last.arc + s)
            self.walk.points += self._zeros(self.last, end, self._values(self.start))
        self.last, self.num_seen = self.start, len(self.walk.points)

    def _ends_at(self, point: BranchPoint) -> bool:
        """Whether a condition holds at a point; the walk ends there if one does."""
        for name, one in self.watched.stops.items():
            if public_kind(point.kind) == one if isinstance(one, str) else self._holds(one, point):
                self.reason, self.walk.last = STOP + name, point.arc
                return True
        return False

    def _holds(self, condition: Callable[[Branch], Any], point: BranchPoint) -> bool:
        """Value of a condition on the branch up to a point."""
        nothing = DirectedBranch(self.walk.num_periods, self.walk.bounds, 0)
        so_far = [one for one in self.walk.points if one.arc <= point.arc]
        walk = DirectedBranch(
            self.walk.num_periods, self.walk.bounds, 0, points=so_far, monitored=self.walk.monitored
        )
        return bool(condition(branch_of(self.family, self.start, nothing, walk)))

    def _values(self, point: BranchPoint) -> dict[str, float]:
        """Values of the monitors at a point; NaN where the machine does not follow the cycle."""
        if not self.watched.monitors:
            return {}
        sol = self._solution(point)
        return {name: _number(name, one, sol) for name, one in self.watched.monitors.items()}

    def _solution(self, point: BranchPoint) -> Solution | None:
        family = self.family
        own: AnySystem = jax.tree.map(jnp.asarray, family.system)
        system = machine_at(own, family.path, point.place.p * family.span)
        if family.is_autonomous:
            system = with_unit(system, float(np.sum(point.place.flights) * system.forcing.period))
        cycle = int(family.num_periods), 2 * np.pi * float(family.phase), np.asarray(point.cycle.start)
        return run_of_cycle(system, *cycle, self.flow, room_for(len(point.sequence.kind)))

    def _zeros(self, before: BranchPoint, after: BranchPoint, values: dict[str, float]) -> list[BranchPoint]:
        """Zeros of the monitors between two points, in order; `values` are those at the second."""
        found = []
        for name, one in self.watched.monitors.items():
            ends = self.values.get(name, np.nan), values[name]
            if not np.all(np.isfinite(ends)) or (ends[0] > 0) == (ends[1] > 0):
                continue

            def value_at(point: BranchPoint, name: str = name, one: Callable = one) -> Requests[float]:
                yield from ()  # a run, not one of the kernels
                return _number(name, one, self._solution(point))

            task = zero_between(before, after, ends, value_at, self.walk.num_periods)
            (zero,) = drive([self.family], [task], lambda: None)
            found += [] if zero is None else [zero._replace(kind=MONITOR + name)]
        return sorted(found, key=lambda point: point.arc)


def _number(name: str, monitor: Callable[[Solution], Any], sol: Solution | None) -> float:
    """Value of a monitor, NaN without a solution.

    Raises:
        ValueError: if it is no real number.
    """
    if sol is None:
        return np.nan
    value = np.asarray(monitor(sol))
    if value.shape != () or not np.isrealobj(value) or value.dtype == object:
        raise ValueError(
            f"Argument `monitor` must give for `{name}` a function of one cycle that returns a real number, but it returned "
            f"{value.dtype} of shape {value.shape}."
        )
    return float(value)
