"""Random loads: records of a stationary Gaussian process with a given spectrum.

The spectrum is cut into cells as wide as the resolution of a record twice as long as the one asked for. Each is a cosine and a
sine with independent normal amplitudes, whose variance is the integral of the spectrum over the cell. So the load is
Gaussian, its variance is that of the spectrum whatever the cells are, and it does not repeat within the record. (Cosines
of fixed amplitudes and random phases were rejected: they are Gaussian only as their number grows, which a narrow spectrum
does not let it.) Knots lie close enough that the cubic spline through them is the sum of the harmonics.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.fft
from scipy.interpolate import PPoly

from .._jax.arrays import Numbers, as_numpy_float, real_number
from .._system.tabulated import Tabulated
from .random_numbers import Rng, generator_of

# For type checkers. At run time `random_load` refuses anything else, with a clear message.
if TYPE_CHECKING:
    Spectrum = Callable[[np.ndarray], Numbers] | Sequence[Numbers]
else:
    Spectrum = object

# Knots in the shortest period: a cubic spline misses its amplitude by (2 pi / 12)^4 / 384, 0.02 %.
_KNOTS = 12
# Most knots of a record.
_MOST = 2_000_000
# Share of the variance of a function that may lie beyond the highest frequency, if that is not given.
_LEFT_OUT = 1e-3
# Octaves in which a function is integrated, below and above the lowest frequency of the record, and nodes in each.
_OCTAVES, _NODES_OF_OCTAVE = (-10, 50), 200
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


def random_load(
    spectrum: Spectrum,
    duration: Numbers,
    rng: Rng | None = None,
    *,
    direction: Numbers = (1.0,),
    max_frequency: Numbers | None = None,
) -> Tabulated:
    """Draw a record of a stationary Gaussian random load with a given spectrum.

    The load has zero mean and the two-sided spectral density `S(w)` over angular frequencies: its variance is the integral of
    S from minus to plus infinity, twice that over the positive frequencies. Of a one-sided density take a half; of one in
    Hz, `G(f)`, take `G(w / 2 pi) / (4 pi)`. White noise has a constant S up to a `max_frequency` far above the machine.

    Records of the same spectrum and duration have the same times. So many of them are a sweep:
    `vx.sweep(system, {"forcing.values": [load.values for load in loads]}, duration=duration)`.

    Args:
        spectrum: S, a function of an array of angular frequencies, not negative, that returns as many densities; or a pair of
            rising frequencies and densities, (frequencies,) each, linear between them and zero outside.
        duration: length of the record, which begins at time 0.
        rng: as for `vx.ensemble`: a whole number or a generator of NumPy, from which each record takes its own numbers.
        direction: force on every mass for a load of 1, (n,); one mass if left out. An acceleration of the base has the
            default, and goes through `vx.base_excitation`. Independent loads on several masses are a sum of records.
        max_frequency: angular frequency beyond which S is cut off; the last one of a pair, and for a function the frequency
            beyond which a thousandth of the variance lies, if left out.

    Returns:
        The load, a cubic spline with 12 knots in the period of the highest frequency. It follows the harmonics within 0.02 %
        of their amplitudes there, and far more closely below.

    Raises:
        ValueError: for a spectrum that is negative, not finite, or of infinite variance without `max_frequency`; or a record
            of more than two million knots.

    Example:
        ```python
        import numpy as np, vijax as vx
        rng = np.random.default_rng(1)
        noise = vx.random_load(lambda w: 0.01 / (1 + w**4), 200.0, rng)
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], noise, [vx.Stop(0, 0.5, "upper", 0.7)])
        sol = vx.simulate(system, 0.0, 200.0)
        ```

    References:
        M. Shinozuka & C.-M. Jan, J. Sound Vib. 25 (1972) 111; M. Shinozuka & G. Deodatis, Appl. Mech. Rev. 44 (1991) 191.
    """
    length, shares = real_number("duration", duration), as_numpy_float(direction)
    if not 0 < length < np.inf:
        raise ValueError(f"Argument `duration` must be positive, but is {length:g}.")
    if shares.ndim != 1 or not shares.size or not np.isfinite(shares).all():
        raise ValueError(f"Argument `direction` must have shape (n,), finite, but is {shares.tolist()}.")
    given = None if max_frequency is None else real_number("max_frequency", max_frequency)
    if given is not None and not 0 < given < np.inf:
        raise ValueError(f"Argument `max_frequency` must be positive, but is {given:g}.")
    if callable(spectrum):
        highest = given or _highest(spectrum, 2 * np.pi / length)
        of_cells = lambda edges: _integrals(spectrum, edges)  # noqa: E731
    else:
        frequencies, densities = _table(spectrum)
        highest = min(given or np.inf, frequencies[-1])
        of_cells = lambda edges: np.diff(_cumulative(frequencies, densities, edges))  # noqa: E731
    count = int(max(np.ceil(min(length * highest * _KNOTS / (2 * np.pi), 2.0 * _MOST)), _KNOTS))
    if count > _MOST:
        raise ValueError(
            f"A record of length {length:g} with frequencies up to {highest:g} has more than {_MOST} knots: give a lower "
            "`max_frequency`, or a shorter `duration`."
        )
    size: Any = scipy.fft.next_fast_len(2 * count, real=True)
    width = 2 * np.pi * count / (length * size)
    middles = width * np.arange(int(np.ceil(highest / width + 0.5)))
    edges = np.minimum(np.append(np.maximum(middles - width / 2, 0), middles[-1] + width / 2), highest)
    deviations = np.sqrt(2 * of_cells(edges))
    normal = generator_of(rng, None).normal(size=(2, len(middles)))
    waves = deviations * (normal[0] - 1j * normal[1])
    waves[0] = 2 * waves[0].real  # the mean of the record, which `irfft` counts once
    values = np.fft.irfft(waves * (size / 2), size)[: count + 1]
    return Tabulated(np.linspace(0.0, length, count + 1), np.outer(values, shares), "cubic")


def _table(spectrum: Spectrum) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and densities of a pair, checked."""
    if not isinstance(spectrum, Sequence | np.ndarray) or len(spectrum) != 2:
        raise ValueError(
            "Argument `spectrum` must be a function of angular frequencies, or a pair of frequencies and densities, but is "
            f"{spectrum!r}."
        )
    frequencies, densities = (as_numpy_float(a) for a in spectrum)
    is_alike = frequencies.ndim == 1 and len(frequencies) > 1 and frequencies.shape == densities.shape
    if not is_alike or not (frequencies[0] >= 0 and np.all(np.diff(frequencies) > 0)):
        raise ValueError(
            "The pair of `spectrum` must have two or more rising frequencies, none negative, and as many densities, but has "
            f"the shapes {frequencies.shape} and {densities.shape}."
        )
    if not (np.isfinite(frequencies[-1]) and _is_density(densities)):
        raise ValueError(
            "The pair of `spectrum` must have finite frequencies, and finite densities, none negative."
        )
    return frequencies, densities


