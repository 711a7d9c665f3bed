"""Programs that `faults.py` disturbs: each does some work in a folder, and leaves its results in `result`.

    python scripts/fault_victims.py KIND FOLDER

It prints `ready` when its imports are done, and `working` when its executor has started.
"""

import os
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import jax
import numpy as np

import vijax as vx

# A sweep of many small chunks: case (b) chatters and sticks at the first values, and is chaotic at the last.
VALUES = {"forcing.frequency": np.linspace(0.3, 2.1, 480)}
CHUNKS = vx.ExecutionSettings(cores=1, max_chunk=12, in_flight=4)


def sweep(**where: Any) -> dict[str, np.ndarray]:
    """The sweep that several kinds share; the numbers that it found."""
    system = vx.models.wagg_bishop_b(1.0)
    found = vx.sweep(system, VALUES, transient=60, record=12, progress=False, settings=CHUNKS, **where)
    return {str(name): column.values for name, column in found.data_vars.items() if name != "steps"}


def executor_of(kind: str, stack: ExitStack) -> Any:
    """An executor with two workers, or none."""
    if kind == "processes":
        return stack.enter_context(ProcessPoolExecutor(2, get_context("spawn")))
    if kind == "dask":
        from distributed import Client, LocalCluster

        cluster = stack.enter_context(LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0"))
        return stack.enter_context(Client(cluster))
    if kind == "mpi":
        from mpi4py.futures import MPIPoolExecutor

        return stack.enter_context(MPIPoolExecutor())
    return None


def single_run(folder: Path) -> dict[str, np.ndarray]:
    """A run and an orbit, with all programs in a folder of their own."""
    vx.keep_compiled(folder / "programs")
    system = vx.models.impact_oscillator(2.3, position=-0.2, restitution=0.6, damping_ratio=0.05)
    sol = vx.simulate(system, 0.0, 40.0, [-1.0], max_events=64)
    orbit = vx.periodic_orbit(system, [-1.56766], [0.771438], max_events=64)
    return {
        "t": np.asarray(sol.events.t),
        "x": np.asarray(sol.x1),
        "multipliers": np.asarray(orbit.multipliers),
    }


def main() -> None:
    """Do the work of one kind."""
    kind, folder = sys.argv[1], Path(sys.argv[2])
    jax.config.update("jax_enable_x64", True)
    print("ready", flush=True)
    with ExitStack() as stack:
        executor = executor_of(kind, stack)
        print("working", flush=True)
        if kind == "programs":
            found = single_run(folder)
        elif kind == "zarr":
            found = sweep(out=folder / "out")
        else:
            found = sweep(store=folder / "store", executor=executor)
        part = folder / f"part-{os.getpid()}"
        part.write_bytes(pickle.dumps(found))
        part.replace(folder / "result")


if __name__ == "__main__":
    main()
