"""Guards of friction and compliant contacts during an approximate step, as `event_margins.py` has those of rigid contacts.

A guard is evaluated at the states inside the step, whatever it is. So the registry of limits is all that is needed to
know. The guards between the nodes are a polynomial; its error is at most the difference between its derivative and the
slope of the guard, times the time since the start.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.guards import is_idle, leading_zeros, select_active
from .._hybrid.limits import Limit
from .._jax.arrays import Flag, Scalar, smallest
from .._jax.xla import compute_once, in_one_kernel
from .._machine.contacts import Held
from .._machine.derivatives import derivatives, rates
from .._machine.machine import Machine
from .._machine.state import State
from .bernstein import bernstein, derivative_coefficients, nodes
from .event_margins import (
    EventFreeProof,
    EventMargins,
    StepInterior,
    phase_changes,
    proof_of,
    series_radius,
    without_leading_zeros,
)
from .exact_step import state_after_step


class GuardView(eqx.Module):
    """Guard during a step.

    Attributes:
        now: value, slope, and further Taylor coefficients at the start, (4,).
        values: values at the nodes of `bernstein.py`, (nodes,).
        slopes: time derivatives there, (nodes,).
        leading_zeros: number of leading Taylor coefficients that vanish exactly.
        is_idle: whether the guard has no event.
    """

    now: Float[Array, "*guards 4"]
    values: Float[Array, "*guards nodes"]
    slopes: Float[Array, "*guards nodes"]
    leading_zeros: Int[Array, "..."]
    is_idle: Flag


def guard_margins_at(machine: Machine, state: State, hold: Held) -> EventMargins:
    """Values of all guards at a state, and their Taylor coefficients."""
    motion = derivatives(machine, state, hold)

    def known(limit: Limit) -> list[Array]:
        value, slope, second, *third = limit.derivatives(machine, state, hold, motion)
        bend = third[0] / 6 if third else jnp.zeros_like(value)
        radius = series_radius(4 if third else 3, value.dtype)
        return [value, slope, second / 2, bend, jnp.full_like(value, radius)]

    value, slope, curve, bend, radius = select_active(machine, state, known)
    idle = is_idle(state)
    value, slope = jnp.where(idle, 1, value), jnp.where(idle, 0, slope)
    return EventMargins(value, slope, jnp.where(idle, 0, curve), jnp.where(idle, 0, bend), radius, motion)


def guards_crossed_in_step(
    machine: Machine,
    state: State,
    hold: Held,
    now: EventMargins,
    end: EventMargins,
    inside: StepInterior,
    step: Scalar,
    is_expected: Bool[Array, " guards"],
) -> EventFreeProof:
    """Test every guard during a step; an event that `is_expected` at its end does not count as crossed."""
    changes = phase_changes(machine, state, inside, step)

    def at_node(displacement: Array, gain: Array, change: Array, time: Array) -> tuple[Array, Array]:
        there = state_after_step(machine, state, displacement, state.v + gain, change, time)
        moves = rates(machine, there, hold)
        value = select_active(machine, state, lambda limit: limit.value(machine, there, hold))
        return value, select_active(machine, state, lambda limit: limit.slope(machine, there, hold, moves))

    times = step * nodes(len(inside.gain) - 1)
    values, slopes = jax.vmap(at_node, out_axes=1)(inside.displacement, inside.gain, changes, times)
    # The ends are as accurate as the step.
    values = values.at[:, 0].set(now.value).at[:, -1].set(end.value)
    slopes = slopes.at[:, 0].set(now.slope).at[:, -1].set(end.slope)
    view = GuardView(
        now=jnp.stack([now.value, now.slope, now.curve, now.bend], axis=1),
        values=values,
        slopes=slopes,
        leading_zeros=leading_zeros(state),
        is_idle=is_idle(state),
    )
    return in_one_kernel(jax.vmap(_prove, (0, None, 0)), view, step, is_expected)


def _prove(view: GuardView, step: Scalar, is_expected: Flag) -> EventFreeProof:
    values, slopes = compute_once(bernstein, view.values), compute_once(bernstein, view.slopes)
    pairs = zip(derivative_coefficients(values), slopes, strict=True)
    error = -smallest([-jnp.abs(by_value - step * slope) for by_value, slope in pairs])
    starts = step * view.now[1], step**2 * view.now[2], step**3 * view.now[3]
    likely = without_leading_zeros(values, starts, view.leading_zeros)
    nearest = smallest([view.values[j] for j in range(1, len(values))]) + error
    is_crossed = ((nearest < 0) | (view.values[-1] < 0)) & ~is_expected
    return proof_of(likely, is_crossed, view.leading_zeros, view.is_idle, error)
