"""Branches of periodic orbits: many side by side, beside one that is followed by SciPy."""

import time
from functools import partial

import numpy as np
import scipy.optimize

import vijax as vx

from .many import run_sweep
from .orbits import strobe_of
from .report import say
from .scenes import FREQUENCY

AMPLITUDE, BOUNDS = "forcing.amplitude[0]", (0.7, 1.0)
# Branches; of the last there are 8,000, as each is followed both ways.
FEW, MANY = (1, 100), (1, 100, 1000, 4000)
# Points that SciPy is given, and how far apart: they take it a second each.
POINTS, STEP = 6, 5e-3


def branches(full: bool) -> list[dict]:
    """Branches of case (a) over the frequency, each of another amplitude, from the orbits to the datasets."""
    rows = []
    for number in MANY if full else FEW:
        values = {AMPLITUDE: np.linspace(0.2, 0.8, number) if number > 1 else np.array([0.3])}
        orbits = vx.periodic_orbits(run_sweep(vx.models.wagg_bishop_a(0.8), values), progress=False)
        follow = partial(vx.continuation, orbits, FREQUENCY, BOUNDS, progress=False)
        found = follow()  # and compile
        start = time.process_time()
        follow()
        cpu, points = time.process_time() - start, sum(map(len, found))
        rows.append(
            {
                "method": "vijax",
                "branches": len(found),
                "points": points,
                "bifurcations": sum(len(branch.bifurcations) for branch in found),
                "closing error": max(float(branch.points.residual.max()) for branch in found),
                "us of CPU per point": 1e6 * cpu / points,
            }
        )
        say(rows[-1])
    rows.append(_by_scipy())
    say(rows[-1])
    return rows


def _by_scipy() -> dict:
    """A few steps of pseudo-arclength by the hybrid method of Powell, on runs by `solve_ivp` with its events.

    Its error is how far the orbits are from closing when vijax runs them.
    """
    system = vx.models.wagg_bishop_a(0.8, 0.3)
    orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
    strobe = strobe_of(system, orbit.num_periods)
    y = np.concatenate([orbit.x0, orbit.v0, [float(system.forcing.frequency)]])
    tangent, found = np.eye(5)[-1], []

    def equations(y: np.ndarray, base: np.ndarray, tangent: np.ndarray, step: float) -> np.ndarray:
        return np.append(strobe(y[:-1], y[-1]) - y[:-1], (y - base) @ tangent - step)

    start = time.process_time()
    for _ in range(POINTS):
        new = scipy.optimize.root(equations, y + STEP * tangent, (y, tangent, STEP), tol=1e-11).x
        tangent = (new - y) / np.linalg.norm(new - y)
        y = new
        found.append(y)
    cpu = time.process_time() - start
    return {
        "method": "SciPy",
        "branches": 1,
        "points": POINTS,
        "closing error": max(map(_closing, found)),
        "us of CPU per point": 1e6 * cpu / POINTS,
    }


def _closing(y: np.ndarray) -> float:
    system = vx.models.wagg_bishop_a(y[-1], 0.3)
    sol = vx.simulate(system, 0.0, system.forcing.period, y[:2], y[2:-1])
    return float(np.abs(np.concatenate([sol.x1, sol.v1]) - y[:-1]).max())
