"""Values of loads at instants, and the harmonics that they have, by NumPy; the engine has loads as numbers of machines."""

from typing import Any

import numpy as np

from .forcing import Harmonic
from .tabulated import Tabulated, Waveform

# Samples of a wave form, whose Fourier series tells its harmonics; share of the largest below which there is none.
_SAMPLES, _NOTHING = 512, 1e-9


def load_at(load: Any, at: np.ndarray, frequency: float) -> np.ndarray:
    """Load at some instants, (instants, n), in periods of `frequency`; that of a load of another frequency too."""
    turns_of_period = 1.0
    if load.frequency is not None and frequency > 0 and not isinstance(load, Tabulated):
        turns_of_period = float(load.frequency) / frequency
    if isinstance(load, Harmonic):
        waves = load.waves()
        values = np.asarray(load.mean) + np.zeros((len(at), 1))
        for h, (cosine, sine) in enumerate(zip(waves.cosine, waves.sine, strict=True), start=1):
            turns = 2 * np.pi * h * at[:, None] * (turns_of_period if _is_turning(load) else 0)
            values = values + np.cos(turns) * np.asarray(cosine) + np.sin(turns) * np.asarray(sine)
        return values
    if isinstance(load, Waveform):
        knots, where = np.asarray(load.phases), 2 * np.pi * (at * turns_of_period % 1)
        where = np.where(where < knots[0], where + 2 * np.pi, where)
    else:
        knots, where = np.asarray(load.times), at * (2 * np.pi / frequency if frequency > 0 else 1.0)
    interval = np.searchsorted(knots, where, side="right") - 1
    rows = np.asarray(load.derivatives())
    is_within = (interval >= 0) & (interval < len(rows))
    interval = np.clip(interval, 0, len(rows) - 1)
    step, factor, values = (where - knots[interval])[:, None], 1.0, 0.0
    for order in range(rows.shape[1]):
        values = values + factor * rows[interval, order]
        factor = factor * step / (order + 1)
    return np.where(is_within[:, None], values, 0.0)


def _is_turning(load: Any) -> bool:
    """False for harmonics of frequency 0, which are constant; those of a sum have no frequency of their own."""
    return load.frequency is None or float(load.frequency) > 0


def harmonics_of(load: Any) -> list[int]:
    """Numbers of the harmonics that a load has; [1] if it does not repeat."""
    if isinstance(load, Tabulated):
        return [1]
    if isinstance(load, Harmonic):
        waves = load.waves()
        size = np.hypot(np.asarray(waves.cosine), np.asarray(waves.sine)).max(axis=1)
        return [h for h, a in enumerate(size, start=1) if a > 0] if _is_turning(load) else []
    samples = load_at(load, (np.arange(_SAMPLES) + 0.5) / _SAMPLES, 0.0)
    size = np.abs(np.fft.rfft(samples, axis=0)).max(axis=1)
    if len(np.asarray(load.phases)) * 2 > _SAMPLES:
        return [1]
    return [h for h in range(1, _SAMPLES // 2) if size[h] > _NOTHING * size.max()]
