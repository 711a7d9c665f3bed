"""Limits of friction elements.

| mode | first guard | second guard |
| --- | --- | --- |
| slip | sliding velocity, in the direction of slip | none |
| stick | Fs - T | Fs + T |

Of friction of a contact Fs = mu N, linear in the state too: N is the reaction of a contact that holds, or the force of the
spring of a compliant one.

The Taylor coefficients of the sliding velocity are those of the velocities, so a zero is proved absent as for gaps.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._machine.contacts import Held
from .._machine.derivatives import Derivatives, Rates, approach_snap, approaches, rates
from .._machine.kinds import FRICTION
from .._machine.machine import Machine
from .._machine.state import State
from .compliant_limits import spring_derivatives, spring_rest, spring_series
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


def _deceleration(machine: Machine, state: State, hold: Held) -> Array:
    return -_slip_rates(machine, state, hold, rates(machine, state, hold))[1] / machine.frequency


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
    speed=_deceleration,
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


def _of_tied(machine: Machine, state: State, forces: Series, springs: Series, side: int) -> Series:
    """Fs - side T of friction of contacts, from reactions and forces of springs; of other friction with its constant Fs."""
    contacts, laws = machine.contacts, machine.contacts.laws

    def grip(force: Array, spring: Array) -> Array:
        normal = contacts.at_normal(jnp.where(state.held, force, jnp.where(state.mode.closed, spring, 0)))
        return jnp.where(contacts.are_tied, laws.static_coefficient * normal, 0) - side * force

    if isinstance(forces, list):
        rest = [grip(*pair) for pair in zip(forces, springs, strict=False)]
    else:
        num = min(len(forces), len(springs))
        rest = jax.vmap(grip)(forces[:num], springs[:num])
    return behind(laws.grip + rest[0], rest[1:])


def _tied_rest(machine: Machine, rests: tuple[Array, ...], hold: Held) -> Array:
    contacts, laws = machine.contacts, machine.contacts.laws
    own = FORCE.rest(machine, rests, hold)
    normal = contacts.at_normal(own + spring_rest(machine, rests, hold))
    return own + jnp.where(contacts.are_tied, laws.static_coefficient * normal, 0)


def _tied_grip(side: int) -> Limit:
    """Limit of the force of friction of contacts that sticks, on one side."""

    def derivatives(machine: Machine, state: State, hold: Held, now: Derivatives) -> list[Array]:
        forces, springs = (of(machine, state, hold, now) for of in (FORCE.derivatives, spring_derivatives))
        return _of_tied(machine, state, forces, springs, side)

    def value(machine: Machine, state: State, hold: Held) -> Array:
        spring = machine.contacts.spring_force(state.gap, machine.approach(state))
        return _of_tied(machine, state, [FORCE.value(machine, state, hold)], [spring], side)[0]

    def slope(machine: Machine, state: State, hold: Held, now: Rates) -> Array:
        spring = spring_derivatives(machine, state, hold, now)[1]
        # Without the constant part of the value.
        grip = machine.contacts.laws.grip
        return _of_tied(machine, state, [FORCE.slope(machine, state, hold, now)], [spring], side)[0] - grip

    def series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> Series:
        forces, springs = (of(machine, state, hold, series) for of in (FORCE.series, spring_series))
        return _of_tied(machine, state, forces, springs, side)

    return GRIP_AHEAD._replace(
        value=value, slope=slope, derivatives=derivatives, rest=_tied_rest, series=series
    )


TIED_AHEAD, TIED_BEHIND = _tied_grip(1), _tied_grip(-1)
