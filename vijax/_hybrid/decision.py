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
above its force can have several; the motion of all others is unique. Rows that depend on others that hold are at rest
with them, whatever their forces: these are not unique, and those of bounds (grip, preload, zero) with independent rows
between are enough. So elements side by side, or around a loop, hold as long as some forces within their bounds do.

Up to `_ENUMERATED` elements at rest all sets are tried, one after the other. Of more, the first are the starts of pivots:
all elements in conflict change their act at once, later one at a time (as principal pivots of linear complementarity:
K. G. Murty, Linear Algebra Appl. 7 (1974)).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .._jax.concrete import stop_gradients
from .._jax.xla import is_any
from .._machine.machine import Machine
from .._machine.state import State
from .._machine.switching import FRICTION, RIGID
from .just_after import just_after, sign_just_after

# Number of elements at rest up to which all sets are tried; of more, number of starts, of pivots from each, and of those
# that change several acts at once.
_ENUMERATED, _STARTS, _PIVOTS, _JOINT_PIVOTS = 5, 27, 64, 16
# Score of a conflict, of friction at rest, of any other element at rest.
_CONFLICT, _STICKS, _HOLDS = -10_000, 100, 1


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
    """

    act: Int[Array, "contacts ..."]
    held: Bool[Array, "contacts ..."]
    kept: Bool[Array, "contacts ..."]
    depends: Bool[Array, "contacts ..."]
    jumps: Bool[Array, "contacts ..."]


def decide(machine: Machine, state: State, at_rest: AtRest) -> Decision:
    """Decide what the elements at rest do; in `state.mode` they have no part."""
    machine, state = stop_gradients((machine, state))
    machine = machine.in_mode(state)
    force = machine.total_force(state)
    elements = at_rest.elements
    count = jnp.sum(elements, axis=0)
    is_listed = count <= _ENUMERATED
    most = jnp.sum(jnp.where(elements, _worth(machine), 0), axis=0)

    def goes_on(carry: _Search) -> Array:
        is_over = (carry.best.score >= jnp.where(is_listed, most, 0)) | carry.is_last
        return is_any(~is_over & (is_listed | (carry.turn < _STARTS * _PIVOTS)))

    def turned(carry: _Search) -> _Search:
        found = _judged(machine, state, force, at_rest, carry.acts)
        best = jax.tree.map(lambda a, b: jnp.where(found.score > carry.best.score, a, b), found, carry.best)
        turn = carry.turn + 1
        following, is_last = _next_set(elements, carry.start)
        starts_anew = is_listed | (turn % _PIVOTS == 0)
        start = jnp.where(starts_anew, following, carry.start)
        changes = found.proposed != carry.acts
        first_change = changes & (jnp.cumsum(changes, axis=0) == 1)
        is_single = turn % _PIVOTS > _JOINT_PIVOTS
        pivoted = jnp.where(jnp.where(is_single, first_change, changes), found.proposed, carry.acts)
        is_last = carry.is_last | (is_listed & is_last)
        return _Search(turn, start, jnp.where(starts_anew, start, pivoted), is_last, best)

    none, still = jnp.zeros_like(elements), jnp.zeros_like(at_rest.at_bound)
    lowest = jnp.full_like(count, 2 * len(elements) * _CONFLICT)
    nothing = _Judged(lowest, still, Decision(still, none, none, none, none))
    search = _Search(jnp.array(0), still, still, jnp.zeros_like(count, bool), nothing)
    return jax.lax.while_loop(goes_on, turned, search).best.decision


class _Judged(NamedTuple):
    """A set of acts: its score, not negative if it stands; the acts after a pivot; what it means."""

    score: Int[Array, "..."]
    proposed: Int[Array, "contacts ..."]
    decision: Decision


class _Search(NamedTuple):
    """Search among sets of acts: the number of turns, the last set begun with, the next one, and the best so far."""

    turn: Int[Array, ""]
    start: Int[Array, "contacts ..."]
    acts: Int[Array, "contacts ..."]
    is_last: Bool[Array, "..."]
    best: _Judged


def _worth(machine: Machine) -> Array:
    return jnp.where(machine.contacts.are(FRICTION), _STICKS, _HOLDS)


def _next_set(elements: Array, acts: Array) -> tuple[Int[Array, "contacts ..."], Bool[Array, "..."]]:
    """The set that follows, acts 0, -1, 1 counted upwards from the first element at rest; and whether it is the first again."""

    def count(carries: Array, one: tuple[Array, Array]) -> tuple[Array, Array]:
        is_at_rest, act = one
        # 0 -> -1 -> 1 -> 0.
        turned = jnp.where(act == 0, -1, jnp.where(act < 0, 1, 0)).astype(act.dtype)
        return carries & (~is_at_rest | (act > 0)), jnp.where(carries & is_at_rest, turned, act)

    carries, acts = jax.lax.scan(count, jnp.ones_like(elements[0]), (elements, acts))
    return acts, carries


def _judged(machine: Machine, state: State, force: Array, at_rest: AtRest, act: Array) -> _Judged:
    """Judge a set of acts by the forces and accelerations that it leads to, and their derivatives."""
    contacts, elements = machine.contacts, at_rest.elements
    laws, are = contacts.laws, contacts.are
    friction, rigid = are(FRICTION), are(RIGID)
    holds = elements & (act == 0)
    hold = contacts.hold(holds)
    depends = contacts.depend_on(holds, hold.inertia) & ~holds
    idle = contacts.is_redundant(hold)
    bound = jnp.where(friction, jnp.where(depends, laws.grip, laws.force), laws.preload)
    pushes = elements & jnp.where(friction, ~holds, act == 1)
    own = jnp.where(pushes, act * bound, 0)

    def spring_rates(moves: list[Array]) -> Array:
        # F0 + k d + c d' of a spring at d = 0 and d' = 0.
        rate = (
            laws.damping * moves[-1]
            if len(moves) == 1
            else laws.damping * moves[-1] + laws.stiffness * moves[-2]
        )
        return jnp.where(pushes & ~friction, rate, 0)

    forces, errors, moves, move_errors = just_after(machine, state, force, hold, own, spring_rates)
    most = jnp.where(rigid, jnp.inf, jnp.where(friction, laws.grip, laws.preload))
    least = jnp.where(friction, -laws.grip, 0)
    # A bound that the force was found to reach is reached exactly.
    known = [jnp.where(holds, at_rest.at_bound, 0) == side for side in (1, -1)]
    near = errors[0] * float(jnp.finfo(force.dtype).eps) ** -0.5
    room = [jnp.where(rigid, jnp.inf, most - forces[0]), forces[0] - least]
    room = [jnp.where(k & (jnp.abs(r) <= near), 0, r) for k, r in zip(known, room, strict=True)]
    above = sign_just_after([room[0], -forces[1], -forces[2]], errors) < 0
    below = sign_just_after([room[1], forces[1], forces[2]], errors) < 0
    motion = sign_just_after(moves, move_errors)
    carried = idle & (motion != 0) & ~(rigid & (motion > 0))
    if contacts.walls is None:
        carried = jnp.zeros_like(idle)
    above, below = (holds & ~idle & a | carried & (motion == s) for a, s in ((above, 1), (below, -1)))
    returns = elements & ~holds & ~depends & (act * motion < 0)
    impossible = elements & rigid & (act == 1)
    wrong = above | below | returns | impossible
    proposed = jnp.where(above, jnp.int8(1), jnp.where(below, jnp.int8(-1), jnp.int8(0)))
    proposed = jnp.where(wrong, proposed, act).astype(jnp.int8)
    held = holds & ~idle
    kept = elements & (idle | depends)
    worth = jnp.where(held | kept, _worth(machine), 0)
    score = jnp.sum(jnp.where(wrong, _CONFLICT, worth), axis=0)
    jumps = jnp.abs(moves[0]) > move_errors[0]
    return _Judged(score, proposed, Decision(act, held, kept, depends & ~elements, jumps))
