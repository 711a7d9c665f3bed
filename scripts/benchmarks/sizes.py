"""Larger machines: time against the number of masses and of stops.

Of a large machine no digits are known. So each has a small one beside it, coupled to nothing, whose
impacts are: both are one machine to the program, and the error is that of the small part, in the runs
that are timed.
"""

from functools import partial

import numpy as np

import vijax as vx

from .many import run_sweep
from .report import say
from .scenes import Scene, frequencies_around, load, machine, sweep_error
from .timing import Compilations, summary, times

ONE_MASS, TWO_MASSES = "n1_both_r07", "paper_a_om080"
POINTS, PERIODS = 128, 10
MASSES = [1, 2, 4, 5, 8, 12, 16, 20, 32, 50, 100, 200]
STOPS = [2, 4, 8, 16, 30]
# Span of one trajectory.
ALONE = 80.0
# The masses of the machine whose stops are counted.
OF_STOPS = 16


def masses(full: bool) -> list[dict]:
    """Time of a sweep, of one trajectory, and of compiling, against the number of masses, each with a stop."""
    rows = []
    for n in MASSES if full else (1, 2, 8, 20):
        scene = load(ONE_MASS if n == 1 else TWO_MASSES)
        rest = n - scene["n"]
        rows.append(measure(scene, rest, [vx.Stop(i, 0.3, "upper", 0.7) for i in range(rest)]))
    return rows


def stops(full: bool) -> list[dict]:
    """Likewise against the number of stops of sixteen masses: upper ones first, then lower ones too."""
    rows, scene = [], load(TWO_MASSES)
    rest = OF_STOPS - scene["n"]
    every = [vx.Stop(i, 0.3, "upper", 0.7) for i in range(rest)]
    every += [vx.Stop(i, -0.3, "lower", 0.7) for i in range(rest)]
    for count in STOPS if full else (4, 16):
        rows.append(measure(scene, rest, every[: count - len(scene["stops"])]))
    return rows


def measure(scene: Scene, rest: int, more: list[vx.Stop]) -> dict:
    """A sweep of a scene's machine and `rest` masses in a chain beside it, with stops of their own."""
    system = beside(scene, rest, more)
    run = partial(
        run_sweep, system, frequencies_around(scene, POINTS, 0.75, 1.25), transient=0, record=PERIODS
    )
    with Compilations() as compiling:
        ds = run()
    until = min(scene["t1"], PERIODS * 2 * np.pi / scene["Omega"])
    error = sweep_error(ds, {**scene, "t1": until, "events": [e for e in scene["events"] if e["t"] <= until]})
    row = {"masses": system.num_masses, "stops": system.num_stops, "error": error, **summary(times(run, 3))}
    steps = int(ds.steps.sum())
    row |= {
        "steps per period": steps / POINTS / PERIODS,
        "microseconds per step": 1e6 * row["min / s"] / steps,
    }
    alone = times(lambda: vx.simulate(system, 0.0, ALONE, max_events=1024).x1, 6)
    row |= {"one trajectory / ms": 1e3 * min(alone[1:]), "compiling / s": compiling.seconds}
    say(row)
    return row


def beside(scene: Scene, rest: int, more: list[vx.Stop]) -> vx.ImpactSystem:
    """A scene's machine and a chain of `rest` masses that are not coupled to it, as one machine."""
    small = machine(scene)
    if rest == 0:
        return small
    chain = vx.chain([1.0] * rest, [0.1] * rest, [1.0] * rest, vx.Harmonic([0.5] + [0.0] * (rest - 1), 1.0))
    load_ = vx.Harmonic([*scene["A"], 0.5, *[0.0] * (rest - 1)], scene["Omega"])
    n = scene["n"]
    own = [vx.Stop(n + int(s.mass), s.position, s.side, s.restitution) for s in more]
    damping, stiffness = (_diagonal(getattr(small, k), getattr(chain, k)) for k in ("damping", "stiffness"))
    return vx.ImpactSystem(np.ones(n + rest), damping, stiffness, load_, [*small.stops, *own])


def _diagonal(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Two square matrices as blocks of one."""
    a, b = np.asarray(a), np.asarray(b)
    return np.block([[a, np.zeros((len(a), len(b)))], [np.zeros((len(b), len(a))), b]])
