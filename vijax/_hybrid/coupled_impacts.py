"""Resets of contacts that may share inertia, at events and at the start.

Impacts follow Moreau's form of Newton's law over all closed contacts, see `vx.Contact`: contacts that hold count as
plastic, and stay closed or are torn open. After a jump, complementarity of contact forces and accelerations selects
the contacts that hold among those closed and at rest. Where rows depend on each other, as for a table with four legs,
only contacts that carry a force hold; the others are `KEPT_CLOSED`. When one releases, complementarity of the rates of
forces and accelerations selects the contacts that take over.

Light bounces that are sure to end are completed at once, as in `diagonal_impacts.py`. Light bounces of several
contacts that drive each other (a dropped stack) are completed together: contact forces do not change the momentum
along the directions that these contacts leave free, and the impulse of dampers while the gaps close is computed. The
skipped change is of third order in the speeds, as for one contact; the times of sticking are accurate to a few last
bounces. A relative velocity at the level of rounding makes its impact plastic, so contacts that bounce without being
pressed together also stop bouncing.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Flag, Scalar
from .._jax.xla import compute_once, is_any
from .._machine.contacts import after_loss
from .._machine.derivatives import rates, sizes_of_force
from .._machine.first_state import moving_with, state_before_contact
from .._machine.machine import Machine
from .._machine.small_matrices import slack_of
from .._machine.state import KEPT_CLOSED, State
from .._system.checks import is_touching
from .complementarity import solve_complementarity
from .just_after import just_after, sign_just_after
from .own_times import contacts_at_own_times
from .sticking import (
    chatter_is_complete,
    chatter_time,
    is_disturbed,
    is_light,
    is_nearly_hit,
    is_negligible,
    usual_speeds,
)
from .transition import Instant

# Speed of an impact, relative to that of another at its instant, which is left by rounding.
ROUNDING = 1e-12


def first_state(
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """State at t0. Contacts hit at t0 are hit by the first step."""
    contacts = machine.contacts
    x, v = given = machine.relative_to_stops(phase, x, v)
    phase_rate = machine.phase_rate(phase)
    position, speed = contacts.rounded(t0)
    # Values converted to the coordinates of the machine carry the rounding of a product.
    touching = is_touching(contacts.gaps(x, phase), 4 * (position + contacts.size(jnp.abs(x))))
    x = contacts.with_closed_gaps(x, touching, phase)
    approach = contacts.towards(v, phase_rate)
    state = state_before_contact(machine, phase, x, v, jnp.zeros(touching.shape, bool))
    size = speed + contacts.size(jnp.abs(v)) + usual_speeds(machine, state)
    at_rest = touching & is_touching(approach, 4 * size)
    state = eqx.tree_at(lambda s: s.v, state, contacts.with_zero_approach(v, at_rest, phase_rate))
    leaving = touching & ~at_rest & (approach < 0)
    contact = jnp.where(leaving, jnp.int8(1), state.contact)
    gap = jnp.where(touching, 0, state.gap)
    state = eqx.tree_at(lambda s: (s.gap, s.contact), state, (gap, contact))
    if not machine.can_stick:
        return moving_with(machine, state, *given)
    closed, contact = _holding_after_jump(machine, state, at_rest, contact, jnp.any(at_rest, axis=0))
    hold = contacts.hold(closed)
    forces, errors, *_ = just_after(machine, state, machine.total_force(state), hold)
    held = closed & (sign_just_after(forces, errors) >= 0)
    let_go = closed & ~held
    contact = jnp.where(let_go, jnp.int8(3), contact)
    state = eqx.tree_at(lambda s: (s.held, s.contact), state, (held, contact))
    held, contact = _holding_after_release(machine, state, let_go, held, contact)
    state = eqx.tree_at(lambda s: (s.held, s.contact), state, (held, contact))
    return moving_with(machine, state, *given)


def resolve(
    machine: Machine, state: State, is_event: Bool[Array, "stops ..."], jumps: Flag | None = None
) -> tuple[State, Instant]:
    """Apply the impacts of this instant, then stick and release contacts; the load may jump, see `past_knots`."""
    v_minus = machine.approach(state)
    hit = without_rounding(is_event & ~state.held & (v_minus > 0), v_minus)
    none, zeros = jnp.zeros_like(hit), jnp.zeros_like(state.gap)
    arrived = jnp.zeros_like(state.time, bool)
    instant = Instant(hit, none, none, v_minus, v_minus, zeros, arrived, state.time, zeros)
    after, instant, torn = jax.lax.cond(
        is_any(hit),
        lambda: compute_once(impact, machine, state, instant)[:3],
        lambda: (state, instant, none),
    )
    if not machine.can_stick:
        return after, instant
    # An impact may also bring to rest what touches, as where masses of one speed meet.
    is_doubtful = state.held | (after.contact >= 2) | (hit & is_light(instant.velocity_plus))
    return jax.lax.cond(
        is_any(is_doubtful),
        lambda: _stick_and_release(machine, after, instant, is_event, torn, jumps),
        lambda: (after, instant),
    )


def without_rounding(
    hit: Bool[Array, "stops ..."], speed: Float[Array, "stops ..."]
) -> Bool[Array, "stops ..."]:
    """Flags of the impacts without those whose speed is rounding beside another's: they are hit in turn, at the same instant."""
    return hit & (speed > ROUNDING * jnp.max(speed * hit, axis=0))


