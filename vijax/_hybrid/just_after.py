"""Forces and accelerations just after an instant: their values and first derivatives, and what of them is rounding."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._jax.arrays import matvec
from .._machine.contacts import Held
from .._machine.derivatives import sizes_of_force
from .._machine.machine import Machine
from .._machine.small_matrices import slack_of
from .._machine.state import State
from .._machine.switching import SwitchingContacts


class JustAfter(NamedTuple):
    """Lists of a value and its first two derivatives, and of their rounding errors, (contacts,) each.

    Attributes:
        forces: of the elements that hold.
        force_errors: rounding errors of `forces`.
        moves: accelerations along all rows, relative to those of the contacts.
        move_errors: rounding errors of `moves`.
    """

    forces: list[Float[Array, "contacts ..."]]
    force_errors: list[Float[Array, "contacts ..."]]
    moves: list[Float[Array, "contacts ..."]]
    move_errors: list[Float[Array, "contacts ..."]]


def just_after(
    machine: Machine,
    state: State,
    force: Float[Array, "n ..."],
    hold: Held,
    own: Float[Array, "contacts ..."] | None = None,
    own_rates: Callable | None = None,
) -> JustAfter:
    """Forces and accelerations with the contacts of `hold` closed.

    Args:
        machine: the machine.
        state: the state.
        force: force on the masses without that of any element at rest.
        hold: the contacts that hold.
        own: forces of elements at rest that give way; they act against `force`.
        own_rates: their next derivative, from the accelerations along the rows and their derivatives; 0 if left out.
    """
    contacts, phase = machine.contacts, state.phase
    noise = slack_of(contacts.compliance)
    back = lambda a: matvec(jnp.abs(jnp.swapaxes(contacts.rows, 0, 1)), a)  # noqa: E731
    dragged = contacts.sizes_dragged
    motion = [jnp.abs(state.x), jnp.abs(state.v)]
    size, load = sizes_of_force(machine, force, motion[0], motion[1]), force
    if isinstance(contacts, SwitchingContacts):
        size = size + contacts.size_of_load(state.mode)
    if own is not None:
        size, load = size + back(dragged(jnp.abs(own))), force - contacts.back(contacts.dragged(own))
    accelerations: list[Array] = []
    found = JustAfter([], [], [], [])
    for order in range(3):
        accelerations.append(contacts.accelerations(load, hold, phase))
        found.forces.append(contacts.contact_force(load, hold, phase))
        found.moves.append(contacts.accelerated_towards(accelerations[-1], phase))
        wall = jnp.zeros_like(contacts.limit) + contacts.acceleration_bound(order)
        of_forces = matvec(jnp.abs(hold.reaction), size) + matvec(jnp.abs(hold.inertia), wall)
        reached = contacts.inverse_mass_size(size + back(dragged(of_forces)))
        found.force_errors.append(noise * of_forces)
        found.move_errors.append(noise * (contacts.size(reached) + wall))
        motion.append(reached)
        if order == 2:
            return found
        if order == 0:
            load = machine.total_force_rate(state, accelerations[0])
        else:
            load = machine.total_force_curvature(state, accelerations[0], accelerations[1])
        load = load if own_rates is None else load - contacts.back(contacts.dragged(own_rates(found.moves)))
        size = sizes_of_force(machine, load, motion[-2], motion[-1], order + 1)
        phase = machine.phase_rate(phase)
    return found


def forces_of_elements(machine: Machine, state: State) -> Float[Array, "contacts ..."]:
    """Forces N and T of all elements, of a machine in the mode of the state."""
    reaction = machine.contacts.contact_force(
        machine.total_force(state), machine.hold(state.held), state.phase
    )
    return machine.contacts.dragged(jnp.where(state.held, reaction, machine.contacts.forces_of(state)))


def accelerations_towards(machine: Machine, state: State) -> Float[Array, "contacts ..."]:
    """Accelerations towards contacts, and of sliding, of a machine in the mode of the state."""
    pulls = machine.contacts.accelerations(machine.total_force(state), machine.hold(state.held), state.phase)
    return machine.contacts.accelerated_towards(pulls, state.phase)


def sign_just_after(
    values: list[Float[Array, "contacts ..."]], errors: list[Float[Array, "contacts ..."]]
) -> Float[Array, "contacts ..."]:
    """Sign of a function just after an instant, from its value and derivatives there: of the first that is not rounding."""
    sign = jnp.zeros_like(values[0])
    for value, is_zero in zip(values[::-1], _are_rounding(values, errors)[::-1], strict=True):
        sign = jnp.where(is_zero, sign, jnp.sign(value))
    return sign


def zeros_just_after(
    values: list[Float[Array, "contacts ..."]], errors: list[Float[Array, "contacts ..."]]
) -> Int[Array, "contacts ..."]:
    """Number of leading ones, up to two, of a function and its derivatives that are rounding."""
    is_zero = _are_rounding(values, errors)
    return jnp.where(is_zero[0], jnp.where(is_zero[1], 2, 1), 0).astype(jnp.int8)


def _are_rounding(values: list[Array], errors: list[Array]) -> list[Array]:
    """Flags of values that are rounding errors.

    Where a function touches zero, rounding moves the zero by the root of its error, where the slope is no longer rounding. What
    counts is the extremum of the parabola.
    """
    is_zero = [jnp.abs(a) <= error for a, error in zip(values, errors, strict=True)]
    _, slope, curvature = values
    touches = is_zero[0] & (slope * curvature < 0) & (slope**2 <= 2 * errors[0] * jnp.abs(curvature))
    return [is_zero[0], is_zero[1] | touches, is_zero[2]]
