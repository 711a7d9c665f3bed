"""Sweeps that go on from point to point: every point starts where the one before it ended.

Such a chain is sequential by nature, and is run so, in a loop of few lanes, a chain in each, that is not left between two points.
Guessed starts, corrected until none changes any more, were rejected: all points settle side by side then, but a chaotic motion
remembers its start, and each of its points takes a round of all lanes. A sweep that is chaotic in places took ten times as long.
"""

from collections.abc import Callable

import jax
import numpy as np

from .._execution.carry_start import carried_start
from .._execution.points import LaneInput
from .._execution.runner import AbstractRunner, PointResults, together
from .._execution.settings import ExecutionSettings


def lanes_of_chains(settings: ExecutionSettings, num_chains: int) -> int:
    """Lanes for so many chains: a power of two, so that few programs are compiled, and no more than others have."""
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
        points: the machines and starts; `x0` and `v0` have all points as their last axis. The start of
            the first point of a chain holds, those of the others where a motion did not stay finite.
        chain: the points in the order in which they are visited, one chain a column, (visits, chains).
        runner: runs pieces of the chains.
        tell: called with the number of points done.
        settings: sizes of pieces.

    Returns:
        What came of the points, in their order.
    """
    num_visits = max(min(settings.visits, settings.points // chain.shape[1]), 1)
    pieces = [chain[k : k + num_visits] for k in range(0, len(chain), num_visits)]
    x0, v0, parts = points.x0.copy(), points.v0.copy(), []
    for k, piece in enumerate(pieces):
        if k > 0:
            which = np.searchsorted(np.sort(pieces[k - 1], axis=None), pieces[k - 1][-1])
            x0[:, piece[0]], v0[:, piece[0]] = _starts(points, piece[0], parts[-1], which)
        parts.append(runner.run(LaneInput(points.system, x0, v0), piece, tell))
    return together(enumerate(parts), pieces)


def _starts(
    points: LaneInput, following: np.ndarray, found: PointResults, which: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Starts of points that follow on some of those found."""
    of_points = lambda a: a if a.shape[-1] == 1 else a[..., following]  # noqa: E731
    own = LaneInput(jax.tree.map(of_points, points.system), points.x0[:, following], points.v0[:, following])
    x, v, held = (found.ends[name][..., which] for name in ("x", "v", "held"))
    x, v = carried_start(own.system, (x, v), held, (own.x0, own.v0))
    return np.asarray(x), np.asarray(v)
