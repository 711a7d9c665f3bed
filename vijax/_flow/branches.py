"""Branches of a force: abs, max, where, tables. The scalar that a choice depends on is its guard; its mode is the number of
knots below the guard.

The memory of the flow carries the modes: within a step they are constant, and a step ends where a guard meets a knot. A zero
of the guard changes the mode, nothing else. After an event, at which velocities jump, the first coefficient of guard - knot
that is not zero decides anew.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._jax.arrays import Scalar, smallest
from .._jax.xla import is_any
from .._series.modes import bounds_of_mode, decide, next_knot, num_rounds
from .._series.plan import Plan
from .._series.series import Series
from .first_zero import first_zero
from .series import horner

# Orders by which the first modes are decided.
DECIDING = 4
# Value of a mode that is to be decided.
_UNKNOWN = -1.0


class BranchMemory(eqx.Module):
    """Branches in force.

    Attributes:
        modes: mode of every switch, -1 where it is to be decided.
        entered: 1 where the guard has just risen through the knot below it, -1 where it has fallen through that above it.
    """

    modes: tuple[Scalar, ...]
    entered: tuple[Scalar, ...]


class Branches(eqx.Module):
    """Branches in a step, and those that follow it.

    Attributes:
        modes: modes in the step.
        until: time to the first change, infinite if there is none.
        changes: flags of the switches that change then.
        steps: change of each mode, 1 or -1.
        guards: coefficients of guard - knot of each switch, for the knot that it meets.
        is_in_time: static, whether each guard is linear in time.
    """

    modes: tuple[Scalar, ...]
    until: Scalar
    changes: tuple[Bool[Array, "..."], ...]
    steps: tuple[Scalar, ...]
    guards: tuple[list[Array], ...]

    def after(self, duration: Scalar, has_event: Bool[Array, "..."]) -> BranchMemory:
        """Memory after a flight."""
        modes, entered = [], []
        for mode, changes, step in zip(self.modes, self.changes, self.steps, strict=True):
            is_changed = changes & (duration >= self.until)
            now = jnp.where(is_changed, mode + step, mode)
            modes.append(jnp.where(has_event & ~is_changed, _UNKNOWN, now))
            entered.append(jnp.where(is_changed, step, 0.0))
        return BranchMemory(tuple(modes), tuple(entered))

    def at_end(self) -> tuple[Scalar, ...]:
        """Modes after `until`."""
        return tuple(
            jnp.where(changes, mode + step, mode)
            for mode, changes, step in zip(self.modes, self.changes, self.steps, strict=True)
        )

    def delays(self) -> tuple[Scalar, ...]:
        """Zeros whose derivatives are those of the times of the changes at `until`."""
        found = []
        until = jax.lax.stop_gradient(jnp.where(jnp.isfinite(self.until), self.until, 0))
        for guard, changes in zip(self.guards, self.changes, strict=True):
            value, slope = horner(guard, until), horner([k * c for k, c in enumerate(guard)][1:], until)
            still = jax.lax.stop_gradient
            is_simple = changes & (slope != 0)
            own = -(value - still(value)) / still(jnp.where(is_simple, slope, 1))
            found.append(jnp.where(is_simple, own, 0))
        return tuple(found)


def unknown_branches(num_switches: int, like: Scalar) -> BranchMemory | None:
    """Memory before the first step."""
    if not num_switches:
        return None
    unknown = jnp.full_like(like, _UNKNOWN)
    return BranchMemory((unknown,) * num_switches, (jnp.zeros_like(like),) * num_switches)


def modes_now(plan: Plan, memory: BranchMemory, series_with: Callable[[tuple], Series]) -> tuple[Scalar, ...]:
    """Modes of the branches in force, decided where they are unknown.

    Args:
        plan: plan of the force.
        memory: memory of the flow.
        series_with: function of the modes: the first orders of the series of the force along the motion in these.
    """

    def decided() -> tuple[Scalar, ...]:
        modes = tuple(jnp.zeros_like(m) for m in memory.modes)
        for _ in range(num_rounds(plan)):
            found = decide(series_with(modes))
            modes = tuple(jnp.where(m < 0, found[j], m) for j, m in enumerate(memory.modes))
        return modes

    is_unknown = jnp.stack([m < 0 for m in memory.modes])
    return jax.lax.cond(is_any(is_unknown), decided, lambda: memory.modes)


def branches_ahead(series: Series, modes: tuple[Scalar, ...], memory: BranchMemory, limit: Scalar) -> Branches:
    """Branches in a step of at most `limit`, and the first change in it."""
    times, zeros, polynomials, fresh = {}, [], [], []
    steps, guards = [], []
    for s, switch in enumerate(series.plan.switches):
        c = [series.guard(s, k) for k in range(len(series))]
        if switch.is_time:
            when, step = next_knot(series, s)
            times[s] = jnp.maximum(when - series.given[0], 0)
            low, high = bounds_of_mode(series, s, modes[s])
            knot = jnp.where(step > 0, high, low)
            steps.append(step)
            guards.append([c[0] - jnp.where(jnp.isfinite(knot), knot, c[0]), *c[1:]])
            continue
        low, high = bounds_of_mode(series, s, modes[s])
        for side, knot in ((1, high), (-1, low)):
            is_there = jnp.isfinite(knot)
            first = jnp.where(is_there, side * (jnp.where(is_there, knot, 0) - c[0]), 1)
            is_fresh = memory.entered[s] == -side
            first = jnp.where(is_fresh, 0, jnp.maximum(first, 0))
            polynomials.append([first, *(jnp.where(is_there, -side * a, 0) for a in c[1:])])
            fresh.append(is_fresh)
            zeros.append((s, side))
        steps.append(None)
        guards.append(None)
    if polynomials:
        columns = [jnp.stack([p[k] for p in polynomials]) for k in range(len(series))]
        reached, is_zero = jax.lax.stop_gradient(first_zero(columns, jnp.stack(fresh), limit))
        nearest = smallest(reached)
    else:
        reached, is_zero, nearest = [], [], jnp.full_like(limit, jnp.inf)
    until = nearest
    for when in times.values():
        until = jnp.minimum(until, jax.lax.stop_gradient(when))
    changes: list[Any] = [None] * len(steps)
    for s, when in times.items():
        changes[s] = (when <= until) & (until < limit)
    for row, (s, side) in enumerate(zeros):
        is_met = is_zero[row] & (reached[row] <= until) & (until < limit)
        own = polynomials[row]
        guard = [-side * a for a in own]
        if steps[s] is None:
            changes[s], steps[s], guards[s] = is_met, jnp.full_like(limit, float(side)), guard
            continue
        changes[s] = changes[s] | is_met
        steps[s] = jnp.where(is_met, float(side), steps[s])
        guards[s] = [jnp.where(is_met, a, b) for a, b in zip(guard, guards[s], strict=True)]
    until = jnp.where(until < limit, until, jnp.inf)
    return Branches(modes, until, tuple(changes), tuple(steps), tuple(guards))
