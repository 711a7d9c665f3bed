"""Distances between points of stroboscopic sections, many at once."""

from collections.abc import Iterator

import numpy as np

# Numbers of one table of distances.
_ROOM = 1 << 22


def nearest(points: np.ndarray, others: np.ndarray, *, itself: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """For each point the nearest of some others, and how far it is.

    Args:
        points: (points, states).
        others: (others, states).
        itself: whether both are the same, and no point counts as its own neighbour.

    Returns:
        The number of the nearest, and the distance in the largest difference of a coordinate, (points,) each.
    """
    place = np.zeros(len(points), int)
    if not len(others):
        return place, np.full(len(points), np.inf)
    # |p - q|^2 = |p|^2 - 2 p.q + |q|^2 chooses the neighbour, by one product of matrices; as its digits cancel, the
    # distance from that one is computed again.
    middle = others.mean(axis=0)
    centred, half = others - middle, ((others - middle) ** 2).sum(axis=1) / 2
    for block in _blocks(len(points), len(others)):
        table = half[None] - (points[block] - middle) @ centred.T
        if itself:
            table[np.arange(len(table)), np.arange(block.start, block.start + len(table))] = np.inf
        place[block] = table.argmin(axis=1)
    return place, np.abs(points - others[place]).max(axis=1)


def _blocks(num_points: int, num_others: int) -> Iterator[slice]:
    width = max(1, _ROOM // num_others)
    return (slice(k, min(k + width, num_points)) for k in range(0, num_points, width))


def mixes(ours: np.ndarray, theirs: np.ndarray, least: float) -> bool:
    """Whether two samples, (points, states), may be of one set: Schilling's test of nearest neighbours.

    In the union of two samples of one distribution a point has its nearest neighbour in either with equal chance, in whatever
    dimension and of whatever distribution. Where the two sets lie apart every point has it in its own.

    Args:
        ours: a sample.
        theirs: another.
        least: the fraction of points with their nearest neighbour in the other sample, from which on they mix.

    References:
        M. F. Schilling, Multivariate two-sample tests based on nearest neighbors, J. Am. Stat. Assoc. 81 (1986) 799.
    """
    size = min(len(ours), len(theirs))
    ours, theirs = (a[np.linspace(0, len(a) - 1, size).astype(int)] for a in (ours, theirs))
    crossed = [nearest(a, b)[1] <= nearest(a, a, itself=True)[1] for a, b in ((ours, theirs), (theirs, ours))]
    return bool(np.mean(crossed) >= least)


def same_cycle(ours: np.ndarray, theirs: np.ndarray, tolerance: float) -> bool:
    """Whether two cycles of section points, (periods, states), are one, begun at any of its periods."""
    if ours.shape != theirs.shape:
        return False
    turned = np.stack([np.roll(theirs, k, axis=0) for k in range(len(theirs))])
    return bool(np.abs(turned - ours).max(axis=(1, 2)).min() <= tolerance)


def set_distance(ours: np.ndarray, theirs: np.ndarray) -> float:
    """How far two sets of points are apart: the mean distance from a point of one to the nearest of the other.

    Of the two means, one for each set, the larger counts. The largest distance instead of the mean, Hausdorff's, would hang
    on the most seldom visited point of a cloud.
    """
    return float(max(nearest(a, b)[1].mean() for a, b in ((ours, theirs), (theirs, ours))))
