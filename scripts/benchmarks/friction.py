"""Dry friction: sweeps beside the scalar C++ of one machine, and a single motion beside regularised friction.

The machine is x'' + c x' + x = A cos(W t) - F sgn(x'). Errors are those of a golden scene of it, which sticks twice a
period. Regularised friction is F tanh(x' / eps), as users write it: it never sticks, and its error is that of eps.
"""

import json
import resource
import subprocess
from collections.abc import Callable
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import vijax as vx

from . import cpp
from .many import run_sweep
from .report import say
from .scenes import FREQUENCY, GOLDEN, RECORD, TRANSIENT, Scene
from .timing import cpu_seconds, repeated, summary

FRICTION = cpp.SCALAR.with_name("friction_reference.cpp")
SCENE = "forced_sticks"
FREQUENCIES = np.linspace(0.3, 1.7, 1000)
# Widths of the regularisation, as speeds, and tolerances that are small beside their errors.
WIDTHS = {1e-2: 1e-7, 1e-3: 1e-8, 1e-4: 1e-9, 1e-5: 1e-10}


def friction_sweeps(full: bool) -> list[dict]:
    """A sweep of 1000 frequencies, 100 + 20 periods, on one core each: CPU time, in turns with the scalar program.

    `largest difference` is that of the states at the ends of all points between both.
    """
    system, program = machine(golden()), cpp.compiled(FRICTION)
    sweep = partial(run_sweep, system, {FREQUENCY: FREQUENCIES}, settings=vx.ExecutionSettings(cores=1))
    ds, seconds = sweep(), {"vijax": [], "scalar C++": []}
    ends = None if program is None else scalar_ends(program)
    for _ in range(15 if full else 7):
        seconds["vijax"].append(cpu_seconds(sweep, resource.RUSAGE_SELF))
        if program is not None:
            run = partial(scalar_sweep, program, "sweep")
            seconds["scalar C++"].append(cpu_seconds(run, resource.RUSAGE_CHILDREN))
    own = np.stack([ds[name].values.reshape(len(FREQUENCIES), -1)[:, -1] for name in ("x", "v")])
    rows, errors = [], {"vijax": exact_error(), "scalar C++": scalar_error(program)}
    sticks = {"vijax": int(ds.num_friction_sticks.sum())}
    if ends is not None:
        sticks["scalar C++"] = int(ends[1].sum())
    for method, taken in seconds.items():
        if not taken:
            continue
        row: dict[str, Any] = {"method": method, "points": len(FREQUENCIES), "sticks": sticks[method]}
        row |= {"error": errors[method], **summary(taken)}
        if method == "vijax" and ends is not None:
            row["largest difference"] = float(np.max(np.abs(own - ends[3:])))
            row["times faster"] = float(np.median(seconds["scalar C++"]) / np.median(taken))
        rows.append(row)
        say(row)
    return rows


def friction_precision(full: bool) -> list[dict]:
    """Time against error of the state at the end of the golden scene: exact, and regularised in diffrax and SciPy."""
    scene, rows = golden(), []
    runs: dict[tuple[str, float | None], Callable[[], np.ndarray]] = {("vijax", None): exact_end}
    for width, tolerance in WIDTHS.items():
        for method in ("LSODA", "Radau"):
            runs[f"SciPy {method}, tanh", width] = partial(scipy_end, method, width, tolerance)
        for solver in (diffrax.Tsit5(), diffrax.Kvaerno5()):
            name = f"diffrax {type(solver).__name__}, tanh"
            runs[name, width] = partial(diffrax_end, solver, width, tolerance)
    truth = np.array([*scene["x1"], *scene["v1"]])
    for (method, width), run in runs.items():
        error = float(np.max(np.abs(run() - truth)))
        row = {"method": method, "width": width, "error": error, **summary(repeated(run)(5 if full else 2))}
        rows.append(row)
        say(row)
    return rows


def golden() -> Scene:
    """The scene, to 36 digits."""
    return json.loads((GOLDEN.parent / "golden_switching" / f"{SCENE}.json").read_text())


def machine(scene: Scene) -> vx.ImpactSystem:
    """The machine of the scene, for vijax."""
    (element,) = scene["friction"]
    mass, load = np.diag(scene["M"]), vx.Harmonic(scene["A"], scene["Omega"])
    friction = [vx.Friction(0, element["force"], static=element["static"])]
    return vx.ImpactSystem(mass, scene["C"], scene["K"], load, [], friction=friction)


