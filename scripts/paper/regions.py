"""Fig. 6: the motions of case (a) in the plane of forcing frequency and amplitude."""

from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr

import vijax as vx
from vijax import plot

from .motions import is_kind, words
from .output import AMPLITUDE, FREQUENCY, NUMBERS, compare, save

# Steps of 0.0025 and 0.004.
_POINTS = (721, 201)
# The paper discards 100 periods. Where a motion does not repeat after them, far more are.
_SHORT, _LONG = 100, 1000
# The impacts of the whole plane at once would fill the memory.
_COLUMNS = 30


def fig6(out: Path, coarse: int = 1) -> None:
    """Case (a): regions of the motions reached from rest."""
    right, up = ((n - 1) // coarse + 1 for n in _POINTS)
    frequencies, amplitudes = np.linspace(0.2, 2.0, right), np.linspace(0.2, 1.0, up)
    strips = [_classified(frequencies[k : k + _COLUMNS], amplitudes) for k in range(0, right, _COLUMNS)]
    motions = _joined(strips)
    print(
        f"Fig. 6, case (a), {right} x {up} points, each from rest, after {_SHORT} forcing periods, or {_LONG}"
    )
    print("more where there is a motion that does not repeat")
    compare(_facts(motions))
    fig, ax = plt.subplots(figsize=(10, 5), layout="constrained")
    plot.regions(motions, max_classes=10, ax=ax)
    ax.set_title(f"Fig. 6, case (a): motions reached from rest; {NUMBERS}", loc="left")
    save(fig, _as_table(motions), out / "fig6")


def _classified(frequencies: np.ndarray, amplitudes: np.ndarray) -> xr.Dataset:
    """The motions of a strip of the plane."""
    system, values = vx.models.wagg_bishop_a(1.0), {FREQUENCY: frequencies, AMPLITUDE: amplitudes}
    ds = vx.sweep(system, values, transient=_SHORT, progress=False)
    motions = vx.classify(ds)[["motion", "num_periods", "num_impacts"]]
    is_open = (motions.num_periods == 0).any(AMPLITUDE).values
    if not is_open.any():
        return motions
    values[FREQUENCY] = frequencies[is_open]
    before = ds[["x", "v"]].isel({FREQUENCY: is_open})
    later = vx.sweep(system, values, transient=_LONG, carry_from=before, progress=False)
    settled = motions.isel({FREQUENCY: ~is_open})
    return _joined([settled, vx.classify(later)[list(motions)]]).sortby(FREQUENCY)


def _joined(parts: list[xr.Dataset]) -> xr.Dataset:
    """Parts of the plane side by side."""
    return xr.concat(parts, FREQUENCY, data_vars="minimal", combine_attrs="override")


def _facts(motions: xr.Dataset) -> list[tuple[str, str, str]]:
    """What Sec. 4.4.1 says of the picture."""
    left = motions.motion[FREQUENCY] < 0.4
    chatter = is_kind(motions, "chattering") & left
    at_rest = is_kind(motions, "non_impacting") & left
    chaos = is_kind(motions, "non_periodic")
    amplitude = motions[AMPLITUDE].values
    lowest = motions.isel({AMPLITUDE: 0})
    is_simple = (lowest.num_periods == 1) & (lowest.num_impacts == 1).all("stop")
    edge = float(lowest[FREQUENCY][~is_simple.values & (lowest[FREQUENCY] < 0.6).values].max())
    return [
        ("line between others and 1 | 1, at A_0 = 0.2", "Omega = 0.4", f"Omega = {edge:.4f}"),
        ("no impact, Omega < 0.4", "at A_0 = 0.2", _span(at_rest, amplitude)),
        ("complete chatter, Omega < 0.4", "a small region at A_0 > 0.8", _span(chatter, amplitude)),
        ("windows in the chaotic region", "for the most part period 1", _windows(motions, chaos)),
        ("non-periodic", "-", f"{float(chaos.mean()):.1%} of the plane"),
        ("not settled", "-", f"{float(is_kind(motions, 'not_settled').mean()):.1%} of the plane"),
    ]


def _span(where: xr.DataArray, amplitude: np.ndarray) -> str:
    """The amplitudes at which something is so."""
    found = amplitude[where.any(FREQUENCY).values]
    return f"A_0 = {found[0]:.3f} ... {found[-1]:.3f}" if len(found) else "nowhere"


def _windows(motions: xr.Dataset, chaos: xr.DataArray) -> str:
    """The most frequent motions between the first and the last chaotic frequency of each amplitude."""
    after = chaos.cumsum(FREQUENCY) > 0
    before = chaos.isel({FREQUENCY: slice(None, None, -1)}).cumsum(FREQUENCY) > 0
    is_between = (after & before.sortby(FREQUENCY) & ~chaos).stack(point=chaos.dims)
    inside = motions.stack(point=chaos.dims).isel(point=is_between.values)
    common = Counter(words(inside.transpose("point", "stop"))).most_common(3)
    return "; ".join(f"{' | '.join(motion)} {count / is_between.sum():.0%}" for motion, count in common)


def _as_table(motions: xr.Dataset) -> pd.DataFrame:
    """A row for each point."""
    flat = motions.stack(point=motions.motion.dims)
    kinds = np.array(motions.motion.attrs["flag_meanings"].split())
    impacts = flat.num_impacts.transpose("point", "stop").values
    return pd.DataFrame(
        {
            "frequency": flat[FREQUENCY].values,
            "amplitude": flat[AMPLITUDE].values,
            "motion": kinds[flat.motion.values],
            "num_periods": flat.num_periods.values,
            "impacts of mass 0": impacts[:, 0],
            "impacts of mass 1": impacts[:, 1],
        }
    )
