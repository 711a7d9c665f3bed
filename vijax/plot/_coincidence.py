"""Branches whose lines lie on those of another: a legend says so, since a picture cannot show it."""

import numpy as np

Line = tuple[np.ndarray, np.ndarray]

# Largest distance of lines that look like one, as a share of the picture; share of the points of a branch on another.
_APART, _MOST = 2e-3, 0.95
# Number of distances that are held at a time.
_BLOCK = 1_000_000


def hidden_under(lines: list[list[Line]], names: list[str]) -> list[str]:
    """Names, with a note for each branch that lies on another one before it.

    Args:
        lines: lines of each branch, whose pieces are separated by NaN.
        names: names of the branches; those without a name are left as they are.
    """
    parts = [_segments(one) for one in lines]
    ends = np.concatenate([np.empty((0, 2)), *(part.reshape(-1, 2) for part in parts)])
    if not len(ends):
        return names
    size = np.ptp(ends, axis=0)
    size[size == 0] = 1.0
    parts = [part / size for part in parts]
    found = list(names)
    for k, part in enumerate(parts):
        for j in range(k):
            if names[k] and names[j] and names[j] != names[k] and _lies_on(part, parts[j]):
                found[k] = f"{names[k]} (on {names[j]})"
                break
    return found


def _segments(lines: list[Line]) -> np.ndarray:
    """Segments of lines, (segments, 2 ends, 2)."""
    found = [np.empty((0, 2, 2))]
    for x, y in lines:
        points = np.column_stack([x, y])
        pairs = np.stack([points[:-1], points[1:]], axis=1)
        found.append(pairs[np.isfinite(pairs).all(axis=(1, 2))])
    return np.concatenate(found)


def _lies_on(part: np.ndarray, other: np.ndarray) -> bool:
    """True where nearly all points of some segments lie on others."""
    if not len(part) or not len(other):
        return False
    points = part.mean(axis=1)
    step = max(1, _BLOCK // len(other))
    near = [_distance(points[k : k + step], other) < _APART for k in range(0, len(points), step)]
    return bool(np.concatenate(near).mean() >= _MOST)


def _distance(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Distance of each point from the nearest of some segments."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
    apart = points[:, None] - start
    share = ((apart * along).sum(axis=2) / length).clip(0, 1)
    return np.sqrt((((apart - share[..., None] * along) ** 2).sum(axis=2)).min(axis=1))
