"""Bounds of a force along a motion, for complex times.

A force that acts in a narrow range of positions, as exp(-(x / w)^2), or begins steeply, as tanh(x / w), shows in no coefficient
before the motion is there, and perhaps not at the end of the step either. On a disc of times it shows: a sum of absolute
coefficients bounds positions and velocities there, and arithmetic of discs the force. Terms that are polynomials of a low degree
show all of themselves in their coefficients, and those of time alone have their own bound, see `time_bound.py`.
"""

from collections.abc import Callable
from functools import lru_cache
from math import inf
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Scalar
from .algebra import Operand, is_known
from .discs import Disc, discs_of
from .operations import Chosen, Linear, Product, Square, chosen
from .order_loop import LoopSeries
from .plan import Plan
from .series import Series

# Degree of polynomials in positions and velocities that need no bound: far below the order of the series.
_LOW = 8


def has_motion_bound(plan: Plan) -> bool:
    """True if the force has terms of positions or velocities that are no polynomials of a low degree."""
    wild = _wild(plan)
    return any(s in wild for s in _wanted(plan))


def motion_bound(
    plan: Plan,
    series: Series | LoopSeries,
    radius: Scalar,
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    step: Scalar,
) -> tuple[Float[Array, "n ..."], Scalar]:
    """Bound a force on a disc of times.

    Args:
        plan: operations.
        series: series along the motion.
        radius: radius of the disc.
        x: how far positions are from their values now, there.
        v: how far velocities are.
        step: length of a step.

    Returns:
        How far the forces are from their values now but for what needs no bound, and the largest of the same of the guards of
        choices, each relative to its distance from its knots or to what it does in the step. Infinite, or NaN, where a
        singularity may be on the disc.
    """
    wild = _wild(plan)
    first, n = 1 + plan.num_numbers, plan.num_masses
    given = {0: radius} | {first + i: x[i] for i in range(n)} | {first + n + i: v[i] for i in range(n)}
    discs = discs_of(plan, series, given, [s for s in _wanted(plan) if s in wild])
    of = _radius_without_tame(plan, series, discs, wild)
    of_force = jnp.stack([of(s) + jnp.zeros_like(radius) for s in plan.forces])
    of_guards = jnp.zeros_like(radius)
    for j, switch in enumerate(plan.switches):
        if switch.guard in wild:
            own = of(switch.guard) / _scale_of_guard(plan, series, j, jnp.abs(step))
            of_guards = jnp.where(own <= of_guards, of_guards, own)
    return of_force, of_guards


def _radius_without_tame(
    plan: Plan, series: Series | LoopSeries, discs: dict[Operand, Disc], wild: frozenset[int]
) -> Callable[[Operand], Any]:
    """Function of a series: its radius without that of terms that are not wild."""
    by_out = {operation.out: operation for operation in plan.operations}

    def of(s: Operand) -> Any:
        if is_known(s) or s not in wild:
            return 0.0
        operation = by_out[s]
        if isinstance(operation, Linear):
            return sum(abs(c) * of(a) for c, a in zip(operation.factors, operation.args, strict=True))
        if isinstance(operation, Product) and operation.args[0] not in plan.moving:
            return jnp.abs(series.coefficient(operation.args[0], 0)) * of(operation.args[1])
        if isinstance(operation, Chosen):
            which, *cases = operation.args
            return chosen(series.coefficient(which, 0), [of(case) for case in cases])
        return discs[s].radius

    return of


def _scale_of_guard(plan: Plan, series: Series | LoopSeries, switch: int, step: Scalar) -> Scalar:
    """Distance of a guard from the farthest of its knots, or what its terms are in a step."""
    now, found = series.guard(switch, 0), jnp.zeros_like(step)
    for k in reversed(range(1, len(series))):
        found = (found + jnp.abs(series.guard(switch, k))) * step
    for j in range(len(plan.switches[switch].knots)):
        found = jnp.maximum(found, jnp.abs(now - series.knot(switch, j)))
    return found


def _wanted(plan: Plan) -> list[int]:
    return [s for s in (*plan.forces, *(switch.guard for switch in plan.switches)) if not is_known(s)]


@lru_cache
def _wild(plan: Plan) -> frozenset[int]:
    """Series of positions or velocities that are no polynomials of a low degree, but for factors that are of time alone."""
    first = 1 + plan.num_numbers
    degrees: dict[int, float] = dict.fromkeys(range(first, first + 2 * plan.num_masses), 1.0)
    for operation in plan.operations:
        own = [degrees.get(a, 0.0) for a in operation.sources if not is_known(a)]
        if not any(own):  # of time alone, or a number
            degree = 0.0
        elif isinstance(operation, Linear | Chosen):
            degree = max(own)
        elif isinstance(operation, Product | Square):
            degree = sum(own) if isinstance(operation, Product) else 2 * own[0]
        else:
            degree = inf
        degrees[operation.out] = degree
    return frozenset(s for s, degree in degrees.items() if degree > _LOW)