def impact(
    machine: Machine, state: State, instant: Instant
) -> tuple[State, Instant, Bool[Array, "stops ..."], Float[Array, "stops ..."]]:
    """State after the impacts, their velocities and impulses, the closed contacts that they tear open, and all impulses."""
    struck = struck_speeds(machine, state, instant)
    speed, restitution, closed = struck
    q = -(1 + restitution) * speed
    _, impulse, rest = solve_complementarity(machine.contacts.compliance, q, instant.hit | closed)
    after, instant, is_open = after_impulses(machine, state, instant, struck, impulse, rest)
    names = lambda s, i: (s.x, s.v, s.gap, i.velocity_minus, i.velocity_plus, i.impulse)  # noqa: E731
    moved = contacts_at_own_times(machine, state, instant.hit, closed, *names(after, instant))
    after, instant = eqx.tree_at(lambda both: names(*both), (after, instant), moved)
    return after, instant, is_open, impulse


class Struck(NamedTuple):
    """Before an impact: speeds of approach to the contacts hit, their restitution coefficients, and flags of closed contacts."""

    speed: Float[Array, "stops ..."]
    restitution: Float[Array, "stops ..."]
    closed: Bool[Array, "stops ..."]


def struck_speeds(machine: Machine, state: State, instant: Instant) -> Struck:
    """Speeds, restitution coefficients and closed contacts for the law of impacts."""
    contacts = machine.contacts
    speed = jnp.where(instant.hit, instant.velocity_minus, 0)
    # Also where masses move alike under equal forces: the speed is then a rounding error of what these give.
    noise = contacts.noise(state.v) + 16 * float(jnp.finfo(speed.dtype).eps) * usual_speeds(machine, state)
    is_fast = speed > noise
    restitution = jnp.where(is_fast, contacts.restitution_at(speed), 0)
    # Those with three leading zeros of their gap touch. What a force pulls apart has a gap just after this instant, so it is hit by
    # itself, in turn, however short its flights are, until what is left of the speeds at this instant is rounding.
    is_slow = (state.gap == 0) & (jnp.abs(instant.velocity_minus) <= noise) & ~jnp.any(is_fast, axis=0)
    rests = state.held | (state.contact >= 3) | (is_slow & ~instant.hit)
    return Struck(speed, restitution, contacts.is_rigid & rests)


def after_impulses(
    machine: Machine,
    state: State,
    instant: Instant,
    struck: Struck,
    impulse: Float[Array, "stops ..."],
    rest: Float[Array, "stops ..."],
) -> tuple[State, Instant, Bool[Array, "stops ..."]]:
    """State after impulses along the rows, velocities of the impacts, and flags of closed contacts that they tear open.

    `rest` is by how much contacts open faster than by their restitution.
    """
    contacts, hit = machine.contacts, instant.hit
    speed, restitution, closed = struck
    v = after_loss(state.v, contacts.inverse_mass_times(contacts.back(impulse)))
    is_open = closed & (rest > 0)
    plus = jnp.where(hit, -restitution * speed - rest, instant.velocity_plus)
    x = contacts.with_closed_gaps(state.x, hit | closed, state.phase)
    # Updated by the displacement, not recomputed: a nearly closed contact keeps the digits of its gap. One that was left at this
    # instant may have a gap of rounding.
    is_zero = (state.gap == 0) | (state.contact > 0)
    gap = contacts.gap_moved(state.gap, hit | closed | is_zero, x - state.x)
    # Other contacts with zero gap may open, or be hit at the same instant, as these impacts change velocities.
    approach, noise = contacts.speeds(v, machine.phase_rate(state.phase)), contacts.noise(v)
    is_left = contacts.is_rigid & is_zero & ~(hit | state.held) & (state.contact < 3)
    contact = jnp.where(is_left, jnp.where(approach > noise, jnp.int8(0), jnp.int8(2)), state.contact)
    contact = jnp.where(hit | is_open | (is_left & (approach < -noise)), jnp.int8(1), contact)
    after = eqx.tree_at(lambda s: (s.x, s.v, s.gap, s.contact), state, (x, v, gap, contact))
    instant = eqx.tree_at(lambda i: (i.velocity_plus, i.impulse), instant, (plus, jnp.where(hit, impulse, 0)))
    return after, instant, is_open


