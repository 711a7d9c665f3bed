"""Fig. 9: individual impact maps of case (b)."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import vijax as vx
import xarray as xr
from vijax import plot

from .motions import is_kind, random_starts
from .output import FREQUENCY, compare, impacts_of, save

# Panel: frequency, stop, whether the chaotic motion is meant, what the paper says.
_PANELS = {
    "a": (0.3, 1, False, "a line of points falling to zero velocity, then sticking"),
    "b": (0.715, 1, True, "chaos in three distinct sets"),
    "c": (2.05, 0, True, "chaos, less dominated by linear sets than (d)"),
    "d": (2.05, 1, True, "chaos, in part linear sets that lead to zero velocity"),
}


def fig9(out: Path, coarse: int = 1) -> None:
    """Case (b): where the impacts lie in the plane of phase and velocity."""
    system = vx.models.wagg_bishop_b(1.0)
    starts = random_starts(system, 48 // coarse)
    frequencies = sorted({panel[0] for panel in _PANELS.values()})
    ds = vx.sweep(
        system,
        {FREQUENCY: np.array(frequencies), "x0": starts},
        transient=500,
        record=400 // coarse,
        progress=False,
        max_impacts=1600 // coarse,
    )
    chaos = is_kind(vx.classify(ds, last=max(2, 40 // coarse)), "non_periodic")
    fig, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
    rows, tables = [], []
    for ax, (panel, (frequency, stop, is_chaotic, said)) in zip(axes.flat, _PANELS.items(), strict=True):
        at = ds.sel({FREQUENCY: [frequency]})
        at = at.isel(x0=chaos.sel({FREQUENCY: frequency}).values if is_chaotic else [0])
        plot.impact_map(at, stop, ax=ax)
        ax.set_title(f"({panel}) $\\Omega$ = {frequency}, mass {stop + 1}", loc="left")
        ours = impacts_of(at.isel({FREQUENCY: 0}), ("phase", "velocity")).query(f"mass == {stop + 1}")
        rows.append((f"({panel}) Omega = {frequency}, mass {stop + 1}", said, _found(at, ours, stop)))
        tables.append(ours.assign(panel=panel)[["panel", "frequency", "impact_phase", "impact_velocity"]])
    print(f"Fig. 9, case (b), {ds.sizes['period']} forcing periods after 500, from {len(starts)} starts")
    compare(rows)
    save(fig, pd.concat(tables), out / "fig9")


def _found(at: xr.Dataset, impacts: pd.DataFrame, stop: int) -> str:
    """The size of an attractor and how far it reaches down."""
    speed = impacts["impact_velocity"].abs()
    sticks = "sticks, " if at.num_sticks.sel(stop=stop).any() else ""
    lows = f"{sticks}speeds {speed.min():.2g} ... {speed.max():.2g}"
    return f"{len(impacts)} impacts of {at.sizes['x0']} starts, {lows}"
