"""Fourier coefficients and power spectra of motions with impacts.

Positions have kinks at impacts, and velocities jumps. Sampled at equal times, as for an FFT, they are aliased however
fine the samples are. Here the integrals are taken between events and knots of wave forms, where the motion is smooth, by
Gauss quadrature at times at which it is exact, so that only rounding errors remain.
"""

import numpy as np
import xarray as xr

from .._jax.arrays import Count, Numbers, as_numpy_float, whole_number
from .._trajectory.solution import Solution
from .record import forcing_periods

# `_NODES`: nodes of the Gauss rule.
# `_TURN`: largest change of phase between its ends for which it is exact to rounding.
_NODES, _TURN = 16, 10.0
# Entries of the table of phases in memory at once.
_ROOM = 1 << 22
# Default highest frequency, as a multiple of that of the load.
_HARMONICS = 10
_WINDOWS = {"hann": lambda share: 1 - np.cos(2 * np.pi * share), "none": np.ones_like}


def power_spectrum(
    sol: Solution, frequencies: Numbers | None = None, *, last: Count | None = None, window: str = "hann"
) -> xr.Dataset:
    """Compute Fourier coefficients of a motion, exact to rounding through all its events and knots of wave forms.

    Corners of a `force`, as of a choice or a table in it, are not known: there the error may be 1e-8 of the motion.

    The coefficient of a function y at an angular frequency w is the mean of y(t) exp(-i w t), weighted by the window,
    over the last forcing periods. For a motion that repeats in them, without a window, the coefficients at the
    multiples of W / last are those of its Fourier series. A chaotic motion has a continuous spectrum, of which one
    window shows an uneven sample.

    Args:
        sol: the motion, whose events must all be logged.
        frequencies: angular frequencies, (frequencies,); all multiples of W / last up to ten times the frequency W of
            the load, if left out.
        last: whole forcing periods at the end of the motion; all there are, if left out.
        window: "hann", which lets lines between the multiples leak little, or "none".

    Returns:
        Along `frequency` and `mass`: the complex coefficients `x` and `v` of positions and velocities, and `power`,
        the squared magnitude of `x`.

    Raises:
        ValueError: if there is not one whole period, no such window, a load without a frequency, or the log was cut.

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_b(2.05)
        sol = vx.simulate(system, 0.0, 200 * system.forcing.period)
        spectrum = vx.power_spectrum(sol, last=100)
        ```
    """
    (period,) = forcing_periods(sol)
    t0, t1 = float(sol.t0), float(sol.t1)
    whole = int(np.floor((t1 - t0) / period * (1 + 1e-12)))
    num = whole if last is None else whole_number("last", last, 1)
    if not 1 <= num <= whole:
        raise ValueError(
            f"Of the {whole} whole forcing periods of the motion {num} are requested: simulate a longer motion."
        )
    if window not in _WINDOWS:
        raise ValueError(f"Argument `window` must be {' or '.join(map(repr, _WINDOWS))}, but is {window!r}.")
    if float(sol.known_until) < t1:
        raise ValueError("The log of the motion was cut: simulate it with larger `max_events`.")
    multiples = 2 * np.pi / (num * period) * np.arange(_HARMONICS * num + 1)
    w = multiples if frequencies is None else as_numpy_float(frequencies)
    if w.ndim != 1 or not w.size:
        raise ValueError(f"Argument `frequencies` must have shape (frequencies,), but has shape {w.shape}.")
    begin = max(t1 - num * period, t0)
    t, weight = _nodes(sol, begin, t1, max(float(np.abs(w).max()), float(sol.machine.rate)))
    weight = weight * _WINDOWS[window]((t - begin) / (t1 - begin))
    x, v = (_coefficients(w, t, weight / weight.sum(), np.asarray(a)) for a in sol.evaluate(t))
    dims = ("frequency", "mass")
    variables = {"x": (dims, x), "v": (dims, v), "power": (dims, np.abs(x) ** 2)}
    ds = xr.Dataset(variables, coords={"frequency": w})
    ds["frequency"].attrs = {"long_name": "angular frequency"}
    ds["x"].attrs = {"long_name": "Fourier coefficient of the position"}
    ds["v"].attrs = {"long_name": "Fourier coefficient of the velocity"}
    ds["power"].attrs = {"long_name": "squared magnitude of the Fourier coefficient of the position"}
    ds.attrs = {"forcing_frequency": 2 * np.pi / period, "num_periods": num, "window": window}
    return ds


def _nodes(sol: Solution, begin: float, end: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Quadrature nodes inside the smooth pieces of a motion, and their weights."""
    corners = np.concatenate([np.asarray(sol.restarts.t), _knots(sol, begin, end)])
    edges = np.unique(np.concatenate([[begin], corners[(corners > begin) & (corners < end)], [end]]))
    parts = np.maximum(np.ceil(np.diff(edges) * rate / _TURN), 1).astype(int)
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    length = np.repeat(np.diff(edges) / parts, parts)
    first = np.repeat(edges[:-1], parts) + number * length
    place, weight = np.polynomial.legendre.leggauss(_NODES)
    t = first[:, None] + length[:, None] * (1 + place) / 2
    return t.ravel(), (length[:, None] * weight / 2).ravel()


def _knots(sol: Solution, begin: float, end: float) -> np.ndarray:
    """Times at which wave forms change from one polynomial to the next."""
    tables, found = sol.machine.tables, [np.zeros(0)]
    for stream in () if tables is None else tables.streams:
        assert stream.frequency is not None  # the load repeats
        phases = np.asarray(stream.knots)[: int(stream.count)]
        turn = 2 * np.pi / float(stream.frequency)
        turns = np.arange(np.floor(begin / turn), np.ceil(end / turn))
        found.append((turn * (turns[:, None] + phases / (2 * np.pi))).ravel())
    return np.concatenate(found)


def _coefficients(w: np.ndarray, t: np.ndarray, weight: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Weighted sums of y exp(-i w t), (frequencies, n)."""
    rows = max(_ROOM // len(t), 1)
    parts = [
        np.exp(-1j * np.outer(w[k : k + rows], t)) @ (weight[:, None] * y) for k in range(0, len(w), rows)
    ]
    return np.concatenate(parts)
