"""The same motions by `diffrax.diffeqsolve`: up to an `Event`, the velocity reversed, and on again.

As a careful user would write it:

- The event is the smallest gap of all. Of several events in one step diffrax takes the first of the list, and
  the others, if they were earlier, are then through their stops.
- Its zero is found by `Bisection`, which takes one event alone and stays inside the step; Newton's
  method leaves it now and then.
- After an impact the mass is set a few roundings before its stop. A crossing must begin above zero, so the
  first step after a gap of zero would see none.
- y is one array, and matrices are multiplied column by column, which takes diffrax the least time in a batch.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jax import Array
from peers import LIMIT, Machine

from .scenes import Outcome, Program, Scene
from .timing import repeated

_MAX_STEPS = 100_000
# As near as a time around 100 can be told.
_ROOT_FINDER = optimistix.Bisection(rtol=1e-16, atol=3e-14, flip=True)
# How far before its stop a mass starts again.
_BEFORE = 1e-15


class Fate(NamedTuple):
    """What became of a motion.

    Attributes:
        t: how far it came; NaN where no step was small enough.
        y: x and v there, (2 n,).
        num_impacts: impacts so far.
        impacts: time, stop and velocity before, of each, (room, 3).
        num_steps: steps tried.
        num_kept: those among them that were accurate enough.
    """

    t: Array
    y: Array
    num_impacts: Array
    impacts: Array
    num_steps: Array
    num_kept: Array


def by_diffeqsolve(scene: Scene, tolerance: float, solver: str) -> Program:
    """A scene by adaptive steps."""
    run = with_events(solver, masses(scene))
    machine = Machine(scene)
    arguments = (numbers(scene), *map(jnp.asarray, (machine.t0, machine.t1, machine.start)), tolerance)
    return Program(lambda: outcome(run(*arguments)), repeated(lambda: run(*arguments)))


def outcome(fate: Fate) -> Outcome:
    """What the benchmark compares."""
    found = np.asarray(fate.impacts)[: int(fate.num_impacts)]
    rows = [(float(t), int(j), float(v)) for t, j, v in found]
    return Outcome(rows, np.asarray(fate.y), bool(np.isnan(fate.t)) or len(rows) == len(fate.impacts))


def masses(scene: Scene) -> tuple[int, ...]:
    """The mass at each stop."""
    return tuple(stop["mass"] for stop in scene["stops"])


def numbers(scene: Scene) -> dict[str, Array]:
    """All numbers of a scene that a compiled program takes as they come."""
    machine = Machine(scene)
    found: dict[str, Any] = {
        k: getattr(machine, k) for k in ("mass", "damping", "stiffness", "load", "phase")
    }
    stops = np.array([stop[1:] for stop in machine.stops], float).T
    if machine.cubic.size:
        found["cubic"] = machine.cubic
    found |= dict(zip(("position", "sign", "restitution"), stops, strict=True))
    return {k: jnp.asarray(v, float) for k, v in (found | {"frequency": machine.frequency}).items()}


def rate(t: Any, y: Array, args: dict[str, Array]) -> Array:
    """Time derivative of y."""
    x, v = jnp.split(y, 2)
    force = args["load"] * jnp.cos(args["frequency"] * t + args["phase"])
    for matrix, vector in ((args["damping"], v), (args["stiffness"], x)):
        force -= sum(matrix[:, i] * vector[i] for i in range(len(vector)))
    if "cubic" in args:
        force -= args["cubic"] * x * x * x
    return jnp.concatenate([v, force / args["mass"]])


def solve(
    solver: str, is_constant: bool, accuracy: Array, event: diffrax.Event | None, *arguments: Any
) -> diffrax.Solution:
    """One call of `diffeqsolve`, by steps of the length `accuracy`, or of that relative and absolute tolerance."""
    t0, t1, start, args = arguments
    constant, adaptive = diffrax.ConstantStepSize(), diffrax.PIDController(rtol=accuracy, atol=accuracy)
    return diffrax.diffeqsolve(
        diffrax.ODETerm(rate), getattr(diffrax, solver)(), t0, t1, accuracy if is_constant else None, start, args,
        event=event, stepsize_controller=constant if is_constant else adaptive, max_steps=_MAX_STEPS, throw=False,
    )  # fmt: skip


def without_events(
    solver: str, args: dict[str, Array], t0: Array, t1: Array, start: Array, tolerance: Array
) -> diffrax.Solution:
    """The smooth motion, whatever the stops say."""
    return solve(solver, False, tolerance, None, t0, t1, start, args)


@cache
def with_events(
    solver: str, masses: tuple[int, ...], *, is_constant: bool = False, room: int = LIMIT
) -> Callable[..., Fate]:
    """The compiled motion with impacts of all machines that have these masses at their stops.

    Args:
        solver: its name in diffrax.
        masses: the mass at each stop.
        is_constant: whether steps are all of one length.
        room: the impacts after which it is given up.

    Returns:
        A function of numbers, t0, t1, the start, and a tolerance or the length of steps.
    """
    at = jnp.array(masses)

    def gaps(y: Array, args: dict[str, Array]) -> Array:
        return args["sign"] * (args["position"] - y[at])

    event = diffrax.Event(lambda t, y, args, **_: jnp.min(gaps(y, args)), _ROOT_FINDER, direction=False)

    def fly(args: dict[str, Array], t1: Array, accuracy: Array, fate: Fate) -> Fate:
        sol = solve(solver, is_constant, accuracy, event, fate.t, t1, fate.y, args)
        assert sol.ts is not None
        assert sol.ys is not None
        t, y, is_hit = sol.ts[-1], sol.ys[-1], jnp.any(jnp.asarray(sol.event_mask))
        j = jnp.argmin(gaps(y, args))
        speed = y[len(y) // 2 + at[j]]
        before_stop = args["position"][j] - _BEFORE * args["sign"][j]
        after = y.at[at[j]].set(before_stop).at[len(y) // 2 + at[j]].set(-args["restitution"][j] * speed)
        slot = jnp.where(is_hit, fate.num_impacts, room)
        return Fate(
            jnp.where(is_hit | (t >= t1), t, jnp.nan),
            jnp.where(is_hit, after, y),
            fate.num_impacts + is_hit,
            fate.impacts.at[slot].set(jnp.stack([t, j, speed]), mode="drop"),
            fate.num_steps + sol.stats["num_steps"],
            fate.num_kept + sol.stats["num_accepted_steps"],
        )

    @jax.jit
    def run(args: dict[str, Array], t0: Array, t1: Array, start: Array, accuracy: Array) -> Fate:
        zero = jnp.array(0)
        first = Fate(t0, start, zero, jnp.full((room, 3), jnp.nan), zero, zero)
        is_on = lambda fate: (fate.t < t1) & (fate.num_impacts < room)  # noqa: E731
        return jax.lax.while_loop(is_on, lambda fate: fly(args, t1, accuracy, fate), first)

    return run
