"""Functions of time alone in a force that its series at one time do not tell: pulses."""

import jax.numpy as jnp

from .._series.operations import Chosen, Integral, Linear, Product, Square, is_known
from .._series.plan import Plan


def has_pulses(plan: Plan) -> bool:
    """True if a force has functions of time alone that are neither polynomials nor harmonic between knots of time.

    Such a function, a Gaussian for instance, may be about to begin and yet show in no coefficient now.
    """
    first = 1 + plan.num_numbers
    moving = set(range(first, first + 2 * plan.num_masses))
    timed, linear, tame = {0}, {0}, {0}
    read: set[int] = {f for f in plan.forces if not is_known(f)}
    for operation in plan.operations:
        sources = operation.of if isinstance(operation, Integral) else operation.args
        own = {a for a in sources if not is_known(a)}
        if own & moving:
            moving.add(operation.out)
            read |= own
            continue
        of_time = own & timed
        if not of_time:
            continue
        timed.add(operation.out)
        is_sum = isinstance(operation, Linear) or (isinstance(operation, Product) and len(of_time) == 1)
        if is_sum and of_time <= linear:
            linear.add(operation.out)
        if isinstance(operation, Integral):
            is_tame = operation.value in (jnp.sin, jnp.cos) and of_time <= linear
        else:
            is_polynomial = isinstance(operation, Linear | Product | Square | Chosen)
            is_tame = is_polynomial and of_time <= tame
        if is_tame:
            tame.add(operation.out)
    return bool((read & timed) - tame)
