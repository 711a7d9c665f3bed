"""Taylor coefficients of the motion of a machine with a force, order by order.

    x_(k+1) = v_k / (k + 1),   v_(k+1) = a_k / (k + 1),   a = contacts(f(t) - C v - K x + force(t, x, v))

The series of the force come from `_series`; those of the load are linear, as in `series.py`. The derivatives of the force by
positions and velocities have series too, and bound the derivatives of the motion, see `series_length.py`.
"""

from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._jax.arrays import Scalar, add_up, matvec
from .._jax.xla import compute_once
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .._series.order_loop import Convolution, LoopSeries, first_sums, one_order
from .._series.plan import Plan
from .._series.series import Series, series_of
from .orders import Orders

# Orders of the phase of the load beyond those of positions: it is summed over steps of up to `LONGEST_PHASE` radians.
MORE_OF_PHASE = 6
LONGEST_PHASE = 1.5


class ForceSeries(NamedTuple):
    """Coefficients of a motion: lists order by order, or arrays with the orders first where a loop made them.

    Attributes:
        x: positions, orders 0 to P, (n, ...) each.
        v: velocities, likewise.
        force: force on the masses without contact forces, orders 0 to P - 1.
        phase: phase of the load, orders 0 to P + MORE_OF_PHASE.
        series: series of the force along the motion; of a loop the first coefficients, and those of the guards of its switches, None
            if nobody reads them.
        sizes: `jacobian_sizes` of a plan that has them.
    """

    x: Orders
    v: Orders
    force: Orders
    phase: Orders
    series: Any
    sizes: tuple[Any, Any] | None


def force_series(
    plan: Plan,
    machine: Machine,
    state: State,
    hold: Held,
    modes: tuple[Array, ...],
    order: int,
    *,
    is_alone: bool,
) -> ForceSeries:
    """Coefficients up to an order.

    Args:
        plan: plan of the force of the machine.
        machine: the machine.
        state: state at which the series begin.
        hold: contacts that hold.
        modes: branches of the force.
        order: P.
        is_alone: whether a loop makes them, of one trajectory; otherwise they are written out, for `lanes_last`.
    """
    assert machine.extra is not None
    at_knot = () if state.memory is None else [entered != 0 for entered in state.memory.entered]
    clock = machine.clock(state)
    series = series_of(plan, machine.extra.force, clock, like=state.x, modes=modes, at_knot=at_knot)
    if is_alone:
        return compute_once(_by_loop, machine, hold, series, state, order)
    x, v, phase, force = [state.x], [state.v], [state.phase], []
    for k in range(order):
        series = series.extend(*in_space(machine, phase[k], x[k], v[k]))
        total, a = _motion(machine, hold, series.force(k), x[k], v[k], phase[k], has_mean=k == 0)
        force.append(total)
        x.append(v[k] * (1 / (k + 1)))
        v.append(a * (1 / (k + 1)))
        phase.append(machine.phase_rate(phase[k]) * (1 / (k + 1)))
    for k in range(order, order + MORE_OF_PHASE):
        phase.append(machine.phase_rate(phase[k]) * (1 / (k + 1)))
    sizes = jacobian_sizes(machine, series, order) if plan.has_jacobian else None
    return ForceSeries(x, v, force, phase, series, sizes)


