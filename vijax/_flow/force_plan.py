"""Plans of the Taylor series of forces, kept for all machines with a force of one structure."""

from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp

from .._series.plan import Plan, plan_force

_KEPT = 256


def plan_of(force: Any, num_masses: int, *, lanes: bool, jacobian: bool = False) -> Plan:
    """Plan of the series of a force.

    Args:
        force: function of (t, x, v) as a pytree, every number of which may change.
        num_masses: n.
        lanes: whether the numbers have lanes as last axis.
        jacobian: whether its derivatives by positions and velocities have series too.

    Raises:
        Refused: an operation of the force has no Taylor series.
    """
    leaves, structure = jax.tree.flatten(force)
    key = (
        structure,
        tuple((jnp.shape(a), str(jnp.result_type(a))) for a in leaves),
        num_masses,
        lanes,
        jacobian,
    )
    try:
        return _plan(*key)
    except TypeError:  # the function of the force has no hash
        return _plan.__wrapped__(*key)


@lru_cache(_KEPT)
def _plan(structure: Any, shapes: tuple, num_masses: int, lanes: bool, jacobian: bool) -> Plan:
    with jax.ensure_compile_time_eval():
        numbers = [jnp.zeros(shape, dtype) for shape, dtype in shapes]
    return plan_force(jax.tree.unflatten(structure, numbers), num_masses, lanes=lanes, jacobian=jacobian)
