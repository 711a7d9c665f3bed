"""Elements at rest: which of them hold, and which let go or slip.

Contacts and friction elements at rest are decided together. All hold first. Those beyond their limits let go: a rigid
contact that would have to pull opens, friction beyond its grip slips, a preloaded compliant contact beyond its range
opens or yields. Elements that then move against their own force hold again, one at a time in their order. This repeats
until all agree: a linear complementarity problem with bounds on both sides, solved by pivots as in
`complementarity.py`. The last pivots are single ones, which end for every definite matrix.

An element whose row depends on those of elements before it carries no force while these hold, and is kept closed by
them. So a rigid contact takes the load off friction along its row until it would have to pull, and only then does friction.
A stop that moves carries such an element with it: friction on its mass slips.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import matrix_product, matvec
from .._jax.concrete import stop_gradients
from .._jax.xla import is_any
from .._machine.machine import Machine
from .._machine.state import KEPT_CLOSED, State
from .._machine.switching import COMPLIANT, FRICTION, RIGID

# Maximum number of pivots, and number of those that exchange several elements at once.
_PIVOTS, _JOINT_PIVOTS = 64, 16


class AtRest(NamedTuple):
    """Elements at rest, (contacts,) each.

    Attributes:
        elements: flags of the elements at rest; all others keep their mode.
        released: flags of those among them whose hold ended at this instant.
        push: what released elements do: direction of slip, 1 for a compliant contact that yields, 0 for one that opens.
        saturated: flags of slipping friction elements, with the directions of `push`, that others kept at rest.
        may_return: flags of released ones that hold again if they would move against their force.
    """

    elements: Bool[Array, "contacts ..."]
    released: Bool[Array, "contacts ..."]
    push: Int[Array, "contacts ..."]
    saturated: Bool[Array, "contacts ..."]
    may_return: Bool[Array, "contacts ..."]


class Settled(NamedTuple):
    """Decision, (contacts,) each; it concerns elements at rest alone.

    Attributes:
        held: flags of elements that hold and carry a force.
        push: direction of slip, 1 for a compliant contact that yields; 0 for all else.
        contact: their new `State.contact`.
        depends: flags of all other elements whose rows depend on those held.
    """

    held: Bool[Array, "contacts ..."]
    push: Int[Array, "contacts ..."]
    contact: Int[Array, "contacts ..."]
    depends: Bool[Array, "contacts ..."]


def settle(machine: Machine, state: State, at_rest: AtRest) -> Settled:
    """Decide which elements at rest hold; in `state.mode` they have no part."""
    machine, state = stop_gradients((machine, state))
    force = machine.in_mode(state).total_force(state)
    if machine.contacts.num == 1:
        return _decision(machine, at_rest.elements, state, _single_choice(machine, state, force, at_rest))

    def goes_on(choice: _Choice) -> Array:
        return is_any(jnp.any(choice.is_wrong, axis=0)) & (choice.count < _PIVOTS)

    def pivot(choice: _Choice) -> _Choice:
        found = _beyond(machine, state, force, choice.holds, choice.push)
        first, later = _begun(at_rest, found), _exchanged(at_rest, choice, found)
        is_first = choice.count == 0
        return jax.tree.map(lambda a, b: jnp.where(is_first, a, b), first, later)

    # The first turn, with all of them holding, shows which elements take over from released ones.
    like = force[0] + state.gap[0]
    zeros = jnp.zeros((len(at_rest.push), *like.shape), like.dtype)
    none = jnp.zeros_like(at_rest.push)
    start = _Choice(
        at_rest.elements, none, at_rest.released, at_rest.elements, jnp.array(0), zeros, zeros > 0
    )
    return _decision(machine, at_rest.elements, state, jax.lax.while_loop(goes_on, pivot, start))


class _Choice(NamedTuple):
    """Choice of the elements that hold, (contacts,) each.

    Attributes:
        holds: flags of elements that hold.
        push: what the others do, see `AtRest`.
        released: flags of elements whose hold ended and that nothing else holds.
        is_wrong: flags of elements in conflict with the choice before.
        count: number of turns.
        along: acceleration of every element along its row, as `_Beyond.along`.
        idle: flags of elements that hold without a force.
    """

    holds: Bool[Array, "contacts ..."]
    push: Int[Array, "contacts ..."]
    released: Bool[Array, "contacts ..."]
    is_wrong: Bool[Array, "contacts ..."]
    count: Int[Array, ""]
    along: Float[Array, "contacts ..."]
    idle: Bool[Array, "contacts ..."]


def _single_choice(machine: Machine, state: State, force: Float[Array, "n ..."], at_rest: AtRest) -> _Choice:
    """Choice of the only element: what exceeds its limits lets go, and then moves as it is pushed."""
    none = jnp.zeros_like(at_rest.push)
    found = _beyond(machine, state, force, at_rest.elements, none)
    lets_go = at_rest.released | found.too_far
    push = jnp.where(at_rest.released, at_rest.push, jnp.where(found.too_far, found.push, none))
    holds = at_rest.elements & ~lets_go
    along = _beyond(machine, state, force, holds, push).along
    return _Choice(holds, push, at_rest.released, lets_go, jnp.array(2), along, found.idle)


def _begun(at_rest: AtRest, found: "_Beyond") -> _Choice:
    """Choice in which all hold but those released at this instant, unless others hold in their place.

    So friction beyond its grip stays at rest that is pressed onto a rigid contact.
    """
    # With more elements than the masses can distinguish, their forces are not unique.
    is_relieved = (found.idle & ~found.is_let_down) | (found.is_inside & at_rest.saturated)
    released = (at_rest.released | at_rest.saturated) & ~is_relieved
    push = jnp.where(released, at_rest.push, jnp.int8(0))
    holds = at_rest.elements & ~released
    return _Choice(holds, push, released, at_rest.elements, jnp.array(1), found.along, found.idle)


def _exchanged(at_rest: AtRest, choice: _Choice, found: "_Beyond") -> _Choice:
    """Choice after a pivot; unchanged if none is in conflict."""
    fixed = choice.released & ~at_rest.may_return
    too_far, back = found.too_far, at_rest.elements & ~fixed & found.returns
    wrong = too_far | back
    many = jnp.where(jnp.any(too_far, axis=0), too_far, _first(back))
    changed = jnp.where(choice.count > _JOINT_PIVOTS, _first(wrong), many)
    push = jnp.where(changed, jnp.where(choice.holds, found.push, jnp.int8(0)), choice.push)
    return _Choice(
        choice.holds ^ changed, push, choice.released, wrong, choice.count + 1, found.along, found.idle
    )


class _Beyond(NamedTuple):
    """Elements in conflict with a choice.

    Attributes:
        too_far: flags of elements that hold beyond their limits.
        push: what they would do.
        returns: flags of elements that move against their force.
        along: acceleration of every element along its row, 0 where it is a rounding error.
        idle: flags of elements that hold without a force.
        is_inside: flags of elements that hold within their limits by more than rounding.
        is_let_down: flags of those without a force that depend on elements not inside.
    """

    too_far: Bool[Array, "contacts ..."]
    push: Int[Array, "contacts ..."]
    returns: Bool[Array, "contacts ..."]
    along: Float[Array, "contacts ..."]
    idle: Bool[Array, "contacts ..."]
    is_inside: Bool[Array, "contacts ..."]
    is_let_down: Bool[Array, "contacts ..."]


def _beyond(
    machine: Machine,
    state: State,
    force: Float[Array, "n ..."],
    holds: Bool[Array, "contacts ..."],
    push: Int[Array, "contacts ..."],
) -> _Beyond:
    contacts = machine.contacts
    laws, are = contacts.laws, contacts.are
    noise = 64 * len(holds) * float(jnp.finfo(force.dtype).eps)
    own = contacts.back(push * jnp.where(are(FRICTION), laws.force, laws.preload))
    load, size = force - own, jnp.abs(force) + jnp.abs(own)
    hold = contacts.hold(holds)
    reaction = contacts.contact_force(load, hold, state.phase)
    slack = noise * matvec(jnp.abs(hold.reaction), size)
    acceleration = contacts.accelerations(load, hold, state.phase)
    along = contacts.relative_acceleration(acceleration, state.phase)
    small = noise * (contacts.size(jnp.abs(acceleration)) + contacts.size(contacts.inverse_mass_size(size)))
    along = jnp.where(jnp.abs(along) <= small, 0, along)
    most = jnp.where(are(RIGID), jnp.inf, jnp.where(are(FRICTION), laws.grip, laws.preload))
    least = jnp.where(are(FRICTION), -laws.grip, 0)
    redundant = contacts.is_redundant(hold)
    is_carried = redundant & jnp.where(are(RIGID), along < 0, along != 0)
    if contacts.walls is None:
        is_carried = jnp.zeros_like(redundant)
    is_inside = holds & ~redundant & (reaction < most - slack) & (reaction > least + slack)
    # Rounding errors open no contact. Friction beyond its grip slips, by however little.
    slack = jnp.where(are(FRICTION), 0, slack)
    above, below = reaction > most + slack, reaction < least - slack
    too_far = (holds & ~redundant & (above | below)) | is_carried
    above = jnp.where(is_carried, along > 0, above)
    turned = jnp.where(above, jnp.int8(1), jnp.where(are(FRICTION), jnp.int8(-1), jnp.int8(0)))
    # An open contact that closes; friction, or a contact that yields, that moves against its push.
    returns = ~holds & jnp.where(push == 0, along > 0, push * along < 0)
    share = matrix_product(contacts.compliance, hold.inertia)
    is_doubtful = holds & ~redundant & ~is_inside
    is_let_down = jnp.any((jnp.abs(share) > noise) & is_doubtful[None], axis=1)
    return _Beyond(too_far, turned, returns, along, redundant & ~is_carried, is_inside, is_let_down)


def _decision(
    machine: Machine, elements: Bool[Array, "contacts ..."], state: State, choice: _Choice
) -> Settled:
    contacts = machine.contacts
    held = choice.holds & ~choice.idle
    # Friction at its bound that others keep at rest holds with a constant force.
    is_beside = elements & ~held & ((choice.push == 0) | contacts.are(FRICTION))
    depends = jax.lax.cond(is_any(held), lambda: contacts.depend_on(held), lambda: jnp.zeros_like(held))
    is_kept = (is_beside & depends & ~contacts.are(COMPLIANT)) | (choice.holds & choice.idle)
    moves = jnp.where(choice.along != 0, jnp.int8(2), jnp.int8(3))
    # The guard of friction is a velocity, and vanishes to one order less.
    moves = jnp.where(contacts.are(FRICTION), moves - jnp.int8(1), moves)
    contact = jnp.where(held, jnp.int8(0), jnp.where(is_kept, jnp.int8(KEPT_CLOSED), moves))
    return Settled(
        held, choice.push, jnp.where(elements, contact, state.contact), depends & ~held & ~elements
    )


def _first(flags: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
    """The first of the flags alone."""
    return flags & (jnp.cumsum(flags, axis=0) == 1)
