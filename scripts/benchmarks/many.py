"""Many trajectories: the paper's sweeps, throughput, what a chattering point costs."""

import multiprocessing
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import peers
import xarray as xr

import vijax as vx

from . import cpp
from .peak import floating_point_peak, operations_per_step, recorded_call
from .report import say
from .scenes import (
    FREQUENCY,
    LIGHT_SCENE,
    RECORD,
    ROOM,
    SHORT,
    TRANSIENT,
    Program,
    Scene,
    frequencies_around,
    judge,
    load,
    machine,
    scenes_of_case,
    sweep_error,
)
from .single import installed
from .timing import Compilations, in_turns, memory_high_water, num_cores, repeated, summary, times

# Machine, frequencies, and the two stops and the amplitude, of each case of the paper.
CASES: dict[str, tuple[Callable, np.ndarray, tuple[float, float, float]]] = {
    "a": (vx.models.wagg_bishop_a, np.linspace(0.2, 2.0, 721), (0.3, 0.3, 0.3)),
    "b": (vx.models.wagg_bishop_b, np.linspace(0.1, 2.5, 961), (-0.3, 0.1, 0.5)),
}
PERIODS = TRANSIENT + RECORD
HEYOKA_TOLERANCE = 1e-13
# Points from which on a size is run in a process of its own, to know its memory.
LARGE = 100_000
CHATTERING_SCENE, QUIET_SCENE = "paper_b_om020", "paper_b_om140"

# Logs are cut on purpose, where impacts are not what is measured.
warnings.filterwarnings("ignore", ".* ended with max_impacts_reached", UserWarning)
run_sweep = partial(vx.sweep, progress=False)


def sweeps(full: bool) -> list[dict]:
    """The paper's sweeps, 100 + 20 periods, from the call to the dataset, in turns with the scalar program.

    Errors are those of the scenes of the same machine, each run by itself. The scalar program runs as one
    process a core, their start included; heyoka likewise, but started and compiled, and in a quick
    run with every fourth frequency, the time in proportion.
    """
    rows, cores, program = [], num_cores(), cpp.compiled(cpp.SCALAR)
    for case, (build, frequencies, stops) in CASES.items():
        system, values = build(1.0), {FREQUENCY: frequencies}
        runs = {"vijax": repeated(partial(run_sweep, system, values))}
        errors = {"vijax": case_error(case)}
        if program is not None:
            runs["scalar C++"] = repeated(partial(cpp.scalar_sweep, program, stops, frequencies, cores))
            errors["scalar C++"] = peer_error(case, cpp.scalar)
        found = in_turns(runs, 15 if full else 7)
        if case == "a":  # in the other it falls through a stop
            seconds = installed(partial(heyoka_seconds, stops, frequencies, full))
            if seconds is not None:
                found["heyoka"] = summary(seconds)
                errors["heyoka"] = peer_error(case, partial(peers.heyoka, tolerance=HEYOKA_TOLERANCE))
        for method, timed in found.items():
            row = {
                "case": case,
                "method": method,
                "points": len(frequencies),
                "error": errors[method],
                **timed,
            }
            rows.append(row)
            say(row)
    return rows


def carried_sweeps(full: bool) -> list[dict]:
    """The same where every point starts where the one before it ended, in turns with the scalar program on one core.

    That program takes the points one after another too, and as long wherever they start.
    """
    rows, program = [], cpp.compiled(cpp.SCALAR)
    for case, (build, frequencies, stops) in CASES.items():
        run = partial(run_sweep, build(1.0), {FREQUENCY: frequencies}, carry="up")
        runs, errors = {"vijax": repeated(run)}, {"vijax": case_error(case)}
        if program is not None:
            runs["scalar C++, one core"] = repeated(partial(cpp.scalar_sweep, program, stops, frequencies, 1))
            errors["scalar C++, one core"] = peer_error(case, cpp.scalar)
        for method, timed in in_turns(runs, 9 if full else 4).items():
            rows.append({"case": case, "method": method, "error": errors[method], **timed})
            say(rows[-1])
    return rows


def solver_sweeps(full: bool) -> list[dict]:
    """The sweep of case (a) by `DiffraxFlow`, in turns with the exact motion."""
    build, frequencies, _ = CASES["a"]
    flows = {"exact": None, "DiffraxFlow": vx.DiffraxFlow()}
    runs = {
        name: repeated(partial(run_sweep, build(1.0), {FREQUENCY: frequencies}, flow=flow))
        for name, flow in flows.items()
    }
    rows = []
    for method, timed in in_turns(runs, 5 if full else 3).items():
        rows.append({"method": method, "error": case_error("a", flows[method]), **timed})
        say(rows[-1])
    return rows


def heyoka_seconds(stops: tuple[float, float, float], frequencies: np.ndarray, full: bool) -> list[float]:
    """Run times of a sweep by heyoka on all cores; by proportion from every fourth frequency if not full."""
    few = frequencies[:: 1 if full else 4]
    taken = peers.heyoka_sweep(
        partial(peers.wagg_bishop, stops), few, HEYOKA_TOLERANCE, num_cores(), 3 if full else 1
    )
    return [len(frequencies) / len(few) * seconds for seconds in taken]


