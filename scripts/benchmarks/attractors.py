"""Attractors: Lyapunov exponents of sweeps beside the sweep and serial code in SciPy; basins likewise."""

import time
from collections.abc import Callable
from functools import partial

import jax
import numpy as np
import scipy.integrate
import xarray as xr

import vijax as vx

from .many import CASES
from .report import say
from .scenes import FREQUENCY, RECORD, TRANSIENT
from .timing import in_turns, repeated

# Forcing periods that SciPy follows, after as many to settle; it takes milliseconds for each.
FEW = 40
TOLERANCE = 1e-10
# Starts that SciPy follows to their attractors, for which it need not be as exact.
FEW_STARTS, LOOSE = 8, 1e-8
# Chaotic: the machine of both cases of the paper that SciPy is given.
CHAOTIC = 2.0


def exponents(full: bool) -> list[dict]:
    """Sweeps with Lyapunov exponents, in turns with the same without.

    Errors are those of the sum of all exponents against the exact loss of volume, where nothing sticks.
    """
    rows = []
    for case, (build, frequencies, _) in CASES.items():
        system, values = build(1.0), {FREQUENCY: frequencies}
        sweep = partial(vx.sweep, system, values, max_impacts=0, progress=False)
        ds = sweep(lyapunov=True)
        sweep()
        timed = in_turns(
            {"with": repeated(partial(sweep, lyapunov=True)), "without": repeated(sweep)}, 9 if full else 3
        )
        row = {
            "case": case,
            "method": "vijax",
            "points": ds.result.size,
            "error": _volume_error(system, ds),
            "min / s": timed["with"]["min / s"],
            "of the sweep": timed["with"]["min / s"] / timed["without"]["min / s"],
            "us per period": 1e6 * timed["with"]["min / s"] / (120 * ds.result.size),
        }
        rows.append(row)
        say(row)
    rows.append(_by_scipy())
    say(rows[-1])
    return rows


def _volume_error(system: vx.ImpactSystem, ds: xr.Dataset) -> float:
    """The largest error of the sum of exponents, relative to the loss of volume."""
    logs = np.log([float(stop.restitution) for stop in system.stops])  # pyright: ignore[reportAttributeAccessIssue]
    damping = np.trace(np.asarray(system.damping) / np.asarray(system.mass)[:, None])
    exact = -damping + 2 * (ds.num_impacts.values @ logs) / (20 * ds.forcing_period.values)
    found = ds.lyapunov_exponents.values.sum(axis=1)
    is_free = np.isfinite(found)
    return float(np.abs(found / exact - 1)[is_free].max())


def basins(full: bool) -> list[dict]:
    """Labels over a grid of starts of case (b), where chaos is beside a cycle, in turns with the sweep alone.

    SciPy is given some of the starts, and the attractors that are found.
    """
    system, size = vx.models.wagg_bishop_b(2.05), 300 if full else 100
    grid = {"x0[0]": np.linspace(-0.25, 0.3, size), "v0[0]": np.linspace(-1.0, 1.0, size)}
    runs = {
        "basins": partial(vx.basins, system, grid, progress=False),
        "sweep": partial(vx.sweep, system, grid, max_impacts=0, progress=False),
    }
    found, _ = (run() for run in runs.values())
    timed = in_turns({name: repeated(run) for name, run in runs.items()}, 3)
    row = {
        "method": "vijax",
        "starts": size * size,
        "attractors": found.sizes["attractor"],
        "min / s": timed["basins"]["min / s"],
        "of the sweep": timed["basins"]["min / s"] / timed["sweep"]["min / s"],
        "us per start": 1e6 * timed["basins"]["min / s"] / size**2,
    }
    rows = [row, _basins_by_scipy(system, found)]
    for one in rows:
        say(one)
    return rows


def _by_scipy() -> dict:
    """One motion with its tangents by `solve_ivp`, from event to event, by saltation matrices."""
    system = vx.models.wagg_bishop_b(CHAOTIC)
    _variational(system, 1)
    start = time.perf_counter()
    growth, impacts, duration = _variational(system, FEW)
    seconds = time.perf_counter() - start
    logs = np.log([float(stop.restitution) for stop in system.stops])  # pyright: ignore[reportAttributeAccessIssue]
    damping = np.trace(np.asarray(system.damping) / np.asarray(system.mass)[:, None])
    exact = -damping + 2 * (impacts @ logs) / duration
    return {
        "case": "b",
        "method": "SciPy",
        "points": 1,
        "error": abs(float(growth.sum() / duration / exact - 1)),
        "us per period": 1e6 * seconds / FEW,
    }


