"""First passages, level crossings and peaks of motions in time, over a sweep or an ensemble."""

from typing import Any

import numpy as np
import xarray as xr

from .._dataset_attributes import with_words
from .._dataset_checks import check_columns, check_is_dataset
from .._jax.arrays import Count, Numbers, as_numpy_float, real_number, whole_number
from .record import dims_of

# Halvings by which the time of a first passage is found within a step.
_HALVINGS = 50


def level_crossings(ds: xr.Dataset, levels: Numbers, mass: Count = 0, *, after: Numbers = 0.0) -> xr.Dataset:
    """Compute first passages, rates of upward crossings, and peaks of motions in time, with their errors over the samples.

    Between two saved times the position is the cubic through the positions and velocities at both. That is exact to fourth order in
    the time between them: save about twenty times in the period of the fastest motion. An impact between them is met to
    first order. First passages of a level that is a stop are exact instead: they are its first impacts, `ds.impact_time`.

    Args:
        ds: result of `vx.sweep` or `vx.ensemble` with `duration` and `ts`. All its points are samples of one random motion.
        levels: positions, (levels,).
        mass: number of the mass.
        after: time from which on the motion is counted, as once it is stationary.

    Returns:
        A dataset along `level`: `crossing_rate`, upward crossings per unit of time; `passage_share`, the fraction of samples
        that pass the level, or are beyond it at `after`; of each sample `first_passage`, the time at which it does, NaN if it
        does not, and `peak`, its largest position; `peak_mean` and `peak_std`. Each mean over the samples has a standard
        error, as `crossing_rate_error`.

    Raises:
        ValueError: for a dataset without saved states, fewer than two samples, or fewer than two times from `after` on.

    Example:
        ```python
        import numpy as np, vijax as vx
        rng = np.random.default_rng(1)
        loads = [vx.random_load(lambda w: 0.01 / (1 + w**4), 100.0, rng) for _ in range(50)]
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], loads[0], [])
        records = {"forcing.values": [load.values for load in loads]}
        ds = vx.sweep(system, records, duration=100.0, ts=np.linspace(0.0, 100.0, 400))
        print(vx.level_crossings(ds, [0.2, 0.4]).passage_share)
        ```

    References:
        S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46; D. E. Newland, An Introduction to Random Vibrations, Spectral & Wavelet Analysis
        (1993), Ch. 8.
    """
    check_is_dataset(ds, "ds", "`vx.sweep`")
    if "xs" not in ds or "vs" not in ds or "time" not in ds:
        raise ValueError(
            "Argument `ds` has no saved states: give `vx.sweep` or `vx.ensemble` a `duration` and `ts`."
        )
    check_columns(ds, "`vx.sweep`", {"result": (), **dict.fromkeys(("xs", "vs"), ("time", "mass"))})
    wanted, number, first = as_numpy_float(levels), whole_number("mass", mass), real_number("after", after)
    if wanted.ndim != 1 or not wanted.size or not np.isfinite(wanted).all():
        raise ValueError(f"Argument `levels` must have shape (levels,), finite, but is {wanted.tolist()}.")
    if number >= ds.sizes["mass"]:
        raise ValueError(f"Argument `mass` is {number}, but there are {ds.sizes['mass']} masses.")
    grid, t = dims_of(ds), ds["time"].values
    is_counted = t >= first
    if np.count_nonzero(is_counted) < 2:
        raise ValueError(
            f"Fewer than two of the saved times are {first:g} or later: give `vx.sweep` more `ts`."
        )
    x, v = (
        ds[name].isel(mass=number).transpose(*grid, "time").values[..., is_counted] for name in ("xs", "vs")
    )
    shape, t = x.shape[:-1], t[is_counted]
    samples = int(np.prod(shape))
    if samples < 2:
        raise ValueError("A single sample has no error: sweep two records or more.")
    steps = _Steps(t, x.reshape(samples, -1), v.reshape(samples, -1))
    passages, counts = (np.stack(a, axis=-1) for a in zip(*map(steps.passages, wanted), strict=True))
    peaks, span = steps.peaks(), t[-1] - t[0]
    share = np.isfinite(passages).mean(axis=0)
    of_samples = lambda a: a.reshape(*shape, *a.shape[1:])  # noqa: E731
    columns = {
        "first_passage": (
            (*grid, "level"),
            of_samples(passages),
            "time at which the sample first passes the level",
        ),
        "passage_share": ("level", share, "fraction of the samples that pass the level"),
        "passage_share_error": (
            "level",
            np.sqrt(share * (1 - share) / samples),
            "binomial standard error of the fraction",
        ),
        "crossing_rate": (
            "level",
            counts.mean(axis=0) / span,
            "upward crossings of the level per unit of time",
        ),
        "crossing_rate_error": ("level", _error(counts / span), "standard error of the rate"),
        "peak": (grid, of_samples(peaks), "largest position of the sample"),
        "peak_mean": ((), peaks.mean(), "mean of the largest positions"),
        "peak_mean_error": ((), _error(peaks), "standard error of the mean"),
        "peak_std": ((), peaks.std(ddof=1), "standard deviation of the largest positions"),
        "peak_std_error": ((), _error_of_deviation(peaks), "standard error of the standard deviation"),
    }
    coords = {name: a for name, a in ds.coords.items() if set(a.dims) <= set(grid) and name in grid}
    attrs = {"mass": number, "samples": samples, "after": first, "duration": float(span)}
    return xr.Dataset(with_words(columns), coords={**coords, "level": wanted}, attrs=attrs)


