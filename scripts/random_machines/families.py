"""Checks on a random machine over its frequency: a sweep, the orbits of its points, their branches, and runs beside those."""

import warnings
from collections import Counter
from typing import NamedTuple

import numpy as np
import xarray as xr

import vijax as vx

from .ends_of_branches import (
    MOST_BRANCHES,
    MOST_IMPACTS,
    MOST_POINTS,
    MOST_STARTS,
    SAME,
    Fault,
    is_cut,
    other_ends,
    starts_of,
    wrong_ends,
)
from .laws import gaps
from .machines import machine, own_numbers
from .motions import is_endless
from .orbits import UNSTABLE, orbit_faults
from .other_ways import in_other_units
from .runs import MOST_STEPS
from .shapes import Shape

FREQUENCY = "forcing.frequency"
# Periods before the record of a sweep.
TRANSIENT = 100
# Frequencies of a sweep, their relative range.
POINTS, AROUND = 2048, 0.25
# Most orbits of branches that are run.
ROWS = 256
# Most periods of an orbit that is run, and relative error of one that closes (some have 50 impacts), and of multipliers.
LONGEST, CLOSED = 8, 1e-8
# Times by which rounding may exceed the difference of two runs that have as much.
MANY = 10
# Relative disturbances of orbits, one of which shows what an orbit does: the basin of a stable one may be small, and an
# unstable one may have a stable one beside it. Periods until those that attract are back, and the others have left.
BESIDE, BACK = (1e-5, 1e-9), 100
# Relative distance of a frequency from a bifurcation below which orbits are not run: basins shrink to nothing there.
NEAR = 1e-5
# Fall of the disturbance of a stable orbit that is demanded, and growth of that of an unstable one from where the growth is
# expected to be at least its square.
LESS, MORE = 1e-2, 1e2
# Units of branches are powers of two, up to this one and its inverse.
OTHER_UNITS = 20
# Result codes with which nothing is wrong.
ALLOWED = "successful", "max_impacts_reached"
# Motion that is stable by itself, by its largest multiplier.
CLEARLY_STABLE = 0.95


class Rows(NamedTuple):
    """Orbits at several frequencies, (orbits, ...)."""

    values: np.ndarray
    x: np.ndarray
    v: np.ndarray
    num_periods: np.ndarray
    multipliers: np.ndarray


def check_sweep(shape: Shape, own: dict) -> tuple[list[Fault], Counter]:
    """Sweep a driven machine over its frequency, and check the sweep and its orbits."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return _check_sweep(shape, own)[:2]


def check_family(shape: Shape, own: dict, rng: np.random.Generator) -> tuple[list[Fault], Counter]:
    """`check_sweep`, and check the branches through its orbits."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        faults, counts, orbits, cycles = _check_sweep(shape, own)
        system, values = machine(shape, own), orbits[FREQUENCY].values
        found = _branches(orbits, values)
        other_orbits, again, unit = _branches_in_other_units(shape, own, values, rng)
        faults += wrong_ends(found) + other_ends((orbits, other_orbits), found, again, unit)
        faults += _on_branches(cycles, orbits, found)
        rows = _rows_of_branches(found)
        if len(rows.values):
            faults += _closing("branch", system, rows, _run(system, rows, rows.v, 0))
            faults += _attraction(system, rows)
            faults += _single(shape, own, found)
    counts += Counter(
        swept=POINTS + (4 * ROWS if len(rows.values) else 0),
        branches=len(found) + len(again),
        points=sum(map(len, [*found, *again])),
    )
    return faults, counts


def _check_sweep(shape: Shape, own: dict) -> tuple[list[Fault], Counter, xr.Dataset, np.ndarray]:
    """Faults, numbers of points and orbits, the orbits, and their states after each period."""
    system, frequency = machine(shape, own), float(own["frequency"])
    values = frequency * np.linspace(1 - AROUND, 1 + AROUND, POINTS)
    ds, orbits = _swept(system, values, own["v0"])
    faults = _codes(own, system, ds) + _penetration(shape, own, ds) + _side(shape, ds)
    faults += _volume(shape, own, ds, orbits)
    rows = _rows_of_sweep(ds, orbits)
    cycles = _run(system, rows, rows.v, 0)
    faults += _closing("sweep", system, rows, cycles)
    counts = Counter(swept=3 * POINTS, orbits=int(orbits["converged"].sum()))
    return faults, counts, orbits, cycles


