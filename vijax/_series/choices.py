"""Comparisons: flags that the modes of switches say."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from .algebra import Operand, is_known
from .builder import Builder, key_of
from .operations import BranchFlag, Chosen, Linear
from .switches import Switch


def above(build: Builder, a: Operand, b: Operand) -> Operand:
    """Flag that a > b."""
    terms, constant = terms_of(build, a)
    others, other = terms_of(build, b)
    for s, c in others.items():
        terms[s] = terms.get(s, 0.0) - c
    constant -= other
    moving = {s: c for s, c in terms.items() if c and not build.is_fixed(s)}
    still = {s: c for s, c in terms.items() if c and build.is_fixed(s)}
    if not moving:
        difference = build.linear([(c, s) for s, c in still.items()], constant)
        return build.compute(lambda d: jnp.greater(d, 0), (difference,), "positive")
    if not still and set(moving) <= build.not_negative:
        if constant >= 0 and min(moving.values()) > 0:
            return np.bool_(True)
        if constant <= 0 and max(moving.values()) < 0:
            return np.bool_(False)
    # Equal and opposite guards are one.
    unit = moving[min(moving)]
    guard = build.linear([(c / unit, s) for s, c in moving.items()])
    knot = build.linear([(-c / unit, s) for s, c in still.items()], 0.0 - constant / unit)
    mode = mode_of(build, guard, (knot,))
    flag = build.once(("branch", mode), lambda: build.add(BranchFlag(build.new(), (mode,), 0)))
    return flag if unit > 0 else build.compute(jnp.logical_not, (flag,), "not")


def equal(build: Builder, a: Operand, b: Operand) -> Operand:
    """Flag that a = b: at instants alone, unless they are one, or one was chosen to be the other."""
    if build.is_fixed(a) and build.is_fixed(b):
        return build.compute(jnp.equal, (a, b), "equal")
    for one, other in ((a, b), (b, a)):
        operation = None if is_known(one) else build.by_out.get(one)
        if isinstance(operation, Chosen):
            which, *cases = operation.args
            return build.choose(which, [equal(build, case, other) for case in cases])
    return np.bool_(not is_known(a) and not is_known(b) and a == b)


def terms_of(build: Builder, a: Operand) -> tuple[dict[int, float], float]:
    """Factors of the series that a sum is made of, and its constant."""
    if is_known(a):
        return {}, float(a)
    total: dict[int, float] = {}
    constant, waiting = 0.0, [(1.0, a)]
    while waiting:
        factor, s = waiting.pop()
        operation = build.by_out.get(s)
        if isinstance(operation, Linear):
            constant += factor * operation.constant
            waiting.extend((factor * c, b) for c, b in zip(operation.factors, operation.args, strict=True))
        else:
            total[s] = total.get(s, 0.0) + factor
    return total, constant


def mode_of(build: Builder, guard: int, knots: Sequence[Operand]) -> int:
    """Series of the mode of a switch: the number of knots below its guard."""

    def make() -> int:
        mode = build.leaf(is_fixed=True)
        build.switches.append(Switch(guard, tuple(knots), mode))
        return mode

    return build.once(("switch", guard, *map(key_of, knots)), make)