def _variational(system: vx.ImpactSystem, num_periods: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Growth of four tangents, impacts, and the duration; orthonormal again after every period."""
    field, matrix, gaps = _as_scipy(system)
    n, stops, period = len(matrix) // 2, jax.tree.map(np.asarray, system.stops), float(system.forcing.period)

    def slope(t: float, whole: np.ndarray) -> np.ndarray:
        tangents = matrix @ whole[2 * n :].reshape(2 * n, 2 * n)
        return np.concatenate([field(t, whole[: 2 * n]), tangents.ravel()])

    y, frame = np.array([0.0, 0.0, 0.0, 0.05]), np.eye(2 * n)
    growth, impacts = np.zeros(2 * n), np.zeros(len(stops))
    for k in range(num_periods):
        t, end = k * period, (k + 1) * period
        while t < end:
            whole = np.concatenate([y, frame.ravel()])
            found = scipy.integrate.solve_ivp(
                slope, (t, end), whole, "DOP853", events=gaps, rtol=TOLERANCE, atol=TOLERANCE
            )
            t, whole = found.t[-1], found.y[:, -1]
            y, frame = whole[: 2 * n].copy(), whole[2 * n :].reshape(2 * n, 2 * n)
            for j, (stop, times) in enumerate(zip(stops, found.t_events, strict=True)):
                if len(times):
                    impacts[j] += 1
                    place = n + stop.mass
                    reset, before = np.eye(2 * n), field(t, y)
                    reset[place, place] = -float(stop.restitution)
                    speed = y[place]
                    y[stop.mass], y[place] = stop.position, reset[place, place] * speed
                    jump = (field(t, y) - reset @ before) / speed
                    reset[:, stop.mass] += jump
                    frame = reset @ frame
        frame, scales = np.linalg.qr(frame)
        growth += np.log(np.abs(np.diag(scales)))
    return growth, impacts, num_periods * period


def _as_scipy(system: vx.ImpactSystem) -> tuple[Callable, np.ndarray, list[Callable]]:
    """The rate of change of (x, v), its matrix, and the gaps of the stops, as `solve_ivp` takes them."""
    machine = jax.tree.map(np.asarray, system)
    n, load, inverse = len(machine.mass), machine.forcing, 1 / machine.mass[:, None]
    matrix = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-inverse * machine.stiffness, -inverse * machine.damping]]
    )
    amplitude = np.concatenate([np.zeros(n), load.amplitude / machine.mass])

    def field(t: float, y: np.ndarray) -> np.ndarray:
        return matrix @ y + amplitude * np.cos(load.frequency * t)

    def gap_of(stop: vx.Stop) -> Callable:
        def gap(t: float, whole: np.ndarray) -> float:
            return stop.sign * (float(stop.position) - whole[stop.mass])

        gap.terminal, gap.direction = True, -1
        return gap

    return field, matrix, [gap_of(stop) for stop in machine.stops]


def _basins_by_scipy(system: vx.ImpactSystem, found: xr.Dataset) -> dict:
    """Some starts one after another by `solve_ivp`, each led to the attractor whose section is nearest in its last periods."""
    right, up = found["label"].dims
    places = np.linspace(0, found["label"].size - 1, FEW_STARTS).astype(int)
    sections = np.concatenate([found["section_x"], found["section_v"]], axis=2)
    start = time.perf_counter()
    labels = []
    for i, j in zip(*np.unravel_index(places, found["label"].shape), strict=True):
        y = np.array([float(found[right][i]), 0.0, float(found[up][j]), 0.0])
        ends = _section(system, y, TRANSIENT + RECORD)[-RECORD:]
        away = np.abs(sections[:, None] - ends[None, :, None]).max(axis=3)
        labels.append(int(np.nanmin(away, axis=2).max(axis=1).argmin()))
    seconds = time.perf_counter() - start
    return {
        "method": "SciPy",
        "starts": FEW_STARTS,
        "min / s": seconds,
        "us per start": 1e6 * seconds / FEW_STARTS,
        "same labels": float(np.mean(np.array(labels) == found["label"].values.ravel()[places])),
    }


def _section(system: vx.ImpactSystem, y: np.ndarray, num_periods: int) -> np.ndarray:
    """The states (x, v) at the end of each period, (periods, 2 n)."""
    (field, _, gaps), n, period = _as_scipy(system), system.num_masses, float(system.forcing.period)
    section = []
    for k in range(num_periods):
        t, end = k * period, (k + 1) * period
        while t < end:
            solved = scipy.integrate.solve_ivp(
                field, (t, end), y, "DOP853", events=gaps, rtol=LOOSE, atol=LOOSE
            )
            t, y = solved.t[-1], solved.y[:, -1].copy()
            for stop, times in zip(system.stops, solved.t_events, strict=True):
                if len(times):
                    (mass,) = stop.coefficients
                    y[mass] = float(stop.position)
                    y[n + mass] *= -float(stop.restitution)  # pyright: ignore[reportAttributeAccessIssue]
        section.append(y)
    return np.array(section)
