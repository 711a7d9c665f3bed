"""The C++ programs: the scalar one that knows the paper's machine, and the one that measures the processor."""

import atexit
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from .scenes import RECORD, TRANSIENT, Outcome, Program, Scene

SCALAR = Path(__file__).parents[1] / "scalar_reference.cpp"


@cache
def compiled(source: Path) -> Path | None:
    """A C++ program, built for this machine, or None where there is no compiler."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        return None
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    program = Path(folder) / source.stem
    subprocess.run(
        [compiler, "-O3", "-march=native", "-ffast-math", "-o", str(program), str(source)], check=True
    )
    return program


def scalar(scene: Scene) -> Program | None:
    """The scalar C++ program on a scene of the paper's machine; None where there is no compiler."""
    program = compiled(SCALAR)
    if program is None:
        return None
    positions = [s["position"] for s in sorted(scene["stops"], key=lambda s: s["mass"])]
    numbers = map(repr, (*positions, scene["A"][0], scene["Omega"], scene["t1"]))
    command = [str(program), "trajectory", *numbers]

    def lines(repeats: int) -> list[list[str]]:
        done = subprocess.run([*command, str(repeats)], check=True, capture_output=True, text=True)
        return [line.split() for line in done.stdout.splitlines()]

    def outcome() -> Outcome:
        rows = lines(1)
        impacts = [
            (float(t), int(j), float(v))
            for name, *numbers in rows
            if name == "impact"
            for j, t, v in [numbers]
        ]
        end = next(numbers for name, *numbers in rows if name == "end")
        return Outcome(impacts, np.array(end, float))

    return Program(outcome, lambda repeats: [float(row[1]) for row in lines(repeats) if row[0] == "seconds"])


def scalar_sweep(
    program: Path, stops: tuple[float, float, float], frequencies: np.ndarray, cores: int
) -> None:
    """Run a sweep of a paper case by the scalar program: one process a core, their start included."""
    processes = []
    for k in range(cores):
        share = frequencies[k::cores]
        numbers = [*stops, share[0], share[-1], len(share), TRANSIENT, RECORD]
        arguments = [repr(float(a)) if isinstance(a, float) else str(a) for a in numbers]
        processes.append(subprocess.Popen([program, "sweep", *arguments], stdout=subprocess.DEVNULL))
    for process in processes:
        if process.wait() != 0:
            raise RuntimeError("The scalar program failed.")
