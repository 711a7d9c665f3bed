"""Branches of a force: abs, max, where, tables.

The scalar that a choice depends on is its guard; its mode is the number of knots below the guard.

The memory of the flow carries the modes: within a step they are constant, and a step ends where a guard meets a knot. A zero
of the guard changes the mode, nothing else. After an event, at which velocities jump, the first coefficient of guard - knot
that is not zero decides anew.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._jax.arrays import Flag, Scalar, smallest
from .._jax.xla import is_any
from .._series.modes import bounds_of_mode, decide, next_knot, num_rounds
from .._series.order_loop import LoopSeries
from .._series.plan import Plan
from .._series.series import Series
from .first_zero import first_zero
from .series import derivative, horner

# Orders by which the first modes are decided.
DECIDING = 4
# Value of a mode that is to be decided.
_UNKNOWN = -1.0
# Rounding errors of a guard, relative to its terms, in units of the last place.
_ROUNDINGS = 64


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
    """

    modes: tuple[Scalar, ...]
    until: Scalar
    changes: tuple[Bool[Array, "..."], ...]
    steps: tuple[Scalar, ...]

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


def unknown_branches(num_switches: int, like: Scalar) -> BranchMemory | None:
    """Memory before the first step."""
    if not num_switches:
        return None
    unknown = jnp.full_like(like, _UNKNOWN)
    return BranchMemory((unknown,) * num_switches, (jnp.zeros_like(like),) * num_switches)


def is_entering(memory: BranchMemory) -> Flag:
    """True where a guard is at a knot, or may be."""
    found = jnp.zeros(memory.modes[0].shape, bool)
    for mode, entered in zip(memory.modes, memory.entered, strict=True):
        found = found | (entered != 0) | (mode < 0)
    return found


def modes_now(
    plan: Plan, memory: BranchMemory, series_with: Callable[[tuple], Series | LoopSeries]
) -> tuple[Scalar, ...]:
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


def branches_ahead(
    series: Series | LoopSeries, modes: tuple[Scalar, ...], memory: BranchMemory, limit: Scalar
) -> Branches:
    """Branches in a step of at most `limit`, and the first change in it; a constant."""
    times, sides, polynomials, fresh = {}, [], [], []
    for s, switch in enumerate(series.plan.switches):
        if switch.is_time:
            when, step = next_knot(series, s)
            times[s] = jnp.maximum(when - series.given[0], 0), step
            continue
        for side, polynomial in _distances(series, s, modes[s]):
            is_fresh = memory.entered[s] == -side
            first = jnp.where(is_fresh, 0, jnp.maximum(polynomial[0], 0))
            polynomials.append([first, *polynomial[1:]])
            fresh.append(is_fresh)
            sides.append((s, side))
    until, reached, is_zero = jnp.full_like(limit, jnp.inf), [], []
    if polynomials:
        columns = [jnp.stack([p[k] for p in polynomials]) for k in range(len(series))]
        reached, is_zero = first_zero(columns, jnp.stack(fresh), limit)
        until = smallest(reached)
    for when, _ in times.values():
        until = jnp.minimum(until, when)
    none = jnp.zeros(limit.shape, bool)
    changes, steps = [none] * len(modes), [jnp.ones_like(limit)] * len(modes)
    for s, (when, step) in times.items():
        changes[s], steps[s] = (when <= until) & (until < limit), step
    for row, (s, side) in enumerate(sides):
        is_met = is_zero[row] & (reached[row] <= until) & (until < limit)
        changes[s] = changes[s] | is_met
        steps[s] = jnp.where(is_met, float(side), steps[s])
    until = jnp.where(until < limit, until, jnp.inf)
    return Branches(modes, until, tuple(changes), tuple(steps))


def _distances(series: Series | LoopSeries, s: int, mode: Scalar) -> list[tuple[int, list[Array]]]:
    """Coefficients of the distances to the knots above (1) and below (-1) a mode; one where there is none."""
    guard, found = [series.guard(s, k) for k in range(len(series))], []
    low, high = bounds_of_mode(series, s, mode)
    for side, knot in ((1, high), (-1, low)):
        is_there = jnp.isfinite(knot)
        first = jnp.where(is_there, side * (jnp.where(is_there, knot, 0) - guard[0]), 1)
        found.append((side, [first, *(jnp.where(is_there, -side * a, 0) for a in guard[1:])]))
    return found


def changes_at(
    series: Series | LoopSeries, modes: tuple[Scalar, ...], step: Scalar
) -> tuple[Branches, Scalar]:
    """Changes at the end of a step that ended on one, and a zero with the first and second derivatives of the time of them.

    Changes at one instant move together, or the force does not jump.
    """
    still = jax.lax.stop_gradient
    delay, changes, steps = jnp.zeros_like(step), [], []
    for s, mode in enumerate(modes):
        is_changed, change = jnp.zeros(step.shape, bool), jnp.ones_like(step)
        for side, c in _distances(series, s, mode):
            value, slope = horner(c, step), horner(derivative(c), step)
            size = horner([jnp.abs(a) for a in c], step) + jnp.abs(series.guard(s, 0))
            is_met = (jnp.abs(value) <= _ROUNDINGS * float(jnp.finfo(size.dtype).eps) * size) & (slope < 0)
            is_met = still(is_met & (step > 0))
            falls = jnp.where(is_met, slope, -1)
            first = -(value - still(value)) / falls
            bend = horner(derivative(derivative(c)), step)
            delay = jnp.where(is_met, first - bend / (2 * falls) * first * first, delay)
            is_changed, change = is_changed | is_met, jnp.where(is_met, float(side), change)
        changes.append(is_changed)
        steps.append(change)
    return Branches(modes, still(step), tuple(changes), tuple(steps)), delay