def case_error(case: str, flow: vx.DiffraxFlow | None = None) -> float | None:
    """The largest error of an impact time of `sweep` on the scenes of a case; None if one was missed."""
    scenes, (build, frequencies, _) = scenes_of_case(case), CASES[case]
    values = np.resize([scene["Omega"] for scene in scenes], len(frequencies))  # compiled for this shape
    ds = run_sweep(build(1.0), {FREQUENCY: values}, transient=0, flow=flow)
    return worst([sweep_error(ds, scene, k) for k, scene in enumerate(scenes)])


def peer_error(case: str, build: Callable[[Scene], Program | None]) -> float | None:
    """Likewise, of a peer."""
    programs = [(build(scene), scene) for scene in scenes_of_case(case)]
    return worst([judge(p.outcome(), scene)["time error"] for p, scene in programs if p is not None])


def worst(errors: list[float | None]) -> float | None:
    """The largest, or None if there is any None."""
    known = [error for error in errors if error is not None]
    return max(known) if len(known) == len(errors) else None


def work(full: bool) -> list[dict]:
    """What the steps of the paper's sweeps are spent on, and how far that is from the processor's peak."""
    rows = []
    for case, (build, frequencies, _) in CASES.items():
        system, values = build(1.0), {FREQUENCY: frequencies}
        with recorded_call() as calls:
            every = run_sweep(system, values, transient=0, record=PERIODS, max_impacts=0)
        timed = summary(times(partial(run_sweep, system, values), 9 if full else 4))
        peak = floating_point_peak()
        lane_steps, steps = every.steps.attrs["lane_steps"], int(every.steps.sum())
        operations = operations_per_step(calls[0])
        rate = operations * lane_steps / timed["min / s"] / 1e9
        row = {"case": case, "error": case_error(case), **timed}
        row |= {"steps per period": steps / len(frequencies) / PERIODS}
        row |= {"steps per impact": steps / int(every.num_impacts.sum())}
        row |= {"wasted lane-steps": 1 - steps / lane_steps}
        row |= {"nanoseconds per step and core": 1e9 * timed["min / s"] * num_cores() / steps}
        row |= {"operations per step": operations, "GFLOP/s": rate}
        row |= {"peak GFLOP/s": peak.rate, "share of peak": rate / peak.rate, "peak measured by": peak.how}
        rows.append(row)
        say(row)
    return rows


def throughput(full: bool) -> list[dict]:
    """Time against the number of points, 20 forcing periods each, all recorded, room for 16 impacts."""
    rows = []
    for points in [1, 10, 100, 1000, 10_000, 100_000, 1_000_000] if full else [1, 100, 1000, 10_000]:
        rows.append(in_fresh_process(points) if points >= LARGE else throughput_row(points))
        say(rows[-1])
    return rows


def throughput_row(points: int) -> dict:
    """One size. The first point is a scene."""
    scene = load(LIGHT_SCENE)
    run = partial(
        run_sweep,
        machine(scene),
        frequencies_around(scene, points),
        transient=0,
        record=SHORT,
        max_impacts=ROOM,
    )
    with Compilations() as compiling:
        ds = run() if points < LARGE else warm_up()
    before = memory_high_water()
    seconds, kept = [], []
    for _ in range(5 if points < LARGE else 1):
        seconds += times(lambda: kept.append(run()), 1)
        ds = kept.pop()
    row = {"points": points, "error": sweep_error(ds, scene), **summary(seconds)}
    row |= {"microseconds per point": 1e6 * min(seconds) / points, "compiling / s": compiling.seconds}
    if points >= LARGE:
        row |= {"memory before / MB": before, "memory high-water / MB": memory_high_water()}
        row |= {"dataset / MB": ds.nbytes / 1e6}
    return row


def warm_up() -> xr.Dataset:
    """A sweep of the shape of all large ones."""
    scene = load(LIGHT_SCENE)
    values = frequencies_around(scene, 4096)
    return run_sweep(machine(scene), values, transient=0, record=1, max_impacts=ROOM)


def in_fresh_process(points: int) -> dict:
    """A size by itself: the high-water mark of memory belongs to a process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(throughput_row, points).result()


def chattering_point(full: bool) -> list[dict]:
    """What a point that chatters costs among 999 that do not. It, or else the first of them, is a scene."""
    rows, quiet = [], load(QUIET_SCENE)
    others = frequencies_around(quiet, 1000, 1.5, 1.8)[FREQUENCY]
    runs, errors = {}, {}
    for name, scene in (("quiet", quiet), ("one chatters", load(CHATTERING_SCENE))):
        values = {FREQUENCY: np.append(scene["Omega"], others[1:])}
        runs[name] = partial(run_sweep, machine(scene), values, transient=0, record=25)
        errors[name] = sweep_error(runs[name](), scene)
    found = in_turns({name: repeated(run) for name, run in runs.items()}, 9 if full else 5)
    for name, timed in found.items():
        row = {"points": name, "error": errors[name], **timed}
        row["ratio"] = timed["min / s"] / found["quiet"]["min / s"]
        rows.append(row)
        say(row)
    return rows
