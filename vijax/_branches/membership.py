"""Membership of orbits in given branches, decided by the cycle of the branch at the same parameter."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._orbits.sequence import Sequence
from .._system.system import machine_of
from .._trajectory.simulate import simulate_all
from .bracket import Bracket, next_trial
from .branch import Bifurcation, Branch, cycle_of
from .kernels import CorrectedCycle
from .kinds import EndKind
from .parameter_family import ExtendedCycle, ParameterFamily
from .point import BranchPoint, End, at_parameter, corrected
from .requests import Requests
from .scheduler import drive
from .section import in_section
from .starts import Start, families_of, value_of
from .tolerances import EXACT, MEMBER_NEAR, NEGLIGIBLE

# Most trials to find the cycle at a parameter between two points.
_TRIALS = 40


class _Chance(NamedTuple):
    """An orbit by its number, its states in all its periods, and the points `k` and `k + 1` between which it may lie.

    On a closed branch `k + 1` may be the first point again.
    """

    orbit: int
    value: float
    states: np.ndarray
    branch: Branch
    number: int
    k: int


class KnownOrbits:
    """Orbits that are compared with branches, from all of their periods.

    Args:
        starts: the orbits.
        fold: whether an orbit lies where one of its mirror images does.
    """

    def __init__(self, starts: list[Start], *, fold: bool = False):
        images = [(k, image) for k, start in enumerate(starts) for image in (_images(start) if fold else [])]
        self._starts = [*starts, *(image for _, image in images)]
        self._owners = np.array([*range(len(starts)), *(k for k, _ in images)], int)
        self._known: dict[int, np.ndarray] = {}
        self._values: dict[int, float] = {}

    def not_on(self, which: list[int], branches: list[Branch]) -> list[int]:
        """Numbers of those orbits, among some, that lie on none of the branches."""
        found = self.on(which, branches)
        return [k for k in which if not found[k]]

    def on(self, which: list[int], branches: list[Branch]) -> dict[int, set[int]]:
        """For each of some orbits the numbers of the branches on which it lies."""
        found: dict[int, set[int]] = {k: set() for k in which}
        chances = [chance for j, branch in enumerate(branches) for chance in self._chances(which, j, branch)]
        if not chances:
            return found
        families = self._families(chances)
        tasks = [_is_met(chance, family) for chance, family in zip(chances, families, strict=True)]
        for chance, is_met in zip(chances, drive(families, tasks, lambda: None), strict=True):
            if is_met:
                found[int(self._owners[chance.orbit])].add(chance.number)
        return found

    def _chances(self, which: list[int], number: int, branch: Branch) -> Iterator[_Chance]:
        points = branch.points
        # The last point of a closed branch comes before its first one.
        rows = np.arange(len(branch) + (branch.ends[1] == EndKind.CLOSED)) % len(branch)
        values = branch.values[rows]
        z = np.concatenate([points["x0"].values, points["v0"].values], axis=1)[rows]
        num_periods = points.attrs["num_periods"]
        own = np.flatnonzero(np.isin(self._owners, which)).tolist()
        for orbit in (k for k in own if self._starts[k].num_periods == num_periods):
            if orbit not in self._values:
                self._values[orbit] = value_of(self._starts[orbit].system, branch.path)
            p = self._values[orbit]
            # An orbit at a bound is at the last point of the branch, up to the rounding of the scaled parameter.
            before = np.where(np.abs(values - p) <= EXACT * abs(p), 0, values - p)
            between = np.flatnonzero(before[:-1] * before[1:] <= 0)
            states = self._states(orbit) if between.size else np.zeros(0)
            size = np.abs(states).max(initial=0)
            chords = np.abs(np.diff(z, axis=0)).max(axis=1)
            for k in between:
                away = min(np.abs(states - z[end]).max(axis=1).min() for end in (k, k + 1))
                # Where both states of a mass turn back, a chord is short. (Rejected: to accept an orbit near a chord. Where an
                # impact passes the start of the cycle the chord leads nowhere, and between two branches it leads to both.)
                if away <= MEMBER_NEAR * chords[max(k - 1, 0) : k + 2].max() + NEGLIGIBLE * size:
                    yield _Chance(orbit, p, states, branch, number, int(k))

    def _states(self, orbit: int) -> np.ndarray:
        if orbit not in self._known:
            self._known[orbit] = _states(self._starts[orbit])
        return self._known[orbit]

    def _families(self, chances: list[_Chance]) -> list[ParameterFamily]:
        """Family of each chance; orbits that are compared with several branches have one."""
        values = np.concatenate([[chance.value for chance in chances], *(c.branch.values for c in chances)])
        low, high = float(values.min()), float(values.max())
        room = 0.0 if low < high else 1.0  # for a branch of a single point
        numbers = list(dict.fromkeys(chance.orbit for chance in chances))
        starts, path = [self._starts[k] for k in numbers], chances[0].branch.path
        found = dict(zip(numbers, families_of(starts, path, low - room, high + room), strict=True))
        return [found[chance.orbit] for chance in chances]


def _is_met(chance: _Chance, family: ParameterFamily) -> Requests[bool]:
    """True if the branch has the orbit between its two points."""
    p, span = chance.value / float(family.span), float(family.span)
    at = [Bifurcation(chance.branch, end % len(chance.branch)) for end in (chance.k, chance.k + 1)]
    ends = [cycle_of(point, family.scale, point.value / span) for point in at]
    cycle = yield from _between(ends, p)
    if cycle is not None and (yield from _is_same(chance, family, ends[0][0], cycle)):
        return True
    for sequence, place in ends:
        cycle = yield from at_parameter(sequence, place, p)
        if cycle.found.is_converged and (yield from _is_same(chance, family, sequence, cycle)):
            return True
    return False


def _between(ends: list[tuple[Sequence, ExtendedCycle]], p: float) -> Requests[CorrectedCycle | None]:
    """The cycle at a parameter between two cycles of a branch, or None.

    Corrected in planes across the chord: where two branches cross, Newton's method at fixed parameter finds either.
    """
    (sequence, first), (other, last) = ends
    if len(sequence.kind) != len(other.kind):
        return None
    chord = last.moved(first, -1.0)
    length = float(np.sqrt(chord.along(chord)))
    if length == 0:
        return None
    way = ExtendedCycle(*(np.asarray(a / length) for a in chord))
    bracket, cycle = Bracket.between(float(first.p) - p, float(last.p) - p, length), None
    while (s := next_trial(bracket)) is not None and bracket.trials < _TRIALS:
        guess = first.moved(way, s)
        cycle = yield from corrected(sequence, guess, way, first.along(way) + s)
        if not cycle.found.is_converged:
            return None
        bracket = bracket.narrowed(s, float(cycle.found.place.p) - p)
    return cycle


def _is_same(
    chance: _Chance, family: ParameterFamily, sequence: Sequence, cycle: CorrectedCycle
) -> Requests[bool]:
    """True if a cycle is the orbit; False for one that has no state at its start, as its events are out of order."""
    point = yield from in_section(BranchPoint.of(sequence, cycle, 0.0), family.last_phase)
    if isinstance(point, End):
        return False
    away = np.abs(chance.states - point.cycle.start).max(axis=1).min()
    return bool(away < NEGLIGIBLE * np.abs(chance.states).max())


def _states(start: Start) -> np.ndarray:
    """States of an orbit at the start of each of its forcing periods, (num_periods, 2 n)."""
    if start.num_periods == 1:
        return start.state[None]
    x, v = np.split(start.state, 2)
    period = 2 * np.pi / float(start.system.forcing.frequency)
    ts = start.phase / (2 * np.pi) * period + period * np.arange(start.num_periods)
    sol = simulate_all(
        start.system, ts[0], ts[-1], x, v, ts=ts, args=start.args, flow=start.flow, throw=False
    )
    return np.concatenate([sol.xs, sol.vs], axis=1)


def _images(start: Start) -> list[Start]:
    """The mirror images of an orbit that a load drives, those apart that are the orbit itself."""
    machine = machine_of(start.system)
    symmetries = () if start.is_autonomous else machine.symmetries(args=start.args)
    own, found = _states(start) if symmetries else np.zeros(0), []
    for symmetry in symmetries:
        period, (x, v) = 2 * np.pi / float(machine.forcing.frequency), np.split(start.state, 2)
        t0 = start.phase / (2 * np.pi) * period
        later = t0 + float(symmetry.shift) * period
        sol = simulate_all(start.system, t0, later, x, v, args=start.args, flow=start.flow, throw=False)
        image = np.concatenate(symmetry.image(np.asarray(sol.x1), np.asarray(sol.v1)))
        if np.abs(own - image).max(axis=1).min() > NEGLIGIBLE * np.abs(own).max():
            found.append(start._replace(state=image))
    return found