def _stick_and_release(
    machine: Machine,
    state: State,
    instant: Instant,
    is_event: Bool[Array, "stops ..."],
    torn: Bool[Array, "stops ..."],
    jumps: Flag | None,
) -> tuple[State, Instant]:
    """Stick and release contacts, after all impacts of this instant."""
    contacts, hit = machine.contacts, instant.hit
    is_jump = jnp.any(hit, axis=0)
    is_jump = is_jump if jumps is None else is_jump | jumps
    torn, was_held = state.held & torn, state.held & ~torn
    let_go = is_event & was_held
    held = was_held & ~let_go
    state = eqx.tree_at(lambda s: s.held, state, held)
    nothing = jnp.zeros_like(hit), jnp.zeros_like(state.gap)
    completed, duration = jax.lax.cond(
        is_any(hit), lambda: compute_once(_complete_chatter, machine, state, instant), lambda: nothing
    )
    # Contacts at rest: held, at the end of their bounces, hit plastically, or released at this instant.
    is_plastic = hit & (instant.velocity_plus == 0)
    at_rest = held | (is_jump & (completed | is_plastic | (~(hit | let_go) & (state.contact >= 2))))
    contact = jnp.where(let_go, jnp.int8(3), state.contact)
    now_held, contact = jax.lax.cond(
        is_any(is_jump),
        lambda: compute_once(_holding_after_jump, machine, state, at_rest | is_plastic, contact, is_jump),
        lambda: (held, contact),
    )
    num_free = jnp.sum(let_go | state.is_kept_closed, axis=0)
    is_handed_on = ~is_jump & jnp.any(let_go, axis=0) & (num_free > 1)
    now_held, contact = jax.lax.cond(
        is_any(is_handed_on),
        lambda: compute_once(
            _holding_after_release, machine, state, let_go & is_handed_on, now_held, contact
        ),
        lambda: (now_held, contact),
    )
    stuck, thrown = now_held & ~was_held, was_held & ~now_held
    x, v = jax.lax.cond(
        is_any(now_held),
        lambda: contacts.closed_and_stopped(state.x, state.v, now_held, state.phase, machine.damping),
        lambda: (state.x, state.v),
    )
    gap = jnp.where(now_held, 0, state.gap)
    names = lambda s: (s.x, s.v, s.gap, s.held, s.contact)  # noqa: E731
    after = eqx.tree_at(names, state, (x, v, gap, now_held, contact))
    instant = eqx.tree_at(
        lambda i: (i.stuck, i.released, i.chatter),
        instant,
        (stuck, torn | thrown, jnp.where(stuck & completed, duration, 0)),
    )
    return after, instant


