"""How far a sweep is from what the processor can do.

The floating-point operations of one turn of the loop over lanes are counted in its compiled text, where XLA
has already removed, fused and repeated what it will. An addition, multiplication, division or square root
is one operation, however long it takes; comparisons, choices, minima and whole numbers are none. Of the
branches of a conditional the longer one is counted.
"""

import math
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from vijax._execution import lane_queue, threads

from . import cpp
from .timing import num_cores, times

_SOURCE = Path(__file__).parent / "peak.cpp"
_ONE = (
    "add",
    "subtract",
    "multiply",
    "divide",
    "sqrt",
    "rsqrt",
    "power",
    "exponential",
    "log",
    "sine",
    "cosine",
)
_SHAPE = re.compile(r"\s*(?:ROOT )?%(\S+) = (f\d+|\w+)\[([\d,]*)\]\S* ([\w-]+)\(%?([\w.-]*)")
_CALLED = re.compile(r"(?:calls|to_apply|body|true_computation|false_computation)=%([\w.-]+)")
_BRANCHES = re.compile(r"branch_computations=\{([^}]*)\}")
_TRIPS = re.compile(r'known_trip_count":\{"n":"(\d+)"')
# A side of the matrix product that stands for the peak where there is no compiler.
_SIDE = 2048


class Peak(NamedTuple):
    """The most floating-point operations a second, in 1e9, of all cores together, and how they were had."""

    rate: float
    how: str


def floating_point_peak() -> Peak:
    """Measure it, all cores at work at once."""
    program, cores = cpp.compiled(_SOURCE), num_cores()
    if program is not None:
        running = [subprocess.Popen([program], stdout=subprocess.PIPE, text=True) for _ in range(cores)]
        rate = sum(float(process.communicate()[0]) for process in running)
        return Peak(rate, f"multiply-adds in registers, {cores} processes")
    matrix = np.ones((_SIDE, _SIDE))
    seconds = min(times(lambda: matrix @ matrix, 5))
    return Peak(2 * _SIDE**3 / seconds / 1e9, "matrix product of NumPy")


@contextmanager
def recorded_call() -> Iterator[list[tuple]]:
    """The arguments of the loop over lanes in sweeps that are run while this is entered."""
    calls: list[tuple] = []
    original = threads.run_lanes

    def record(*args: Any) -> Any:
        calls.append(args)
        return original(*args)

    threads.run_lanes = record
    try:
        yield calls
    finally:
        threads.run_lanes = original


def operations_per_step(args: tuple) -> float:
    """Floating-point operations of one step of one lane, of a recorded call."""
    with jax.numpy_rank_promotion("allow"):
        program = lane_queue.lane_programs.compiled(*args)
    return operations_per_turn(program.as_text()) / args[-1].point.size


def operations_per_turn(text: str) -> float:
    """Floating-point operations of one turn, without the loops inside it that find and write the few impacts."""
    bodies = _computations(text)
    loops = [line for lines in bodies.values() for line in lines if " while(" in line]
    inner = [body for line in loops if not _TRIPS.search(line) for body in _CALLED.findall(line)]
    return max(_count(body, bodies) for body in inner if _loops_inside(body, bodies) <= 2)


def _computations(text: str) -> dict[str, list[str]]:
    """The lines of every computation."""
    bodies: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in text.splitlines():
        if line.endswith("{") and (line.startswith(("%", "ENTRY"))):
            lines = bodies.setdefault(line.removeprefix("ENTRY ").split()[0].lstrip("%"), [])
        elif line.startswith(" "):
            lines.append(line)
    return bodies


def _callees(line: str) -> list[str]:
    """Computations that a line calls, those of a conditional too."""
    branches = [name.strip().lstrip("%") for found in _BRANCHES.findall(line) for name in found.split(",")]
    return _CALLED.findall(line) + branches


def _loops_inside(name: str, bodies: dict[str, list[str]]) -> int:
    """How deep loops of unknown length are nested inside."""
    depths = [
        (" while(" in line and not _TRIPS.search(line)) + _loops_inside(callee, bodies)
        for line in bodies[name]
        for callee in _callees(line)
    ]
    return max(depths, default=0)


def _count(name: str, bodies: dict[str, list[str]]) -> float:
    """Operations of one call of a computation."""
    total, shapes = 0.0, {}
    for line in bodies[name]:
        match = _SHAPE.match(line)
        if match is not None:
            result, kind, shape, operation, operand = match.groups()
            shapes[result] = [int(k) for k in shape.split(",") if k]
            if kind.startswith("f"):
                total += _own(operation, shapes[result], shapes.get(operand, []), line, bodies)
        if " conditional(" in line:
            total += max(_count(branch, bodies) for branch in _callees(line))
        elif any(f" {kind}(" in line for kind in ("fusion", "call", "while")):
            trips = _TRIPS.search(line)
            total += (int(trips[1]) if trips else 1) * sum(_count(c, bodies) for c in _callees(line))
    return total


def _own(
    operation: str, shape: list[int], operand: list[int], line: str, bodies: dict[str, list[str]]
) -> float:
    """Operations of one line, without those of what it calls, from the shapes of it and its first operand."""
    if operation in _ONE:
        return math.prod(shape)
    if operation == "reduce" and any(_count(c, bodies) for c in _callees(line)):
        return math.prod(operand) - math.prod(shape)
    if operation == "dot":
        summed = re.findall(r"lhs_contracting_dims=\{([\d,]*)\}", line)[0].split(",")
        return 2 * math.prod(shape) * math.prod(operand[int(k)] for k in summed if k)
    return 0