def _error(values: np.ndarray) -> Any:
    """Standard error of the mean of samples, first axis."""
    return values.std(axis=0, ddof=1) / np.sqrt(len(values))


def _error_of_deviation(values: np.ndarray) -> float:
    """Standard error of the standard deviation of samples, to leading order, whatever their distribution is."""
    away = values - values.mean()
    variance = (away**2).mean()
    spread = max((away**4).mean() - variance**2, 0.0)
    return float(np.sqrt(spread / len(values)) / (2 * np.sqrt(variance))) if variance > 0 else 0.0


class _Steps:
    """Cubics between the saved times of samples, in the share of the step, (samples, steps) each.

    Attributes:
        t: times, (steps + 1,).
        c: coefficients, (4, samples, steps).
    """

    def __init__(self, t: np.ndarray, x: np.ndarray, v: np.ndarray):
        h, rise = np.diff(t), np.diff(x, axis=1)
        a, b = v[:, :-1] * h, v[:, 1:] * h
        self.t, self.h = t, h
        self.c = np.stack([x[:, :-1], a, 3 * rise - 2 * a - b, a + b - 2 * rise])
        self.top = self._place_of_maximum()

    def at(self, s: np.ndarray) -> np.ndarray:
        """Positions at shares of the steps."""
        return self.c[0] + s * (self.c[1] + s * (self.c[2] + s * self.c[3]))

    def _place_of_maximum(self) -> np.ndarray:
        """Share of each step at which it is highest."""
        _, c1, c2, c3 = self.c
        root = np.sqrt(np.maximum(c2**2 - 3 * c1 * c3, 0))
        # The root of the slope where it falls, in the form without cancellation.
        below = root - c2
        with np.errstate(divide="ignore", invalid="ignore"):
            inner = np.where(c2 < 0, c1 / below, (-c2 - root) / (3 * c3))
        inner = np.where(np.isfinite(inner), np.clip(inner, 0, 1), 0)
        trials = np.stack([0 * inner, inner, 1 + 0 * inner])
        best = np.argmax([self.at(s) for s in trials], axis=0)
        return np.take_along_axis(trials, best[None], axis=0)[0]

    def peaks(self) -> np.ndarray:
        """Largest position of each sample, (samples,)."""
        return self.at(self.top).max(axis=1)

    def passages(self, level: float) -> tuple[np.ndarray, np.ndarray]:
        """First time at which each sample passes a level, NaN if it never does, and its upward crossings, (samples,)."""
        begins, highest = self.c[0], self.at(self.top)
        is_up = (begins < level) & (highest >= level)
        counts = np.count_nonzero(is_up, axis=1)
        low, high = np.zeros_like(begins), self.top.copy()
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            is_beyond = self.at(middle) >= level
            low, high = np.where(is_beyond, low, middle), np.where(is_beyond, middle, high)
        k = np.argmax(is_up, axis=1)
        rows = np.arange(len(begins))
        first = np.where(counts > 0, self.t[k] + self.h[k] * high[rows, k], np.nan)
        return np.where(begins[:, 0] >= level, self.t[0], first), counts
