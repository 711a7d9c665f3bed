"""Impacts on contacts with friction: Newton's law in Moreau's form, over all contacts that the impulses concern.

With the approach speeds u- and sliding velocities w- before, the impulses p of contacts and P of their friction satisfy

- p >= 0, u+ + r u- <= 0, p (u+ + r u-) = 0;
- |P| <= mu p; w+ = 0 if |P| < mu p, otherwise P = mu p sgn(w+).

They concern the contacts hit, and the closed ones that are linked to them. Each contact pushes or opens, its friction sticks or
slips in one of two directions: the sets of these acts are tried as in `decision.py`. In each the impulses are linear in the
velocities before, so that their derivatives are those of the set that stands. Friction of constant force, and compliant
contacts, give no impulse.

References:
    J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, CISM 302 (1988) 1-82;
    F. Pfeiffer & C. Glocker, Multibody Dynamics with Unilateral Contacts (1996), Ch. 8.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import matvec
from .._jax.concrete import stop_gradients
from .._machine.contacts import after_loss
from .._machine.kinds import FRICTION
from .._machine.machine import Machine
from .._machine.small_matrices import slack_of
from .._machine.state import State
from .acts import CONFLICT, HOLDS, STICKS, Judged, search_acts
from .coupled_impacts import Struck, after_impulses, struck_speeds
from .friction_limits import sliding_velocity
from .own_times import not_differentiable
from .transition import Instant

# Number of elements up to which all sets are tried: three contacts with friction each.
_ENUMERATED = 6


class Impulses(NamedTuple):
    """Impulses of an impact, (contacts,) each.

    Attributes:
        of_all: p of contacts and P of their friction.
        rest: by how much contacts open faster than by their restitution, 0 where they push.
        sticks: flags of friction whose sliding velocity is 0 after it.
    """

    of_all: Float[Array, "contacts ..."]
    rest: Float[Array, "contacts ..."]
    sticks: Bool[Array, "contacts ..."]


def impact_with_friction(
    machine: Machine, state: State, instant: Instant
) -> tuple[State, Instant, Bool[Array, "stops ..."], Float[Array, "stops ..."], Bool[Array, "stops ..."]]:
    """As `impact` of `coupled_impacts.py`; and flags of friction whose sliding velocity the impact takes to 0."""
    contacts = machine.contacts
    struck = struck_speeds(machine, state, instant)
    wanted, elements = _wanted(machine, state, instant.hit, struck)
    act, is_paradox = _acts(*stop_gradients((machine, wanted)), elements)
    found = _impulses(machine, wanted, elements, act)
    after, instant, is_open = after_impulses(machine, state, instant, struck, found.of_all, found.rest)
    is_paradox = state.mode.paradox | (is_paradox & jnp.any(instant.hit, axis=0))
    after = eqx.tree_at(lambda s: s.mode.paradox, after, is_paradox)
    rubbed = jnp.where(contacts.are_tied & contacts.at_normal(instant.hit), found.of_all, 0)
    instant = eqx.tree_at(lambda i: i.friction_impulse, instant, rubbed)
    moved = not_differentiable(jnp.sum(instant.hit, axis=0) > 1, after.x, after.v)
    after = eqx.tree_at(lambda s: (s.x, s.v), after, moved)
    return after, instant, is_open, found.of_all, found.sticks


def rebound_with_friction(
    machine: Machine, state: State, hit: Bool[Array, "contacts ..."]
) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "contacts ..."]]:
    """Positions and velocities after impacts on the contacts `hit`, and the impulses of all elements.

    The map goes on smoothly beyond a grazing: a contact that is left at the speed |u| has the acts of one that is approached at it.
    """
    contacts, phase_rate = machine.contacts, machine.phase_rate(state.phase)
    closed = contacts.is_rigid & (state.held | state.is_kept_closed)

    def wanted(state: State) -> tuple[Array, Array]:
        speed = jnp.where(hit, sliding_velocity(machine, state), 0)
        return _wanted(machine, state, hit, Struck(speed, contacts.restitution_at(speed), closed))

    speed = sliding_velocity(machine, state)
    is_left = hit & (speed < 0)
    towards = contacts.with_approach(state.v, is_left, jnp.where(is_left, -speed, 0), phase_rate)
    towards = jnp.where(jnp.any(is_left, axis=0), towards, state.v)
    chosen, elements = wanted(eqx.tree_at(lambda s: s.v, state, towards))
    act, _ = _acts(*stop_gradients((machine, chosen)), elements)
    impulse = _impulses(machine, wanted(state)[0], elements, act).of_all
    x = contacts.with_closed_gaps(state.x, hit | closed, state.phase)
    return x, after_loss(state.v, contacts.inverse_mass_times(contacts.back(impulse))), impulse


def _wanted(
    machine: Machine, state: State, hit: Bool[Array, "contacts ..."], struck: Struck
) -> tuple[Float[Array, "contacts ..."], Bool[Array, "contacts ..."]]:
    """Speeds that the impulses take away where contacts push and friction sticks, and flags of the elements concerned."""
    contacts = machine.contacts
    members = _concerned(machine, hit, struck.closed)
    elements = members | (contacts.are_tied & contacts.at_normal(members))
    sliding = sliding_velocity(machine, state)
    return jnp.where(contacts.are(FRICTION), sliding, (1 + struck.restitution) * struck.speed), elements


def _concerned(machine: Machine, hit: Array, closed: Array) -> Bool[Array, "contacts ..."]:
    """Flags of the contacts hit, and of closed ones linked to them by inertia, their own or that of their friction."""
    contacts = machine.contacts
    size = contacts.num
    normal = [k if i < 0 else i for k, i in enumerate(contacts.laws.normal)]
    links = contacts.compliance != 0
    links = links & ~(contacts.are(FRICTION) & ~contacts.are_tied)[None]

    def reached(members: Array) -> Array:
        with_friction = members | (contacts.are_tied & contacts.at_normal(members))
        touched = jnp.any(links & with_friction[None], axis=1)
        by_contact = [
            jnp.any(jnp.stack([touched[k] for k in range(size) if normal[k] == j]), axis=0)
            if j in normal
            else jnp.zeros_like(touched[0])
            for j in range(size)
        ]
        return members | (closed & jnp.stack(by_contact))

    for _ in range(size):
        hit = reached(hit)
    return hit


def _acts(
    machine: Machine, wanted: Float[Array, "contacts ..."], elements: Bool[Array, "contacts ..."]
) -> tuple[Int[Array, "contacts ..."], Bool[Array, "..."]]:
    """Acts of the elements that agree with the law, and whether there are none: 0 pushes or sticks, -1 opens, +-1 slips."""
    worth = jnp.where(machine.contacts.are(FRICTION), STICKS, HOLDS)
    first = jnp.zeros(elements.shape, jnp.int8)
    best = search_acts(
        lambda act: _judged(machine, wanted, elements, act),
        elements,
        first,
        jnp.sum(jnp.where(elements, worth, 0), axis=0),
        first,
        enumerated=_ENUMERATED,
        has_two=~machine.contacts.are(FRICTION),
    )
    return best.found, best.score < 0


def _directed(machine: Machine, elements: Array, act: Array) -> tuple:
    """Contacts whose impulses bring along those of friction that slips; flags of elements that push or stick, and that slip."""
    contacts = machine.contacts
    friction = contacts.are(FRICTION)
    parted = friction & (contacts.at_normal(act) == -1)
    pushes = elements & (act == 0) & ~parted
    slips = elements & friction & (act != 0) & ~parted
    return contacts.directed(jnp.where(slips, act, 0).astype(jnp.int8)), pushes, slips


def _impulses(machine: Machine, wanted: Array, elements: Array, act: Array) -> Impulses:
    """Impulses of a set of acts."""
    contacts, pushes, _ = _directed(machine, elements, act)
    inertia = contacts.inertia_among(pushes)
    impulse = contacts.dragged(matvec(inertia, jnp.where(pushes, wanted, 0)))
    opens = elements & ~contacts.are(FRICTION) & ~pushes
    rest = jnp.where(opens, matvec(contacts.compliance, impulse) - wanted, 0)
    return Impulses(impulse, rest, pushes & contacts.are(FRICTION))


def _judged(machine: Machine, wanted: Array, elements: Array, act: Array) -> Judged:
    """Judge a set of acts by its impulses and the velocities after it."""
    contacts, pushes, slips = _directed(machine, elements, act)
    friction, laws = contacts.are(FRICTION), contacts.laws
    inertia = contacts.inertia_among(pushes)
    multipliers = matvec(inertia, jnp.where(pushes, wanted, 0))
    impulse = contacts.dragged(multipliers)
    size = contacts.sizes_dragged(matvec(jnp.abs(inertia), jnp.where(pushes, jnp.abs(wanted), 0)))
    # Speeds left to take away: of sliding, and where contacts open by how much too slowly they do.
    left = wanted - matvec(contacts.compliance, impulse)
    noise = slack_of(contacts.compliance)
    left_noise = noise * (jnp.abs(wanted) + matvec(jnp.abs(contacts.compliance), size))
    left = jnp.where(jnp.abs(left) <= left_noise, 0, left)
    most = jnp.where(friction, laws.coefficient * contacts.at_normal(impulse), jnp.inf)
    most_noise = noise * (size + jnp.where(friction, laws.coefficient * contacts.at_normal(size), 0))
    above = pushes & (impulse > most + most_noise)
    below = pushes & (impulse < jnp.where(friction, -most, 0) - most_noise)
    is_open = elements & ~friction & (act == -1)
    parted = elements & friction & ~pushes & ~slips
    returns = jnp.where(slips, act * left < 0, is_open & (left > 0))
    # A row that depends on others has no impulse: theirs must do for it.
    is_idle = pushes & jnp.all(inertia == 0, axis=1)
    above, below = above | (is_idle & (left > 0)), below | (is_idle & (left < 0))
    wrong = above | below | returns | (parted & (act != 0))
    proposed = jnp.where(above & friction, jnp.int8(1), jnp.where(below, jnp.int8(-1), jnp.int8(0)))
    proposed = jnp.where(wrong, proposed, act).astype(jnp.int8)
    worth = jnp.where(pushes, jnp.where(friction, STICKS, HOLDS), 0)
    score = jnp.sum(jnp.where(wrong, CONFLICT, worth), axis=0)
    return Judged(score, proposed, act)