def _complete_chatter(
    machine: Machine, state: State, instant: Instant
) -> tuple[Bool[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Contacts whose bounces are completed at once, and the durations of the skipped bounces.

    Light bounces of linked contacts together if all of them complete; otherwise those of each hit contact.
    """
    contacts, hit = machine.contacts, instant.hit
    is_hit = hit & is_light(instant.velocity_plus)
    is_near = ~hit & is_nearly_hit(machine, state)
    both = jnp.stack([is_hit | is_near, is_hit])
    end = lambda _, bouncing: (None, _chatter_completion(machine, state, instant, bouncing))  # noqa: E731
    _, (is_complete, durations) = jax.lax.scan(end, None, both)
    is_linked = jnp.any((contacts.compliance != 0) & is_hit[None], axis=1)
    is_joint = jnp.any(is_near & is_linked, axis=0) & jnp.all(is_complete[0] | ~both[0], axis=0)
    completed, duration = (jnp.where(is_joint, a[0], a[1]) for a in (is_complete, durations))
    is_met = ~is_joint & is_disturbed(machine, state, hit, completed, duration)
    return completed & (~is_met | is_negligible(machine, state, instant.velocity_plus)), duration


def _chatter_completion(
    machine: Machine, state: State, instant: Instant, bouncing: Bool[Array, "stops ..."]
) -> tuple[Bool[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Flags of light bounces that are sure to end while the rest of `bouncing` holds, and their durations."""
    contacts = machine.contacts
    hold = contacts.hold(state.held | bouncing)
    now = rates(machine, state, hold)
    pull = contacts.pull(now.force, hold, state.phase)
    pull_rate = contacts.pull(now.force_rate, hold, machine.phase_rate(state.phase))
    # Speed of the next impact on the contact.
    fall = jnp.sqrt(machine.approach(state) ** 2 + 2 * jnp.maximum(pull * state.gap, 0))
    speed = jnp.where(instant.hit, jnp.abs(instant.velocity_plus), fall)
    duration = chatter_time(speed, pull, contacts.light_restitution)
    is_complete = bouncing & chatter_is_complete(speed, pull, pull_rate, duration, machine.rate)
    # A dependent row carries no force, and rests when the rows it depends on do.
    is_spare = bouncing & contacts.is_redundant(hold) & is_light(speed)
    return is_complete | (is_spare & jnp.any(is_complete, axis=0)), jnp.where(is_spare, 0, duration)


def _holding_after_jump(
    machine: Machine,
    state: State,
    at_rest: Bool[Array, "stops ..."],
    contact: Int[Array, "stops ..."],
    is_jump: Bool[Array, "..."],
) -> tuple[Bool[Array, "stops ..."], Int[Array, "stops ..."]]:
    """Contacts that hold after a jump, among those `at_rest`, and the new `State.contact`."""
    contacts = machine.contacts
    force = machine.total_force(state)
    # Touching bodies whose accelerations are equal are not taken apart by rounding.
    size = contacts.inverse_mass_size(sizes_of_force(machine, force, jnp.abs(state.x), jnp.abs(state.v)))
    slack = slack_of(contacts.compliance) * (contacts.size(size) + contacts.acceleration_bound())
    opening = -contacts.free_pull(force, state.phase)
    opening = jnp.where(jnp.abs(opening) <= slack, 0, opening)
    held, _, opening = solve_complementarity(contacts.compliance, opening, at_rest)
    left = jnp.where(opening > 0, jnp.int8(2), jnp.int8(3))
    left = jnp.where(at_rest, jnp.where(held, jnp.int8(0), left), contact)
    is_beside = ~held & (state.gap == 0) & jnp.any(held, axis=0)
    depends = jax.lax.cond(is_any(is_beside), lambda: contacts.depend_on(held), lambda: jnp.zeros_like(held))
    left = jnp.where(is_beside & depends, jnp.int8(KEPT_CLOSED), left)
    return jnp.where(is_jump, held, state.held), jnp.where(is_jump, left, contact)


def _holding_after_release(
    machine: Machine,
    state: State,
    let_go: Bool[Array, "stops ..."],
    held: Bool[Array, "stops ..."],
    contact: Int[Array, "stops ..."],
) -> tuple[Bool[Array, "stops ..."], Int[Array, "stops ..."]]:
    """Contacts that take over from released ones, and the new `State.contact`, also of contacts kept closed.

    No force jumps: forces of new contacts start at zero, and their rates obey the conditions of forces after a jump.
    """
    contacts, is_asked = machine.contacts, jnp.any(let_go, axis=0)
    hold = contacts.hold(state.held)
    phase_rate = machine.phase_rate(state.phase)
    opening = -contacts.pull(rates(machine, state, hold).force_rate, hold, phase_rate)
    is_free = (let_go | state.is_kept_closed) & is_asked
    bearing, force_rate, _ = solve_complementarity(
        contacts.compliance_beside(hold), opening, is_free & ~contacts.depend_on(state.held)
    )
    # The force of a contact that has let go falls by a higher derivative where its rate is zero.
    bearing = bearing & (~let_go | (force_rate > 0))
    held = held | bearing
    left = jnp.where(contacts.depend_on(held), jnp.int8(KEPT_CLOSED), jnp.int8(3))
    return held, jnp.where(is_free, jnp.where(bearing, jnp.int8(0), left), contact)