def _swept(system: vx.ImpactSystem, values: np.ndarray, v0: np.ndarray) -> tuple[xr.Dataset, xr.Dataset]:
    """A sweep and its orbits."""
    ds = vx.sweep(
        system,
        {FREQUENCY: values},
        v0=v0,
        transient=TRANSIENT,
        max_steps=MOST_STEPS,
        quantities=["max_position", "min_position"],
        progress=False,
    )
    return ds, vx.periodic_orbits(ds, progress=False)


def _branches_in_other_units(
    shape: Shape, own: dict, values: np.ndarray, rng: np.random.Generator
) -> tuple[xr.Dataset, list[vx.Branch], float]:
    """Orbits of the machine in other units, branches from them in the reverse order, and the unit of frequencies."""
    # Bounces below a velocity of 1e-6 complete a chatter: with another unit of velocity orbits have more or fewer of them.
    mass, time = 2.0 ** rng.integers(-OTHER_UNITS, OTHER_UNITS + 1, (2, 1))
    length = time
    other = own_numbers(
        in_other_units(shape, {name: a[None] for name, a in own.items()}, mass, length, time), 0
    )
    its_values = values / time
    _, orbits = _swept(machine(shape, other), its_values, other["v0"])
    return orbits, _branches(orbits, its_values, backwards=True), 1 / float(time[0])


def _branches(orbits: xr.Dataset, values: np.ndarray, *, backwards: bool = False) -> list[vx.Branch]:
    """Branches through some of the orbits."""
    which = starts_of(orbits)[:MOST_STARTS]
    if not len(which):
        return []
    return vx.branches(
        orbits.isel({FREQUENCY: which[::-1] if backwards else which}),
        (float(values[0]), float(values[-1])),
        max_points=MOST_POINTS,
        max_branches=MOST_BRANCHES,
        progress=False,
    )


def _codes(own: dict, system: vx.ImpactSystem, ds: xr.Dataset) -> list[Fault]:
    """Result codes of a sweep; points that ran out of steps have another try with those that the library allows."""
    codes = _result_names(ds)
    failed = ~np.isin(codes, ALLOWED)
    if is_endless({name: a[None] for name, a in own.items()})[0]:
        failed &= codes != "max_steps_reached"
    longer = np.flatnonzero(failed & (codes == "max_steps_reached"))
    if len(longer):
        values = ds[FREQUENCY].values[longer]
        again = vx.sweep(system, {FREQUENCY: values}, v0=own["v0"], transient=TRANSIENT, progress=False)
        failed[longer] = ~np.isin(_result_names(again), ALLOWED)
    return [
        (f"sweep: {code}", float(count))
        for code, count in zip(*np.unique(codes[failed], return_counts=True), strict=True)
    ]


def _result_names(ds: xr.Dataset) -> np.ndarray:
    names = np.array(ds["result"].attrs["flag_meanings"].split())
    return names[np.searchsorted(ds["result"].attrs["flag_values"], ds["result"].values)]


def _penetration(shape: Shape, own: dict, ds: xr.Dataset) -> list[Fault]:
    """No mass is beyond a stop that stands still, at any time, nor beyond others at the end of a period."""
    xs, values = ds["section_x"].values, ds[FREQUENCY].values
    lanes = {name: np.repeat(a[None], len(values), axis=0) for name, a in own.items()}
    ts = ds["forcing_period"].values[:, None] * (TRANSIENT + 1 + np.arange(xs.shape[1]))
    least = [np.nanmin(gaps(shape, lanes | {"frequency": values}, ts, xs))]
    for j, (i, side) in enumerate(shape.stops):
        if not (shape.is_moving and j == 0):
            sign, name = (1, "max_position") if side == "upper" else (-1, "min_position")
            least.append(own["position"][j] - np.nanmax(sign * ds[name].values[:, i]))
    excess = -min(least) / (1e-11 * (np.nanmax(np.abs(xs)) + 1.0))
    return [("sweep: penetration", float(excess))] if excess > 1 else []


def _side(shape: Shape, ds: xr.Dataset) -> list[Fault]:
    """Velocities before impacts are towards the stops that stand still."""
    faults = []
    for j, (_, side) in enumerate(shape.stops):
        if shape.is_moving and j == 0:
            continue
        own = ds["impact_velocity"].values[ds["impact_stop"].values == j]
        if (own < 0 if side == "upper" else own > 0).any():
            faults.append(("sweep: side of an impact", 1.0))
    return faults


