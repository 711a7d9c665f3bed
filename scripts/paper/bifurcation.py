"""Figs. 4 and 7: impact velocities against the forcing frequency, swept up and down."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr

import vijax as vx
from vijax import plot

from .motions import classes_of, is_kind
from .output import FREQUENCY, FREQUENCY_STEP, NUMBERS, announce, compare, impacts_of, ranges, save

# Masses that hit within a time step of the paper have a double impact. It is not printed, but at the two
# frequencies that are named the impacts are 0.0051 and 0.0047 apart.
_DOUBLE_WITHIN = 0.0055


def fig4(out: Path, coarse: int = 1) -> None:
    """Case (a): impact velocities of both masses against the forcing frequency."""
    title = f"Fig. 4, case (a): stops at 0.3 and 0.3, $A_0$ = 0.3; {NUMBERS}"
    ds, rest = _sweeps(vx.models.wagg_bishop_a(1.0), (0.2, 2.0), coarse)
    announce(title)
    compare([*_facts_of_case_a(ds), _soundness(ds, rest)])
    _draw(ds, rest, title, out / "case_a")


def fig7(out: Path, coarse: int = 1) -> None:
    """Case (b): the same for stops on opposite sides."""
    title = f"Fig. 7, case (b): stops at -0.3 and 0.1, $A_0$ = 0.5; {NUMBERS}"
    ds, rest = _sweeps(vx.models.wagg_bishop_b(1.0), (0.1, 2.2), coarse)
    announce(title)
    compare([*_facts_of_case_b(ds, rest), _soundness(ds, rest)])
    _draw(ds, rest, title, out / "case_b")


def _sweeps(system: vx.ImpactSystem, band: tuple[float, float], coarse: int) -> tuple[xr.Dataset, xr.Dataset]:
    """Up and down as the paper does, and once more with every frequency started from rest."""
    first, last = (round(edge / FREQUENCY_STEP) for edge in band)
    values = {FREQUENCY: FREQUENCY_STEP * np.arange(first, last + 1, coarse)}
    return vx.sweep(system, values, carry="both"), vx.sweep(system, values)


def _facts_of_case_a(ds: xr.Dataset) -> list[tuple[str, str, str]]:
    """What Sec. 4.4 says of Fig. 4."""
    motions = classes_of(ds, _DOUBLE_WITHIN)
    double = motions.num_double_impacts.where(motions.num_periods > 0) > 0
    chaos = is_kind(motions, "non_periodic")
    return [
        ("non-periodic motions", "upper half of the range", f"Omega = {ranges(chaos)}"),
        ("double impacts of periodic motions", "Omega = 0.27, 0.435", f"Omega = {ranges(double)}"),
    ]


def _facts_of_case_b(ds: xr.Dataset, rest: xr.Dataset) -> list[tuple[str, str, str]]:
    """What Sec. 4.5 says of Fig. 7."""
    sticks = [ds.num_sticks.sel(stop=j) > 0 for j in range(2)]
    carried, started = (is_kind(classes_of(a), "non_periodic") for a in (ds, rest))
    is_low = ds[FREQUENCY] < 1.6
    return [
        ("mass 0 sticks", "Omega < 0.5", f"Omega = {ranges(sticks[0])}"),
        ("mass 1 sticks", "Omega < 0.5", f"Omega = {ranges(sticks[1])}"),
        ("non-periodic, below 1.6", "very small regions from 0.6", f"Omega = {ranges(carried & is_low)}"),
        (
            "non-periodic, above 1.6",
            "large regions, beside period 1",
            f"Omega = {ranges(carried & ~is_low)}",
        ),
        ("the same from rest", "-", f"Omega = {ranges(started & ~is_low)}"),
    ]


def _soundness(ds: xr.Dataset, rest: xr.Dataset) -> tuple[str, str, str]:
    """How many of the points came to their end."""
    sound = sum(int((a.result == 0).sum()) for a in (ds, rest))
    return "points computed to their end", "-", f"{sound} of {ds.result.size + rest.result.size}"


def _draw(ds: xr.Dataset, rest: xr.Dataset, title: str, path: Path) -> None:
    """All impacts of both masses; grey, below the others, those of the motions reached from rest."""
    fig, axes = plt.subplots(ds.sizes["stop"], sharex=True, figsize=(8, 6.4), layout="constrained")
    plot.bifurcation(rest, None, ax=axes, color="0.5", markersize=3, markeredgewidth=0, label="from rest")
    plot.bifurcation(ds, None, ax=axes)
    for j, ax in enumerate(axes):
        ax.set_title(f"({'ab'[j]}) mass {j}", loc="left")
        ax.label_outer()
    fig.suptitle(title)
    tables = [impacts_of(ds), impacts_of(rest).assign(direction="rest")]
    save(fig, pd.concat(tables), path)
