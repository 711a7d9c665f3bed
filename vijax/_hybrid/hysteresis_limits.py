"""Limits and resets of Jenkins elements.

| mode | first guard | second guard |
| --- | --- | --- |
| stick | F / k - e | F / k + e |
| slip | row . v, in the direction of slip | none |

e is the stretch of the spring, e' = row . v while its slider sticks. So the guards of stick are those of a gap, with the
stretch in place of the position. The force is continuous, so what an element does changes no acceleration: all others are
decided first. One whose stretch is at a limit then slips if its masses go on that way just after the instant, by the first
of row . v and its derivatives that is not rounding; otherwise it sticks.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .._jax.arrays import with_derivative_of
from .._jax.concrete import stop_gradients
from .._machine.contacts import Held
from .._machine.derivatives import Derivatives, Rates, approaches
from .._machine.kinds import JENKINS
from .._machine.machine import Machine
from .._machine.state import FROZEN, State
from .just_after import just_after, sign_just_after, zeros_just_after
from .limits import GAP, SLIP, Limit, Series, behind, each_order, scaled
from .sticking import usual_speeds
from .transition import Zeros


def is_stuck(machine: Machine, state: State) -> Bool[Array, "contacts ..."]:
    """Flags of Jenkins elements whose slider sticks."""
    return machine.contacts.are(JENKINS) & (state.mode.direction == 0)


def _room(side: int, machine: Machine, state: State) -> Array:
    """Stretch left to the limit on a side."""
    return machine.contacts.laws.reach - side * machine.contacts.stretches(state.v)


def _room_derivatives(side: int, machine: Machine, state: State, hold: Held, now: Derivatives) -> list[Array]:
    del hold
    return [_room(side, machine, state), *(-side * a for a in approaches(machine, state, now))]


def _room_series(side: int, machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> Series:
    del hold
    x, _, _ = series
    return behind(_room(side, machine, state), scaled(-side, each_order(machine.contacts.along, x[1:])))


def _slope(side: int, machine: Machine, state: State, hold: Held, now: Rates) -> Array:
    del hold, now
    return -side * machine.contacts.along(state.v)


def _stretch(side: int, leading_zeros: Any) -> Limit:
    return Limit(
        event=SLIP,
        is_active=is_stuck,
        value=lambda machine, state, hold: _room(side, machine, state),
        slope=partial(_slope, side),
        derivatives=partial(_room_derivatives, side),
        order=4,
        rest=lambda machine, rests, hold: machine.contacts.size(rests[0]),
        series=partial(_room_series, side),
        near=GAP.near,
        leading_zeros=leading_zeros,
        speed=lambda machine, state, hold: side * machine.contacts.along(state.v) / machine.frequency,
    )


STRETCH_AHEAD = _stretch(1, lambda state: state.contact)
STRETCH_BEHIND = _stretch(-1, lambda state: state.mode.begins)


class AtLimit(NamedTuple):
    """Flags of Jenkins elements whose stretch is at its upper or its lower limit, (contacts,) each, and those at a stop.

    Attributes:
        upper: at F / k.
        lower: at -F / k.
        stopped: with a velocity along the row that is zero at this instant.
        struck: with masses that an impact of this instant turns.
    """

    upper: Bool[Array, "contacts ..."]
    lower: Bool[Array, "contacts ..."]
    stopped: Bool[Array, "contacts ..."]
    struck: Bool[Array, "contacts ..."]


def at_limits(
    machine: Machine,
    before: State,
    zeros: tuple[Bool[Array, "contacts ..."], Bool[Array, "contacts ..."]],
    is_struck: Bool[Array, "contacts ..."],
) -> AtLimit:
    """Jenkins elements at a limit, from the state and the zeros of their guards just before, and what impacts strike."""
    contacts, own = machine.contacts, machine.contacts.are(JENKINS)
    old, stretch, reach = before.mode.direction, contacts.stretches(before.v), contacts.laws.reach
    sticks, is_pointlike = own & (old == 0), own & (reach == 0)
    first, second = zeros
    upper = (old > 0) | (sticks & (first | (stretch >= reach)))
    lower = (old < 0) | (sticks & (second | (stretch <= -reach)))
    return AtLimit(
        (own & upper) | is_pointlike,
        (own & lower) | is_pointlike,
        own & ~sticks & first & ~is_struck,
        own & is_struck & ~is_pointlike,
    )


def limits_at_start(machine: Machine, state: State) -> Zeros:
    """Flags of Jenkins elements that start at their limits, but for the rounding of a start that was converted."""
    contacts, reach = machine.contacts, machine.contacts.laws.reach
    stretch = contacts.stretches(state.v)
    least = reach * (1 - 4 * float(jnp.finfo(stretch.dtype).eps))
    return Zeros(stretch >= least, stretch <= -least)


def sliders_driven(machine: Machine, state: State, at: AtLimit) -> State:
    """State in which Jenkins elements at a limit slip where their masses move that way; before all else is decided."""
    speed, rounding = _speeds(machine, state, at)
    sign = jnp.where(jnp.abs(speed) <= rounding, 0, jnp.sign(speed)).astype(jnp.int8)
    return _slipping(machine, state, at, sign)[0]


def sliders_settled(machine: Machine, state: State, at: AtLimit) -> State:
    """State in which Jenkins elements slip or stick, after all else is decided."""
    own = machine.contacts.are(JENKINS)
    zeros, sign = _motion_just_after(machine, state, at)
    state, new = _slipping(machine, state, at, sign)
    # A slider that stops leaves the limit at which it is; one that slips from rest has no speed yet.
    sticks = jnp.where(own & (new == 0), jnp.minimum(zeros + 1, 3), 0).astype(jnp.int8)
    contact = jnp.where(new != 0, zeros, jnp.where(at.upper, sticks, 0)).astype(jnp.int8)
    contact = jnp.where(own & (state.contact != FROZEN), contact, state.contact)
    begins = jnp.where(own, jnp.where(at.lower, sticks, jnp.int8(0)), state.mode.begins)
    return eqx.tree_at(lambda s: (s.contact, s.mode.begins), state, (contact, begins))


def _slipping(
    machine: Machine, state: State, at: AtLimit, sign: Int[Array, "contacts ..."]
) -> tuple[State, Int[Array, "contacts ..."]]:
    """State with Jenkins elements that slip where their masses move beyond a limit, and their directions."""
    contacts = machine.contacts
    new = jnp.where((at.upper & (sign > 0)) | (at.lower & (sign < 0)), sign, jnp.int8(0))
    direction = jnp.where(contacts.are(JENKINS), new, state.mode.direction)
    place = at.upper.astype(jnp.int8) - (at.lower & ~at.upper).astype(jnp.int8)
    place = jnp.where(new != 0, new, place)
    v = contacts.with_stretches(state.v, place)
    # Where an impact stops a slider, the stretch has the derivative of its own time, see `own_times.py`, and not that of the limit.
    kept = jnp.where(at.struck & (new == 0), jnp.int8(0), place)
    v = with_derivative_of(v, contacts.with_stretches(state.v, kept))
    return eqx.tree_at(lambda s: (s.v, s.mode.direction), state, (v, direction)), new


def _speeds(machine: Machine, state: State, at: AtLimit) -> tuple[Array, Array]:
    """Velocities along the rows, and their rounding errors."""
    contacts = machine.contacts
    size = contacts.size(jnp.abs(state.v)) + usual_speeds(machine, state)
    speed = jnp.where(at.stopped, 0, contacts.along(state.v))
    return speed, 64 * float(jnp.finfo(size.dtype).eps) * size


def _motion_just_after(
    machine: Machine, state: State, at: AtLimit
) -> tuple[Int[Array, "contacts ..."], Int[Array, "contacts ..."]]:
    """Number of derivatives of row . v, itself the first, that are zero before one that is not, and the sign of that."""
    machine, state = stop_gradients((machine, state))
    machine = machine.in_mode(state)
    force, hold = machine.total_force(state), machine.hold(state.held)
    found = just_after(machine, state, force, hold)
    speed, rounding = _speeds(machine, state, at)
    values, errors = [speed, *found.moves[:2]], [rounding, *found.move_errors[:2]]
    return zeros_just_after(values, errors), sign_just_after(values, errors).astype(jnp.int8)
