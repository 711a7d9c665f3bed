"""Throughput and errors on the device that JAX takes first: a graphics card, if there is one, else the processor."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

import vijax as vx

from .report import say
from .scenes import GOLDEN, LIGHT_SCENE, ROOM, SHORT, frequencies_around, judge, load, machine, sweep_error
from .single import by_vijax, side_by_side
from .timing import Compilations, memory_high_water, summary, times

SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
# Trajectories at a time on a graphics card, which hides the time of its memory by many threads, and room for their records:
# at every visit of the host each lane needs a row. The processor has the sizes that `sweep` has by itself.
LANES, ROWS = 1 << 17, 1 << 20
# From this size on one run is timed, and memory told.
LARGE = 1_000_000
# Systems a second that MPGOS publishes, a program for graphics cards: with its own system, on its own card.
MPGOS = 4.1e3


@contextmanager
def first_device() -> Iterator[None]:
    """Work on the device that JAX takes first, not on the processor. The setting must be global: a sweep works in threads."""
    jax.config.update("jax_default_device", jax.devices()[0])
    try:
        yield
    finally:
        jax.config.update("jax_default_device", jax.devices("cpu")[0])


def accelerator(full: bool) -> list[dict]:
    """Throughput on the accelerator, if JAX sees one."""
    if jax.default_backend() == "cpu":
        print("JAX sees no accelerator.")
        return []
    with first_device():
        return throughput(SIZES if full else SIZES[:2], None)


def throughput(sizes: Sequence[int], lanes: int | None) -> list[dict]:
    """Sweeps, and as far as there is memory for their logs `simulate` under `jax.vmap`."""
    rows = []
    for points in sizes:
        runs = [partial(sweep_row, points, lanes)]
        if points < LARGE:
            runs.append(partial(batch_row, points))
        for run in runs:
            rows.append(hardware() | run())
            say(rows[-1])
    return rows


def hardware() -> dict[str, Any]:
    """Device and precision."""
    return {"device": jax.devices()[0].device_kind, "bits": 64 if jax.config.read("jax_enable_x64") else 32}


def settings_for(points: int, lanes: int | None) -> vx.ExecutionSettings:
    """Sizes of the queues of a sweep: of so many lanes, or what suits the device."""
    if lanes is None and jax.default_backend() == "cpu":
        return vx.ExecutionSettings()
    lanes = min(lanes or LANES, points)
    return vx.ExecutionSettings(lanes=lanes, points=lanes, impact_rows=ROWS, mark_rows=ROWS, cores=1)


def sweep_row(points: int, lanes: int | None) -> dict[str, Any]:
    """`sweep` over the frequency, 20 forcing periods each, all recorded, room for 16 impacts. The first point is a scene."""
    scene = load(LIGHT_SCENE)
    settings = settings_for(points, lanes)
    asked = {"transient": 0, "record": SHORT, "max_impacts": ROOM, "settings": settings, "progress": False}

    def run(points: int = points) -> xr.Dataset:
        with warnings.catch_warnings():  # logs are cut on purpose
            warnings.filterwarnings("ignore", ".* ended with max_impacts_reached", UserWarning)
            return vx.sweep(machine(scene), frequencies_around(scene, points), **asked)

    with Compilations() as compiling:  # the program depends on the settings alone
        found = [run(min(points, LANES))]
    seconds = times(lambda: found.append(run()), 3 if points < LARGE else 1)
    row = _rates("sweep", points, seconds, sweep_error(found[-1], scene))
    row |= {"compiling / s": compiling.seconds}
    return row if points < LARGE else row | {"memory high-water / MB": memory_high_water()}


def batch_row(points: int) -> dict[str, Any]:
    """Many starts of a scene by `simulate` under `jax.vmap`."""
    scene = load(LIGHT_SCENE)
    starts = jnp.linspace(0.0, -0.5, points)[:, None] * jnp.ones((1, 2))
    run = partial(side_by_side(machine(scene), scene["t0"], scene["t1"], jnp.zeros(2)), starts)
    with Compilations() as compiling:
        sol = jax.block_until_ready(run())
    end = np.concatenate([sol.x1[0], sol.v1[0]])
    error = float(np.max(np.abs(end - np.array([*scene["x1"], *scene["v1"]]))))
    row = _rates("vmap of simulate", points, times(run, 3), error)
    return row | {"compiling / s": compiling.seconds}


def _rates(by: str, points: int, seconds: list[float], error: float | None) -> dict[str, Any]:
    timed = summary(seconds)
    rate = points / timed["min / s"]
    row = {"by": by, "points": points, "error": error, **timed, "microseconds per point": 1e6 / rate}
    return row | {"systems per second": rate, "of MPGOS, published": MPGOS, "ratio": rate / MPGOS}


def scenes(names: Sequence[str] | None = None) -> list[dict]:
    """Errors of scenes, all that there are if none are named, each run by itself."""
    rows = []
    for name in names or sorted(path.stem for path in GOLDEN.glob("*.json")):
        scene = load(name)
        rows.append(hardware() | {"scene": name, **judge(by_vijax(scene).outcome(), scene)})
        say(rows[-1])
    return rows
