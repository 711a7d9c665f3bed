"""Fourier series of a load, of the motion of a stop, of the response to them.

All series of a machine share its frequency W, and are evaluated at the same phase: cosine and sine of h W t for every
harmonic h = 1, 2, ..., which are computed once and then rotated. Under a load of several frequencies the harmonics of each
follow those of the one before, see `Tones`. A series is linear in the phase. So one sum
suffices: at a phase it is the value, at `phase_rate` the derivative, at the change of the phase in a step the change
of the value, to full relative accuracy however short the step.

Axes: (harmonics, rows) of a series, (2, harmonics) of a phase; lanes, if any, last.
"""

import equinox as eqx
import numpy as np

from .._jax.arrays import Reals, add_up, append_axes, array_namespace, stack


class Tones(eqx.Module):
    """Angular frequencies of the rows of a series that has harmonics of several frequencies.

    It stands where one frequency W of all rows may stand.

    Attributes:
        frequencies: the fundamental frequencies, (tones, ...), lanes last.
        counts: number of harmonics of each.
    """

    frequencies: Reals
    counts: tuple[int, ...] = eqx.field(static=True)

    @property
    def orders(self) -> np.ndarray:
        """Order h of every row, (harmonics,)."""
        return np.concatenate([np.arange(1, count + 1) for count in self.counts])

    @property
    def speeds(self) -> Reals:
        """Angular frequencies h W of all rows, (harmonics, ...)."""
        return self.of_rows(self.frequencies)

    def of_rows(self, of_tones: Reals) -> Reals:
        """Multiples by the order of each row, (harmonics, ...), from one number for each tone."""
        orders = self.orders.reshape(-1, *[1] * (np.ndim(of_tones) - 1))
        return orders * of_tones[np.repeat(np.arange(len(self.counts)), self.counts)]


class Waves(eqx.Module):
    """A Fourier series without its mean: sum_h (cosine_h cos(h W t) + sine_h sin(h W t)).

    Attributes:
        cosine: (harmonics, rows), one row for every mass or stop.
        sine: likewise.
    """

    cosine: Reals
    sine: Reals

    @property
    def num_harmonics(self) -> int:
        """Number of harmonics."""
        return len(self.cosine)

    def speeds(self, frequency: Reals | Tones) -> Reals:
        """Angular frequencies of all harmonics, (harmonics, 1)."""
        if isinstance(frequency, Tones):
            return frequency.speeds[:, None]
        return _orders(self.num_harmonics, self.cosine) * frequency

    def at(self, phase: Reals) -> Reals:
        """Sum at a phase, (rows,); columns of the phase behind those of the harmonics are of loads by tables."""
        if phase.shape[1] > self.num_harmonics:
            phase = phase[:, : self.num_harmonics]
        return add_up(self.cosine * phase[0][:, None] + self.sine * phase[1][:, None])

    def at_angle(self, angle: Reals) -> Reals:
        """Sum at an angle W t."""
        return self.at(self._phase_at(angle))

    def slope_at_angle(self, angle: Reals) -> Reals:
        """Derivative of the sum by the angle; the time derivative is W times that."""
        return self.at(phase_rate(self._phase_at(angle), 1))

    def bound(self, order: int = 0) -> Reals:
        """Bound of the sum, or of its derivative of some order by the angle, over all phases."""
        size = abs(self.cosine) + abs(self.sine)
        return add_up(size * _orders(self.num_harmonics, size) ** order)

    def rate_bound(self, order: int, frequency: Reals | Tones) -> Reals:
        """Bound of a time derivative of the sum, of some order."""
        if not isinstance(frequency, Tones):
            return frequency**order * self.bound(order)
        return add_up((abs(self.cosine) + abs(self.sine)) * self.speeds(frequency) ** order)

    def rounded(self, angle: Reals, order: int = 0) -> Reals:
        """Bound that sets the rounding error at an angle, which is itself rounded."""
        return self.bound(order) + abs(angle) * self.bound(order + 1)

    def padded(self, num_harmonics: int) -> "Waves":
        """Series with harmonics of zero amplitude appended."""
        missing = np.zeros((num_harmonics - self.num_harmonics, *self.cosine.shape[1:]), self.cosine.dtype)
        joined = lambda a: array_namespace(a).concatenate([a, missing])  # noqa: E731
        return Waves(joined(self.cosine), joined(self.sine))

    def _phase_at(self, angle: Reals) -> Reals:
        return append_axes(phase_at(angle, self.num_harmonics), self.cosine)


def phase_at(angle: Reals, num_harmonics: int) -> Reals:
    """Phase at an angle W t of any shape: (2, harmonics) and then that shape."""
    return phase_of(_orders(num_harmonics, angle, axes=1) * angle)


def phase_of(angles: Reals) -> Reals:
    """Phase at the angles of all harmonics, (harmonics, ...)."""
    library = array_namespace(angles)
    return library.stack([library.cos(angles), library.sin(angles)])


def phase_rate(phase: Reals, frequency: Reals | Tones) -> Reals:
    """Time derivative of a phase, at which a series gives its own; derivative by the angle if `frequency` is 1."""
    if np.ndim(phase) == 2 and not isinstance(
        frequency, Tones
    ):  # fewer operations; a kernel of many lanes is slower by it
        orders = _orders(len(phase[0]), phase[0])
        return np.stack([-orders, orders]) * frequency * phase[::-1]
    speed = speeds(phase, frequency)
    return stack([-speed * phase[1], speed * phase[0]])


def turned(phase: Reals, by: Reals) -> Reals:
    """Phase rotated by another; its change alone, if 1 is subtracted from the cosines of the other."""
    (cos, sin), (turn, slide) = phase, by
    return stack([turn * cos - slide * sin, turn * sin + slide * cos])


def speeds(phase: Reals, frequency: Reals | Tones) -> Reals:
    """Angular frequencies h W of all harmonics, shaped to multiply cosines or sines of a phase."""
    if isinstance(frequency, Tones):
        return frequency.speeds
    return _orders(len(phase[0]), phase[0]) * frequency


def _orders(num_harmonics: int, like: Reals, axes: int = 0) -> np.ndarray:
    """1, 2, ... followed by axes of length one; in all `axes` more than `like` has."""
    return np.arange(1, num_harmonics + 1).reshape(-1, *[1] * (np.ndim(like) + axes - 1))
