"""The solvers of diffrax in `vx.DiffraxFlow` and in `diffeqsolve` with `Event`: orders, errors, times.

The machines are linear, so the true motion is known. Order is seen with steps of constant length, where
nothing but the length changes; what accuracy costs, with adaptive ones.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import vijax as vx
from vijax._flow.diffrax_flow import DiffraxFlow

from . import diffeqsolve
from .diffeqsolve import Fate, outcome
from .report import say
from .scenes import Scene, judge, load, machine, smooth_end
from .timing import in_turns, repeated

OURS, THEIRS = "DiffraxFlow", "diffeqsolve with Event"
IMPACTS, LIGHT = "paper_a_om080", "graze_slow_m1e-6"
SCENES = {IMPACTS: "20 impacts: case (a), W = 0.8", LIGHT: "one impact, at a speed of 7e-5"}
ORDERS = {"Heun": 2, "Bosh3": 3, "Tsit5": 5, "Dopri8": 8}
# Lengths of constant steps, each shorter than the one before by the root of 2.
LENGTHS = 0.8 * 2.0 ** (-np.arange(13) / 2)
TOLERANCES = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12]
# The tolerance at which the cost of a step is told.
TOLERANCE = 1e-8
# Trajectories of a batch, their frequencies by that of the scene, which is the first, and room for impacts.
BATCH, LOWEST, HIGHEST, ROOM = 1000, 0.875, 1.125, 64
# Below this, errors are those of rounding.
ROUNDING = 1e-13
# An error is a power of the length for short steps alone: so many of the shortest are fitted.
FITTED = 5
FAR = 100.0

Run = Callable[[], Fate]
# t0, t1 and y(t0).
Span = tuple[Array, Array, Array]


def convergence(full: bool) -> list[dict]:
    """Errors of both by the length of constant steps and by tolerance; with tolerances run times as well.

    Each tolerance is a program to compile, so a quick run has one, and in a batch alone, which `batch_cost` needs too.
    """
    rows: list[dict] = []
    for solver in ORDERS if full else ("Heun", "Tsit5", "Dopri8"):
        for name in SCENES:
            rows += constant_steps(name, solver)
    rows += orders(rows)
    if not full:
        return rows + adaptive_steps(IMPACTS, "Dopri8", [TOLERANCE], [BATCH], 2)
    for solver in ("Tsit5", "Dopri8"):
        rows += adaptive_steps(IMPACTS, solver, TOLERANCES, [1, BATCH], 3)
        rows += adaptive_steps(LIGHT, solver, TOLERANCES, [1], 3)
    return rows


def constant_steps(name: str, solver: str) -> list[dict]:
    """Errors of a scene for each length of the steps."""
    scene, rows = two_stops(load(name)), []
    every = by_length(solver)(machine(scene), start(scene), jnp.asarray(LENGTHS))
    run = diffeqsolve.with_events(solver, diffeqsolve.masses(scene), is_constant=True)
    for k, length in enumerate(LENGTHS.tolist()):
        fates = {OURS: nth(every, k), THEIRS: run(diffeqsolve.numbers(scene), *start(scene), length)}
        for method, fate in fates.items():
            row = {"scene": name, "solver": solver, "method": method, "length of steps": length}
            row |= {"span": scene["t1"] - scene["t0"]}
            rows.append(row | {"steps tried": int(fate.num_steps)} | judge(outcome(fate), scene))
    return rows


def adaptive_steps(
    name: str, solver: str, tolerances: list[float], batches: list[int], rounds: int
) -> list[dict]:
    """Errors and times of a scene for each tolerance, by itself or the first of a batch."""
    scene, rows = two_stops(load(name)), []
    runs: dict[tuple[str, float, int], Run] = {
        (method, tolerance, lanes): partial(build(solver, tolerance, lanes), scene)
        for tolerance in tolerances
        for lanes in batches
        for method, build in BUILD.items()
    }
    fates = {key: run() for key, run in runs.items()}
    timed = in_turns({str(key): repeated(run) for key, run in runs.items()}, rounds)
    for key, fate in fates.items():
        method, tolerance, lanes = key
        first = nth(fate, 0)
        row = {"scene": name, "solver": solver, "method": method, "tolerance": tolerance, "at once": lanes}
        row |= {"steps tried": int(first.num_steps), "steps kept": int(first.num_kept)}
        row |= judge(outcome(first), scene)
        rows.append(row | {f"each: {what}": seconds / lanes for what, seconds in timed[str(key)].items()})
        say(rows[-1])
    return rows


def batch_cost(full: bool) -> list[dict]:
    """Time of a step that is kept, in a batch, beside that of `diffeqsolve` in the smooth motion, without events."""
    rows: list[dict] = []
    scene = load(IMPACTS)
    smooth = scene | {"stops": [stop | {"position": FAR} for stop in scene["stops"]]}
    for solver in ("Tsit5", "Dopri8") if full else ("Dopri8",):
        runs: dict[tuple[str, str], Run] = {
            ("diffeqsolve", "none"): partial(without_events(solver), smooth),
            (OURS, "none"): partial(by_flow(solver, TOLERANCE, BATCH), smooth),
            (OURS, "many"): partial(by_flow(solver, TOLERANCE, BATCH), scene),
            (THEIRS, "many"): partial(by_events(solver, TOLERANCE, BATCH), scene),
        }
        fates = {key: run() for key, run in runs.items()}
        timed = in_turns({str(key): repeated(run) for key, run in runs.items()}, 9 if full else 3)
        per_step = {k: timed[str(k)]["min / s"] / float(jnp.sum(fate.num_kept)) for k, fate in fates.items()}
        for key, fate in fates.items():
            first, (method, impacts) = nth(fate, 0), key
            end = smooth_end(scene) if impacts == "none" else np.array([*scene["x1"], *scene["v1"]])
            row = {"solver": solver, "method": method, "lanes": BATCH, "tolerance": TOLERANCE}
            row |= {"impacts": float(jnp.mean(fate.num_impacts)), **timed[str(key)]}
            row |= {
                "steps tried": float(jnp.mean(fate.num_steps)),
                "steps kept": float(jnp.mean(fate.num_kept)),
            }
            row |= {
                "nanoseconds a step": 1e9 * per_step[key],
                "ratio": per_step[key] / next(iter(per_step.values())),
            }
            rows.append(row | {"error": float(np.max(np.abs(np.asarray(first.y) - end)))})
            say(rows[-1])
    return rows


def orders(rows: list[dict]) -> list[dict]:
    """The power of the length of steps with which the errors of the end state and of impact times fall."""
    found = []
    for method, solver in dict.fromkeys((row["method"], row["solver"]) for row in rows):
        row: dict[str, Any] = {"solver": solver, "method": method, "order": ORDERS[solver]}
        own = [r for r in rows if (r["scene"], r["method"], r["solver"]) == (IMPACTS, method, solver)]
        for error in ("state error", "time error"):
            row[f"fitted to {error}"] = fitted_order(own, error)
        found.append(row)
        say(row)
    return found


def fitted_order(rows: list[dict], error: str) -> float | None:
    """The slope of an error over the length of steps, the shortest of those above rounding; None where they are too few."""
    right = [row for row in rows if row["outcome"] == "right" and row[error] > ROUNDING]
    points = np.log(sorted((row["length of steps"], row[error]) for row in right)[:FITTED])
    return float(np.polyfit(points[:, 0], points[:, 1], 1)[0]) if len(points) > 1 else None


class Kept(DiffraxFlow):
    """Counts every step as rejected that is tried again, those too that an event cuts short."""

    def fly(self, machine: Any, state: Any, remaining: Array, resolution: Array) -> Any:
        """Try one step."""
        flight = DiffraxFlow.fly(self, machine, state, remaining, resolution)
        rejected = state.memory.rejected + (flight.duration == 0)
        return eqx.tree_at(lambda f: f.end.memory.rejected, flight, rejected)


def simulated(flow: DiffraxFlow, system: vx.ImpactSystem, t0: Array, t1: Array, y: Array) -> Fate:
    """A trajectory by `simulate`, told as the others are."""
    sol = vx.simulate(system, t0, t1, *jnp.split(y, 2), flow=flow, max_events=ROOM, throw=False)
    log, end = sol.events, jnp.concatenate([sol.x1, sol.v1])
    impacts = jnp.stack([log.t, log.stop, log.velocity_minus], axis=1)[jnp.argsort(log.kind != vx.IMPACT)]
    t = jnp.where(sol.result == vx.RESULTS.successful, sol.t1, jnp.nan)
    kept = sol.num_steps - sol.num_rejected
    return Fate(t, end, jnp.sum(log.kind == vx.IMPACT), impacts, sol.num_steps, kept)


@cache
def by_length(solver: str) -> Callable[..., Fate]:
    """Trajectories of a machine by steps of constant lengths, one a lane."""

    def one(system: vx.ImpactSystem, span: Span, length: Array) -> Fate:
        flow = DiffraxFlow(getattr(diffrax, solver)(), diffrax.ConstantStepSize(), dt0=length)
        return simulated(flow, system, *span)

    return in_lanes(one, len(LENGTHS))


@cache
def by_flow(solver: str, tolerance: float, lanes: int) -> Callable[[Scene], Fate]:
    """Trajectories of a scene and of others of near frequency, by `DiffraxFlow`."""
    controller = diffrax.PIDController(rtol=tolerance, atol=tolerance)
    flow = Kept(getattr(diffrax, solver)(), controller, dt0=None)

    def one(system: vx.ImpactSystem, span: Span, frequency: Array) -> Fate:
        return simulated(flow, eqx.tree_at(lambda s: s.forcing.frequency, system, frequency), *span)

    run = in_lanes(one, lanes)
    return lambda scene: run(machine(scene), start(scene), frequencies(scene, lanes))


@cache
def by_events(solver: str, tolerance: float, lanes: int) -> Callable[[Scene], Fate]:
    """Likewise by `diffeqsolve` with `Event`."""
    return lambda scene: _by_events(solver, diffeqsolve.masses(scene), lanes)(
        diffeqsolve.numbers(scene) | {"accuracy": jnp.asarray(tolerance)},
        start(scene),
        frequencies(scene, lanes),
    )


@cache
def _by_events(solver: str, masses: tuple[int, ...], lanes: int) -> Callable[..., Fate]:
    run = diffeqsolve.with_events(solver, masses, room=ROOM)

    def one(args: dict[str, Array], span: Span, frequency: Array) -> Fate:
        return run(args | {"frequency": frequency}, *span, args["accuracy"])

    return in_lanes(one, lanes)


@cache
def without_events(solver: str) -> Callable[[Scene], Fate]:
    """A batch of the smooth motion by `diffeqsolve`."""

    def one(args: dict[str, Array], span: Span, frequency: Array) -> Fate:
        sol = diffeqsolve.without_events(
            solver, args | {"frequency": frequency}, *span, jnp.asarray(TOLERANCE)
        )
        assert sol.ts is not None
        assert sol.ys is not None
        tried, kept = sol.stats["num_steps"], sol.stats["num_accepted_steps"]
        return Fate(sol.ts[-1], sol.ys[-1], jnp.array(0), jnp.zeros((0, 3)), tried, kept)

    run = in_lanes(one, BATCH)
    return lambda scene: run(diffeqsolve.numbers(scene), start(scene), frequencies(scene, BATCH))


BUILD: dict[str, Callable[[str, float, int], Callable[[Scene], Fate]]] = {OURS: by_flow, THEIRS: by_events}


def in_lanes(one: Callable[..., Fate], lanes: int) -> Callable[..., Fate]:
    """Compile a function of what all lanes share, twice, and of what each has of its own; one lane without `vmap`."""
    if lanes > 1:
        return jax.jit(jax.vmap(one, in_axes=(None, None, 0)))
    return jax.jit(lambda a, b, own: jax.tree.map(lambda c: c[None], one(a, b, own[0])))


def start(scene: Scene) -> Span:
    """t0, t1 and y(t0)."""
    y = jnp.asarray([*scene["x0"], *scene["v0"]], float)
    return jnp.asarray(scene["t0"], float), jnp.asarray(scene["t1"], float), y


def frequencies(scene: Scene, lanes: int) -> Array:
    """That of the scene, then others around it."""
    return scene["Omega"] * jnp.append(1.0, jnp.linspace(LOWEST, HIGHEST, lanes - 1))


def nth(fates: Fate, lane: int) -> Fate:
    """One of many."""
    return jax.tree.map(lambda a: a[lane], fates)


def two_stops(scene: Scene) -> Scene:
    """A scene with a stop far off at the first mass, if it has none there: then all are one program."""
    if len(scene["stops"]) == 2:
        return scene
    far = {"mass": 0, "position": FAR, "side": "upper", "restitution": 1.0}
    events = [event | {"stop": event["stop"] + 1} for event in scene["events"]]
    return scene | {"stops": [far, *scene["stops"]], "events": events}
