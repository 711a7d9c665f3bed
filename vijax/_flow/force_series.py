"""Taylor coefficients of the motion of a machine with a force, order by order.

    x_(k+1) = v_k / (k + 1),   v_(k+1) = a_k / (k + 1),   a = contacts(f(t) - C v - K x + force(t, x, v))

The series of the force come from `_series`; those of the load are linear, as in `series.py`. The derivatives of the force by
positions and velocities have series too, and bound the derivatives of the motion, see `series_length.py`.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._jax.arrays import add_up, matvec
from .._jax.xla import compute_once
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .._series.plan import Plan
from .._series.series import Series, series_of

# Orders of the phase of the load beyond those of positions: it is summed over steps of up to `LONGEST_PHASE` radians.
MORE_OF_PHASE = 6
LONGEST_PHASE = 1.5


class ForceSeries(NamedTuple):
    """Coefficients of a motion, lists order by order.

    Attributes:
        x: positions, orders 0 to P, (n, ...) each.
        v: velocities, likewise.
        force: force on the masses without contact forces, orders 0 to P - 1.
        phase: phase of the load, orders 0 to P + MORE_OF_PHASE.
        series: series of the force along the motion.
    """

    x: list[Array]
    v: list[Array]
    force: list[Array]
    phase: list[Array]
    series: Series


def force_series(
    plan: Plan,
    machine: Machine,
    state: State,
    hold: Held,
    modes: tuple[Array, ...],
    order: int,
    *,
    fence: bool,
) -> ForceSeries:
    """Coefficients up to an order.

    Args:
        plan: plan of the force of the machine.
        machine: the machine.
        state: state at which the series begin.
        hold: contacts that hold.
        modes: branches of the force.
        order: P.
        fence: whether XLA computes each order once, needed outside of `lanes_last`.
    """
    assert machine.extra is not None
    at_knot = () if state.memory is None else [entered != 0 for entered in state.memory.entered]
    clock = machine.clock(state)
    series = series_of(plan, machine.extra.force, clock, like=state.x, modes=modes, at_knot=at_knot)
    x, v, phase, force = [state.x], [state.v], [state.phase], []
    call = compute_once if fence else _plainly
    for k in range(order):
        series, total, a, phase_next = call(_next, machine, hold, series, x[k], v[k], phase[k], k)
        force.append(total)
        x.append(v[k] * (1 / (k + 1)))
        v.append(a * (1 / (k + 1)))
        phase.append(phase_next)
    for k in range(order, order + MORE_OF_PHASE):
        phase.append(machine.phase_rate(phase[k]) * (1 / (k + 1)))
    return ForceSeries(x, v, force, phase, series)


def _plainly(function: Any, *args: Any) -> Any:
    return function(*args)


def _next(
    machine: Machine, hold: Held, series: Series, x: Array, v: Array, phase: Array, k: int
) -> tuple[Series, Array, Array, Array]:
    """Series with order k, coefficient k of the whole force and of the accelerations, and k + 1 of the phase."""
    series = series.extend(*in_space(machine, phase, x, v))
    total = series.force(k) + machine.varying_load(phase)
    total = total - matvec(machine.damping, v) - matvec(machine.stiffness, x)
    if k == 0:
        total = total + machine.mean
    a = machine.contacts.accelerations(total, hold, phase)
    return series, total, a, machine.phase_rate(phase) * (1 / (k + 1))


def in_space(machine: Machine, phase: Array, x: Array, v: Array) -> tuple[Array, Array]:
    """Positions and velocities as the force takes them, or coefficients of these, from those relative to the stops."""
    if machine.frame is None:
        return x, v
    w, rate = machine.frame.at(phase)
    return x + w, v + rate


def jacobian_sizes(machine: Machine, series: Series, order: int) -> tuple[list[Any], list[Any]]:
    """Largest row sums of coefficients 0 to order - 1 of the derivatives of accelerations by positions, by velocities.

    None where a coefficient is known to be zero. Rows and columns are scaled by the roots of the masses, so that no unit
    matters.
    """
    root = None
    if machine.inverse_mass.ndim == machine.mean.ndim:
        root = jnp.sqrt(machine.inverse_mass)
    own = (machine.stiffness, machine.damping)
    parts = ([series.by_x(k) for k in range(order)], [series.by_v(k) for k in range(order)])
    found = []
    for matrix, entries in zip(own, parts, strict=True):
        first = {(i, j): -matrix[i, j] for i, j in np.ndindex(matrix.shape[:2])}
        total = {at: first[at] + entries[0].get(at, 0) for at in first}
        found.append([_row_sum(machine, root, total), *(_row_sum(machine, root, e) for e in entries[1:])])
    return found[0], found[1]


def _row_sum(machine: Machine, root: Array | None, entries: dict[tuple[int, int], Array]) -> Array | None:
    if not entries:
        return None
    n, rows = machine.num_masses, []
    if root is None:  # a full mass matrix: each row times M^-1
        zero = jnp.zeros_like(next(iter(entries.values())))
        of_masses = [jnp.abs(machine.inverse_mass[i]) for i in range(n)]
        columns = [add_up([jnp.abs(entries[at]) for at in entries if at[0] == i] or [zero]) for i in range(n)]
        rows = [add_up([row[i] * columns[i] for i in range(n)]) for row in of_masses]
    else:
        for i in range(n):
            own = [root[i] * root[j] * jnp.abs(a) for (r, j), a in entries.items() if r == i]
            if own:
                rows.append(add_up(own))
    return largest(rows)


def largest(rows: list[Array]) -> Array:
    """Largest of some arrays, elementwise."""
    found = rows[0]
    for a in rows[1:]:
        found = jnp.maximum(found, a)
    return found
