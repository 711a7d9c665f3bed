"""Limits of friction elements.

| mode | first guard | second guard |
| --- | --- | --- |
| slip | sliding velocity, in the direction of slip | none |
| stick | Fs - T | Fs + T |

The Taylor coefficients of the sliding velocity are those of the velocities, so a zero is proved absent as for gaps.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._machine.contacts import Held
from .._machine.derivatives import Derivatives, Rates, approach_snap, approaches
from .._machine.machine import Machine
from .._machine.state import State
from .._machine.switching import FRICTION
from .limits import FORCE, GAP, SLIP, STICK, Limit, Series, behind, each_order, force_below, scaled


def is_sticking(machine: Machine, state: State) -> Bool[Array, "contacts ..."]:
    """Flags of friction elements that stick and carry a force."""
    return state.held & machine.contacts.are(FRICTION)


def sliding_velocity(machine: Machine, state: State) -> Array:
    """Velocity w of friction elements, and the speeds of approach to contacts."""
    return machine.contacts.speeds(state.v, machine.phase_rate(state.phase))


def _slip_rates(machine: Machine, state: State, hold: Held, now: Rates) -> list[Array]:
    del hold
    _, *later = approaches(machine, state, now)
    return [state.mode.direction * a for a in (sliding_velocity(machine, state), *later)]


def _slip_derivatives(machine: Machine, state: State, hold: Held, now: Derivatives) -> list[Array]:
    last = state.mode.direction * approach_snap(machine, state, hold, now)
    return [*_slip_rates(machine, state, hold, now), last]


def _slip_series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> Series:
    del hold
    x, _, _ = series
    later = each_order(machine.contacts.along, x[2:])
    later = scaled(1, later, range(2, 2 + len(later)))
    return scaled(state.mode.direction, behind(sliding_velocity(machine, state), later))


SLIDING = Limit(
    event=STICK,
    is_active=lambda machine, state: state.mode.direction != 0,
    value=lambda machine, state, hold: state.mode.direction * sliding_velocity(machine, state),
    slope=lambda machine, state, hold, now: _slip_rates(machine, state, hold, now)[1],
    derivatives=_slip_derivatives,
    order=4,
    rest=lambda machine, rests, hold: machine.contacts.size(rests[3]),
    series=_slip_series,
    leading_zeros=lambda state: state.contact,
    near=GAP.near,
)


def _grip(machine: Machine, forces: Series, side: Array) -> Series:
    return behind(machine.contacts.laws.grip - side * forces[0], scaled(-side, forces[1:]))


def _grip_derivatives(machine: Machine, state: State, hold: Held, now: Derivatives) -> list[Array]:
    forces = FORCE.derivatives(machine, state, hold, now)
    return _grip(machine, forces, jnp.where(forces[1] < 0, -1, 1))


def _grip_series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> Series:
    forces = FORCE.series(machine, state, hold, series)
    return _grip(machine, forces, jnp.where(forces[0] < 0, -1, 1))


GRIP_AHEAD, GRIP_BEHIND = (
    force_below(SLIP, is_sticking, lambda machine: machine.contacts.laws.grip, sign) for sign in (1, -1)
)
# Both in one, for exact steps: Fs - |T|, and ahead of a step the end towards which T moves, see `switching_step.py`.
GRIP = GRIP_AHEAD._replace(
    value=lambda machine, state, hold: (
        machine.contacts.laws.grip - jnp.abs(FORCE.value(machine, state, hold))
    ),
    derivatives=_grip_derivatives,
    series=_grip_series,
)
