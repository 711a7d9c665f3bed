"""Smooth motion over any duration, ignoring the stops.

A modal flow takes one evaluation for any duration. Other flows step through a forcing period. A whole period of a
linear machine is one affine map z -> P z + b, the same for every period. Its powers come from repeated squaring: the
cost grows with the logarithm of their number. Time and phase restart with every period, as in the loop of a trajectory.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._jax.arrays import Scalar, smallest
from .._jax.xla import is_any
from .._machine.machine import Machine
from .._machine.state import State
from .._system.waves import turned
from .affine import affine_power
from .interface import AbstractFlow

# Period of a machine without load, times its rate: any would serve, this one is a few steps.
_UNIT = 8.0


class _Goal(NamedTuple):
    """Arguments of `coast` that say when the motion ends."""

    phase0: Float[Array, "2 harmonics"]
    periods: Int[Array, ""]
    time: Scalar
    max_steps: Int[Array, ""]


def coast(
    flow: AbstractFlow,
    machine: Machine,
    state: State,
    phase0: Float[Array, "2 harmonics"],
    periods: Int[Array, ""],
    time: Scalar,
    max_steps: Int[Array, ""],
) -> State:
    """Follow the smooth motion from a state to a later time, with the contacts that it holds.

    Args:
        flow: the flow.
        machine: the machine as arrays.
        state: start of the motion.
        phase0: forcing phase at the start of a period.
        periods: whole forcing periods from the start of the trajectory to the final time.
        time: remainder of the final time, which is not before the start of the motion.
        max_steps: bound on the steps within a period. A motion that needs more ends in NaN.
    """
    goal = _Goal(phase0, periods, time, max_steps)
    if machine.tables is None and flow.flow_map_reaches_far:
        return _flow_map(flow, machine, state, goal)
    if machine.tables is not None or machine.tones is not None:
        return _through_periods(flow, machine, state, goal)
    return _by_steps(flow, machine, state, goal)


def _flow_map(flow: AbstractFlow, machine: Machine, state: State, goal: _Goal) -> State:
    """Coast by one evaluation of the flow map."""
    phase0, periods, time, _ = goal
    span = (periods - state.periods) * machine.period + (time - state.time)
    phase = turned(machine.phase_of_period(phase0, periods), machine.phase_of_harmonics(time))
    displacement, gain = flow.flow_map(machine, state, machine.hold(state.held), span, phase - state.phase)
    names = lambda s: (s.periods, s.time, s.phase, s.x, s.v)  # noqa: E731
    there = periods, time, phase, machine.moved(state.x, displacement), state.v + gain
    # Over a zero span the state stays the same to the last bit.
    here = [jnp.where(span == 0, a, b) for a, b in zip(names(state), there, strict=True)]
    return eqx.tree_at(names, state, here)


def _by_steps(flow: AbstractFlow, machine: Machine, state: State, goal: _Goal) -> State:
    """Coast step by step within a period, and by whole periods."""
    phase0, periods, time, max_steps = goal
    is_driven = machine.frequency > 0
    unit = jnp.where(is_driven, machine.period, _UNIT * machine.timescale)
    is_later = periods > state.periods
    ahead = jnp.maximum(jnp.where(is_later, machine.period, time) - state.time, 0)
    whole = jnp.where(is_driven, periods - state.periods - is_later, jnp.floor(ahead / unit).astype(int))
    ahead = jnp.where(is_driven, ahead, ahead - whole * unit)
    state = _for(flow, machine, state, ahead, max_steps)
    state = _at_start(state, phase0, is_driven & is_later)

    # Zero for lanes without whole periods left: a period may be far longer than the rest of the motion.
    length = jnp.where(whole > 0, unit, 0)

    def period(state: State) -> State:
        return _at_start(_for(flow, machine, state, length, max_steps), phase0, is_driven)

    if flow.is_linear:
        state = jax.lax.cond(is_any(whole > 0), lambda: _power(period, state, whole), lambda: state)
    else:
        repeat = lambda carry: (period(carry[0]), carry[1] - 1)  # noqa: E731
        state, _ = jax.lax.while_loop(lambda carry: carry[1] > 0, repeat, (state, whole))
    return _for(flow, machine, state, jnp.where(is_driven & is_later, time, 0), max_steps)


def _through_periods(flow: AbstractFlow, machine: Machine, state: State, goal: _Goal) -> State:
    """Coast step by step, from knot to knot of loads by tables and from period to period, which need not be alike."""
    phase0, periods, time, max_steps = goal

    def left(state: State) -> tuple[Scalar, Array]:
        is_last = state.periods >= periods
        return jnp.where(is_last, time, machine.period) - state.time - state.time_low, is_last

    def step(carry):
        state, steps = carry
        ahead, is_last = left(state)
        until = None if machine.tables is None else machine.until_knots(state)
        target = jnp.maximum(ahead if until is None else jnp.minimum(ahead, smallest(until)), 0)
        moved, length = flow.coast(machine, state, target)
        is_there = length >= target
        rounding = 4 * jnp.finfo(target.dtype).eps * jnp.minimum(machine.period, state.time + target)
        if until is not None:
            moved, _ = machine.past_knots(moved, is_there & (until <= target + rounding))
        moved = machine.start_period(moved, phase0, is_there & ~is_last & (ahead <= target + rounding))
        return moved, steps + 1

    def is_on(carry):
        ahead, is_last = left(carry[0])
        return ((ahead > 0) | ~is_last) & (carry[1] < max_steps)

    end, _ = jax.lax.while_loop(is_on, step, (state, jnp.array(0)))
    ahead, is_last = left(end)
    return eqx.tree_at(lambda s: s.x, end, jnp.where((ahead > 0) | ~is_last, jnp.nan, end.x))


def _at_start(state: State, phase0: Float[Array, "2 harmonics"], is_over: Array) -> State:
    later = state.periods + 1, jnp.zeros_like(state.time), jnp.zeros_like(state.time), phase0
    where = lambda s: (s.periods, s.time, s.time_low, s.phase)  # noqa: E731
    return eqx.tree_at(
        where, state, tuple(jnp.where(is_over, a, b) for a, b in zip(later, where(state), strict=True))
    )


def _for(
    flow: AbstractFlow, machine: Machine, state: State, time: Scalar, max_steps: Int[Array, ""]
) -> State:
    """Coast for a time, step by step; NaN if `max_steps` do not suffice."""

    def step(carry):
        state, remaining, steps = carry
        state, length = flow.coast(machine, state, remaining)
        return state, remaining - length, steps + 1

    is_on = lambda carry: (carry[1] > 0) & (carry[2] < max_steps)  # noqa: E731
    state, remaining, _ = jax.lax.while_loop(is_on, step, (state, time, jnp.array(0)))
    return eqx.tree_at(lambda s: s.x, state, jnp.where(remaining > 0, jnp.nan, state.x))


def _power(period, state: State, count: Int[Array, ""]) -> State:
    """Apply the affine map of a period `count` times, by repeated squaring."""
    n = len(state.x)
    names = lambda s: (s.x, s.v)  # noqa: E731

    def strobe(z: Float[Array, " state"]) -> Float[Array, " state"]:
        return jnp.concatenate(names(period(eqx.tree_at(names, state, (z[:n], z[n:])))))

    z = affine_power(strobe, jnp.concatenate(names(state)), count)
    return eqx.tree_at(lambda s: (s.x, s.v, s.periods), state, (z[:n], z[n:], state.periods + count))