def _volume(shape: Shape, own: dict, ds: xr.Dataset, orbits: xr.Dataset) -> list[Fault]:
    """Product of the multipliers (Liouville): a flight loses volume by the damper, an impact by the square of its restitution."""
    if shape.is_switching or shape.is_moving:
        return []
    is_free = (ds["num_sticks"].values == 0).all(axis=1) & (ds["held_time"].values == 0).all(axis=(1, 2))
    which = np.flatnonzero(orbits["converged"].values & is_free)
    multipliers = orbits["multipliers"].values[which]
    time = (orbits["num_periods"].values * ds["forcing_period"].values)[which]
    mass = own["mass"] if shape.is_full else np.diag(own["mass"])
    r = np.concatenate([own["restitution"], own["contact_restitution"]])
    impacts = orbits["num_impacts"].values[which]
    volume = np.exp(-np.trace(np.linalg.solve(mass, own["damping"])) * time)
    volume = volume * np.prod(r ** (2 * impacts), axis=1)
    largest = np.maximum(1.0, np.abs(multipliers[:, :1])) ** multipliers.shape[1]
    excess = np.abs(np.prod(multipliers, axis=1) - volume) / (SAME * largest[:, 0])
    return [] if (excess <= 1).all() else [("sweep: product of the multipliers", float(np.nanmax(excess)))]


def _rows_of_sweep(ds: xr.Dataset, orbits: xr.Dataset) -> Rows:
    """Orbits of a sweep; where there is none, the state at its end, as of no periods."""
    is_orbit = orbits["converged"].values
    return Rows(
        ds[FREQUENCY].values,
        np.where(is_orbit[:, None], orbits["x0"].values, ds["x"].values),
        np.where(is_orbit[:, None], orbits["v0"].values, ds["v"].values),
        orbits["num_periods"].values,
        orbits["multipliers"].values,
    )


def _rows_of_branches(branches: list[vx.Branch]) -> Rows:
    """Some orbits of branches that the machine follows, as many each time: a sweep of another size is another program."""
    kept = []
    for branch in branches:
        points, n = branch.points, int(branch.points.attrs["num_periods"])
        places = np.append([point.value for point in branch.bifurcations], branch.values[[0, -1]])
        away = np.abs(branch.values[:, None] - places).min(axis=1) / np.abs(branch.values)
        own = points.isel(point=points["is_admissible"].values & (away > NEAR))
        columns = [own[name].values for name in (FREQUENCY, "x0", "v0", "multipliers")]
        kept.append((*columns[:3], np.full(own.sizes["point"], n), columns[3]))
    if not sum(len(one[0]) for one in kept):
        return Rows(*[np.empty(0)] * len(Rows._fields))
    columns = [np.concatenate(column) for column in zip(*kept, strict=True)]
    which = np.linspace(0, len(columns[0]) - 1, ROWS).round().astype(int)
    return Rows(*(column[which] for column in columns))


def _run(system: vx.ImpactSystem, rows: Rows, v: np.ndarray, transient: int) -> np.ndarray:
    """States of runs from the orbits with other velocities at the end of each recorded period, (orbits, periods, 2 masses)."""
    starts = xr.Dataset({"x": ((FREQUENCY, "mass"), rows.x), "v": ((FREQUENCY, "mass"), v)})
    ds = vx.sweep(
        system,
        {FREQUENCY: rows.values},
        transient=transient,
        record=LONGEST,
        carry_from=starts,
        max_steps=10 * MOST_STEPS,
        progress=False,
    )
    return np.concatenate([ds["section_x"].values, ds["section_v"].values], axis=2)


def _closing(name: str, system: vx.ImpactSystem, rows: Rows, cycles: np.ndarray) -> list[Fault]:
    """Runs from orbits, (orbits, periods, 2 masses), return to them after their periods."""
    start, n = np.concatenate([rows.x, rows.v], axis=1), rows.num_periods
    largest = np.maximum(1.0, np.abs(rows.multipliers[:, 0]))
    is_fair = (n > 0) & (n <= LONGEST) & (largest < UNSTABLE)
    end = cycles[np.arange(len(n)), np.clip(n, 1, LONGEST) - 1]
    # Where a stick erases the start of a cycle, runs from beside it differ by the rounding that grows behind the stick.
    away = np.abs(_run(system, rows, _disturbed(rows, BESIDE[-1]), 0) - cycles).max(axis=2)
    spread = np.where(np.arange(LONGEST) < n[:, None], away, 0.0).max(axis=1)
    allowed = CLOSED * largest * (np.abs(cycles).max(axis=(1, 2)) + 1e-3) + MANY * spread
    excess = np.abs(end - start).max(axis=1) / allowed
    wrong = is_fair & ~(excess <= 1)
    return [(f"{name}: closing of an orbit", float(excess[wrong].max()))] if wrong.any() else []


