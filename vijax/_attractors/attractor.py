"""One attractor: its section, its kind, its multipliers; and the test of whether two are the same."""

from typing import NamedTuple

import numpy as np

from .._orbits.many import Orbits
from .._sections.classify import MOTIONS, classified
from .distances import mixes, same_cycle
from .ensemble import Machines

# Cycles that are not polished are one if they are closer than so many tolerances, relative to their size. Polished
# ones, whose closing error is that of rounding, must agree to half of all digits.
_SLACK = 10
# A search that ends farther from its start, relative to the size, has found another cycle.
_NEAR = 1e-2
# Smallest fraction of mixed neighbourhoods of clouds that mix: all are expected of one attractor, none of two. Motions
# that seldom pass from one part of their attractor to another need time to mix all.
_MIXED = 0.25
# Number of points of a cloud that are kept.
_CLOUD = 2048
_NON_PERIODIC = MOTIONS.index("non_periodic")


class Attractor(NamedTuple):
    """An attractor.

    Attributes:
        machine: index of its machine.
        points: its section as states (W x, v), (points, 2 n): of a cycle those of its n periods in order, the lowest
            x[0] first; of chaos a cloud.
        size: the largest absolute value in them.
        num_periods: n, 0 for chaos.
        kind: index in `MOTIONS`.
        num_impacts: impacts at each stop in n periods, (stops,).
        held_time: time in n periods during which each stop holds its mass, (stops,).
        multipliers: (2 n,), NaN where they are unknown.
        residual: closing error, NaN if it was not polished.
        is_lasting: false if a motion is known to leave it.
        num_images: number of different images under the symmetries of the machine, itself among them, if they were asked for.
    """

    machine: int
    points: np.ndarray
    size: float
    num_periods: int
    kind: int
    num_impacts: np.ndarray
    held_time: np.ndarray
    multipliers: np.ndarray
    residual: float
    is_lasting: bool = True
    num_images: int = 1

    @property
    def is_polished(self) -> bool:
        """True if its state is that of the periodic orbit itself."""
        return bool(np.isfinite(self.residual))

    @property
    def is_stable(self) -> bool:
        """True if all multipliers are known and lie inside the unit circle."""
        return bool((np.abs(self.multipliers) < 1).all())


def orbits_near(
    machines: Machines,
    states: np.ndarray,
    machine: np.ndarray,
    num_periods: np.ndarray,
    is_quiet: np.ndarray,
) -> tuple[Orbits, np.ndarray]:
    """Periodic orbits found from states that nearly repeat, and flags of those that belong to their motion.

    A quiet motion may be far from its orbit, as its linear machine has no other.
    """
    found = machines.polish(states, machine, num_periods)
    start = machines.after_impacts(found.start * machines.scale(machine), machine)
    away = np.abs(start - machines.after_impacts(states, machine)).max(axis=1)
    is_near = away <= _NEAR * np.maximum(np.abs(states).max(axis=1), np.finfo(states.dtype).tiny)
    return found, found.is_orbit & (is_near | (is_quiet & (found.num_impacts == 0).all(axis=1)))


def cycles_from(
    machines: Machines,
    states: np.ndarray,
    machine: np.ndarray,
    num_periods: np.ndarray,
    is_quiet: np.ndarray,
) -> list[Attractor]:
    """Cycles near states that nearly repeat, polished where the search succeeds."""
    found, is_found = orbits_near(machines, states, machine, num_periods, is_quiet)
    start = found.start * machines.scale(machine)
    start = np.where(is_found[:, None], start, states)
    ds = machines.run(
        start, machine, 0, max(4 * int(num_periods.max()), 8), max_impacts=1 << 14, goes_on=True
    )
    kinds = classified(ds)
    # A cycle that repeats sooner is polished again, as such: else its multipliers would be those of several cycles.
    n = np.where(kinds["num_periods"].values > 0, kinds["num_periods"].values, num_periods)
    sooner = np.flatnonzero(n < num_periods)
    of_sooner = (a[sooner] for a in (start, machine, n, is_quiet))
    again = iter(cycles_from(machines, *of_sooner) if sooner.size else [])
    section = np.concatenate([ds["section_x"].values, ds["section_v"].values], axis=2)
    each = np.repeat(machine, section.shape[1])
    section = (section * machines.scale(machine)[:, None]).reshape(len(each), -1)
    section = machines.after_impacts(section, each).reshape(len(machine), -1, states.shape[1])
    motions = []
    for k in range(len(states)):
        if n[k] < num_periods[k]:
            motions.append(next(again))
            continue
        points = section[k, : n[k]]
        points = np.roll(points, -int(points[:, 0].argmin()), axis=0)
        motions.append(
            Attractor(
                machine=int(machine[k]),
                points=points,
                size=_size(points),
                num_periods=int(n[k]),
                kind=int(kinds["motion"].values[k]),
                num_impacts=kinds["num_impacts"].values[k],
                held_time=kinds["held_time"].values[k],
                multipliers=found.multipliers[k] if is_found[k] else np.full(states.shape[1], np.nan + 0j),
                residual=float(found.residual[k]) if is_found[k] else np.nan,
            )
        )
    return motions


def cloud_of(machines: Machines, machine: int, points: np.ndarray) -> Attractor:
    """The attractor of a chaotic motion, from its section, (points, 2 n)."""
    unknown = np.full(machines.system.num_stops, np.nan)
    points = thinned(points)
    multipliers = np.full(points.shape[1], np.nan + 0j)
    size = _size(points)
    return Attractor(machine, points, size, 0, _NON_PERIODIC, unknown, unknown, multipliers, np.nan)


def attractor_index(known: list[Attractor], motion: Attractor, tolerance: float) -> int:
    """Index of a motion among the `known` ones, to which it is added if it is new."""
    for k, other in enumerate(known):
        if other.machine == motion.machine and is_same(other, motion, tolerance):
            if not motion.num_periods:
                points = thinned(np.concatenate([other.points, motion.points]))
                known[k] = other._replace(points=points, size=_size(points))
            return k
    known.append(motion)
    return len(known) - 1


def is_same(ours: Attractor, theirs: Attractor, tolerance: float) -> bool:
    """True where two motions of one machine are one, by their states and events.

    Cycles are compared point by point, up to a shift by whole periods; clouds by `mixes`.
    """
    if ours.num_periods != theirs.num_periods:
        return False
    if not ours.num_periods:
        return mixes(ours.points, theirs.points, _MIXED)
    is_exact = ours.is_polished and theirs.is_polished
    if is_exact and not np.array_equal(ours.num_impacts, theirs.num_impacts, equal_nan=True):
        return False
    within = np.sqrt(np.finfo(ours.points.dtype).eps) if is_exact else _SLACK * tolerance
    return same_cycle(ours.points, theirs.points, within * max(ours.size, theirs.size))


def thinned(points: np.ndarray) -> np.ndarray:
    """At most `_CLOUD` of the points, spread evenly."""
    return points if len(points) <= _CLOUD else points[np.linspace(0, len(points) - 1, _CLOUD).astype(int)]


def _size(points: np.ndarray) -> float:
    return float(np.abs(points).max()) or 1.0
