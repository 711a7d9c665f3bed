"""Where the CPU time of a first result goes: tracing, lowering, XLA, running; and how many programs of which size it needs.

python -m benchmarks.waits branch       # in scripts/: what the fresh process runs; prints JSON

CPU time counts, not the clock: it is the same within some tenths on a busy machine. Every call has a process and an
empty store of its own; a branch contains the orbit from which it starts. "second" is a process that finds the store filled.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import process_time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import vijax as vx
from vijax._jax.programs import Programs

from .report import say
from .timing import Compilations

SCRIPTS = Path(__file__).parents[1]
FREQUENCY = "forcing.frequency"
QUANTITIES = (
    "max_position", "min_position", "peak_to_peak", "max_velocity", "min_velocity", "rms_position", "rms_velocity", "max_force",
    "impact_rate", "impulse",
)  # fmt: skip


def stops() -> vx.ImpactSystem:
    """Two masses, each with a stop."""
    return vx.models.wagg_bishop_a(0.8)


def friction() -> vx.ImpactSystem:
    """A mass with dry friction."""
    load = vx.Harmonic([1.0], 0.7)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [], friction=[vx.Friction(0, 0.3)])


def force() -> vx.ImpactSystem:
    """A mass with a stop and a cubic spring."""
    return vx.ImpactSystem(
        [1.0],
        [[0.1]],
        [[1.0]],
        vx.Harmonic([0.3], 0.9),
        [vx.Stop(0, 0.4, "upper", 0.7)],
        force=vx.models.CubicSpring(jnp.array([0.2])),
    )


def mixed() -> vx.ImpactSystem:
    """Two masses with a stop, a compliant one, and friction."""
    limits = [vx.Stop(0, 0.3, "upper", 0.7), vx.CompliantStop(1, 0.3, "upper", 20.0, 0.1)]
    chain = vx.chain([1.0, 1.2], [0.05] * 2, [1.0] * 2, vx.Harmonic([1.0, 0.0], 0.9), limits)
    return vx.ImpactSystem(
        chain.mass,
        chain.damping,
        chain.stiffness,
        chain.forcing,
        chain.stops,
        friction=[vx.Friction(0, 0.1)],
    )


def sweep(system: vx.ImpactSystem, **options: Any) -> Any:
    """Some frequencies."""
    values = {FREQUENCY: np.linspace(0.75, 0.95, 20)}
    return vx.sweep(system, values, transient=5, record=3, progress=False, **options)


def orbit(system: vx.ImpactSystem) -> vx.PeriodicOrbit:
    """The orbit on which a machine settles."""
    start = vx.simulate(system, 0.0, 100 * system.forcing.period, max_events=1, throw=False)
    return vx.periodic_orbit(system, start.x1, start.v1, throw=False)


def branch(system: vx.ImpactSystem) -> vx.Branch:
    """Its branch along the frequency."""
    frequency = float(system.forcing.frequency)
    bounds = 0.85 * frequency, 1.15 * frequency
    return vx.continuation(orbit(system), FREQUENCY, bounds, max_points=40, progress=False)


def curve(system: vx.ImpactSystem) -> Any:
    """The curve of its first fold."""
    followed = vx.continuation(orbit(system), FREQUENCY, (0.8, 1.0), progress=False)
    fold = next(point for point in followed.bifurcations if point.kind == "fold")
    bounds = {FREQUENCY: (0.8, 1.1), "stops[0].position": (0.2, 0.4)}
    return vx.bifurcation_curve(fold, "stops[0].position", bounds, max_points=3, progress=False)


def basins(system: vx.ImpactSystem) -> Any:
    """A small grid."""
    grid = {"x0[0]": np.linspace(-0.3, 0.3, 4), "v0[0]": np.linspace(-1.0, 1.0, 4)}
    return vx.basins(system, grid, transient=20, progress=False)


def jacobian(system: vx.ImpactSystem) -> jax.Array:
    """Derivatives of an end state by the start."""
    return jax.jacfwd(_end(system))(jnp.full(system.num_masses, -0.1))


def compiled_jacobian(system: vx.ImpactSystem) -> jax.Array:
    """The same under the `jit` of a user."""
    x = jnp.full(system.num_masses, -0.1)
    return jax.jit(jax.jacfwd(_end(system))).trace(x).lower().compile()(x)


def _end(system: vx.ImpactSystem) -> Callable[[jax.Array], jax.Array]:
    return lambda x: vx.simulate(system, 0.0, 20.0, x, throw=False).x1


def sweep_of_quantities(system: vx.ImpactSystem) -> Any:
    """A sweep with ten quantities."""
    return sweep(system, quantities=QUANTITIES)


CALLS: dict[str, tuple[Callable[[Any], Any], Callable[[], vx.ImpactSystem]]] = {
    "orbit, stops": (orbit, stops),
    "branch, stops": (branch, stops),
    "curve, stops": (curve, stops),
    "basins, stops": (basins, stops),
    "sweep, friction": (sweep, friction),
    "orbit, friction": (orbit, friction),
    "branch, friction": (branch, friction),
    "sweep, force": (sweep, force),
    "orbit, force": (orbit, force),
    "branch, force": (branch, force),
    "sweep, mixed": (sweep, mixed),
    "branch, mixed": (branch, mixed),
    "sweep of 10 quantities, mixed": (sweep_of_quantities, mixed),
    "jacfwd, mixed": (jacobian, mixed),
    "jacfwd, stops": (jacobian, stops),
    "jit(jacfwd), stops": (compiled_jacobian, stops),
}
# Calls that a second process makes again.
AGAIN = "branch, force", "jit(jacfwd), stops"


def waits(calls: Sequence[str] = ()) -> list[dict]:
    """Parts of the wait for some calls of the table, or for all, in fresh processes."""
    rows = []
    for name in calls or CALLS:
        with tempfile.TemporaryDirectory() as folder:
            rows.append({"what": name, **_in_fresh_process(name, folder)})
            say(rows[-1])
            if name in AGAIN:
                rows.append({"what": f"second: {name}", **_in_fresh_process(name, folder)})
                say(rows[-1])
    return rows


def table(rows: list[dict], *others: list[dict]) -> str:
    """The table of the page: a row for each call, the parts of this release of JAX, and the sums of others."""
    parts = "traced", "lowered", "XLA", "running", "all"
    columns = ["", *parts, "programs", "thousand operations", *(f"all, {_release(one)}" for one in others)]
    lines = [columns, ["---"] * len(columns)]
    for row in rows:
        beside = [next((o for o in other if o["what"] == row["what"]), {}) for other in others]
        lines.append(
            [
                row["what"],
                *(f"{row[part]:.1f}" for part in parts),
                f"{row['programs']} + {row['small programs']}",
                f"{row['operations'] / 1000:.1f}",
                *(f"{one['all']:.1f}" if one else "" for one in beside),
            ]
        )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _release(rows: list[dict]) -> str:
    return f"JAX {rows[0]['jax']}"


def _in_fresh_process(name: str, folder: str) -> dict:
    place = os.pathsep.join(filter(None, [str(SCRIPTS), os.environ.get("PYTHONPATH")]))
    settings = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    settings |= {"PYTHONPATH": place, "VIJAX_PROGRAMS": folder}
    command = [sys.executable, "-m", "benchmarks.waits", name]
    done = subprocess.run(command, env=settings, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout.splitlines()[-1])


class _Clock:
    """CPU seconds of the stages of all programs, and their operations."""

    def __init__(self):
        self.seconds = {"traced and lowered": 0.0, "lowered": 0.0, "XLA": 0.0, "counting": 0.0}
        self.programs = self.operations = 0

    def wrap(self, owner: type, name: str, stage: str) -> None:
        """Time a method, the nested calls of which are not counted twice."""
        method, depth = getattr(owner, name), [0]

        def timed(this: Any, *args: Any, **options: Any) -> Any:
            start, depth[0] = process_time(), depth[0] + 1
            try:
                return method(this, *args, **options)
            finally:
                depth[0] -= 1
                if not depth[0]:
                    self.seconds[stage] += process_time() - start

        setattr(owner, name, timed)

    def count(self) -> None:
        """Count the operations of programs that are compiled."""
        compiled = jax.stages.Lowered.compile

        def counted(this: Any, *args: Any, **options: Any) -> Any:
            start = process_time()
            self.operations += this.as_text().count("\n")
            self.programs += 1
            self.seconds["counting"] += process_time() - start
            return compiled(this, *args, **options)

        jax.stages.Lowered.compile = counted  # type: ignore[method-assign]


@contextmanager
def _clocked() -> Iterator[_Clock]:
    clock = _Clock()
    clock.wrap(jax.stages.Lowered, "compile", "XLA")
    clock.count()
    clock.wrap(jax.stages.Traced, "lower", "lowered")
    clock.wrap(Programs, "_lowered", "traced and lowered")
    yield clock


def main() -> None:
    """Make a call of the table and print where the time went."""
    jax.config.update("jax_enable_x64", True)
    call, machine = CALLS[sys.argv[1]]
    system = machine()
    with _clocked() as clock, Compilations() as compilations:
        start = process_time()
        jax.block_until_ready(jax.tree.leaves(call(system)))
        seconds = clock.seconds
        whole = process_time() - start - seconds["counting"]
    # A program under the user's own `jit` is lowered outside of the library's programs.
    traced = max(seconds["traced and lowered"] - seconds["lowered"], 0.0)
    told = {
        "traced": traced,
        "lowered": seconds["lowered"],
        "XLA": seconds["XLA"],
        "running": whole - traced - seconds["lowered"] - seconds["XLA"],
        "all": whole,
        "programs": clock.programs,
        "small programs": compilations.programs - clock.programs,
        "operations": clock.operations,
        "jax": jax.__version__,
    }
    print(json.dumps(told))


if __name__ == "__main__":
    main()
