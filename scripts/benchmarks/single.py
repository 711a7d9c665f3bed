"""One trajectory: run time against error, and what derivatives cost."""

from collections.abc import Callable
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import peers

import vijax as vx

from . import cpp
from .diffeqsolve import by_diffeqsolve
from .report import say
from .scenes import Outcome, Program, Scene, judge, load, machine
from .timing import Compilations, in_turns, repeated

Made = TypeVar("Made")
# Light, several impacts, chatter and sticking: the peers that know no sticking fail in the last.
SCENES = {
    "paper_a_om080": "light: case (a), W = 0.8",
    "paper_b_om110": "many impacts: case (b), W = 1.1",
    "paper_b_om030": "chatter and sticking: case (b), W = 0.3",
}
TOLERANCES = (1e-6, 1e-9, 1e-12)
PEERS: dict[str, tuple[Callable[..., Program | None], tuple[float, ...]]] = {
    "heyoka": (peers.heyoka, (1e-6, 1e-9, 1e-12, 1e-15)),
    "SciPy DOP853": (peers.scipy, TOLERANCES),
    **{
        f"diffrax {s}": (partial(by_diffeqsolve, solver=s), TOLERANCES) for s in ("Tsit5", "Dopri5", "Dopri8")
    },
}
# Trajectories of a batch: the first is the scene, the others start a little beside it.
BATCH, BESIDE = 1000, 1e-2
# The scene by whose side derivatives are taken.
DERIVED = "paper_a_om080"
# Of the central differences of fourth order of the reference: 1e-19 / STEP is their rounding.
STEP = 1e-6


def work_precision(full: bool) -> list[dict]:
    """Run time against errors, of single trajectories; the whole batch's time divided by it for a batch."""
    rows = []
    for name in SCENES:
        scene, programs = load(name), {}
        makers: dict[tuple[str, float | None], Callable[[], Program | None]] = {
            ("vijax", None): lambda scene=scene: by_vijax(scene),
            (f"vijax, {BATCH} at once", None): lambda scene=scene: by_vijax(scene, BATCH),
            ("scalar C++", None): lambda scene=scene: cpp.scalar(scene),
        }
        for peer, (build, tolerances) in PEERS.items():
            makers |= {(peer, t): partial(build, scene, t) for t in tolerances}
        for key, make in makers.items():
            with Compilations() as compiling:
                program = installed(make)
                if program is not None:
                    programs[key] = program, judge(program.outcome(), scene), compiling
        runs = {f"{m} {t}": program.seconds for (m, t), (program, *_) in programs.items()}
        found = in_turns(runs, 7 if full else 2)
        for (method, tolerance), (_, judged, compiling) in programs.items():
            row = {"scene": name, "method": method, "tolerance": tolerance, **judged}
            rows.append(row | found[f"{method} {tolerance}"] | {"compiling / s": compiling.seconds or None})
            say(rows[-1])
    return rows


def by_vijax(scene: Scene, batch: int | None = None) -> Program:
    """A scene by `simulate`, or a batch of it; of a batch the seconds are those of one."""
    system, ends = machine(scene), (scene["t0"], scene["t1"])
    x0, v0 = (jnp.asarray(scene[name], float) for name in ("x0", "v0"))
    if batch is None:
        run = lambda: vx.simulate(system, *ends, x0, v0)  # noqa: E731
    else:
        beside = x0 - BESIDE * jnp.linspace(0.0, 1.0, batch)[:, None]
        together = side_by_side(system, *ends, v0)
        run = lambda: together(beside)  # noqa: E731

    def outcome() -> Outcome:
        sol = run() if batch is None else jax.tree.map(lambda a: a[0], run())
        log, kept = sol.events, np.asarray(sol.events.kind == vx.IMPACT)
        columns = (np.asarray(a)[kept].tolist() for a in (log.t, log.stop, log.velocity_minus))
        return Outcome(list(zip(*columns, strict=True)), np.concatenate([sol.x1, sol.v1]))

    seconds = repeated(run)
    return Program(outcome, lambda repeats: [s / (batch or 1) for s in seconds(repeats)])


def side_by_side(system: vx.ImpactSystem, t0: float, t1: float, v0: jax.Array) -> Callable:
    """Trajectories of a known machine from starts x0, (batch, n), with their logs."""
    return jax.jit(jax.vmap(lambda x0: vx.simulate(system, t0, t1, x0, v0, max_events=256, throw=False)))


def installed(make: Callable[[], Made]) -> Made | None:
    """What `make` returns, or None where a peer is not installed."""
    try:
        return make()
    except ImportError:
        return None


