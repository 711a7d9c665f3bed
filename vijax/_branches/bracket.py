"""Root bracketing for a function that the caller evaluates, one trial at a time."""

from typing import NamedTuple

import numpy as np

# `_TOLERANCE`: of the zero, relative to the first bracket.
# `_MOST`: largest number of trials.
_TOLERANCE, _MOST = 4e-15, 60


class Bracket(NamedTuple):
    """Bracket of a sign change, by Chandrupatla's method.

    Attributes:
        ends: the last trial and the opposite end, one on each side of the zero.
        values: of the function at the ends.
        share: fraction of the way from the last trial to the opposite end for the next trial.
        span: length of the first bracket.
        trials: number of trials so far.
    """

    ends: tuple[float, float]
    values: tuple[float, float]
    share: float
    span: float
    trials: int

    @classmethod
    def between(cls, before: float, after: float, span: float) -> "Bracket":
        """Bracket from the values at 0 and at `span`."""
        share = after / (after - before) if np.isfinite(after - before) else 0.5
        return cls((span, 0.0), (after, before), share, span, 0)

    def narrowed(self, s: float, value: float) -> "Bracket":
        """Bracket with one more value.

        References:
            T. R. Chandrupatla, Adv. Eng. Softw. 28 (1997); T. Scherer, Computational Physics (2010), Sec. 6.1.7.3.
        """
        (a, b), (fa, fb) = self.ends, self.values
        if (value > 0) == (fa > 0):
            c, fc = a, fa
        else:
            (b, fb), (c, fc) = (a, fa), (b, fb)
        a, fa = s, value
        share = 0.5
        if np.all(np.isfinite([fa, fb, fc])) and fb != fc and c != b:
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            if phi * phi < xi and (1 - phi) ** 2 < 1 - xi:
                share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        return Bracket((a, b), (fa, fb), share, self.span, self.trials + 1)


def next_trial(bracket: Bracket) -> float | None:
    """Argument of the next trial; None once the zero is found or the trials are used up."""
    a, b = bracket.ends
    room = _TOLERANCE * bracket.span / max(abs(b - a), 1e-300)
    if room > 0.5 or bracket.trials >= _MOST or (bracket.trials and bracket.values[0] == 0):
        return None
    return a + min(max(bracket.share, room), 1 - room) * (b - a)
