"""The decision of an instant: what each element that is closed and at rest does from now on.

An element at rest does one of three things, its act:

| act | rigid contact | preloaded compliant contact | friction |
| --- | --- | --- | --- |
| 0, holds | force >= 0 | force from 0 to the preload | force within the grip |
| -1, gives way to below | opens | opens | slips backwards |
| 1, gives way to above | never | yields | slips ahead |

An element that gives way has the force of its bound, and must then move that way. A set of acts stands if all elements
agree, not at this instant alone but just after it: a number that is zero to rounding is decided by its first derivative that
is not. So an element at its bound neither returns nor stays by rounding, and what is zero all along is a hold. "Zero" is
meant against the sizes of the terms, in any unit.

Among the sets that stand, the one in which most friction sticks is taken, then most contacts hold: friction whose grip is
above its force can have several; the motion of all others is unique. Of equal ones see `acts.py`. Rows that depend on others that hold are at rest
with them, whatever their forces: these are not unique, and those of bounds (grip, preload, zero) with independent rows
between are enough. So elements side by side, or around a loop, hold as long as some forces within their bounds do.

Friction of a contact has the grip mu N, N the force of the contact. Where it slips, its force mu N s goes with that of the
contact, and whether a contact holds depends on it: all are decided together. Friction of a contact that opens has no part. With
it a set that stands need not exist (Painleve).
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .._jax.concrete import stop_gradients
from .._machine.kinds import FRICTION, RIGID
from .._machine.laws import Laws
from .._machine.machine import Machine
from .._machine.state import SATURATED, State
from .acts import CONFLICT, HOLDS, STICKS, Judged, search_acts
from .just_after import just_after, sign_just_after, zeros_just_after

# Number of elements at rest up to which all sets are tried: three contacts with friction each.
_ENUMERATED = 6


class AtRest(NamedTuple):
    """Elements at rest, (contacts,) each.

    Attributes:
        elements: flags of the elements at rest; all others keep their mode.
        at_bound: sign of the bound that the force of an element that holds has reached at this instant; 0 for all else.
    """

    elements: Bool[Array, "contacts ..."]
    at_bound: Int[Array, "contacts ..."]


class Decision(NamedTuple):
    """Acts of the elements at rest and their consequences, (contacts,) each.

    Attributes:
        act: see the head of this file; 0 for elements that are not at rest.
        held: flags of elements that hold and carry a force.
        kept: flags of elements at rest whose row depends on those held; friction that gives way there has its grip.
        depends: flags of all other elements whose rows depend on those held.
        jumps: flags of elements that move away with an acceleration, not with a jerk alone.
        begins: number of leading derivatives that vanish, of the room of elements that hold to their first and second bound.
        is_paradox: whether no set of acts stands; None without friction of contacts.
    """

    act: Int[Array, "contacts ..."]
    held: Bool[Array, "contacts ..."]
    kept: Bool[Array, "contacts ..."]
    depends: Bool[Array, "contacts ..."]
    jumps: Bool[Array, "contacts ..."]
    begins: tuple[Int[Array, "contacts ..."], Int[Array, "contacts ..."]]
    is_paradox: Bool[Array, "..."] | None = None


def no_decision(at_rest: AtRest) -> Decision:
    """Nothing decided, in a search before its first set."""
    none, still = jnp.zeros_like(at_rest.elements), jnp.zeros_like(at_rest.at_bound)
    return Decision(still, none, none, none, none, (still, still))


def decide(machine: Machine, state: State, at_rest: AtRest) -> Decision:
    """Decide what the elements at rest do; in `state.mode` they have no part."""
    machine, state = stop_gradients((machine, state))
    elements, is_tied = at_rest.elements, machine.has_tied_friction
    most = jnp.sum(jnp.where(elements, _worth(machine), 0), axis=0)
    still = jnp.zeros_like(at_rest.at_bound)
    nothing = no_decision(at_rest)
    if is_tied:
        judge = lambda act: _judged_with_drag(machine, state, at_rest, act)  # noqa: E731
    else:
        machine = machine.in_mode(state)
        force = machine.total_force(state)
        judge = lambda act: _judged(machine, state, force, at_rest, act)  # noqa: E731
    best = search_acts(
        judge,
        elements,
        still,
        most,
        nothing,
        enumerated=_ENUMERATED,
        has_two=machine.contacts.are(RIGID) if is_tied else None,
        has_loads=_has_loads(machine),
    )
    if not is_tied:
        return best.found
    is_paradox = (best.score < 0) & jnp.any(elements, axis=0)
    return best.found._replace(is_paradox=is_paradox)


def _has_loads(machine: Machine) -> bool:
    """Whether two sets of acts may stand in which as much sticks: where one of several friction elements could slip."""
    return machine.contacts.laws.kinds.count(FRICTION) > 1


def _worth(machine: Machine) -> Array:
    return jnp.where(machine.contacts.are(FRICTION), STICKS, HOLDS)


def _judged_with_drag(machine: Machine, state: State, at_rest: AtRest, act: Array) -> Judged:
    """`_judged` of a machine with friction of contacts, with the forces of slip that a set of acts leads to."""
    contacts, elements = machine.contacts, at_rest.elements
    parted = contacts.are_tied & contacts.at_normal(elements) & (contacts.at_normal(act) == -1)
    holds = elements & (act == 0) & ~parted
    slips = elements & contacts.are(FRICTION) & ~holds & ~parted
    side = act * jnp.where(contacts.depend_on(holds), SATURATED, 1)
    direction = jnp.where(slips & contacts.are_tied, side, state.mode.direction).astype(jnp.int8)
    state = eqx.tree_at(lambda s: s.mode.direction, state, direction)
    here = machine.in_mode(state)
    return _judged(here, state, here.total_force(state), at_rest, act, parted)


def _judged(
    machine: Machine,
    state: State,
    force: Array,
    at_rest: AtRest,
    act: Array,
    parted: Bool[Array, "contacts ..."] | None = None,
) -> Judged:
    """Judge a set of acts by the forces and accelerations that it leads to, and their derivatives.

    `parted` are flags of friction whose contact opens.
    """
    contacts, elements = machine.contacts, at_rest.elements
    laws, friction, rigid = contacts.laws, contacts.are(FRICTION), contacts.are(RIGID)
    holds = elements & (act == 0)
    holds = holds if parted is None else holds & ~parted
    hold = contacts.hold(holds)
    depends = contacts.depend_on(holds, hold.inertia) & ~holds
    idle = contacts.is_redundant(hold)
    bound = jnp.where(friction, jnp.where(depends, laws.grip, laws.force), laws.preload)
    pushes = elements & jnp.where(friction, ~holds, act == 1)
    own, spring_rates = jnp.where(pushes, act * bound, 0), partial(_spring_rates, laws, pushes & ~friction)
    forces, errors, moves, move_errors = just_after(machine, state, force, hold, own, spring_rates)
    grips = None
    if parted is not None:
        pushing = [own, spring_rates(moves[:1]), spring_rates(moves[:2])]
        all_forces = [jnp.where(holds, f, p) for f, p in zip(forces, pushing, strict=True)]
        grips = _tied_grips(machine, state, all_forces, moves)
        at_normal = lambda e: jnp.where(contacts.are_tied, contacts.at_normal(e), 0)  # noqa: E731
        errors = [e + laws.static_coefficient * at_normal(e) for e in errors]
    rooms = _rooms(machine, holds, at_rest.at_bound, forces, errors, grips)
    above, below = (sign_just_after(values, errors) < 0 for values in rooms)
    upper, lower = (jnp.where(holds, zeros_just_after(values, errors), 0) for values in rooms)
    begins = jnp.where(friction, upper, lower), jnp.where(friction, lower, upper)
    motion = sign_just_after(moves, move_errors)
    carried = idle & (motion != 0) & ~(rigid & (motion > 0))
    if contacts.walls is None:
        carried = jnp.zeros_like(idle)
    above, below = (holds & ~idle & a | carried & (motion == s) for a, s in ((above, 1), (below, -1)))
    returns = elements & ~holds & ~depends & (act * motion < 0)
    impossible = elements & rigid & (act == 1)
    if parted is not None:
        returns, impossible = returns & ~parted, impossible | (parted & elements & (act != 0))
    wrong = above | below | returns | impossible
    proposed = jnp.where(above, jnp.int8(1), jnp.where(below, jnp.int8(-1), jnp.int8(0)))
    proposed = jnp.where(wrong, proposed, act).astype(jnp.int8)
    held, kept = holds & ~idle, elements & (idle | depends)
    kept = kept if parted is None else kept & ~parted
    worth = jnp.where(held | kept, _worth(machine), 0)
    score = jnp.sum(jnp.where(wrong, CONFLICT, worth), axis=0)
    jumps = jnp.abs(moves[0]) > move_errors[0]
    decision = Decision(act, held, kept, depends & ~elements, jumps, begins)
    load = None
    if _has_loads(machine):
        grip = laws.grip if grips is None else laws.grip + grips[0]
        loads = jnp.abs(forces[0]) / jnp.where(grip > 0, grip, jnp.inf)
        load = jnp.max(jnp.where(held & friction, loads, 0), axis=0)
    return Judged(score, proposed, decision, load)


def _spring_rates(laws: Laws, are_springs: Array, moves: list[Array]) -> Array:
    """Derivative of F0 + k d + c d' of flagged springs at d = 0 and d' = 0, after those whose accelerations are `moves`."""
    rate = laws.damping * moves[-1]
    rate = rate if len(moves) == 1 else rate + laws.stiffness * moves[-2]
    return jnp.where(are_springs, rate, 0)


def _rooms(
    machine: Machine,
    holds: Array,
    at_bound: Array,
    forces: list[Array],
    errors: list[Array],
    grips: list[Array] | None,
) -> tuple[list[Array], list[Array]]:
    """Room of the forces of elements that hold to their upper and to their lower bound, with two derivatives each.

    `grips` are those of friction of contacts, see `_tied_grips`; None without.
    """
    laws, friction, rigid = machine.contacts.laws, machine.contacts.are(FRICTION), machine.contacts.are(RIGID)
    most = jnp.where(rigid, jnp.inf, jnp.where(friction, laws.grip, laws.preload))
    least = jnp.where(friction, -laws.grip, 0)
    room = [jnp.where(rigid, jnp.inf, most - forces[0]), forces[0] - least]
    ahead, behind = [-forces[1], -forces[2]], [forces[1], forces[2]]
    if grips is not None:
        room = [r + grips[0] for r in room]
        ahead, behind = ([a + g for a, g in zip(rates, grips[1:], strict=True)] for rates in (ahead, behind))
    # A bound that the force was found to reach is reached exactly.
    near = errors[0] * float(jnp.finfo(forces[0].dtype).eps) ** -0.5
    known = [jnp.where(holds, at_bound, 0) == side for side in (1, -1)]
    room = [jnp.where(k & (jnp.abs(r) <= near), 0, r) for k, r in zip(known, room, strict=True)]
    return [room[0], *ahead], [room[1], *behind]


def _tied_grips(machine: Machine, state: State, forces: list[Array], moves: list[Array]) -> list[Array]:
    """Grips mu N of friction of contacts and their first two derivatives, 0 for all else.

    `forces` are those of elements at rest; other contacts press if they are compliant and closed.
    """
    contacts, laws = machine.contacts, machine.contacts.laws
    approach = machine.approach(state)
    springs = [
        contacts.spring_force(state.gap, approach),
        laws.stiffness * approach + laws.damping * moves[0],
        laws.stiffness * moves[0] + laws.damping * moves[1],
    ]
    grips = []
    for force, spring in zip(forces, springs, strict=True):
        normal = contacts.at_normal(jnp.where(state.mode.closed, spring, force))
        grips.append(jnp.where(contacts.are_tied, laws.static_coefficient * normal, 0))
    return grips
