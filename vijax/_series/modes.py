"""Modes of the switches of a force: which branches are in force."""

import jax.numpy as jnp
from jaxtyping import Array

from .._jax.arrays import Scalar
from .algebra import Operand, is_known
from .order_loop import LoopSeries
from .plan import Plan
from .series import Series


def num_rounds(plan: Plan) -> int:
    """Calls of `decide` until the modes are those of the start: a guard may depend on other modes."""
    guards = {switch.mode: switch.guard for switch in plan.switches}
    depths: dict[int, int] = {}  # choices, one in another, that a series depends on

    def depth(operand: Operand) -> int:
        return 1 + depth(guards[operand]) if operand in guards else depths.get(operand, 0)

    for operation in plan.operations:
        depths[operation.out] = max((depth(a) for a in operation.args if not is_known(a)), default=0)
    return 1 + max(map(depth, guards), default=0)


def decide(series: Series | LoopSeries) -> Array:
    """Mode of every switch, (switches, ...): the first coefficient of guard - knot decides that is not zero.

    A guard that stays at a knot is below it.
    """
    rows = [_mode(series, j) for j in range(series.plan.num_switches)]
    shape = series.like.shape[1:]
    return jnp.stack(rows) if rows else jnp.zeros((0, *shape), series.like.dtype)


def _mode(series: Series | LoopSeries, switch: int) -> Scalar:
    total = jnp.zeros(series.like.shape[1:], series.like.dtype)
    guard = [series.guard(switch, k) for k in range(len(series))]
    for number in range(len(series.plan.switches[switch].knots)):
        above, *later = [guard[0] - series.knot(switch, number), *guard[1:]]
        for coefficient in later:
            above = jnp.where(above == 0, coefficient, above)
        total = total + (above > 0)
    return total


def next_knot(series: Series | LoopSeries, switch: int) -> tuple[Scalar, Scalar]:
    """Time of the next knot of a guard that is linear in time, infinite if there is none, and the change of the mode there."""
    mode = series.given[2][switch]
    start, rate = series.guard(switch, 0), series.guard(switch, 1)
    is_up = rate > 0
    inside = bounds_of_mode(series, switch, mode)
    knot = jnp.where(is_up, inside[1], inside[0])
    is_moving = (rate != 0) & (jnp.abs(knot) < jnp.inf)
    # Where the guard is time itself, the knot is the time to the last digit.
    t = series.given[0]
    time = (
        knot
        if series.plan.switches[switch].guard == 0
        else t + (knot - start) / jnp.where(is_moving, rate, 1)
    )
    return jnp.where(is_moving, time, jnp.inf), jnp.where(is_up, 1, -1).astype(series.like.dtype)


def bounds_of_mode(series: Series | LoopSeries, switch: int, mode: Scalar) -> tuple[Scalar, Scalar]:
    """Knots below and above a mode, infinite if there is none."""
    low, high = (
        jnp.full_like(series.guard(switch, 0), -jnp.inf),
        jnp.full_like(series.guard(switch, 0), jnp.inf),
    )
    for number in range(len(series.plan.switches[switch].knots)):
        knot = series.knot(switch, number)
        high = jnp.where(mode == number, knot, high)
        low = jnp.where(mode == number + 1, knot, low)
    return low, high
