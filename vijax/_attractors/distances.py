"""Distances between points of stroboscopic sections, many at once."""

import numpy as np

# Number of neighbours of its own sample in the ball around each point of a cloud, which has some hundred points.
NEIGHBOURS = 16


def nearest(points: np.ndarray, others: np.ndarray, rank: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """The nearest of some others, (others, states), to each point, (points, states), or the one of another rank.

    Returns its index, and the distance as the largest difference of a coordinate, (points,) each. A rank beyond the
    number of others stands for the last of them.
    """
    from scipy.spatial import KDTree  # late, as it takes long to import

    distance, place = KDTree(others).query(points, k=min(rank, len(others)), p=np.inf)
    last = lambda a: np.asarray(a).reshape(len(points), -1)[:, -1]  # noqa: E731
    return last(place), last(distance)


def reach(points: np.ndarray) -> np.ndarray:
    """Distance of each point of a cloud to the last of its `NEIGHBOURS`, (points,)."""
    return nearest(points, points, NEIGHBOURS + 1)[1]  # the nearest of all is the point itself


def mixes(ours: np.ndarray, theirs: np.ndarray, least: float) -> bool:
    """True if two samples, (points, states), are from one set: a test of nearest neighbours, after Schilling's.

    Around each point of one sample is the ball that just holds `NEIGHBOURS` neighbours of its own sample. If both are
    of one distribution, whatever it is, and in whatever dimension, the ball almost certainly holds a point of the
    other; if the sets are farther apart than its radius, it holds none. Samples mix from the fraction `least` of such
    balls on. (With the nearest neighbour alone, as in Schilling's test, samples of a quasi-periodic motion may seem
    apart: a rotation close to a rational one leaves them in clumps.)

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
    """True if two cycles of section points, (periods, states), are one, begun at any of its periods."""
    if ours.shape != theirs.shape:
        return False
    turned = np.stack([np.roll(theirs, k, axis=0) for k in range(len(theirs))])
    return bool(np.abs(turned - ours).max(axis=(1, 2)).min() <= tolerance)


def set_distance(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Distance of two sets of points: the mean distance from a point of one to the nearest of the other.

    Of the two means, one for each set, the larger counts. The largest distance instead of the mean, Hausdorff's, would
    depend on the least visited point of a cloud.
    """
    return float(max(nearest(a, b)[1].mean() for a, b in ((ours, theirs), (theirs, ours))))
