"""Figs. 5 and 8: time series at the frequencies of Tables 2 and 3, coexisting motions told apart."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.artist import Artist

import vijax as vx
from vijax import plot

from .motions import LONG, SHORT, TABLE_2, TABLE_3, from_many_starts, words
from .output import FREQUENCY, NUMBERS, announce, as_text, colors_of_the_paper, save

_TRANSIENT_CHAOS = 1.4  # of case (a)


class _Panel(NamedTuple):
    """One motion: where it is after whole forcing periods, and what is said and found of it."""

    name: str
    frequency: float
    point: xr.Dataset
    paper: tuple[str, ...]
    found: tuple[str, ...]
    after: int = LONG


def fig5(out: Path, coarse: int = 1) -> None:
    """Case (a): both masses against time."""
    system, count = vx.models.wagg_bishop_a, 64 // coarse
    panels = _panels(from_many_starts(system(1.0), list(TABLE_2), count, LONG), TABLE_2)
    early = from_many_starts(system(1.0), [_TRANSIENT_CHAOS], count, SHORT).isel({FREQUENCY: 0})
    worst = int(vx.classify(early).recurrence_error.argmax("x0"))
    is_at = [panel.frequency == _TRANSIENT_CHAOS for panel in panels].index(True)
    found = ("chaotic",) * 2
    chaotic = panels[is_at]._replace(name="f", point=early.isel(x0=worst), found=found, after=SHORT)
    panels[is_at] = panels[is_at]._replace(name="f'")
    panels.insert(is_at, chaotic)
    _draw(system, panels, "Fig. 5, case (a): stops at 0.3 and 0.3, $A_0$ = 0.3", out / "fig5")


def fig8(out: Path, coarse: int = 1) -> None:
    """Case (b): both masses against time."""
    system, count = vx.models.wagg_bishop_b, 64 // coarse
    panels = _panels(from_many_starts(system(1.0), list(TABLE_3), count, LONG), TABLE_3)
    _draw(system, panels, "Fig. 8, case (b): stops at -0.3 and 0.1, $A_0$ = 0.5", out / "fig8")


def _panels(ds: xr.Dataset, paper: dict[float, tuple[str, str, str]]) -> list[_Panel]:
    """Every motion that is found from some start, at each frequency."""
    motions = vx.classify(ds)
    panels = []
    for letter, (frequency, said) in zip("abcdefgh", paper.items(), strict=True):
        at = words(motions.sel({FREQUENCY: frequency}))
        for k, found in enumerate(sorted(set(at), key=at.count, reverse=True)):
            point = ds.sel({FREQUENCY: frequency}).isel(x0=at.index(found))
            panels.append(_Panel(letter + "'" * k, frequency, point, said[:2], found))
    return panels


def _draw(system: Callable[[float], vx.ImpactSystem], panels: list[_Panel], title: str, path: Path) -> None:
    """A picture of all panels in two columns, and the table of their curves."""
    rows = -(-len(panels) // 2)
    fig, axes = plt.subplots(rows, 2, figsize=(12, 2.1 * rows + 0.8), layout="constrained")
    curves = []
    names: dict[str, Artist] = {}
    for ax, panel in zip(axes.flat, panels, strict=False):
        sol = _follow(system(panel.frequency), panel.point)
        with colors_of_the_paper():
            plot.time_series(sol, ax=ax)
        names |= {word: handle for handle, word in zip(*ax.get_legend_handles_labels(), strict=True)}
        ax.get_legend().remove()
        ax.set_title(
            f"({panel.name}) $\\Omega$ = {panel.frequency}: {_short(panel)}", loc="left", fontsize=10
        )
        ax.set(xlabel="", ylabel="")
        t = np.linspace(0.0, float(sol.t1), 1501)
        x, v = (np.asarray(a) for a in sol.evaluate(t))
        columns = {"t": t, "x0": x[:, 0], "x1": x[:, 1], "v0": v[:, 0], "v1": v[:, 1]}
        curves.append(pd.DataFrame({"panel": panel.name, "frequency": panel.frequency, **columns}))
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    fig.legend(names.values(), names.keys(), loc="outside upper right", ncols=len(names), frameon=False)
    fig.supxlabel("Time $t$", fontsize="medium")
    fig.supylabel("Position of the masses", fontsize="medium")
    fig.suptitle(f"{title}\n{NUMBERS}", x=0.01, ha="left", fontsize="medium")
    announce(f"{title}; {NUMBERS}; impacts m in n forcing periods of mass 0 | mass 1")
    table = [(f"({p.name})", p.frequency, " | ".join(p.found), " | ".join(p.paper)) for p in panels]
    print(as_text(pd.DataFrame(table, columns=["panel", "Omega", "found", "paper"])))
    save(fig, pd.concat(curves), path)


def _short(panel: _Panel) -> str:
    """What is found of either mass, or of both where it is the same."""
    first, *others = panel.found
    said = " | ".join(panel.found) if any(words != first for words in others) else f"both {first}"
    said = said.replace("inf", r"$\infty$")
    return said if panel.after == LONG else f"{said} after {panel.after} periods"


def _follow(system: vx.ImpactSystem, point: xr.Dataset) -> vx.Solution:
    """Go on from the end of a sweep, which lies whole forcing periods after its start."""
    period = float(point.forcing_period)
    x, v = point.x.values.copy(), point.v.values
    return vx.simulate(system, 0.0, period * max(2, np.ceil(40 / period)), x, v)
