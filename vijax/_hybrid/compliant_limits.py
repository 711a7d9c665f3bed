"""Limits and resets of compliant contacts.

| mode | first guard | second guard |
| --- | --- | --- |
| apart | gap | none |
| closed | depth d | spring force N = F0 + k d + c d' |
| inside | depth d | -N |
| at rest at d = 0 | reaction | F0 - reaction |

A closed contact opens where N falls through zero, or, with a preload, at d = 0 with N left. Without a damper N > 0
follows from d > 0.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Flag, with_derivative_of
from .._machine.contacts import Held
from .._machine.derivatives import Rates, approaches
from .._machine.kinds import COMPLIANT
from .._machine.machine import Machine
from .._machine.state import Mode, State
from .limits import CLOSE, GAP, OPEN, Limit, Series, behind, force_below, scaled
from .sticking import is_rounding
from .transition import Zeros


def is_resting(machine: Machine, state: State) -> Bool[Array, "contacts ..."]:
    """Flags of compliant contacts on which a mass rests at d = 0."""
    return state.held & machine.contacts.are(COMPLIANT)


def spring_derivatives(machine: Machine, state: State, hold: Held, now: Rates) -> list[Array]:
    del hold
    laws = machine.contacts.laws
    speed, acceleration, jerk = approaches(machine, state, now)
    return [
        machine.contacts.spring_force(state.gap, speed),
        laws.stiffness * speed + laws.damping * acceleration,
        laws.stiffness * acceleration + laws.damping * jerk,
    ]


def spring_rest(machine: Machine, rests: tuple[Array, ...], hold: Held) -> Array:
    """Bound of the third Taylor coefficient of N: that of d is a part of the jerk, that of d' of its rate."""
    del hold
    x_rest, _, third, _ = rests
    contacts, laws = machine.contacts, machine.contacts.laws
    return laws.stiffness * contacts.third_rest(third) + 4 * laws.damping * contacts.rest(x_rest)


def spring_series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> Series:
    laws = machine.contacts.laws
    depth = scaled(-1, GAP.series(machine, state, hold, series))
    springs = scaled(laws.stiffness, depth[:-1])
    dampers = scaled(laws.damping, depth[1:], range(1, len(depth)))
    force = (
        [a + b for a, b in zip(springs, dampers, strict=True)]
        if isinstance(depth, list)
        else springs + dampers
    )
    return behind(laws.preload + force[0], force[1:])


DEPTH = Limit(
    event=OPEN,
    is_active=lambda machine, state: state.mode.closed | state.mode.inside,
    value=lambda machine, state, hold: -state.gap,
    slope=lambda machine, state, hold, now: -GAP.slope(machine, state, hold, now),
    derivatives=lambda machine, state, hold, now: [-a for a in GAP.derivatives(machine, state, hold, now)],
    order=GAP.order,
    rest=GAP.rest,
    series=lambda machine, state, hold, series: scaled(-1, GAP.series(machine, state, hold, series)),
    leading_zeros=GAP.leading_zeros,
    near=GAP.near,
    speed=lambda machine, state, hold: -machine.approach(state),
)
SPRING = Limit(
    event=OPEN,
    # Without a damper the depth is equivalent, and loses fewer digits.
    is_active=lambda machine, state: state.mode.closed & (machine.contacts.laws.damping > 0),
    value=lambda machine, state, hold: machine.contacts.spring_force(state.gap, machine.approach(state)),
    slope=lambda machine, state, hold, now: spring_derivatives(machine, state, hold, now)[1],
    derivatives=spring_derivatives,
    order=3,
    rest=spring_rest,
    series=spring_series,
    leading_zeros=lambda state: state.mode.begins,
    near=GAP.near,
)
LAG = Limit(
    event=CLOSE,
    is_active=lambda machine, state: state.mode.inside,
    value=lambda machine, state, hold: -SPRING.value(machine, state, hold),
    slope=lambda machine, state, hold, now: -SPRING.slope(machine, state, hold, now),
    derivatives=lambda machine, state, hold, now: [-a for a in spring_derivatives(machine, state, hold, now)],
    order=3,
    rest=spring_rest,
    series=lambda machine, state, hold, series: scaled(-1, spring_series(machine, state, hold, series)),
    leading_zeros=lambda state: state.mode.begins,
    near=GAP.near,
)
LOAD = force_below(CLOSE, is_resting, lambda machine: machine.contacts.laws.preload)


def compliant_switched(
    machine: Machine,
    state: State,
    events: Zeros,
    is_set_off: Bool[Array, "contacts ..."],
    speed: Float[Array, "contacts ..."],
    is_now: Flag,
) -> tuple[State, Bool[Array, "contacts ..."], Zeros]:
    """State with compliant contacts closed and opened, flags of those now at d = 0, and zeros with those of what opens alike."""
    contacts, mode = machine.contacts, state.mode
    compliant, laws = contacts.are(COMPLIANT), contacts.laws
    is_free = compliant & (~state.held | is_set_off)
    # What is left at this instant opens with it, as where another contact hands on the force that it takes from this one.
    place, rate = contacts.size(jnp.abs(state.x)) + jnp.abs(contacts.limit), contacts.size(jnp.abs(state.v))
    size = laws.preload + laws.stiffness * place + laws.damping * rate
    leaves = mode.closed & (speed < 0) & is_now
    ends = leaves & is_rounding(contacts.spring_force(state.gap, speed), size)
    events = Zeros(events.first | leaves & is_rounding(state.gap, place), events.second | ends)
    at_limit = is_free & (events.first | is_set_off | (state.gap == 0))
    # What passes its position beside another event does so at a time of its own: the gap has derivatives then.
    gap = with_derivative_of(
        jnp.where(at_limit, 0, state.gap), jnp.where(at_limit & (speed == 0), 0, state.gap)
    )
    enters = at_limit & (speed > 0)
    past = jnp.where(at_limit, enters, mode.closed | mode.inside)
    changes = is_free & events.second & ~at_limit
    pushes = contacts.spring_force(gap, speed) > 0
    closed = jnp.where(changes, mode.inside, pushes)
    closed = compliant & past & (enters | closed)
    begins = jnp.where(changes, jnp.int8(1), jnp.int8(0))
    is_new = at_limit & (speed != 0)
    contact = jnp.where(is_new, jnp.int8(1), state.contact)
    mode = Mode(closed, compliant & past & ~closed, mode.direction, begins, mode.paradox)
    return eqx.tree_at(lambda s: (s.gap, s.contact, s.mode), state, (gap, contact, mode)), at_limit, events
