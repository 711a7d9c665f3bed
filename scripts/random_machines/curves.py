"""Checks on curves of bifurcations of a random machine: branches that cross them have the same bifurcation there."""

import json
import warnings
from collections import Counter

import numpy as np

import vijax as vx
from vijax._system.parameters import get_parameter, set_parameter

from .ends_of_branches import MOST_IMPACTS, Fault
from .families import FREQUENCY
from .machines import machine
from .runs import MOST_STEPS
from .shapes import Shape

# Frequencies of the sweep that finds orbits, their relative range, and most branches, their points, and those of a curve.
POINTS, AROUND, MOST_BRANCHES, MOST_POINTS = 64, 0.2, 3, 200
# Relative range of the second parameter, at least of this size.
RANGE, LEAST_SIZE = 0.3, 0.05
# Points of a curve at which branches cross it, their relative range, and from which distances they begin.
CROSSED, SHORT, BESIDE = 2, 0.02, (1e-4, -1e-4, 1e-3, -1e-3)
# Distance of an orbit there from the point, relative to the root of the distance of the parameter.
FARTHEST = 10.0
# Relative distance of two values that are one, error of a critical multiplier, and residual of the equations.
SAME, CRITICAL, SOLVED = 2e-9, 1e-4, 1e-8
# Speed of an impact, relative to the largest, below which it grazes.
LIGHT = 1e-6
# Kinds that have curves, and the distance of multipliers from those of the kind.
KINDS = {
    "fold": lambda mu: np.abs(mu - 1),
    "pd": lambda mu: np.abs(mu + 1),
    "ns": lambda mu: np.abs(np.abs(mu) - 1),
    "gr": None,
    "double_impact": None,
    "force_zero": None,
}


def check_curves(shape: Shape, own: dict, rng: np.random.Generator) -> tuple[list[Fault], Counter]:
    """Follow one curve of each kind of bifurcation of a machine, and check it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        system, faults, counts = machine(shape, own), [], Counter()
        values = float(own["frequency"]) * np.linspace(1 - AROUND, 1 + AROUND, POINTS)
        for point in _points(system, values, own["v0"], rng):
            path = (
                "stops[0].position" if len(shape.stops) and rng.random() < 0.5 else "forcing.amplitude[0][0]"
            )
            at = float(get_parameter(system, path))
            width = RANGE * max(abs(at), LEAST_SIZE)
            bounds = {FREQUENCY: (values[0], values[-1]), path: (at - width, at + width)}
            try:
                curve = vx.bifurcation_curve(point, path, bounds, max_points=MOST_POINTS, progress=False)
            except (
                ValueError
            ) as error:  # begun beside another bifurcation, or a symmetry that the path breaks
                counts[f"no curve: {str(error)[:40]}"] += 1
                continue
            counts += Counter(curves=1, curve_points=curve.sizes["point"])
            faults += _of_curve(curve)
            found, own_counts = _across(system, curve, path, values, rng)
            faults, counts = faults + found, counts + own_counts
    return faults, counts


def _points(
    system: vx.ImpactSystem, values: np.ndarray, v0: np.ndarray, rng: np.random.Generator
) -> list[vx.Bifurcation]:
    """One bifurcation of each kind, of branches through orbits of a sweep."""
    ds = vx.sweep(system, {FREQUENCY: values}, v0=v0, transient=60, max_steps=MOST_STEPS, progress=False)
    orbits = vx.periodic_orbits(ds, progress=False)
    impacts = orbits["num_impacts"].values.sum(axis=1)
    which = np.flatnonzero(orbits["converged"].values & (impacts <= MOST_IMPACTS))
    if not len(which):
        return []
    starts = orbits.isel({FREQUENCY: np.unique(which[[0, len(which) // 2, -1]])})
    found = vx.branches(
        starts, (values[0], values[-1]), max_points=MOST_POINTS, max_branches=MOST_BRANCHES, progress=False
    )
    kinds: dict[str, list[vx.Bifurcation]] = {}
    for branch in found:
        for point in branch.bifurcations:
            kinds.setdefault(point.kind, []).append(point)
    return [points[rng.integers(len(points))] for kind, points in kinds.items() if kind in KINDS]


def _of_curve(curve) -> list[Fault]:
    """Ends, multipliers and residuals along a curve."""
    kind, is_plain = curve.attrs["kind"], curve["special"].values == ""
    # Beside a grazing multipliers are infinite, and those of the kind are rounding.
    speeds = np.abs(curve["impact_speed"].values)
    is_light = (speeds > 0) & (speeds <= LIGHT * speeds.max(axis=1, keepdims=True, initial=0))
    is_plain &= ~is_light.any(axis=1)
    faults = [
        (f"curve: {kind} ends: {end}", 1.0)
        for end in json.loads(curve.attrs["ends"])
        if end == "not_converged"
    ]
    away = KINDS[kind]
    if away is not None and is_plain.any():
        excess = away(curve["multipliers"].values[is_plain]).min(axis=1).max() / CRITICAL
        faults += [("curve: critical multiplier", float(excess))] if excess > 1 else []
    excess = np.abs(curve["residual"].values).max() / SOLVED
    return faults + ([("curve: residual", float(excess))] if excess > 1 else [])


def _across(
    system: vx.ImpactSystem, curve, path: str, values: np.ndarray, rng: np.random.Generator
) -> tuple[list[Fault], Counter]:
    """Branches along the frequency across some points of a curve."""
    faults, counts, kind = [], Counter(), curve.attrs["kind"]
    places = rng.permutation(np.flatnonzero(curve["special"].values == ""))
    for k in places[:CROSSED]:
        at, second = float(curve[FREQUENCY][k]), float(curve[path][k])
        if not values[0] * (1 + SHORT) < at < values[-1] * (1 - SHORT):
            continue
        there = set_parameter(system, path, second)
        x, v = curve["x0"].values[k], curve["v0"].values[k]
        met = [_kinds_met(there, at, by, x, v, curve.attrs["num_periods"]) for by in BESIDE]
        known = [kinds for kinds in met if kinds is not None]
        counts += Counter(crossed=bool(known))
        if known and not any(kind in kinds for kinds in known):
            faults.append((f"curve: a branch across has {sorted(set().union(*known))}, not {kind}", at))
    return faults, counts


def _kinds_met(
    system: vx.ImpactSystem, at: float, by: float, x: np.ndarray, v: np.ndarray, num_periods: int
) -> set[str] | None:
    """Kinds of bifurcation at a frequency on the branch through an orbit beside; None if there is no orbit, or a shorter one."""
    orbit = vx.periodic_orbit(set_parameter(system, FREQUENCY, at * (1 + by)), x, v, num_periods, throw=False)
    away = np.abs(np.concatenate([orbit.x0 - x, orbit.v0 - v])).max()
    size = np.abs(np.concatenate([x, v])).max()
    if orbit.result != vx.ORBIT_RESULTS.successful or away > FARTHEST * abs(by) ** 0.5 * size:
        return None
    if num_periods % 2 == 0:
        half = vx.simulate(orbit.system, 0.0, orbit.period / 2, orbit.x0, orbit.v0)
        if np.abs(np.concatenate([half.x1 - orbit.x0, half.v1 - orbit.v0])).max() < 1e-6 * size:
            return None
    bounds = at * (1 - SHORT), at * (1 + SHORT)
    branch = vx.continuation(orbit, FREQUENCY, bounds, max_points=MOST_POINTS, progress=False)
    return {point.kind for point in branch.bifurcations if abs(point.value - at) < SAME * at}