def _disturbed(rows: Rows, by: float) -> np.ndarray:
    """Velocities beside those of orbits, by a share of the size of their states."""
    size = np.abs(np.concatenate([rows.x, rows.v], axis=1)).max(axis=1, keepdims=True)
    return rows.v + by * size * np.sign(rows.v)


def _distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of states relative to their size, (orbits,)."""
    return np.abs(a - b).max(axis=1) / (np.abs(b).max(axis=1) + 1e-3)


def _attraction(system: vx.ImpactSystem, rows: Rows) -> list[Fault]:
    """Runs begun beside orbits come back to those that are stable, and leave the others."""
    start, n = np.concatenate([rows.x, rows.v], axis=1), rows.num_periods
    # The state after the last whole number of periods of the orbit.
    last = (BACK + LONGEST) // n * n - BACK - 1
    growth = np.log(np.abs(rows.multipliers[:, 0]) + 1e-300) * (BACK / n)
    is_strange = {"a stable orbit attracts": growth < 2 * np.log(LESS)}
    is_strange["an unstable orbit repels"] = growth > 2 * np.log(MORE)
    for beside in BESIDE:
        end = _run(system, rows, _disturbed(rows, beside), BACK)
        away = _distance(end[np.arange(len(n)), last], start) / beside
        is_strange["a stable orbit attracts"] &= ~(away <= LESS)
        is_strange["an unstable orbit repels"] &= ~(away >= MORE)
    is_fair = n <= LONGEST
    return [
        (f"branch: {name}", float((own & is_fair).sum()))
        for name, own in is_strange.items()
        if (own & is_fair).any()
    ]


def _on_branches(cycles: np.ndarray, orbits: xr.Dataset, found: list[vx.Branch]) -> list[Fault]:
    """Every stable orbit of the sweep is on a branch: beside the chord of two of its points."""
    if is_cut(found) or len(starts_of(orbits)) > MOST_STARTS:
        return []
    values, n = orbits[FREQUENCY].values, orbits["num_periods"].values
    is_stable = (n > 0) & (np.abs(orbits["multipliers"].values[:, 0]) < CLEARLY_STABLE)
    is_stable &= orbits["num_impacts"].values.sum(axis=1) <= MOST_IMPACTS
    missed = [
        k
        for k in np.flatnonzero(is_stable & (n <= LONGEST))
        if not any(
            _is_on(branch, values[k], cycles[k, : n[k]])
            for branch in found
            if branch.points.attrs["num_periods"] == n[k]
        )
    ]
    return [("sweep: an orbit is on no branch", float(len(missed)))] if missed else []


def _is_on(branch: vx.Branch, value: float, states: np.ndarray) -> bool:
    rows = np.arange(len(branch) + (branch.ends[1] == "closed")) % len(branch)
    values = branch.values[rows]
    z = np.concatenate([branch.points["x0"].values, branch.points["v0"].values], axis=1)[rows]
    chord, along = np.diff(z, axis=0), np.diff(values)
    share = np.divide(value - values[:-1], along, out=np.full(len(along), np.inf), where=along != 0)
    own = np.flatnonzero((share >= -1e-9) & (share <= 1 + 1e-9))
    near = z[own] + share[own, None] * chord[own]
    # Twice the chord: where an impact crosses the section, the velocity jumps, and one side of the jump is beyond the chord.
    room = 2 * np.abs(chord[own]).max(axis=1) + 1e-6 * (np.abs(z[own]).max(axis=1) + 1e-3)
    return bool((np.abs(near[:, None] - states).max(axis=2) <= room[:, None]).any())


def _single(shape: Shape, own: dict, found: list[vx.Branch]) -> list[Fault]:
    """One orbit of each branch by itself."""
    faults = []
    for branch in found:
        points = branch.points
        is_plain = points["is_admissible"].values & (points["bifurcation"].values == "")
        is_fair = is_plain & (np.abs(points["multipliers"].values[:, 0]) < UNSTABLE)
        for row in np.flatnonzero(is_fair)[len(points["point"]) // 3 :][:1]:
            faults += [(f"branch: {name}", x) for name, x in orbit_faults(shape, own, branch.orbit(int(row)))]
    return faults
