"""Clocks: runs, compilations, memory."""

import os
import resource
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import jax
import numpy as np

# A turn of a short run is repeated for so many seconds, to see it in a warm cache.
_TURN = 0.02
# What JAX calls the stages of a compilation.
_STAGES = {
    "/jax/core/compile/jaxpr_trace_duration": "traced",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowered",
    "/jax/core/compile/backend_compile_duration": "compiled",
}


def times(function: Callable[[], object], repeats: int) -> list[float]:
    """Seconds that every one of some runs takes."""
    found = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(function())
        found.append(time.perf_counter() - start)
    return found


def cpu_seconds(run: Callable[[], object], who: int = resource.RUSAGE_SELF) -> float:
    """CPU time of a run, of this process or of those that it starts."""
    before = resource.getrusage(who)
    times(run, 1)
    after = resource.getrusage(who)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def summary(seconds: list[float]) -> dict[str, float]:
    """Minimum and median."""
    return {"min / s": min(seconds), "median / s": float(np.median(seconds))}


def in_turns(runs: dict[str, Callable[[int], list[float]]], rounds: int) -> dict[str, dict[str, float]]:
    """Time several programs, one after another in every round: a noisy machine is then as noisy for all.

    Args:
        runs: for each the function that runs it a number of times and returns the seconds of each.
        rounds: turns of each.

    Returns:
        Minimum and median of each.
    """
    found: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            first = run(1)
            found[name] += first + run(min(20, int(_TURN / first[0])))
    return {name: summary(seconds) for name, seconds in found.items()}


def repeated(function: Callable[[], object]) -> Callable[[int], list[float]]:
    """A function as `in_turns` wants it."""
    return lambda repeats: times(function, repeats)


class Compilations:
    """What is compiled while this is entered: the number of programs and the seconds of every stage."""

    def __enter__(self) -> "Compilations":
        self._start = len(_durations())
        return self

    def __exit__(self, *_: object) -> None:
        events = _durations()[self._start :]
        self.programs = sum(stage == "compiled" for stage, _ in events)
        self.traces = sum(stage == "traced" for stage, _ in events)
        self.seconds = sum(duration for _, duration in events)


@cache
def _durations() -> list[tuple[str, float]]:
    """Stages of all compilations from the first call on, in their order; JAX appends to it."""
    events: list[tuple[str, float]] = []

    def listen(event: str, duration_secs: float, **_: str | int) -> None:
        if event in _STAGES:
            events.append((_STAGES[event], duration_secs))

    jax.monitoring.register_event_duration_secs_listener(listen)
    return events


def memory_high_water() -> float:
    """The most memory that this process ever had, in MB."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def memory_maps() -> int:
    """The memory maps of this process, where the system tells them."""
    maps = Path("/proc/self/maps")
    return len(maps.read_text().splitlines()) if maps.exists() else 0


def num_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
