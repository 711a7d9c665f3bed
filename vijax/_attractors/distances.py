"""Distances between points of stroboscopic sections, many at once."""

import numpy as np


def nearest(points: np.ndarray, others: np.ndarray, *, itself: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """For each point the nearest of some others, and how far it is.

    Args:
        points: (points, states).
        others: (others, states).
        itself: whether both are the same, and no point counts as its own neighbour.

    Returns:
        The number of the nearest, and the distance in the largest difference of a coordinate, (points,) each.
    """
    from scipy.spatial import KDTree  # late, for it takes long to import

    # The nearest of all to a point of the same set is that point.
    distance, place = KDTree(others).query(points, k=2 if itself else 1, p=np.inf)
    last = lambda a: np.asarray(a).reshape(len(points), -1)[:, -1]  # noqa: E731
    return last(place), last(distance)


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
