"""Sweeps by an executor: how well they scale beside threads, and what a chunk costs beside its points."""

import multiprocessing
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial

import vijax as vx

from .many import run_sweep
from .report import say
from .scenes import LIGHT_SCENE, ROOM, frequencies_around, load, machine, sweep_error
from .timing import in_turns, num_cores, repeated, summary, times

# Forcing periods of each point, as in the paper's sweeps.
PERIODS = 120
# Points of as many chunks, to see what a chunk costs that hardly computes anything.
CHUNKS = 64


def executors(full: bool) -> list[dict]:
    """A sweep by as many processes as cores, in turns with threads, all of them started and compiled.

    The efficiency is the time of threads by that of processes. What a chunk costs is the time of a sweep of points that take no time,
    each a chunk of its own, for every core and chunk: sending, beginning a queue, what comes back.
    """
    scene, rows, cores = load(LIGHT_SCENE), [], num_cores()
    with ProcessPoolExecutor(cores, multiprocessing.get_context("spawn")) as pool:
        for points in (8192, 65536) if full else (8192,):
            values = frequencies_around(scene, points)
            run = partial(run_sweep, machine(scene), values, transient=0, record=PERIODS, max_impacts=ROOM)
            runs = {"threads": partial(run, executor=None), "processes": partial(run, executor=pool)}
            errors = {name: sweep_error(one(), scene) for name, one in runs.items()}
            found = in_turns({name: repeated(one) for name, one in runs.items()}, 5 if full else 3)
            for name, timed in found.items():
                row = {"by": name, "cores": cores, "points": points, "error": errors[name], **timed}
                row["efficiency"] = found["threads"]["min / s"] / timed["min / s"]
                rows.append(row)
                say(row)
        rows.append(of_a_chunk(pool, cores))
        say(rows[-1])
    return rows


def of_a_chunk(executor: Executor, cores: int) -> dict:
    """What a chunk costs beside its points. They run too short to have an error."""
    scene = load(LIGHT_SCENE)
    asked = {"transient": 0, "record": 1, "max_impacts": ROOM, "executor": executor}
    small = vx.ExecutionSettings(max_chunk=1, min_chunk=1, cores=cores)
    run = partial(run_sweep, machine(scene), frequencies_around(scene, CHUNKS), **asked, settings=small)
    run()
    timed = summary(times(run, 5))
    return {
        "by": "processes",
        "chunks": CHUNKS,
        **timed,
        "ms per chunk": 1e3 * timed["min / s"] * cores / CHUNKS,
    }