def _by_loop(machine: Machine, hold: Held, series: Series, state: State, order: int) -> ForceSeries:
    """Coefficients by a loop over the orders from 1 on."""
    plan, dtype = series.plan, state.x.dtype
    phase = _phase_orders(machine, state.phase, order + MORE_OF_PHASE)
    series = series.extend(*in_space(machine, state.phase, state.x, state.v))
    force, a = _motion(machine, hold, series.force(0), state.x, state.v, state.phase, has_mean=True)
    root = _scale(machine)
    guards = [w.guard for w in plan.switches if w.guard in plan.moving]

    def one(carry: tuple[Convolution, Array, Array], now: tuple[Scalar, Scalar, Array]) -> tuple:
        (sums, x, v), (k, share, phase) = carry, now
        own = one_order(series, k, sums, *in_space(machine, phase, x, v))
        total, a = _motion(machine, hold, own.force(k), x, v, phase, has_mean=False)
        sizes = (
            [_row_sum(machine, root, e) for e in (own.by_x(k), own.by_v(k))] if plan.has_jacobian else None
        )
        kept = {guard: jnp.asarray(own.coefficient(guard, k), dtype) for guard in guards}
        return (own.sums, v * share, a * share), (x, v, total, kept, sizes)

    k = np.arange(1, order)
    orders = jnp.asarray(k, dtype), jnp.asarray(1 / (k + 1), dtype), phase[1:order]
    (_, *last), (x, v, forces, kept, later_sizes) = jax.lax.scan(
        one, (first_sums(plan, order, state.x), state.v, a), orders
    )
    x, v = (
        jnp.concatenate([begin[None], later, end[None]])
        for begin, later, end in zip((state.x, state.v), (x, v), last, strict=True)
    )
    sizes = None
    if plan.has_jacobian:
        starts = [jnp.asarray(_row_sum(machine, root, e))[None] for e in _jacobian(machine, series)]
        of_x, of_v = (
            a if b is None else jnp.concatenate([a, b]) for a, b in zip(starts, later_sizes, strict=True)
        )
        sizes = of_x, of_v
    forces = jnp.concatenate([force[None], forces])
    found = LoopSeries(series, kept, order) if plan.num_switches or plan.has_jacobian else None
    return ForceSeries(x, v, forces, phase, found, sizes)


def _motion(
    machine: Machine, hold: Held, own: Array, x: Array, v: Array, phase: Array, *, has_mean: bool
) -> tuple[Array, Array]:
    """Coefficient of the whole force and of the accelerations, from that of the `force` of the machine."""
    total = own + machine.varying_load(phase)
    total = total - matvec(machine.damping, v) - matvec(machine.stiffness, x)
    if has_mean:
        total = total + machine.mean
    return total, machine.contacts.accelerations(total, hold, phase)


def _phase_orders(machine: Machine, phase: Array, order: int) -> Array:
    """Coefficients of the phase of the load from order 0 to `order`."""
    shares = jnp.asarray(1 / np.arange(1, order + 1), phase.dtype)
    last, found = jax.lax.scan(lambda a, share: (machine.phase_rate(a) * share, a), phase, shares)
    return jnp.concatenate([found, last[None]])


def in_space(machine: Machine, phase: Array, x: Array, v: Array) -> tuple[Array, Array]:
    """Positions and velocities as the force takes them, or coefficients of these, from those relative to the stops."""
    if machine.frame is None:
        return x, v
    w, rate = machine.frame.at(phase)
    return x + w, v + rate


def jacobian_sizes(machine: Machine, series: Series, order: int) -> tuple[list[Any], list[Any]]:
    """Largest row sums of coefficients 0 to order - 1 of the derivatives of accelerations by positions, by velocities.

    None where a coefficient is known to be zero; of a loop an array with one row where all but the first are. Rows and columns
    are scaled by the roots of the masses, so that no unit matters.
    """
    root = _scale(machine)
    first = _jacobian(machine, series)
    later = ([of(k) for k in range(1, order)] for of in (series.by_x, series.by_v))
    by_x, by_v = (
        [_row_sum(machine, root, e) for e in (begin, *more)] for begin, more in zip(first, later, strict=True)
    )
    return by_x, by_v


def _scale(machine: Machine) -> Array | None:
    """Roots of the inverse masses; None for a full mass matrix."""
    return jnp.sqrt(machine.inverse_mass) if machine.inverse_mass.ndim == machine.mean.ndim else None


def _jacobian(machine: Machine, series: Series) -> list[dict[tuple[int, int], Array]]:
    """Derivatives of the whole force by positions and velocities now."""
    found = []
    for matrix, entries in ((machine.stiffness, series.by_x(0)), (machine.damping, series.by_v(0))):
        places = np.ndindex(matrix.shape[:2])
        found.append({at: -matrix[at] + entries[at] if at in entries else -matrix[at] for at in places})
    return found


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
    return reduce(jnp.maximum, rows)
