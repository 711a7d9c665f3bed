"""Bounds of series of time alone, for complex times.

A pulse that is still far shows in no coefficient now. A bound on a disc of times much larger than the step shows that the polynomial
misses nothing, see `discs.py`.
"""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from .._jax.arrays import Scalar
from .algebra import is_known
from .discs import discs_of
from .operations import Chosen, Fixed, Integral, Linear, Product, Square
from .plan import Plan
from .series import series_of


def has_time_bound(plan: Plan) -> bool:
    """True if the force has series of time alone that are neither polynomials nor harmonic."""
    return bool(_wild(plan))


def time_bound(plan: Plan, force: Any, t: Any, radius: Any, *, like: Array, modes: Any = ()) -> Scalar:
    """Bound how far series of time alone are from their values at t, for complex times within a radius of t.

    It is the largest over all terms of the force, each without its constant factors, relative to its own value where this is
    larger than one: an amplitude is no scale of the function. Terms that are polynomials, harmonic, or products of such are not
    among them: their coefficients tell all. Infinite, or NaN, where a singularity may be on the disc.
    """
    wild = _wild(plan)
    empty = jnp.zeros_like(like)
    values = series_of(plan, force, t, like=like, modes=modes).extend(empty, empty)
    discs = discs_of(plan, values, {0: radius}, wild)
    most = jnp.zeros(like.shape[1:], like.dtype)
    for series in wild:
        most = jnp.maximum(most, discs[series].radius / jnp.maximum(jnp.abs(discs[series].centre), 1))
    return most


def _wild(plan: Plan) -> list[int]:
    """Terms of time alone that the motion reads, and that are not tame."""
    first = 1 + plan.num_numbers
    moving = set(range(first, first + 2 * plan.num_masses))
    timed, linear, tame = {0}, {0}, {0}
    read: dict[int, None] = {}
    for operation in plan.operations:
        own = [a for a in operation.sources if not is_known(a)]
        if any(a in moving for a in own):
            moving.add(operation.out)
            read.update(dict.fromkeys(a for a in own if a in timed))
        elif any(a in timed for a in own):
            timed.add(operation.out)
            of_time = [a for a in own if a in timed]
            is_sum = isinstance(operation, Linear) or (isinstance(operation, Product) and len(of_time) == 1)
            if is_sum and all(a in linear for a in of_time):
                linear.add(operation.out)
            if isinstance(operation, Integral):
                is_tame = operation.value in (jnp.sin, jnp.cos) and all(a in linear for a in of_time)
            else:
                is_polynomial = isinstance(operation, Linear | Product | Square | Chosen)
                is_tame = is_polynomial and all(a in tame for a in of_time)
            if is_tame:
                tame.add(operation.out)
    read.update(dict.fromkeys(f for f in plan.forces if not is_known(f) and f in timed))
    return _terms(plan, [s for s in read if s not in tame], tame)


def _terms(plan: Plan, series: Sequence[int], tame: set[int]) -> list[int]:
    """Terms of sums that are not tame, without factors that do not change."""
    by_out = {operation.out: operation for operation in plan.operations}
    first = 1 + plan.num_numbers
    given = {*range(1, first), *(switch.mode for switch in plan.switches)}
    is_fixed = lambda a: is_known(a) or a in given or isinstance(by_out.get(a), Fixed)  # noqa: E731
    found: dict[int, None] = {}
    waiting = list(series)
    while waiting:
        s = waiting.pop()
        operation = by_out.get(s)
        own = [] if operation is None else [a for a in operation.sources if not is_fixed(a)]
        if isinstance(operation, Linear) or (isinstance(operation, Product) and len(own) == 1):
            waiting.extend(a for a in own if a not in tame)
        else:
            found[s] = None
    return list(found)
