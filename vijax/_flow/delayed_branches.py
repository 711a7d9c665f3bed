"""Derivatives of a motion whose force goes from one branch to another at a time that moves with the parameters."""

import jax
from jaxtyping import Array

from .._jax.arrays import Scalar
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .._series.plan import Plan
from .._series.series import force_at
from .exact_step import state_after_step
from .force_series import in_space


def gain_of_delay(
    plan: Plan,
    machine: Machine,
    state: State,
    hold: Held,
    modes: tuple[tuple[Scalar, ...], tuple[Scalar, ...]],
    delay: Scalar,
) -> Array:
    """Velocity gained by a motion that goes from branches to others later by a zero with derivatives.

    A motion that goes on in the old branches for dt, and dt less in the new ones, gains (before - after) dt, with the
    accelerations halfway. So second derivatives are right too, also where the force does not jump.
    """
    still, half = jax.lax.stop_gradient, delay / 2
    before, after = (still(_acceleration(plan, machine, state, hold, m)) for m in modes)
    rate = machine.phase_rate(state.phase)

    def halfway(v: Array, modes: tuple[Scalar, ...]) -> Array:
        there = state_after_step(machine, state, half * state.v, v, half * rate, half)
        return _acceleration(plan, machine, there, hold, modes)

    v = state.v + half * before
    return (halfway(v, modes[0]) - halfway(v + half * (before - after), modes[1])) * delay


def _acceleration(plan: Plan, machine: Machine, state: State, hold: Held, modes: tuple[Scalar, ...]) -> Array:
    """Accelerations of the masses in the branches of the force that the modes say."""
    assert machine.extra is not None
    x, v = in_space(machine, state.phase, state.x, state.v)
    own = force_at(plan, machine.extra.force, machine.clock(state), x, v, modes)
    return machine.contacts.accelerations(
        machine.force(state.phase, state.x, state.v) + own, hold, state.phase
    )
