"""Sweeps that go on from point to point: every point starts where the one before it ended.

Such a chain is sequential by nature. But a motion that settles forgets its start, so most ends can be
had without the true start: all points are run at once from a guess, then again from the ends so found,
until no start changes any more by more than rounding. The result is then that of running one after
another, also where attractors coexist. Where the motion is chaotic, and remembers its
start, one more point of the chain gets its true start in every round. (Asking for the same bits makes
every round like that: a settled motion never forgets the last bits.)
"""

from collections.abc import Callable

import numpy as np

from .._execution.points import Point
from .._execution.records import chosen, joined
from .._execution.runner import AbstractRunner, Found
from .._system.contact import AbstractLimit

# Starts that differ by less, compared with the largest anywhere, are the same.
_SAME = 1e-11


def run_chain(
    points: Point,
    chain: np.ndarray,
    runner: AbstractRunner,
    tell: Callable[[int], object],
    ahead: int,
) -> Found:
    """Run points along chains.

    Args:
        points: the machines and starts; `x0` and `v0` have all points as their last axis. The start of
            the first point of a chain holds, those of the others are first guesses.
        chain: the points in the order in which they are visited, one chain a column, (visits, chains).
        runner: runs those of the points that are due, all at once.
        tell: called with the number of points whose true end was found.
        ahead: points of a chain past the last whose end is known that are run again in one round.

    Returns:
        What came of the points, in their order.
    """
    given = np.concatenate([points.x0, points.v0])
    starts = given.copy()
    first = runner.run(points, np.arange(given.shape[1]), _untold)
    ends, runs, lane_steps = first.ends, [first.impacts], first.lane_steps
    used, last_run = given.copy(), np.zeros(given.shape[1], int)
    row = np.arange(len(chain))[:, None]
    num_known = np.zeros(chain.shape[1], int)
    while True:
        starts[:, chain[1:]] = _next_starts(points, given, ends, chain)
        scale = np.abs(starts).max(axis=1)[:, None, None]
        is_same = (np.abs(used[:, chain] - starts[:, chain]) <= _SAME * scale).all(axis=0)
        is_true = np.logical_and.accumulate(is_same, axis=0)
        tell(int((is_true.sum(axis=0) - num_known).sum()))
        num_known = is_true.sum(axis=0)
        if is_true.all():
            break
        which = np.sort(chain[~is_same & (row < num_known + ahead)])
        found = runner.run(Point(points.system, *np.split(starts, 2)), which, _untold)
        used[:, which], last_run[which] = starts[:, which], len(runs)
        runs.append(found.impacts)
        lane_steps += found.lane_steps
        for name, a in found.ends.items():
            ends[name][..., which] = a
    impacts = [chosen(rows, last_run[rows.point] == k) for k, rows in enumerate(runs)]
    return Found(ends, joined(impacts), lane_steps)


def _untold(num_points: int) -> None:
    """Ignore progress: a point that was run may have to be run again."""


def _next_starts(
    points: Point, given: np.ndarray, ends: dict[str, np.ndarray], chain: np.ndarray
) -> np.ndarray:
    """Starts of all points but the first: the end before each, pushed back by stops that moved in.

    A mass that a moving stop holds goes on with it, however it moves from now on.
    """
    before, after = chain[:-1], chain[1:]
    x, v = ends["x"][:, before], ends["v"][:, before]
    frequency = points.system.forcing.frequency
    for stop, held in zip(points.system.stops, ends["held"], strict=True):
        at_start = stop.at(0.0), frequency * stop.slope_at(0.0)
        position, speed = (np.broadcast_to(np.asarray(a), given.shape[1])[after] for a in at_start)
        position, goes_with = stop.sign * position, held[before] & (stop.motion is not None)
        _put(stop, x, position, goes_with | (np.asarray(stop.along(x)) > position))
        _put(stop, v, stop.sign * speed, goes_with)
    carried = np.concatenate([x, v])
    return np.where(np.isfinite(carried).all(axis=0), carried, given[:, after])


def _put(stop: AbstractLimit, of_masses: np.ndarray, along: np.ndarray, which: np.ndarray) -> None:
    """Change positions, or velocities, in place, so that along a stop they are what is given, where asked for."""
    row = {i: np.asarray(a) for i, a in stop.coefficients.items()}
    lack, square = along - np.asarray(stop.along(of_masses)), sum(a * a for a in row.values())
    for i, a in row.items():
        there = along / a if len(row) == 1 else of_masses[i] + a * lack / square
        of_masses[i] = np.where(which, there, of_masses[i])
