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

from .report import say
from .scenes import FREQUENCY, Outcome, judge, load, machine, sweep_error

SCENE = "paper_b_om110"
POINTS = 1000
SCRIPTS = Path(__file__).parents[1]


def first_results(full: bool) -> list[dict]:
    """Seconds from the start of Python to a first result, and how much of them is that call; then a second.

    The second call is with other values of the same shape: what is traced and compiled in it is counted.
    """
    rows = []
    for what in ("simulate", "sweep") if full else ("sweep",):
        with tempfile.TemporaryDirectory() as folder:
            caches = {"none": None, "being filled": folder, "filled": folder}
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


def main() -> None:
    """A first result, and a second one of other values."""
    import numpy as np

    import vijax as vx

    from .timing import Compilations

    scene = load(SCENE)

    def simulate(frequency: float) -> float | None:
        sol = vx.simulate(machine(scene | {"Omega": frequency}), scene["t0"], scene["t1"])
        log, kept = sol.events, np.asarray(sol.events.kind == vx.IMPACT)
        columns = (np.asarray(a)[kept].tolist() for a in (log.t, log.stop, log.velocity_minus))
        outcome = Outcome(list(zip(*columns, strict=True)), np.concatenate([sol.x1, sol.v1]))
        return judge(outcome, scene)["time error"]

    def sweep(frequency: float) -> float | None:
        values = {FREQUENCY: np.append(frequency, np.linspace(0.6, 1.4, POINTS - 1))}
        return sweep_error(vx.sweep(machine(scene), values, transient=0, progress=False), scene)

    run: Callable[[float], float | None] = {"simulate": simulate, "sweep": sweep}[sys.argv[1]]
    told: dict = {}
    for name, frequency in (("first", scene["Omega"]), ("second", 1.01 * scene["Omega"])):
        start = time.perf_counter()
        with Compilations() as compilations:
            error = run(frequency)
        told |= {f"{name} / s": time.perf_counter() - start}
        told |= {
            f"traced, {name}": compilations.traces,
            f"compiled or fetched, {name}": compilations.programs,
        }
        told.setdefault("error", error)
    print(json.dumps(told))


if __name__ == "__main__":
    main()