def exact_end() -> np.ndarray:
    """State at the end of the scene by `simulate`."""
    scene = golden()
    sol = vx.simulate(machine(scene), scene["t0"], scene["t1"], scene["x0"], scene["v0"])
    return np.array([*np.asarray(sol.x1), *np.asarray(sol.v1)])


def exact_error() -> float:
    """Largest error of x and v of the scene at the end of a whole number of periods in `sweep`, by its golden events."""
    scene = golden()
    periods = int(scene["t1"] * scene["Omega"] / (2 * np.pi))
    values = np.resize(scene["Omega"], len(FREQUENCIES))
    ds = run_sweep(
        machine(scene), {FREQUENCY: values}, transient=0, record=periods, x0=scene["x0"], v0=scene["v0"]
    )
    until = 2 * np.pi * periods / scene["Omega"]
    # From there `simulate` goes on to the known end.
    start = {name: ds[name].values.reshape(len(values), -1)[0, -1] for name in ("x", "v")}
    sol = vx.simulate(machine(scene), until, scene["t1"], start["x"][None], start["v"][None])
    end = np.array([*np.asarray(sol.x1), *np.asarray(sol.v1)])
    return float(np.max(np.abs(end - np.array([*scene["x1"], *scene["v1"]]))))


def arguments(scene: Scene) -> list[str]:
    """Numbers of the machine, for the scalar program."""
    (element,) = scene["friction"]
    numbers = scene["M"][0][0], scene["C"][0][0], scene["K"][0][0], scene["A"][0]
    return [repr(float(a)) for a in (*numbers, element["force"], element["static"])]


def scalar_sweep(program, what: str) -> str:
    """What the scalar program prints of the sweep."""
    numbers = [repr(float(FREQUENCIES[0])), repr(float(FREQUENCIES[-1])), str(len(FREQUENCIES))]
    command = [str(program), what, *arguments(golden()), *numbers, str(TRANSIENT), str(RECORD)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def scalar_ends(program) -> np.ndarray:
    """Turns, sticks, slips, x and v at the end of each point, (5, points)."""
    return np.array([line.split() for line in scalar_sweep(program, "ends").splitlines()], float).T


def scalar_error(program) -> float | None:
    """Largest error of x and v of the scalar program at the end of the scene."""
    if program is None:
        return None
    scene = golden()
    numbers = [repr(float(scene[name])) for name in ("Omega", "t1")]
    start = [repr(float(scene[name][0])) for name in ("x0", "v0")]
    command = [str(program), "trajectory", *arguments(scene), *numbers, *start, "1"]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    end = next(line.split()[1:] for line in lines if line.startswith("end"))
    return float(np.max(np.abs(np.array(end, float) - np.array([*scene["x1"], *scene["v1"]]))))


def _rate(scene: Scene, width: float, library: Any) -> Callable:
    load, drag, spring = scene["A"][0], scene["C"][0][0], scene["K"][0][0]
    force = scene["friction"][0]["force"]

    def rate(t, y, args=None):
        del args
        x, v = y
        pull = load * library.cos(scene["Omega"] * t) - drag * v - spring * x
        return library.stack([v, pull - force * library.tanh(v / width)])

    return rate


def scipy_end(method: str, width: float, tolerance: float) -> np.ndarray:
    """State at the end of the scene with regularised friction, by a stiff solver of SciPy."""
    scene = golden()
    start = np.array([*scene["x0"], *scene["v0"]])
    span = scene["t0"], scene["t1"]
    sol = solve_ivp(
        _rate(scene, width, np), span, start, method=method, rtol=tolerance, atol=tolerance, max_step=0.1
    )
    return sol.y[:, -1]


def diffrax_end(solver: diffrax.AbstractSolver, width: float, tolerance: float) -> np.ndarray:
    """State at the end of the scene with regularised friction, by diffrax."""
    scene = golden()
    return np.asarray(_compiled(solver, width, tolerance)(jnp.array([*scene["x0"], *scene["v0"]])))


_programs: dict[tuple, Callable] = {}


def _compiled(solver: diffrax.AbstractSolver, width: float, tolerance: float) -> Callable:
    key = type(solver).__name__, width, tolerance
    if key not in _programs:
        scene = golden()
        term = diffrax.ODETerm(_rate(scene, width, jnp))
        controller = diffrax.PIDController(rtol=tolerance, atol=tolerance, dtmax=0.1)

        def end(y):
            options = {"stepsize_controller": controller, "max_steps": 10_000_000}
            solved = diffrax.diffeqsolve(term, solver, scene["t0"], scene["t1"], 1e-4, y, **options)
            return jnp.asarray(solved.ys)[-1]

        _programs[key] = jax.jit(end)
    return _programs[key]
