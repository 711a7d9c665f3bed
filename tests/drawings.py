"""Readers of pictures, and results to draw."""

import json

import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.colors import to_rgb

import vijax as vx
from vijax._system.description import describe

PATH = "forcing.frequency"
# Least brightness that differs visibly from black on a screen; white is 1.
SEEN = 0.3


def grey(color) -> float:
    return float(np.dot([0.299, 0.587, 0.114], to_rgb(color)))


def events(sol: vx.Solution, kind: int, stop: int) -> np.ndarray:
    return np.asarray(sol.events.t)[(sol.events.kind == kind) & (sol.events.stop == stop)]


def discs(ax, *, filled: bool) -> list[tuple[float, float]]:
    """Places of the round marks, white or filled; one for each line."""
    marks = [line for line in ax.lines if line.get_marker() == "o"]
    is_white = [mpl.colors.same_color(mark.get_markerfacecolor(), "white") for mark in marks]
    return [points(mark).pop() for mark, white in zip(marks, is_white, strict=True) if white != filled]


def points(line) -> set[tuple[float, float]]:
    return set(zip(*(np.asarray(a).tolist() for a in line.get_data()), strict=True))


def named(ax, words: str):
    """Lines with that entry of the legend."""
    return [line for line in ax.lines if line.get_label() == words]


def words_of_legend(ax) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


def cycle(system: vx.ImpactSystem, x, v) -> vx.PeriodicOrbit:
    """Motion over one forcing period as a `PeriodicOrbit`, with made-up multipliers."""
    sol = vx.simulate(system, 0.0, float(system.forcing.period), x, v)
    log = sol.events
    hits = jnp.array([((log.kind == vx.IMPACT) & (log.stop == j)).sum() for j in range(system.num_stops)])
    yes, zero = jnp.array(True), jnp.array(0.0)
    return vx.PeriodicOrbit(
        system=system,
        num_periods=1,
        period=system.forcing.period,
        phase=zero,
        x0=jnp.asarray(x),
        v0=jnp.asarray(v),
        events=log,
        num_impacts=hits,
        multipliers=jnp.linspace(0.5, 0.0, 2 * system.num_masses).astype(complex),
        is_stable=yes,
        is_admissible=yes,
        residual=zero,
        progression=jnp.zeros(system.num_masses),
        num_runs=jnp.array(1),
        result=vx.ORBIT_RESULTS.successful,
        args=None,
        flow=None,
    )


def both_ways(ds: xr.Dataset) -> xr.Dataset:
    """Copies in the two directions of `carry="both"`."""
    return xr.concat([ds, ds], dim="direction").assign_coords(direction=["up", "down"])


def branch_of(cycles, kinds=None, stable=None, *, values=None, system=None, num_periods=1, **attrs):
    """Branch of orbits, each given by (time, stop, speed) of its impacts; by default at 1, 2, 3, ..."""
    count, room = len(cycles), max(map(len, cycles))
    system = vx.models.wagg_bishop_b(1.0) if system is None else system
    event_kind, event_stop = np.full((2, count, room), -1)
    flight, speed = np.zeros((count, room)), np.full((count, room), np.nan)
    for k, cycle in enumerate(cycles):
        for i, (_, stop, fast) in enumerate(cycle):
            event_kind[k, i], event_stop[k, i], speed[k, i] = vx.IMPACT, stop, fast
        flight[k, : len(cycle)] = np.diff([0.0, *(time for time, _, _ in cycle)])
    kinds = [""] * count if kinds is None else kinds
    return vx.Branch(
        xr.Dataset(
            {
                "bifurcation": ("point", kinds),
                "is_stable": ("point", np.ones(count, bool) if stable is None else np.array(stable)),
                "event_kind": (("point", "event"), event_kind),
                "event_stop": (("point", "event"), event_stop),
                "flight": (("point", "event"), flight),
                "impact_speed": (("point", "event"), speed),
                "num_impacts": (
                    ("point", "stop"),
                    [[sum(at == j for _, at, _ in c) for j in range(system.num_stops)] for c in cycles],
                ),
            },
            {PATH: ("point", np.arange(1.0, count + 1) if values is None else np.asarray(values, float))},
            {
                "system": json.dumps(describe(system)),
                "dtype": "float64",
                "path": PATH,
                "num_periods": num_periods,
                "phase": 0.0,
                "ends": json.dumps(["bounds", "bounds"]),
                **attrs,
            },
        )
    )
