"""Points of one piece of an invariant manifold, with their preimages on the pieces before."""

from collections.abc import Callable, Sequence

import numpy as np

# Pieces that are remembered.
_MEMORY = 64
# Distance of preimages between which the curve is straight, and distance below which they are one, relative to the size of the motion.
_STRAIGHT, _ONE = 1e-6, 1e-12
# Passes in which points are left out, where neighbours are then closer than this share of the spacing.
_PASSES, _FULL = 6, 0.7


class CurvePoints:
    """Points of one piece in order.

    Attributes:
        past: states (W x, v) on the last pieces, that on this one last, (points, 2 n) each; NaN where there is none.
        after: the map from one piece to the next.
        size: size of the motion.
        is_cut: whether the curve is cut in an interval, (points - 1,).
        is_tested: whether the middle of an interval was computed, (points - 1,).
        is_first: whether a point is an image of those on the line that was given, (points,).
    """

    def __init__(self, past: list[np.ndarray], after: Callable[[np.ndarray], np.ndarray], size: float):
        count = len(past[-1])
        self.past, self.after, self.size = past, after, size
        self.is_cut, self.is_tested = np.zeros(count - 1, bool), np.zeros(count - 1, bool)
        self.is_first = np.ones(count, bool)

    @classmethod
    def of_line(
        cls, states: np.ndarray, after: Callable[[np.ndarray], np.ndarray], size: float
    ) -> "CurvePoints":
        """Points of the first piece."""
        return cls([states], after, size)

    @property
    def states(self) -> np.ndarray:
        """States on this piece."""
        return self.past[-1]

    def lengths(self) -> np.ndarray:
        """Distances of neighbours."""
        return np.linalg.norm(np.diff(self.states, axis=0), axis=1)

    def map(self) -> None:
        """Go on to the next piece."""
        before = self.lengths()
        self.past = [*self.past[1 - _MEMORY :], self.after(self.states)]
        # An interval that shrinks stays tested: towards an attractor, preimages that are close lie many pieces back.
        with np.errstate(invalid="ignore"):
            self.is_tested &= self.lengths() <= before

    def keep(self, which: np.ndarray) -> None:
        """Keep some of the points; an interval is cut if a part of it was, and tested if all parts were."""
        at = np.flatnonzero(which)
        cuts, untested = (np.diff(np.append(0, np.cumsum(a))[at]) for a in (self.is_cut, ~self.is_tested))
        self.past = [states[at] for states in self.past]
        self.is_cut, self.is_tested, self.is_first = cuts > 0, untested == 0, self.is_first[at]

    def cut_jumps(self, fine: float) -> None:
        """Cut intervals whose ends are apart, though their preimages are one, and those that begin or end where no state is."""
        if len(self.past) < 2:
            return
        length, before = self.lengths(), np.linalg.norm(np.diff(self.past[-2], axis=0), axis=1)
        with np.errstate(invalid="ignore"):
            self.is_cut |= (before <= _ONE * self.size) & ~(length <= fine)

    def divide(self, parts: np.ndarray) -> None:
        """Divide intervals into equal parts."""
        at = np.repeat(np.arange(len(parts)), parts - 1)
        number = np.concatenate([np.arange(1, k) for k in parts if k > 1])
        self._insert(at, self._between(at, number / parts[at]))

    def test_middles(self, which: np.ndarray, angle: float) -> bool:
        """Compute the middles of intervals once, and insert those that lie off the chord. True if there are any."""
        at = np.flatnonzero(which & ~self.is_tested)
        if not at.size:
            return False
        self.is_tested[at] = True
        past = self._between(at, np.full(len(at), 0.5))
        begin, end = self.states[at], self.states[at + 1]
        length = np.linalg.norm(end - begin, axis=1)
        chord = (end - begin) / length[:, None]
        along = ((past[-1] - begin) * chord).sum(axis=1)
        off = np.linalg.norm(past[-1] - begin - along[:, None] * chord, axis=1)
        is_off = ~((off < angle * length / 4) & (along > 0) & (along < length))
        self._insert(at[is_off], [states[is_off] for states in past])
        return bool(is_off.any())

    def _between(self, at: np.ndarray, share: np.ndarray) -> list[np.ndarray]:
        """States on the last pieces of points at a share of intervals, from the last one where these are short."""
        first = np.zeros(len(at), int)
        for k, states in enumerate(self.past[:-1]):
            distance = np.linalg.norm(states[at + 1] - states[at], axis=1)
            first[distance <= _STRAIGHT * self.size] = k
        past: list[np.ndarray] = []
        for k, states in enumerate(self.past):
            # Before that piece they are closer still, and need not be mapped.
            new = states[at] + share[:, None] * (states[at + 1] - states[at])
            if (is_later := first < k).any():
                new[is_later] = self.after(past[-1][is_later])
            past.append(new)
        return past

    def _insert(self, at: np.ndarray, past: Sequence[np.ndarray]) -> None:
        """Insert points into the intervals `at`, in order."""
        self.past = [np.insert(old, at + 1, new, axis=0) for old, new in zip(self.past, past, strict=True)]
        self.is_tested[at] = False
        self.is_tested, self.is_cut = (np.insert(a, at + 1, False) for a in (self.is_tested, self.is_cut))
        self.is_first = np.insert(self.is_first, at + 1, False)


def is_known(states: np.ndarray) -> np.ndarray:
    """True for states that exist, (points,)."""
    return np.asarray(np.isfinite(states).all(axis=1))


def needed(states: np.ndarray, is_cut: np.ndarray, spacing: float, angle: float) -> np.ndarray:
    """True for points without which neighbours would be too far apart, or turn too much; ends of pieces are among them."""
    is_kept = is_known(states)
    is_end = np.append(is_cut, True) | np.append(True, is_cut)
    for start in (1, 2) * _PASSES:
        at = np.flatnonzero(is_kept)
        chords = np.diff(states[at], axis=0)
        size = np.linalg.norm(chords, axis=1)
        is_straight = (chords[1:] * chords[:-1]).sum(axis=1) >= np.cos(angle / 2) * size[1:] * size[:-1]
        is_straight = np.concatenate([[True], is_straight, [True]])
        inner = np.arange(start, len(at) - 1, 2)
        across = np.linalg.norm(states[at[inner + 1]] - states[at[inner - 1]], axis=1)
        is_spare = is_straight[inner - 1] & is_straight[inner] & is_straight[inner + 1]
        is_spare &= ~is_end[at[inner]] & (across < _FULL * spacing)
        is_kept[at[inner[is_spare]]] = False
    return is_kept | is_end
