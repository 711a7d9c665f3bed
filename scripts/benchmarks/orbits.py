"""Periodic orbits: those of the paper's sweeps in a batch, beside the sweep and shooting by SciPy."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import numpy as np
import scipy.integrate
import scipy.optimize
import xarray as xr

import vijax as vx

from .many import CASES, run_sweep
from .report import say
from .scenes import FREQUENCY
from .timing import in_turns, repeated

# Orbits that SciPy is given, without chatter; they take it a second each.
FEW = 6
TOLERANCE = 1e-12


def periodic_orbits(full: bool) -> list[dict]:
    """All periodic points of both sweeps polished, from the call to the dataset, in turns with the sweep.

    Of SciPy's shooting a few of the orbits of case (a); its error is the distance from ours.
    """
    rows = []
    for case, (build, frequencies, _) in CASES.items():
        system, values = build(1.0), {FREQUENCY: frequencies}
        ds = run_sweep(system, values)
        polish = partial(vx.periodic_orbits, ds, progress=False)
        orbits, kinds = polish(), vx.classify(ds)
        timed = in_turns(
            {"orbits": repeated(polish), "sweep": repeated(partial(run_sweep, system, values))},
            7 if full else 3,
        )
        found, wanted = int(orbits.converged.sum()), int((kinds.num_periods > 0).sum())
        row = {
            "case": case,
            "method": "vijax",
            "orbits": found,
            "periodic points": wanted,
            "closing error": float(orbits.residual.max()),
            "min / s": timed["orbits"]["min / s"],
            "of the sweep": timed["orbits"]["min / s"] / timed["sweep"]["min / s"],
            "us per orbit": 1e6 * timed["orbits"]["min / s"] / found,
        }
        rows.append(row)
        say(row)
        if case == "a":
            rows.append(_by_scipy(ds, orbits))
            say(rows[-1])
    return rows


def _by_scipy(ds: xr.Dataset, orbits: xr.Dataset) -> dict:
    """Shooting with the events of `solve_ivp` and the hybrid method of Powell."""
    light = np.flatnonzero(orbits.converged & (orbits.num_impacts.sum("stop") > 0))
    chosen = light[np.linspace(0, len(light) - 1, FEW).astype(int)]
    seconds, errors = 0.0, []
    for k in chosen:
        point, orbit = (d.isel({FREQUENCY: k}) for d in (ds, orbits))
        system, guess = vx.system_of(point), np.concatenate([point.x, point.v])
        start = time.perf_counter()
        state = _shoot(system, guess, int(orbit.num_periods))
        seconds += time.perf_counter() - start
        errors.append(np.abs(state - np.concatenate([orbit.x0, orbit.v0])).max())
    return {
        "case": "a",
        "method": "SciPy",
        "orbits": FEW,
        "error": float(max(errors)),
        "us per orbit": 1e6 * seconds / FEW,
    }


def _shoot(system: Any, guess: np.ndarray, num_periods: int) -> np.ndarray:
    """The fixed point of the stroboscopic map near a guess."""
    strobe, frequency = strobe_of(system, num_periods), float(system.forcing.frequency)
    return scipy.optimize.root(lambda y: strobe(y, frequency) - y, guess, tol=1e-11).x


def strobe_of(system: vx.ImpactSystem, num_periods: int) -> Callable[[np.ndarray, float], np.ndarray]:
    """The stroboscopic map by `solve_ivp` with its events, of a state and a frequency of the load."""
    machine = jax.tree.map(np.asarray, system)
    n, load = len(machine.mass), machine.forcing

    def slope(t: float, y: np.ndarray, frequency: float) -> np.ndarray:
        force = load.mean + load.amplitude * np.cos(frequency * t + load.phase)
        force = force - machine.damping @ y[n:] - machine.stiffness @ y[:n]
        return np.concatenate([y[n:], force / machine.mass])

    def gap_of(stop: vx.Stop):
        def gap(t: float, y: np.ndarray, frequency: float) -> float:
            return stop.sign * (float(stop.position) - y[stop.mass])

        gap.terminal, gap.direction = True, -1
        return gap

    gaps = [gap_of(stop) for stop in machine.stops]

    def strobe(y: np.ndarray, frequency: float) -> np.ndarray:
        t, end = 0.0, num_periods * 2 * np.pi / frequency
        while t < end:
            found = scipy.integrate.solve_ivp(
                slope, (t, end), y, "DOP853", events=gaps, args=(frequency,), rtol=TOLERANCE, atol=TOLERANCE
            )
            t, y = found.t[-1], found.y[:, -1].copy()
            for stop, times in zip(machine.stops, found.t_events, strict=True):
                if len(times):
                    y[stop.mass], y[n + stop.mass] = stop.position, -stop.restitution * y[n + stop.mass]
        return y

    return strobe
