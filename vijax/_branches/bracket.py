"""Zeros of functions that the caller evaluates, one trial at a time, within brackets."""

from typing import NamedTuple

import numpy as np

from .tolerances import BRACKET, BRACKET_ROUNDING, FLAT_CHANGE, FLAT_VALUE, QUADRATIC

# Largest number of trials.
_MOST = 60
# `_SMOOTH`: trials after which a bracket of a smooth function has shrunk by half in each.
# `_ON_CUBIC`: Newton steps on a cubic.
_SMOOTH, _ON_CUBIC = 3, 6


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
    room = max(BRACKET * bracket.span, BRACKET_ROUNDING) / max(abs(b - a), 1e-300)
    if room > 0.5 or bracket.trials >= _MOST or (bracket.trials and bracket.values[0] == 0):
        return None
    return a + min(max(bracket.share, room), 1 - room) * (b - a)


class SlopedBracket(NamedTuple):
    """Bracket of a sign change of a function with known slopes.

    Attributes:
        ends: the two ends, each as argument, value and slope; at the first the value is positive.
        next: the next trial; None once the zero is found or the trials are used up.
        trials: number of trials so far.
        is_flat: True if the function is zero over a whole interval, as where the minimum of a gap becomes an impact:
            no slope tells where that interval begins.
    """

    ends: tuple[tuple[float, float, float], tuple[float, float, float]]
    next: float | None
    trials: int
    is_flat: bool = False

    @classmethod
    def between(
        cls, before: tuple[float, float, float], after: tuple[float, float, float]
    ) -> "SlopedBracket":
        """Bracket from two ends with values of opposite sign; the first one is positive."""
        return cls((before, after), _on_cubic(before, after), 0)

    def narrowed(self, value: float, slope: float) -> "SlopedBracket":
        """Bracket with the value and the slope at its next trial: by Newton's method from there, if that stays inside."""
        s, trials = float(self.next or 0), self.trials + 1
        here, (low, high) = (s, value, slope), self.ends
        if abs(value) < FLAT_VALUE * low[1] and abs(slope * (s - low[0])) < FLAT_CHANGE * low[1]:
            return self._replace(next=None, is_flat=True)
        low, high = (here, high) if value > 0 else (low, here)
        newton = s - value / slope if slope else np.nan
        length, before = abs(high[0] - low[0]), abs(self.ends[1][0] - self.ends[0][0])
        is_inside = min(low[0], high[0]) <= newton <= max(low[0], high[0])
        step = abs(newton - s) if np.isfinite(newton) else np.inf
        if value == 0 or length <= BRACKET_ROUNDING or step <= BRACKET_ROUNDING or trials >= _MOST:
            return SlopedBracket((low, high), None, trials)
        if step < QUADRATIC and is_inside:
            return SlopedBracket((low, high), newton, _MOST - 1)
        middle = (low[0] + high[0]) / 2
        trial = _on_cubic(low, high)
        # A bracket that hardly shrinks, as where the function is no smooth one, is halved.
        is_slow = trials > _SMOOTH and length > before / 2
        return SlopedBracket((low, high), middle if is_slow else trial, trials)


def _on_cubic(low: tuple[float, float, float], high: tuple[float, float, float]) -> float:
    """Zero of the cubic with the values and slopes of two ends, by its inverse, within them; else of the chord."""
    (a, fa, ga), (b, fb, gb) = low, high
    chord = a + (b - a) * fa / (fa - fb) if np.isfinite(fa - fb) and fa != fb else (a + b) / 2
    h = b - a
    if not np.all(np.isfinite([fa, fb, ga, gb])):
        return float(chord)
    c, d = 3 * (fb - fa) - h * (2 * ga + gb), 2 * (fa - fb) + h * (ga + gb)
    x = (chord - a) / h
    for _ in range(_ON_CUBIC):
        f, g = fa + x * (h * ga + x * (c + x * d)), h * ga + x * (2 * c + 3 * x * d)
        new = x - f / g if g else np.nan
        if not 0 <= new <= 1:
            return float(chord)
        x = new
    return float(a + h * x)
