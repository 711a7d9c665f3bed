"""Friction of contacts at an instant: it has a part while its contact presses, and none while that is open."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._machine.machine import Machine
from .._machine.state import FREE, UNLOADED, State, with_laws
from .friction_chatter import Chatter
from .friction_limits import sliding_velocity


class Loaded(NamedTuple):
    """Friction whose contact begins or goes on to press.

    Attributes:
        state: the state, with the directions of friction that slips; friction of open contacts has none.
        settles: flags of elements at rest, (contacts,), with friction of contacts that begin to press.
        duration: time to the end of the bounces that are completed, also of friction that stops before it.
    """

    state: State
    settles: Bool[Array, "contacts ..."]
    duration: Float[Array, "contacts ..."]


def unloaded(machine: Machine, state: State, presses: Bool[Array, "contacts ..."]) -> State:
    """State without friction of contacts that do not press."""
    contacts = machine.contacts
    is_idle = contacts.are_tied & ~contacts.at_normal(presses)
    direction = jnp.where(is_idle, jnp.int8(0), state.mode.direction)
    contact = jnp.where(is_idle, jnp.int8(UNLOADED), state.contact)
    names = lambda s: (s.mode.direction, s.held, s.contact)  # noqa: E731
    return eqx.tree_at(names, state, (direction, state.held & ~is_idle, contact))


def in_laws(
    machine: Machine, state: State, numbers: Int[Array, "contacts ..."] | Bool[Array, "contacts ..."]
) -> State:
    """State in which the elements do what `laws_as_numbers` tells; free friction of contacts is that of open ones.

    Of rigid contacts alone the numbers are flags of those that hold.
    """
    if state.mode is None:
        return eqx.tree_at(lambda s: s.held, state, numbers)
    state = with_laws(state, numbers)
    if not machine.has_tied_friction:
        return state
    is_idle = machine.contacts.are_tied & (numbers == FREE)
    return eqx.tree_at(lambda s: s.contact, state, jnp.where(is_idle, jnp.int8(UNLOADED), state.contact))


def loaded(
    machine: Machine,
    state: State,
    settles: Bool[Array, "contacts ..."],
    size: Float[Array, "contacts ..."],
    chatter: Chatter,
) -> Loaded:
    """Let friction act whose contact presses from now on: it slips in the direction of its sliding velocity, or is at rest.

    Args:
        machine: the machine.
        state: the state.
        settles: flags of the elements at rest.
        size: magnitudes below whose rounding errors a sliding velocity is 0.
        chatter: contacts whose bounces are completed.
    """
    contacts = machine.contacts
    presses = settles | state.held | state.mode.closed
    state, is_idle = unloaded(machine, state, presses), contacts.are_tied & ~contacts.at_normal(presses)
    settles = settles & ~is_idle
    begins = contacts.are_tied & ~is_idle & ~settles & (state.mode.direction == 0)
    speed = sliding_velocity(machine, state)
    direction = jnp.where(begins, jnp.sign(speed), state.mode.direction).astype(jnp.int8)
    slipping = eqx.tree_at(lambda s: s.mode.direction, state, direction)
    rests = begins & (jnp.abs(speed) <= 64 * float(jnp.finfo(speed.dtype).eps) * size)
    completed = contacts.are_tied & contacts.at_normal(chatter.completed)
    longest = jnp.where(completed, contacts.at_normal(chatter.duration), 0)
    stops = begins & completed & _stops_before(machine, slipping, chatter.completed, longest)
    rests = rests | stops
    state = eqx.tree_at(lambda s: s.mode.direction, slipping, jnp.where(rests, jnp.int8(0), direction))
    contact = jnp.where(begins, jnp.int8(0), state.contact)
    state = eqx.tree_at(lambda s: s.contact, state, contact)
    settles = settles | rests
    return Loaded(state, settles, jnp.where(completed & settles, longest, chatter.duration))


def _stops_before(
    machine: Machine,
    state: State,
    completed: Bool[Array, "contacts ..."],
    duration: Float[Array, "contacts ..."],
) -> Bool[Array, "contacts ..."]:
    """Flags of friction that the bounces completed now, and the friction until they are over, stop."""
    held = state.held | completed
    here = machine.in_mode(eqx.tree_at(lambda s: s.held, state, held))
    contacts = here.contacts
    hold = contacts.hold(held)
    v = contacts.without_speeds(state.v, held, machine.phase_rate(state.phase))
    speed = contacts.speeds(v, machine.phase_rate(state.phase))
    gain = contacts.along(contacts.accelerations(here.total_force(state), hold, state.phase))
    return state.mode.direction * (speed + duration * gain) <= 0
