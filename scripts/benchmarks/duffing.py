"""A nonlinear machine: Duffing's oscillator with a stop, beside heyoka and diffrax.

It is that of a golden scene, x'' + 0.1 x' + x + x^3 = 0.5 cos(W t) with a stop at 0.3. Errors of impact times are
those of this scene, the first of the lanes. That of the orbit is what heyoka, in extended precision, finds between
the state at its beginning and a period later.
"""

import json
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import peers
import xarray as xr

import vijax as vx

from . import diffeqsolve
from .convergence import nth, start
from .many import HEYOKA_TOLERANCE, run_sweep
from .report import say
from .scenes import FREQUENCY, GOLDEN, SHORT, Outcome, Scene, exact_impacts, judge, sweep_error, time_error
from .single import installed
from .timing import cpu_seconds, in_turns, repeated, summary

POINTS, LOWEST, HIGHEST = 1000, 0.6, 1.6
# More than any of the points has in its periods.
ROOM = 128
SOLVER, TOLERANCES = "Dopri8", (1e-8, 1e-12)
# Periods after which the motion from rest is a guess of the orbit.
SETTLED = 40
# Closing of an orbit as heyoka sees it.
TIGHT = 1e-19


@cache
def golden() -> Scene:
    """The scene, to 34 digits."""
    return json.loads((GOLDEN.parent / "golden_analytic" / "duffing_stop.json").read_text())


def machine() -> vx.ImpactSystem:
    """The machine of the scene, for vijax."""
    scene, (stop,) = golden(), golden()["stops"]
    cubic = scene["forces"][0]["numbers"]["k3"]
    load = vx.Harmonic(scene["A"], scene["Omega"])
    stops = [vx.Stop(0, stop["position"], stop["side"], stop["restitution"])]
    return vx.ImpactSystem(
        scene["M"], scene["C"], scene["K"], load, stops, force=lambda t, x, v, args: -cubic * x**3
    )


def frequencies() -> np.ndarray:
    """That of the scene, then those of the range."""
    return np.append(golden()["Omega"], np.linspace(LOWEST, HIGHEST, POINTS - 1))


def duffing_sweeps(full: bool) -> list[dict]:
    """1000 frequencies from rest over 20 periods, one core each: CPU time in turns, impacts and error.

    In a quick run heyoka has every fourth frequency, its time and impacts in proportion.
    """
    few = 1 if full else 4
    sweep = partial(
        run_sweep, machine(), {FREQUENCY: frequencies()}, transient=0, record=SHORT, max_impacts=ROOM,
        settings=vx.ExecutionSettings(cores=1),
    )  # fmt: skip
    runs: dict[str, tuple[Callable[[], Any], Callable[[Any], dict]]] = {"vijax": (sweep, of_dataset)}
    equations = partial(peers.duffing, golden())
    points = installed(lambda: peers.heyoka_points(equations, frequencies()[::few], SHORT, HEYOKA_TOLERANCE))
    if points is not None:
        known = judge(peers.heyoka(golden(), HEYOKA_TOLERANCE).outcome(), golden())["time error"]
        runs["heyoka"] = points, lambda count: {"impacts": few * count, "error": known}
    for tolerance in TOLERANCES if full else TOLERANCES[1:]:
        runs[f"diffrax {SOLVER}, {tolerance:g}"] = partial(in_lanes(), tolerance), of_fates
    told = {method: tell(run()) for method, (run, tell) in runs.items()}
    taken: dict[str, list[float]] = {method: [] for method in runs}
    for _ in range(7 if full else 3):
        for method, (run, _) in runs.items():
            taken[method].append((few if method == "heyoka" else 1) * cpu_seconds(run))
    rows = [{"method": method, **told[method], **summary(seconds)} for method, seconds in taken.items()]
    for row in rows:
        row["of vijax"] = row["min / s"] / rows[0]["min / s"]
        say(row)
    return rows


def duffing_motions(full: bool) -> list[dict]:
    """One trajectory, the scene, and one orbit of its machine from a guess: wall-clock time and error of each."""
    system, scene = machine(), golden()
    run = partial(vx.simulate, system, scene["t0"], scene["t1"])
    rest = run()
    guess = vx.simulate(system, 0.0, SETTLED * system.forcing.period)
    find = partial(vx.periodic_orbit, system, guess.x1, guess.v1)
    programs = {"one trajectory, vijax": (repeated(run), simulated_error(rest))}
    other = installed(lambda: peers.heyoka(scene, HEYOKA_TOLERANCE))
    if other is not None:
        programs["one trajectory, heyoka"] = other.seconds, judge(other.outcome(), scene)["time error"]
    for tolerance in TOLERANCES:
        other = diffeqsolve.by_diffeqsolve(scene, tolerance, SOLVER)
        error = judge(other.outcome(), scene)["time error"]
        programs[f"one trajectory, diffrax {SOLVER}, {tolerance:g}"] = other.seconds, error
    programs["one orbit, vijax"] = repeated(find), installed(partial(closing, find()))
    timed = in_turns({what: seconds for what, (seconds, _) in programs.items()}, 9 if full else 4)
    rows = [{"what": what, "error": programs[what][1], **found} for what, found in timed.items()]
    for row in rows:
        say(row)
    return rows


def of_dataset(ds: xr.Dataset) -> dict:
    """Impacts of a sweep, and the error of its first point."""
    return {"impacts": int(ds.num_impacts.sum()), "error": sweep_error(ds, golden())}


def of_fates(fates: diffeqsolve.Fate) -> dict:
    """Likewise, of the lanes of diffrax; the end of the scene is on their way."""
    found = diffeqsolve.outcome(nth(fates, 0)).impacts
    early = [row for row in found if row[0] <= golden()["t1"]]
    return {"impacts": int(fates.num_impacts.sum()), "error": time_error(early, exact_impacts(golden()))}


def simulated_error(sol: vx.Solution) -> float | None:
    """The largest error of an impact time of a trajectory."""
    log = sol.events
    columns = (
        np.asarray(a)[np.asarray(log.kind == vx.IMPACT)].tolist()
        for a in (log.t, log.stop, log.velocity_minus)
    )
    outcome = Outcome(list(zip(*columns, strict=True)), np.concatenate([sol.x1, sol.v1]))
    return judge(outcome, golden())["time error"]


def closing(orbit: vx.PeriodicOrbit) -> float:
    """How far from its beginning heyoka finds the end of an orbit."""
    begin = {"x0": np.asarray(orbit.x0), "v0": np.asarray(orbit.v0)}
    span = {"t0": 0.0, "t1": float(orbit.period)}
    end = peers.heyoka(golden() | begin | span, TIGHT, np.longdouble).outcome().end
    return float(np.max(np.abs(end - np.concatenate(list(begin.values())))))


@cache
def in_lanes() -> Callable[[float], diffeqsolve.Fate]:
    """All points at once by `diffeqsolve` with `Event`, of a tolerance."""
    scene = golden()
    run = diffeqsolve.with_events(SOLVER, diffeqsolve.masses(scene), room=ROOM)
    t0, _, y = start(scene)

    def one(tolerance: jax.Array, frequency: jax.Array) -> diffeqsolve.Fate:
        numbers = diffeqsolve.numbers(scene) | {"frequency": frequency}
        return run(numbers, t0, SHORT * 2 * np.pi / frequency, y, tolerance)

    lanes = jax.jit(jax.vmap(one, in_axes=(None, 0)))
    return lambda tolerance: lanes(jnp.asarray(tolerance), jnp.asarray(frequencies()))
