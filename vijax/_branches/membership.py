"""Membership of orbits in given branches, decided by the cycle of the branch at the same parameter."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._orbits.sequence import Sequence
from .._trajectory.simulate import simulate
from .bracket import Bracket, next_trial
from .branch import Bifurcation, Branch, cycle_of
from .kernels import CorrectedCycle
from .parameter_family import ExtendedCycle, Family
from .point import BranchPoint, KernelRequests, at_parameter, corrected
from .scheduler import drive
from .sequence_switching import in_section
from .starts import Start, family_of, value_of

# _NEAR: largest distance from an orbit to a point, in chords to its neighbour, at which the branch is corrected there.
# (Rejected: to accept an orbit near a chord. Where an impact passes the start of the cycle the chord leads nowhere, and
# between two branches it leads to both.)
# _SAME: relative distance below which two states are equal.
_NEAR, _SAME = 1.0, 1e-6
# Most trials to find the cycle at a parameter between two points.
_TRIALS = 40


class _Chance(NamedTuple):
    """An orbit, its states in all its periods, and the points `k` and `k + 1` of a branch between which it may lie."""

    start: Start
    states: np.ndarray
    branch: Branch
    k: int


def not_on(starts: list[Start], branches: list[Branch]) -> list[Start]:
    """The orbits that lie on none of the branches, each compared from all of its periods."""
    chances = [chance for start in starts for chance in _chances(start, branches)]
    families = [_family(chance) for chance in chances]
    tasks = [_is_met(chance, family) for chance, family in zip(chances, families, strict=True)]
    answers = zip(chances, drive(families, tasks, lambda: None), strict=True) if tasks else ()
    met = {id(chance.start) for chance, is_met in answers if is_met}
    return [start for start in starts if id(start) not in met]


def _chances(start: Start, branches: list[Branch]) -> Iterator[_Chance]:
    own = [branch for branch in branches if branch.points.attrs["num_periods"] == start.num_periods]
    states = _states(start) if own else start.state[None]
    for branch in own:
        points, size = branch.points, np.abs(states).max()
        p, values = value_of(start.system, branch.path), branch.values
        z = np.concatenate([points["x0"].values, points["v0"].values], axis=1)
        for k in np.flatnonzero((values[:-1] - p) * (values[1:] - p) <= 0):
            chord = np.abs(z[k + 1] - z[k]).max()
            away = min(np.abs(states - z[end]).max(axis=1).min() for end in (k, k + 1))
            if away <= _NEAR * chord + _SAME * size:
                yield _Chance(start, states, branch, int(k))


def _family(chance: _Chance) -> Family:
    value = value_of(chance.start.system, chance.branch.path)
    return family_of(chance.start, chance.branch.path, value - 1, value + 1)


def _is_met(chance: _Chance, family: Family) -> KernelRequests:
    """True if the branch has the orbit between its two points."""
    p, span = value_of(chance.start.system, chance.branch.path) / float(family.span), float(family.span)
    at = [Bifurcation(chance.branch, end) for end in (chance.k, chance.k + 1)]
    ends = [cycle_of(point, family.scale, point.value / span) for point in at]
    seen = yield from _between(ends, p)
    if seen is not None and (yield from _is_same(chance, family, ends[0][0], seen)):
        return True
    for sequence, place in ends:
        seen = yield from at_parameter(sequence, place, p)
        if seen.found.is_converged and (yield from _is_same(chance, family, sequence, seen)):
            return True
    return False


def _between(ends: list[tuple[Sequence, ExtendedCycle]], p: float) -> KernelRequests:
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
    bracket, seen = Bracket.between(float(first.p) - p, float(last.p) - p, length), None
    while (s := next_trial(bracket)) is not None and bracket.trials < _TRIALS:
        guess = first.moved(way, s)
        seen = yield from corrected(sequence, guess, way, first.along(way) + s)
        if not seen.found.is_converged:
            return None
        bracket = bracket.narrowed(s, float(seen.found.place.p) - p)
    return seen


def _is_same(chance: _Chance, family: Family, sequence: Sequence, seen: CorrectedCycle) -> KernelRequests:
    """True if a cycle is the orbit."""
    point = yield from in_section(BranchPoint.of(sequence, seen, 0.0), float(family.num_periods))
    away = np.abs(chance.states - point.seen.start).max(axis=1).min()
    return bool(away < _SAME * np.abs(chance.states).max())


def _states(start: Start) -> np.ndarray:
    """States of an orbit at the start of each of its forcing periods, (num_periods, 2 n)."""
    if start.num_periods == 1:
        return start.state[None]
    x, v = np.split(start.state, 2)
    period = 2 * np.pi / float(start.system.forcing.frequency)
    ts = start.phase / (2 * np.pi) * period + period * np.arange(start.num_periods)
    sol = simulate(start.system, ts[0], ts[-1], x, v, ts=ts, args=start.args, flow=start.flow, throw=False)
    return np.concatenate([sol.xs, sol.vs], axis=1)
