"""Distances between points of stroboscopic sections, many at once."""

import numpy as np

# Neighbours of its own sample in the ball around each point of a cloud, of some hundred.
NEIGHBOURS = 16


def nearest(points: np.ndarray, others: np.ndarray, rank: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """For each point the nearest of some others, and how far it is.

    Args:
        points: (points, states).
        others: (others, states).
        rank: 1 for the nearest, 2 for the next, ..., no more than there are others.

    Returns:
        Its number, and the distance in the largest difference of a coordinate, (points,) each.
    """
    from scipy.spatial import KDTree  # late, for it takes long to import

    distance, place = KDTree(others).query(points, k=min(rank, len(others)), p=np.inf)
    last = lambda a: np.asarray(a).reshape(len(points), -1)[:, -1]  # noqa: E731
    return last(place), last(distance)


def reach(points: np.ndarray) -> np.ndarray:
    """How far each point of a cloud is from the last of its `NEIGHBOURS`, (points,)."""
    return nearest(points, points, NEIGHBOURS + 1)[1]  # the nearest of all is the point itself


def mixes(ours: np.ndarray, theirs: np.ndarray, least: float) -> bool:
    """Whether two samples, (points, states), are of one set: a test of nearest neighbours, after Schilling's.

    Around each point of one sample is the ball that just holds so many neighbours of its own sample. If both are of one
    distribution, whatever it is, and in whatever dimension, the ball is as good as certain to hold a point of the other; if
    the sets are farther apart than its radius, it holds none. (With the nearest neighbour alone, as in Schilling's test, samples of a
    quasi-periodic motion may seem apart: a rotation close to a rational one leaves them in clumps.)

    Args:
        ours: a sample.
        theirs: another.
        least: the fraction of balls with a point of the other sample, from which on they mix.

    References:
        M. F. Schilling, Multivariate two-sample tests based on nearest neighbors, J. Am. Stat. Assoc. 81 (1986) 799.
    """
    size = min(len(ours), len(theirs))
    ours, theirs = (a[np.linspace(0, len(a) - 1, size).astype(int)] for a in (ours, theirs))
    shared = 0.0
    for a, b in ((ours, theirs), (theirs, ours)):
        shared += float(np.mean(nearest(a, b)[1] <= reach(a))) / 2
        if shared >= least:
            return True
    return False


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
