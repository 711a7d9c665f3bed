"""The registry of limits: the modes of a contact, the guard of each, and the event that ends it.

In every mode one function of time, its guard, is positive as long as the mode lasts: the gap of an open contact, the contact
force of one that holds. An event happens where a guard vanishes; then a reset (`diagonal_impacts.py`, `coupled_impacts.py`)
decides the modes that follow. The steps of exact flows, the rule of their derivatives, the equations of periodic orbits, the
event log and branches read the guards and the events from here. A section x_i = c is the gap of one more contact, see
`next_crossing.py`.

To add a limit: its guard as a `Limit` in `limits_of`, its events in `EVENTS`, the flags of these in `transition.py`, and its reset.
"""

from collections.abc import Callable
from functools import reduce
from typing import Any, Final, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._machine.contacts import Held
from .._machine.derivatives import Derivatives, Rates, approaches, contact_forces
from .._machine.machine import Machine
from .._machine.state import State

IMPACT: Final = 0
STICK: Final = 1
RELEASE: Final = 2


class Event(NamedTuple):
    """A kind of event.

    Attributes:
        name: the word for it.
        flag: the field of `Instant` that tells at which contacts it happens.
        has_speed: whether its velocities before and after are logged.
    """

    name: str
    flag: str
    has_speed: bool = False


# In the order of their numbers, which is that of the events of one contact at one instant.
EVENTS = (Event("impact", "hit", has_speed=True), Event("stick", "stuck"), Event("release", "released"))
EVENT_NAMES: Final = tuple(event.name for event in EVENTS)


class Limit(NamedTuple):
    """One mode of a contact: its guard, and what happens where the guard vanishes.

    Attributes:
        event: the number of the event that ends the mode.
        bifurcation: what a branch of orbits meets where the guard touches zero between two events.
        is_active: the contacts that are in this mode, (contacts,).
        value: the guard, (contacts,).
        slope: its first time derivative.
        coefficients: its Taylor coefficients as far as they are known exactly.
        rest: the bound of the next one over a step, by the bounds of positions and forces, see `Expansion.rest`.
        series: its Taylor coefficients, by those of positions, forces and phase.
        near: the time to the event, in units of the time scale of the motion, from which these coefficients give it to rounding.
        begins_at_zero: whether a mode that has just begun has vanishing coefficients, `State.contact` of them.
    """

    event: int
    bifurcation: str
    is_active: Callable[[State], Bool[Array, "contacts ..."]]
    value: Callable[[Machine, State, Held], Array]
    slope: Callable[[Machine, State, Held, Rates], Array]
    coefficients: Callable[[Machine, State, Held, Derivatives], tuple[Array, ...]]
    rest: Callable[[Machine, tuple[Array, Array], Held], Array]
    series: Callable[[Machine, State, Held, tuple[Array, ...]], list[Any]]
    near: dict[str, float]
    begins_at_zero: bool


def _gap_coefficients(machine: Machine, state: State, hold: Held, now: Rates) -> tuple[Array, ...]:
    del hold
    v, a, jerk = approaches(machine, state, now)
    return state.gap, -v, -a / 2, -jerk * (1 / 6)


def _gap_series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> list[Any]:
    del hold
    x, _, phase = series
    return [state.gap, *(-machine.contacts.towards(x[k], phase[k]) for k in range(1, len(x)))]


def _force_coefficients(machine: Machine, state: State, hold: Held, now: Derivatives) -> tuple[Array, ...]:
    force, rate, curvature = contact_forces(machine, state, hold, now)
    return force, rate, curvature / 2


def _force_series(machine: Machine, state: State, hold: Held, series: tuple[Array, ...]) -> list[Any]:
    del state
    _, force, phase = series
    return [machine.contacts.pressing(force[k], hold, phase[k]) for k in range(len(force))]


# What five terms leave of the velocity after 1e-3 time scales, 1e-3^5 / 5!, is below rounding. Two terms fewer are known of a
# contact force, so its zero has to be nearer.
GAP = Limit(
    event=IMPACT,
    bifurcation="gr",
    is_active=lambda state: ~state.held,
    value=lambda machine, state, hold: state.gap,
    slope=lambda machine, state, hold, now: (
        -machine.contacts.towards(state.v, machine.phase_rate(state.phase))
    ),
    coefficients=_gap_coefficients,
    rest=lambda machine, rests, hold: machine.contacts.rest(rests[0]),
    series=_gap_series,
    near={"float64": 1e-3, "float32": 1e-2},
    begins_at_zero=True,
)
FORCE = Limit(
    event=RELEASE,
    bifurcation="force_zero",
    is_active=lambda state: state.held,
    value=lambda machine, state, hold: machine.contacts.pressing(
        machine.total_force(state), hold, state.phase
    ),
    slope=lambda machine, state, hold, now: machine.contacts.pressing(
        now.force_rate, hold, machine.phase_rate(state.phase)
    ),
    coefficients=_force_coefficients,
    rest=lambda machine, rests, hold: machine.contacts.pressing_rest(rests[1], hold),
    series=_force_series,
    near={"float64": 1e-4, "float32": 1e-3},
    begins_at_zero=False,
)
LIMITS = (GAP, FORCE)


def limits_of(machine: Machine) -> tuple[Limit, ...]:
    """The limits that contacts of a machine may be at."""
    return LIMITS if machine.can_stick else (GAP,)


def of_active(limits: tuple[Limit, ...], state: State, of: Callable[[Limit], Any]) -> Any:
    """A tree of quantities, of each contact that of the limit that is active."""

    def chosen(found: Any, limit: Limit) -> Any:
        is_active = limit.is_active(state)
        return jax.tree.map(lambda own, other: jnp.where(is_active, own, other), of(limit), found)

    return reduce(chosen, limits[1:], of(limits[0]))
