"""Guards of all elements of a machine, group by group."""

from collections.abc import Callable
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .._machine.kinds import COMPLIANT, FRICTION, JENKINS, RIGID
from .._machine.machine import Machine
from .._machine.state import State
from .compliant_limits import DEPTH, LAG, LOAD, SPRING
from .friction_limits import (
    GRIP,
    GRIP_AHEAD,
    GRIP_BEHIND,
    SLIDING,
    TIED_AHEAD,
    TIED_BEHIND,
    is_sticking,
)
from .hysteresis_limits import STRETCH_AHEAD, STRETCH_BEHIND
from .limits import FORCE, GAP, Limit, limits_of

# Second guard of an element whose mode ends in one way only.
_NONE = Limit(
    event=GAP.event,
    is_active=lambda machine, state: jnp.ones_like(state.held),
    value=lambda machine, state, hold: jnp.ones_like(state.gap),
    slope=lambda machine, state, hold, now: jnp.zeros_like(state.gap),
    derivatives=lambda machine, state, hold, now: _one_and_no_more(state),
    order=3,
    rest=lambda machine, rests, hold: 0 * machine.contacts.rest(rests[0]),
    series=lambda machine, state, hold, series: _one_and_no_more(state),
    leading_zeros=None,
    near=GAP.near,
)
# Guards of the elements of each kind, in the two groups; elements of a kind share the first of theirs with those of others.
_GUARDS = {
    RIGID: ((GAP, FORCE), (_NONE,)),
    COMPLIANT: ((GAP, FORCE, DEPTH), (_NONE, SPRING, LAG, LOAD)),
    FRICTION: ((SLIDING, GRIP_AHEAD), (_NONE, GRIP_BEHIND)),
    JENKINS: ((SLIDING, STRETCH_AHEAD), (_NONE, STRETCH_BEHIND)),
}
_OF_TIED_FRICTION = (SLIDING, TIED_AHEAD), (_NONE, TIED_BEHIND)


def _one_and_no_more(state: State) -> list[Array]:
    one = jnp.ones_like(state.gap)
    return [one, 0 * one, 0 * one]


def guards_of(machine: Machine) -> tuple[tuple[Limit, ...], ...]:
    """Limits of a machine in groups; an element has one active limit in each, the first of a group if no other is."""
    if not machine.contacts.is_switching:
        return (limits_of(machine),)
    kinds = sorted(set(machine.contacts.laws.kinds))
    guards = _GUARDS | ({FRICTION: _OF_TIED_FRICTION} if machine.has_tied_friction else {})
    first, second = ([limit for kind in kinds for limit in guards[kind][group]] for group in (0, 1))
    return tuple(_once(first)), tuple(_once(second))


def _once(limits: list[Limit]) -> list[Limit]:
    """The limits without repetition; they have no hash."""
    return [limit for k, limit in enumerate(limits) if not any(limit is other for other in limits[:k])]


def has_one_guard(machine: Machine) -> bool:
    """True for machines whose elements all have one guard in exact steps: both ends of a grip are one there."""
    contacts = machine.contacts
    if not contacts.is_switching:
        return True
    return not {COMPLIANT, JENKINS} & set(contacts.laws.kinds) and not contacts.laws.is_tied


def guards_of_steps(machine: Machine) -> tuple[tuple[Limit, ...], ...]:
    """Limits in groups as `guards_of`, in one group where `has_one_guard`."""
    if not machine.contacts.is_switching or not has_one_guard(machine):
        return guards_of(machine)
    rigid = (GAP, FORCE) if RIGID in machine.contacts.laws.kinds else ()
    return ((*rigid, SLIDING, GRIP),)


def events_of_steps(
    machine: Machine, state: State, is_event: Bool[Array, "guards_of_steps ..."]
) -> Bool[Array, "guards ..."]:
    """Flags over all guards, from those over guards of steps, at the state at the end of the step."""
    if not machine.contacts.is_switching or not has_one_guard(machine):
        return is_event
    hold = machine.hold(state.held)
    is_behind = is_sticking(machine, state) & (FORCE.value(machine, state, hold) < 0)
    return jnp.concatenate([is_event & ~is_behind, is_event & is_behind])


def select_active(
    machine: Machine,
    state: State,
    of: Callable[[Limit], Any],
    groups_of: Callable = guards_of,
    axis: int = 0,
) -> Any:
    """Tree of quantities, for each guard that of its active limit; `axis` is that of the guards in all of them."""
    groups = []
    for first, *others in groups_of(machine):

        def chosen(found: Any, limit: Limit) -> Any:
            is_active = jnp.expand_dims(limit.is_active(machine, state), tuple(range(axis)))
            return jax.tree.map(lambda own, other: jnp.where(is_active, own, other), of(limit), found)

        groups.append(reduce(chosen, others, of(first)))
    return groups[0] if len(groups) == 1 else jax.tree.map(lambda *a: jnp.concatenate(a, axis), *groups)


def leading_zeros(state: State, machine: Machine | None = None) -> Int[Array, "guards ..."]:
    """Number of leading coefficients that vanish exactly, of every guard; of steps if the machine is given."""
    if state.mode is None or (machine is not None and has_one_guard(machine)):
        return state.contact
    return jnp.concatenate([state.contact, state.mode.begins])


def is_idle(state: State, machine: Machine | None = None) -> Bool[Array, "guards ..."]:
    """Flags of guards of elements whose gap, or sliding velocity, is constant: they have no event; as `leading_zeros`."""
    idle = state.is_frozen
    if state.mode is None or (machine is not None and has_one_guard(machine)):
        return idle
    return jnp.concatenate([idle, idle])
