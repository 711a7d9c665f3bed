"""Fig. 9: individual impact maps of case (b)."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr

import vijax as vx
from vijax import plot

from .motions import is_kind, random_starts
from .output import FREQUENCY, NUMBERS, announce, compare, impacts_of, save

# Panel: frequency, stop, what the paper says.
_PANELS = {
    "a": (0.3, 1, "a line of points falling to zero velocity, then sticking"),
    "b": (0.715, 1, "chaos in three distinct sets"),
    "c": (2.05, 0, "chaos, less dominated by linear sets than (d)"),
    "d": (2.05, 1, "chaos, in part linear sets that lead to zero velocity"),
}


# Two sets are distinct if no impact falls between them for this long, in radians.
_GAP = 0.2


def fig9(out: Path, coarse: int = 1) -> None:
    """Case (b): where the impacts lie in the plane of phase and velocity."""
    attractors = {frequency: _attractor(frequency, coarse) for frequency in (0.715, 2.05)}
    system = vx.models.wagg_bishop_b(1.0)
    attractors[0.3] = vx.sweep(system, {FREQUENCY: np.array([0.3])}, record=2, progress=False)
    fig, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
    rows, tables = [], []
    for ax, (panel, (frequency, stop, said)) in zip(axes.flat, _PANELS.items(), strict=True):
        ds = attractors[frequency]
        plot.impact_map(ds, stop, ax=ax)
        ax.set_title(f"({panel}) $\\Omega$ = {frequency}, mass {stop}", loc="left")
        ours = impacts_of(ds).query(f"mass == {stop}").rename(columns=lambda c: c.removeprefix("impact_"))
        if panel == "c":
            ax.set(xlim=_around(ours.phase), ylim=_around(ours.velocity), xticks=[4.0, 4.1, 4.2, 4.3])
            ax.set_xticklabels(["4.0", "4.1", "4.2", "4.3"])
        rows.append((f"({panel}) Omega = {frequency}, mass {stop}", said, _found(ds, ours, stop)))
        tables.append(ours.assign(panel=panel)[["panel", "frequency", "phase", "velocity"]])
    title = f"Fig. 9, case (b): stops at -0.3 and 0.1, $A_0$ = 0.5; (c) is a close-up; {NUMBERS}"
    announce(title)
    compare(rows)
    fig.suptitle(title)
    save(fig, pd.concat(tables), out / "fig9")


def _attractor(frequency: float, coarse: int) -> xr.Dataset:
    """The chaotic motions reached from random starts; a periodic one coexists at 2.05."""
    system = vx.models.wagg_bishop_b(1.0)
    values = {FREQUENCY: np.array([frequency]), "x0": random_starts(system, 128 // coarse)}
    ds = vx.sweep(system, values, transient=500, record=max(40, 400 // coarse), progress=False)
    is_chaotic = is_kind(vx.classify(ds, last=40), "non_periodic").isel({FREQUENCY: 0})
    return ds.isel(x0=is_chaotic.values)


def _around(values: pd.Series) -> tuple[float, float]:
    """Limits a little beyond the least and the largest of some values."""
    margin = 0.1 * (values.max() - values.min())
    return values.min() - margin, values.max() + margin


def _found(ds: xr.Dataset, impacts: pd.DataFrame, stop: int) -> str:
    """The size of an attractor, of how many sets it is, and how far it reaches down."""
    speed, phase = impacts.velocity.abs(), np.sort(impacts.phase)
    sets = np.count_nonzero(np.diff(phase, append=phase[0] + 2 * np.pi) > _GAP)
    low = "sticks" if ds.num_sticks.isel(stop=stop).any() else f"{sets} apart in phase"
    return f"{len(impacts)} impacts, {low}, speeds {speed.min():.2g} ... {speed.max():.2g}"