def _is_density(values: np.ndarray) -> bool:
    return bool(np.isfinite(values).all() and (values >= 0).all())


def _densities(spectrum: Callable, w: np.ndarray) -> np.ndarray:
    """Densities at some frequencies, (...,).

    Raises:
        ValueError: if they are none.
    """
    values = as_numpy_float(spectrum(w))
    if values.shape not in ((), w.shape) or not _is_density(values):
        raise ValueError(
            "Argument `spectrum` must be a function of an array of angular frequencies that returns as many densities, finite, none "
            f"negative, but for shape {w.shape} it returns shape {values.shape}, from {values.min():g} to {values.max():g}."
        )
    return np.broadcast_to(values, w.shape)


def _integrals(spectrum: Callable, edges: np.ndarray) -> np.ndarray:
    """Integrals of a function over the cells between some edges, (edges - 1,)."""
    half = np.diff(edges) / 2
    w = (edges[:-1] + half)[:, None] + half[:, None] * _NODES
    return (_densities(spectrum, w.ravel()).reshape(w.shape) @ _WEIGHTS) * half


def _cumulative(frequencies: np.ndarray, densities: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Integrals of a pair from its first frequency to others, (others,)."""
    lines = PPoly(np.array([np.diff(densities) / np.diff(frequencies), densities[:-1]]), frequencies)
    return lines.antiderivative()(np.clip(w, frequencies[0], frequencies[-1]))


def _highest(spectrum: Callable, lowest: float) -> float:
    """Frequency beyond which little of the variance of a function lies.

    Raises:
        ValueError: if there is none.
    """
    ends = lowest * 2.0 ** np.arange(_OCTAVES[0], _OCTAVES[1] + 1)
    edges = np.unique(np.concatenate([np.linspace(a, 2 * a, _NODES_OF_OCTAVE) for a in ends[:-1]]))
    behind = np.cumsum(_integrals(spectrum, edges)[::-1])[::-1]
    if not behind[0] > 0:
        raise ValueError("Argument `spectrum` is zero at all frequencies.")
    # A spectrum that falls as 1 / w^2 or faster has next to nothing in the last octaves.
    if behind[np.searchsorted(edges[:-1], ends[-1] / 2**10)] > _LEFT_OUT * behind[0]:
        raise ValueError(
            "Argument `spectrum` has no finite variance: give `max_frequency`, beyond which it is cut off."
        )
    return float(edges[np.argmax(behind <= _LEFT_OUT * behind[0])])
