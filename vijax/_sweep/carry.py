"""Carried sweeps: every point starts where the one before it ended.

Such a chain is sequential by nature. It runs in a loop of few lanes, a chain in each, that does not end between two
points. Guessed starts, corrected until none changes, were rejected: all points then settle together, but a chaotic
motion remembers its start, and each of its points takes a round of all lanes. Partly chaotic sweeps took ten times
longer.
"""

from collections.abc import Callable

import jax
import numpy as np

from .._execution.carry_start import carried_start
from .._execution.points import LaneInput
from .._execution.runner import AbstractRunner, PointResults, join_results
from .._execution.settings import ExecutionSettings
from .._machine.numbers import numbers_of


def lanes_of_chains(settings: ExecutionSettings, chain: np.ndarray, periods: int) -> int:
    """Number of lanes for chains, (visits, chains), of so many forcing periods a point.

    A loop of few lanes takes less time a turn: a power of two, so that few programs are compiled. For short chains its
    compilation would take longer than that saves.
    """
    num_visits, num_chains = chain.shape
    if num_visits * periods < settings.long_chain:
        return settings.lanes
    return min(1 << (num_chains - 1).bit_length(), settings.lanes)


def run_chains(
    points: LaneInput,
    chain: np.ndarray,
    runner: AbstractRunner,
    tell: Callable[[int], object],
    settings: ExecutionSettings,
) -> PointResults:
    """Run points along chains, some visits of all of them at a time.

    Args:
        points: machines and starts; `x0` and `v0` have all points as their last axis. The start of the first point of
            a chain is used, those of the others only where a motion did not stay finite.
        chain: the points in the order of their visits, one chain a column, (visits, chains).
        runner: runs pieces of the chains.
        tell: called with the number of points done.
        settings: sizes of pieces.

    Returns:
        Results of the points, in their order.
    """
    num_visits = max(min(settings.visits, settings.points // chain.shape[1]), 1)
    pieces = [chain[k : k + num_visits] for k in range(0, len(chain), num_visits)]
    x0, v0, parts = points.x0.copy(), points.v0.copy(), []
    for k, piece in enumerate(pieces):
        if k > 0:
            which = np.searchsorted(np.sort(pieces[k - 1], axis=None), pieces[k - 1][-1])
            x0[:, piece[0]], v0[:, piece[0]] = _starts(points, piece[0], parts[-1], which)
        parts.append(runner.run(LaneInput(points.system, x0, v0), piece, tell))
    return join_results(enumerate(parts), pieces)


def _starts(
    points: LaneInput, following: np.ndarray, found: PointResults, which: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Starts of the points `following`, at the ends of the points `which` of `found`."""
    of_points = lambda a: a if a.shape[-1] == 1 else a[..., following]  # noqa: E731
    numbers = jax.tree.map(of_points, numbers_of(points.system))
    x, v, held = (found.ends[name][..., which] for name in ("x", "v", "held"))
    x, v = carried_start(numbers, (x, v), held, (points.x0[:, following], points.v0[:, following]))
    return np.asarray(x), np.asarray(v)