def derivatives(full: bool) -> list[dict]:
    """The Jacobian of an end state by the start and three parameters, and a gradient (if full), per plain run."""
    rows = []
    sets = {"frequency, amplitude, restitution": by_load, "mass, amplitude, stiffness": by_matrices}
    for name, build in sets.items():

        def end(p: jax.Array, build=build) -> jax.Array:
            sol = vx.simulate(build(p), 0.0, 80.0, p[:2], p[2:4], max_events=0, throw=False)
            return jnp.concatenate([sol.x1, sol.v1])

        functions = {"plain": end, "jacfwd": jax.jacfwd(end)}
        if full:
            functions["grad"] = jax.grad(lambda p, f=end: f(p).sum())
        programs = {k: jax.jit(jax.vmap(f)) for k, f in functions.items()}
        points, exact, compiling, errors = lanes(build), reference(build), {}, {}
        for method, program in programs.items():
            with Compilations() as compiling[method]:
                first = np.asarray(program(points)[0])
            errors[method] = None if exact is None else float(np.max(np.abs(first - exact[method])))
        runs = {k: repeated(lambda f=f, points=points: f(points)) for k, f in programs.items()}
        for method, found in in_turns(runs, 9 if full else 4).items():
            row = {"by": name, "method": method, "error": errors[method], **found}
            row["ratio"] = (
                found["min / s"] / rows[-1]["min / s"] * rows[-1]["ratio"] if method != "plain" else 1.0
            )
            rows.append(row | {"compiling / s": compiling[method].seconds})
            say(rows[-1])
    return rows


def by_load(p: jax.Array) -> vx.ImpactSystem:
    """The machine of the scene with p[4:] its frequency, amplitude and restitution."""
    stops = [vx.Stop(i, 0.3, "upper", p[6]) for i in range(2)]
    return vx.chain(
        [1.0, 1.0], [0.1, 0.1], [1.0, 1.0], vx.Harmonic(jnp.array([1.0, 0.0]) * p[5], p[4]), stops
    )


def by_matrices(p: jax.Array) -> vx.ImpactSystem:
    """The machine of the scene with p[4:] its first mass, amplitude and first stiffness."""
    stops = [vx.Stop(i, 0.3, "upper", 0.7) for i in range(2)]
    mass, stiffness = jnp.stack([p[4], 1.0]), jnp.stack([p[6], 1.0])
    return vx.chain(mass, [0.1, 0.1], stiffness, vx.Harmonic(jnp.array([1.0, 0.0]) * p[5], 0.8), stops)


# What p[4:] is in the scene, and how a scene is told.
VALUES: dict[Callable, tuple[float, float, float]] = {by_load: (0.8, 0.3, 0.7), by_matrices: (1.0, 0.3, 1.0)}


def lanes(build: Callable) -> jax.Array:
    """The points of a batch, (batch, 7): the scene first, then from half to one and a half its p[4]."""
    points = np.tile([0.0] * 4 + list(VALUES[build]), (BATCH, 1))
    points[1:, 4] *= np.linspace(0.75, 1.75, BATCH - 1)
    return jnp.asarray(points)


def reference(build: Callable) -> dict[str, np.ndarray] | None:
    """End state and its derivatives at the scene, by differences of heyoka in extended precision."""
    middle = np.array([0.0] * 4 + list(VALUES[build]), np.longdouble)
    scene = load(DERIVED)

    def end(p: np.ndarray) -> np.ndarray:
        changed = scene | {"x0": p[:2], "v0": p[2:4], "A": [p[5], 0]}
        if build is by_load:
            stops = [stop | {"restitution": p[6]} for stop in scene["stops"]]
            changed |= {"Omega": p[4], "stops": stops}
        else:
            changed |= {"M": [p[4], 1], "K": [[p[6] + 1, -1], [-1, 1]]}
        return peers.heyoka(changed, 1e-19, np.longdouble).outcome().end

    def column(h: np.ndarray) -> np.ndarray:
        near, far = (end(middle + k * h) - end(middle - k * h) for k in (1, 2))
        return (8 * near - far) / (12 * STEP)

    columns = installed(lambda: [column(h) for h in np.eye(7, dtype=np.longdouble) * STEP])
    if columns is None:
        return None
    plain, jacobian = np.array([*scene["x1"], *scene["v1"]]), np.stack(columns, axis=1)
    return {"plain": plain, "jacfwd": jacobian, "grad": jacobian.sum(axis=0)}
