"""Simulations of few branches outside of their program: runs by the program of `simulate`, which a process has anyway."""

from collections.abc import Sequence as Many
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np

from .._jax.packing import Layout, Packed, pack
from .._machine.numbers import numbers_of
from .._orbits.search import run_request
from .._orbits.sequence import Instants, Sequence
from .._trajectory.instant_codes import instants_of
from .._trajectory.loop import LoopArguments
from .._trajectory.one_call import EVENTS, KnownMachine
from .._trajectory.solution import RESULTS
from .batches import BATCHES, RUNS_BEHIND, FamilyStack, Form, call, compiled, in_batches, stacked
from .kernels import Begun, RunRequest, SimulatedMotion, read_motion, run_from, simulate_motion
from .padding import room_of_log
from .parameter_family import ExtendedCycle, ParameterFamily


class RunReadings(NamedTuple):
    """Readings of a run: codes and times of its instants, flags of what holds, the number of rows, its success."""

    codes: Any
    times: Any
    held: Any
    count: Any
    is_successful: Any


_SUCCESS = np.asarray(RESULTS.successful._value)
# Rows of the program that reads runs: those of the tries of a call.
_ROWS = RUNS_BEHIND.tries


def simulated(
    stack: FamilyStack, tasks: Many[int], rows: list, form: Form | None = None
) -> dict[int, SimulatedMotion]:
    """Answers to requests for simulations, each a row of the arguments of `simulate_motion`, by kernels of a form."""
    form = form or stack.form(len(tasks))
    if form is BATCHES:
        return call(simulate_motion, stack, tasks, stacked(rows), form)
    runs = call(run_from, stack, tasks, stacked(rows))
    found = {}
    for task, (sequence, place, _) in zip(tasks, rows, strict=True):
        own = motions(
            stack, task, sequence, *jax.tree.map(lambda a: np.asarray(a)[None], (place, runs[task]))
        )
        found[task] = jax.tree.map(lambda a: a[0], own)
    return found


def motions(
    stack: FamilyStack, task: int, sequence: Sequence, places: ExtendedCycle, runs: RunRequest
) -> SimulatedMotion:
    """Motions of some runs of a task, from cycles of a sequence, with which they are compared; along the first axis of all."""
    num, room = len(runs.times), room_of_log(len(sequence.kind))
    readings = []
    for k in range(num):
        machine, times = runs.machine.at(k), runs.times[k]
        readings.append(
            _readings_of(machine, run_request(times[0], times[1], runs.begun.start[k], room), room)
        )
    one = stack.of([task])
    if None in readings:  # a program of its own has room for all
        starts = runs.begun.start
        rows = [(sequence, jax.tree.map(lambda a, k=k: a[k], places), starts[k]) for k in range(num)]
        return stacked([call(simulate_motion, stack, [task], stacked([row]))[task] for row in rows])
    filled = [min(k, num - 1) for k in range(_ROWS)]
    rows = jax.tree.map(
        lambda a: a[filled], (places, runs.begun, RunReadings(*map(np.stack, zip(*readings, strict=True))))
    )
    given = pack(jax.tree.map(lambda a: np.asarray(a)[None], (sequence, *rows)), has_rows=True)
    found = in_batches(compiled(read_runs, 1), 1, one, given)[0].unpacked()
    return jax.tree.map(lambda a: a[0, :num], found)


def read_runs(
    family: ParameterFamily, sequence: Sequence, places: ExtendedCycle, begun: Begun, readings: RunReadings
) -> SimulatedMotion:
    """Motions of runs that are made, along the first axis."""

    def read(place: ExtendedCycle, begun: Begun, readings: RunReadings) -> SimulatedMotion:
        kinds = numbers_of(family.system_at(place.p)).kinds
        instants = Instants(instants_of(readings.codes, readings.times, kinds), readings.held, readings.count)
        return read_motion(family, sequence, place, begun, instants, readings.is_successful)

    return jax.vmap(read)(places, begun, readings)


def _readings_of(machine: Packed, request: LoopArguments, room: int) -> RunReadings | None:
    """Make a run; None if it takes more than one call of the program."""
    if room > EVENTS:
        return None
    found = _known(machine.layout).follow(request, None, machine)
    progress = found.left.in_numpy().unpacked()
    if progress.is_paused:
        return None
    solution, restarts = found.solution, found.solution.restarts
    codes, times, held = (np.asarray(a)[: room + 2] for a in (found.codes, restarts.t, restarts.held))
    return RunReadings(codes, times, held, progress.rows, np.asarray(solution.result._value) == _SUCCESS)


@lru_cache
def _known(layout: Layout) -> KnownMachine:
    """Caller of the program for machines of a layout."""
    blank = Packed(*_sizes(layout), layout)
    return KnownMachine.of(blank)


def _sizes(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Packed zeros of a layout."""
    wholes, reals = (np.zeros(size, dtype) for size, dtype in zip(layout.sizes, layout.dtypes, strict=True))
    return reals, wholes
