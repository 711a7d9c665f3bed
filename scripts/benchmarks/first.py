"""How long one waits for a first result: in a fresh process, with and without JAX's cache on disk.

python -m benchmarks.first simulate     # in scripts/: what the fresh process runs; prints JSON
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

import vijax as vx

from .report import say
from .scenes import FREQUENCY, GOLDEN, Outcome, Scene, judge, load, machine, sweep_error
from .timing import Compilations, memory_maps

SCENE, POINTS = "paper_b_om110", 1000
# A scene with known derivatives.
KNOWN = GOLDEN.parent / "golden_derivatives" / "paper_b_om030.json"
SCRIPTS = Path(__file__).parents[1]
# What is timed, and from what it returns its error.
Timed = tuple[Callable[[], Any], Callable[[Any], float | None]]


def first_results(full: bool) -> list[dict]:
    """Seconds from the start of Python to a first result, and how much of them is that call; then a second.

    The second call is with other values of the same shape: what is traced and compiled in it is counted. CPU seconds are
    those of the first call on all cores; of memory maps, of which a process has some 65,000, those that it leaves.
    """
    rows = []
    for what in RUNS:
        with tempfile.TemporaryDirectory() as folder:
            caches = {"none": None} | (
                {"being filled": folder, "filled": folder} if full or what == "sweep" else {}
            )
            for cache, path in caches.items():
                rows.append({"what": what, "cache": cache, **in_fresh_process(what, path)})
                say(rows[-1])
    return rows


def in_fresh_process(what: str, cache: str | None) -> dict:
    """Run this file in a process of its own."""
    place = os.pathsep.join(filter(None, [str(SCRIPTS), os.environ.get("PYTHONPATH")]))
    settings = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"} | {
        "PYTHONPATH": place
    }
    if cache is not None:
        settings["JAX_COMPILATION_CACHE_DIR"] = cache
    start = time.perf_counter()
    command = [sys.executable, "-m", "benchmarks.first", what]
    done = subprocess.run(command, env=settings, check=True, stdout=subprocess.PIPE, text=True)
    whole = time.perf_counter() - start
    told = json.loads(done.stdout.splitlines()[-1])
    return {"error": told.pop("error"), "process / s": whole - told["second / s"], **told}


def simulate(scene: Scene) -> Timed:
    """One trajectory."""

    def error(sol: vx.Solution) -> float | None:
        log, kept = sol.events, np.asarray(sol.events.kind == vx.IMPACT)
        columns = (np.asarray(a)[kept].tolist() for a in (log.t, log.stop, log.velocity_minus))
        outcome = Outcome(list(zip(*columns, strict=True)), np.concatenate([sol.x1, sol.v1]))
        return judge(outcome, load(SCENE))["time error"]

    system = machine(scene)
    return lambda: vx.simulate(system, scene["t0"], scene["t1"]), error


def evaluate(scene: Scene) -> Timed:
    """The state between events, of a trajectory that is there."""
    sol = vx.simulate(machine(scene), scene["t0"], scene["t1"])
    times = np.linspace(scene["t0"], scene["t1"], 100)
    return lambda: sol.evaluate(times)[0], lambda x: float(
        np.abs(np.asarray(x[-1]) - load(SCENE)["x1"]).max()
    )


def sweep(scene: Scene) -> Timed:
    """The frequency of a scene, and others."""
    values, system = {FREQUENCY: np.append(scene["Omega"], np.linspace(0.6, 1.4, POINTS - 1))}, machine(scene)
    run = lambda: vx.sweep(system, values, transient=0, progress=False)  # noqa: E731
    return run, lambda ds: sweep_error(ds, load(SCENE))


def monodromy_matrix(scene: Scene) -> Timed:
    """The derivative of a forcing period; its determinant is known."""
    system, n = machine(scene), len(scene["x0"])
    start = vx.simulate(system, 0.0, 20 * 2 * np.pi / scene["Omega"])

    def error(matrix: jax.Array) -> float:
        hit = vx.simulate(system, 0.0, 2 * np.pi / scene["Omega"], start.x1, start.v1).events
        restitution = np.array([stop["restitution"] for stop in scene["stops"]])
        factors = restitution[np.asarray(hit.stop)[np.asarray(hit.kind == vx.IMPACT)]] ** 2
        loss = (
            np.trace(np.linalg.solve(np.diag(scene["M"]), np.array(scene["C"]))) * 2 * np.pi / scene["Omega"]
        )
        return float(abs(np.linalg.det(matrix) / (np.exp(-loss) * factors.prod()) - 1))

    assert start.x1.shape == (n,)
    return lambda: vx.monodromy_matrix(system, start.x1, start.v1, 1), error


def forward(scene: Scene) -> Timed:
    """Derivatives of an end state by the start, forward."""
    return _derivatives(scene, jax.jacfwd)


def reverse(scene: Scene) -> Timed:
    """Likewise in reverse."""
    return _derivatives(scene, jax.jacrev)


def _derivatives(scene: Scene, mode: Callable) -> Timed:
    known = json.loads(KNOWN.read_text())
    own = known["scene"]
    system = machine(own | {"Omega": own["Omega"] * scene["Omega"] / load(SCENE)["Omega"]})
    x0, v0 = np.array(own["x0"]), np.array(own["v0"])
    end = lambda x: vx.simulate(system, own["t0"], own["t1"], x, v0).x1  # noqa: E731
    truth = np.array([known["d"][f"x0[{j}]"]["x1"] for j in range(len(x0))]).T
    return lambda: mode(end)(x0), lambda matrix: float(np.abs(matrix / truth - 1).max())


RUNS = {run.__name__: run for run in (simulate, evaluate, sweep, monodromy_matrix, forward, reverse)}


def main() -> None:
    """A first result, and a second one of other values."""
    told: dict = {}
    for name, change in (("first", 1.0), ("second", 1.01)):
        scene = load(SCENE)
        run, error = RUNS[sys.argv[1]](scene | {"Omega": change * scene["Omega"]})
        maps, cpu, start = memory_maps(), time.process_time(), time.perf_counter()
        with Compilations() as compilations:
            found = jax.block_until_ready(run())
        told |= {f"{name} / s": time.perf_counter() - start}
        if name == "first":
            told |= {"CPU / s": time.process_time() - cpu, "memory maps": memory_maps() - maps}
            told["error"] = error(found)
        told |= {
            f"traced, {name}": compilations.traces,
            f"compiled or fetched, {name}": compilations.programs,
        }
    print(json.dumps(told))


if __name__ == "__main__":
    main()
