"""Fourier series of loads by wave forms, with a bound of what is cut off.

Between two knots such a load is a polynomial of the phase a. With the jumps J_jk of its j-th derivative at the knots a_k,
integration by parts gives its amplitudes exactly,

    F_h = (1 / pi) sum_j sum_k J_jk exp(-i h a_k) / (i h)^(j + 1),

so |F_h| <= (1 / pi) sum_j A_j / h^(j + 1), A_j = sum_k |J_jk|. At frequencies h W far above those of the machine the response
is about F_h / (h W)^2, and what harmonics above H add to it is less than a sum of powers of 1 / H.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._machine.machine import Machine
from .._machine.tables import Stream

# Fewest and most harmonics; between them the last one is this many times as fast as the fastest mode.
_FEWEST, _MOST, _ABOVE = 128, 256, 8


class TableWaves(NamedTuple):
    """Fourier series of the loads by wave forms of machines, lanes first.

    Attributes:
        waves: amplitudes F_h, f = Re sum_h F_h exp(i h a), h = 0, 1, ..., (lanes, 1 + harmonics, n).
        jumps: J, of the derivatives by phase at all knots, (lanes, orders, knots, n).
        size: sum of the magnitudes of the load at all knots, which sets the rounding errors, (lanes, n).
    """

    waves: np.ndarray
    jumps: np.ndarray
    size: np.ndarray


def enough_harmonics(machine: Machine, frequencies: np.ndarray) -> int:
    """Number of harmonics for modes of these frequencies, (lanes, n): that of the machine where no load is a table."""
    if machine.tables is None:
        return machine.waves.num_harmonics
    fastest = float(np.max(frequencies / lanes_first(machine.frequency)[:, None]))
    enough = int(np.clip(2.0 ** np.ceil(np.log2(_ABOVE * fastest)), _FEWEST, _MOST))
    return max(enough, machine.waves.num_harmonics)


def waves_of_tables(machine: Machine, count: int) -> TableWaves | None:
    """Series of the loads by wave forms up to a harmonic; None if there are none, lanes last in the machine."""
    if machine.tables is None:
        return None
    own = [_jumps(stream, lanes_first(machine.frequency)) for stream in machine.tables.streams]
    lanes = np.broadcast_shapes(*(one.jumps.shape[:1] for one in own))
    jumps = [np.broadcast_to(one.jumps, (*lanes, *one.jumps.shape[1:])) for one in own]
    waves, size = (
        sum(_amplitudes(one, count) for one in own),
        sum(abs(one.rows[:, 0]).sum(axis=1) for one in own),
    )
    return TableWaves(np.asarray(waves), np.concatenate(jumps, axis=2), np.asarray(size))


def lanes_first(a: ArrayLike) -> np.ndarray:
    """Convert to double precision, with lanes first as NumPy's linear algebra requires."""
    a = np.asarray(a)
    return np.moveaxis(a.astype(np.result_type(a, float)), -1, 0)


class _Jumps(NamedTuple):
    """Knots of a wave form, lanes first.

    Attributes:
        knots: phases, (lanes, knots).
        widths: to the next one, likewise.
        rows: derivatives by phase behind them, (lanes, orders, knots, n).
        jumps: how much these jump there.
    """

    knots: np.ndarray
    widths: np.ndarray
    rows: np.ndarray
    jumps: np.ndarray


def _jumps(stream: Stream, frequency: np.ndarray) -> _Jumps:
    count = int(np.max(stream.count))
    knots = lanes_first(stream.knots)[:, :count]
    rows = np.swapaxes(lanes_first(stream.rows)[:, :count], 1, 2)
    rows = rows / frequency[:, None, None, None] ** np.arange(rows.shape[1])[:, None, None]
    widths = np.diff(np.concatenate([knots, knots[:, :1] + 2 * np.pi], axis=1))
    ends = np.stack([_taylor(rows[:, k:], widths) for k in range(rows.shape[1])], axis=1)
    return _Jumps(knots, widths, rows, rows - np.roll(ends, 1, axis=2))


def _taylor(rows: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Polynomials of given derivatives, (lanes, orders, knots, n), at the end of their intervals."""
    total = 0 * rows[:, 0]
    for j in range(rows.shape[1] - 1, 0, -1):  # Horner's scheme
        total = (total + rows[:, j]) * (widths[..., None] / j)
    return total + rows[:, 0]


def _amplitudes(own: _Jumps, count: int) -> np.ndarray:
    orders = np.arange(1, count + 1)
    turns = np.exp(-1j * orders[:, None] * own.knots[:, None])
    powers = (1j * orders[:, None]) ** -np.arange(1.0, own.jumps.shape[1] + 1)
    varying = sum(turns @ own.jumps[:, j] * powers[:, j, None] for j in range(own.jumps.shape[1])) / np.pi
    # The integral of each polynomial is one of which it is the first derivative.
    whole = np.concatenate([0 * own.rows[:, :1], own.rows], axis=1)
    mean = _taylor(whole, own.widths).sum(axis=1, keepdims=True) / (2 * np.pi)
    return np.concatenate([mean, varying], axis=1)
