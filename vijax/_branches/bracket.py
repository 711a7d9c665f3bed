"""Zeros of functions that are evaluated elsewhere, one trial at a time."""

from typing import NamedTuple

import numpy as np

# Relative to the step, and in trials.
_TOLERANCE, _MOST = 4e-15, 60


class Bracket(NamedTuple):
    """Where a function changes its sign, by Chandrupatla's method.

    Attributes:
        ends: the last trial, and the other end, one on each side of the zero.
        values: of the function there.
        share: where between the ends to try next.
        span: length of the first bracket.
        trials: so far.
    """

    ends: tuple[float, float]
    values: tuple[float, float]
    share: float
    span: float
    trials: int

    @classmethod
    def between(cls, before: float, after: float, span: float) -> "Bracket":
        """From the values at 0 and at `span`."""
        share = after / (after - before) if np.isfinite(after - before) else 0.5
        return cls((span, 0.0), (after, before), share, span, 0)

    def narrowed(self, s: float, value: float) -> "Bracket":
        """With one more value.

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
    """Where to evaluate the function next; None if the zero is known."""
    a, b = bracket.ends
    room = _TOLERANCE * bracket.span / max(abs(b - a), 1e-300)
    if room > 0.5 or bracket.trials >= _MOST or (bracket.trials and bracket.values[0] == 0):
        return None
    return a + min(max(bracket.share, room), 1 - room) * (b - a)
