"""Registry of limits: the modes of a contact, the guard of each, and the event that ends it.

In every mode a function of time, its guard, stays positive: the gap of an open contact, the contact force of a closed
one. An event is a zero of the guard; a reset (`diagonal_impacts.py`, `coupled_impacts.py`, `switching_resets.py`) then
gives the next modes. Exact flows, their derivative rule, the equations of periodic orbits, the event log and branches read guards
and events from here. A section x_i = c is the gap of one more contact, see `next_crossing.py`.

Some modes end in two ways: friction sticks while its force stays between two bounds. Machines with such elements have
two guards for each element, in two groups: `guards_of`. Arrays over guards are those of the first group, then those of the
second.

To add a limit, add its guard as a `Limit` to a group of `guards_of`, its events in `EVENTS`, their flags in
`transition.py`, and its reset.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from .._jax.arrays import Reals, append_axes
from .._machine.contacts import Held
from .._machine.derivatives import Derivatives, Rates, approaches, contact_forces
from .._machine.machine import Machine
from .._machine.state import State

# Taylor coefficients of guards: a list of few, or an array (orders, contacts).
Series = Any

IMPACT: Final = 0
STICK: Final = 1
RELEASE: Final = 2
CLOSE: Final = 3
OPEN: Final = 4
SLIP: Final = 5
TURN: Final = 6


class EventKind(NamedTuple):
    """Kind of event.

    Attributes:
        name: name in the event log.
        flag: field of `Instant`, or of its `switched`, with the contacts at which it happens.
        has_speed: True if the velocities before and after are logged.
    """

    name: str
    flag: str
    has_speed: bool = False


# Ordered by event number, which is the order of the events of one contact at one instant.
EVENTS = (
    EventKind("impact", "hit", has_speed=True),
    EventKind("stick", "stuck"),
    EventKind("release", "released"),
)
# Of friction and compliant contacts alone.
SWITCHING_EVENTS = (
    EventKind("close", "switched.closed", has_speed=True),
    EventKind("open", "switched.opened", has_speed=True),
    EventKind("slip", "switched.slipped"),
    EventKind("turn", "switched.turned"),
)
EVENT_NAMES: Final = tuple(event.name for event in EVENTS + SWITCHING_EVENTS)


class Limit(NamedTuple):
    """One mode of a contact, its guard, and the event at which it ends.

    Attributes:
        event: number of the event that ends the mode.
        is_active: flags of the contacts in this mode, (contacts,).
        value: guard, (contacts,).
        slope: first time derivative of the guard.
        speed: at which it vanishes: of approach to a contact, or of the change of a sliding velocity or a stretch over a radian
            of the load; None for guards of forces.
        derivatives: the guard and its first time derivatives, as many as are exact.
        rest: bound of the next Taylor coefficient over a step, from bounds for positions and forces, see `Expansion.rest`.
        order: number of `derivatives`.
        series: Taylor coefficients of the guard, from those of positions, forces and phase.
        leading_zeros: number of leading coefficients of the guard that vanish exactly in a mode that has just begun, as
            `State.contact` for gaps; None if none ever does.
        near: time to the event below which `series` locates it to rounding, in time scales of the motion, by dtype.
    """

    event: int
    is_active: Callable[[Machine, State], Bool[Array, "contacts ..."]]
    value: Callable[[Machine, State, Held], Array]
    slope: Callable[[Machine, State, Held, Rates], Array]
    derivatives: Callable[[Machine, State, Held, Derivatives], list[Array]]
    order: int
    rest: Callable[[Machine, tuple[Array, ...], Held], Array]
    series: Callable[[Machine, State, Held, tuple[Array, ...]], Series]
    near: dict[str, float]
    leading_zeros: Callable[[State], Int[Array, "contacts ..."]] | None
    speed: Callable[[Machine, State, Held], Array] | None = None


# Most orders that are taken one after the other: they fuse with what follows. A whole series is one array, which compiles
# faster.
_FEW = 8


def each_order(function: Callable[..., Array], *series: Array) -> Series:
    """Taylor coefficients of a linear function of positions, forces or phase, from theirs."""
    num = len(series[0])
    if num > _FEW:
        return jax.vmap(function)(*series)
    return [function(*(a[k] for a in series)) for k in range(num)]


def scaled(factor: Reals, series: Series, orders: Sequence[int] | None = None) -> Series:
    """Each coefficient times a factor, and times a number of its own if `orders` are given."""
    if isinstance(series, list):
        numbers = orders or [1] * len(series)
        return [factor * a if k == 1 else factor * (k * a) for k, a in zip(numbers, series, strict=True)]
    series = series if orders is None else append_axes(np.asarray(orders, series.dtype), series) * series
    return (factor[None] if np.ndim(factor) else factor) * series


def behind(first: Array, series: Series) -> Series:
    """A coefficient, and those that follow."""
    if isinstance(series, list):
        return [first, *series]
    return jnp.concatenate([jnp.broadcast_to(first, series.shape[1:])[None], series])


def _gap_derivatives(machine: Machine, state: State, hold: Held, now: Rates) -> list[Array]:
    del hold
    return [state.gap, *(-a for a in approaches(machine, state, now))]


def _gap_series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> Series:
    del hold
    x, _, phase = series
    return behind(state.gap, scaled(-1, each_order(machine.contacts.towards, x[1:], phase[1:])))


def _force_series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> Series:
    del state
    _, force, phase = series
    contact_force = lambda f, p: machine.contacts.contact_force(f, hold, p)  # noqa: E731
    return each_order(contact_force, force, phase[: len(force)])


# `near`: after 1e-3 time scales the remainder of five terms of the velocity, 1e-3^5 / 5!, is below rounding. A contact
# force has two terms fewer, so its zero must be nearer.
GAP = Limit(
    event=IMPACT,
    is_active=lambda machine, state: ~state.held,
    value=lambda machine, state, hold: state.gap,
    slope=lambda machine, state, hold, now: (
        -machine.contacts.towards(state.v, machine.phase_rate(state.phase))
    ),
    derivatives=_gap_derivatives,
    order=4,
    rest=lambda machine, rests, hold: machine.contacts.rest(rests[0]),
    series=_gap_series,
    near={"float64": 1e-3, "float32": 1e-2},
    leading_zeros=lambda state: state.contact,
    speed=lambda machine, state, hold: machine.approach(state),
)
FORCE = Limit(
    event=RELEASE,
    is_active=lambda machine, state: state.held,
    value=lambda machine, state, hold: machine.contacts.contact_force(
        machine.total_force(state), hold, state.phase
    ),
    slope=lambda machine, state, hold, now: machine.contacts.contact_force(
        now.force_rate, hold, machine.phase_rate(state.phase)
    ),
    derivatives=contact_forces,
    order=3,
    rest=lambda machine, rests, hold: machine.contacts.contact_force_remainder(rests[1], hold),
    series=_force_series,
    near={"float64": 1e-4, "float32": 1e-3},
    leading_zeros=None,
)
LIMITS = (GAP, FORCE)


def force_below(
    event: int,
    is_active: Callable[[Machine, State], Bool[Array, "contacts ..."]],
    most: Callable[[Machine], Array],
    sign: int = 1,
) -> Limit:
    """Limit of the force of a contact that holds, on one side: most - sign force."""

    def below(machine: Machine, forces: Series) -> Series:
        return behind(most(machine) - sign * forces[0], scaled(-sign, forces[1:]))

    return Limit(
        event=event,
        is_active=is_active,
        value=lambda machine, state, hold: most(machine) - sign * FORCE.value(machine, state, hold),
        slope=lambda machine, state, hold, now: -sign * FORCE.slope(machine, state, hold, now),
        derivatives=lambda machine, state, hold, now: below(
            machine, FORCE.derivatives(machine, state, hold, now)
        ),
        order=FORCE.order,
        rest=FORCE.rest,
        series=lambda machine, state, hold, series: below(
            machine, FORCE.series(machine, state, hold, series)
        ),
        leading_zeros=None,
        near=FORCE.near,
    )


def limits_of(machine: Machine) -> tuple[Limit, ...]:
    """Limits of the contacts of a machine."""
    return LIMITS if machine.can_stick else (GAP,)
