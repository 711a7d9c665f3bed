"""What happens at an instant, and at the start, to contacts that may share inertia.

Impacts follow Moreau's form of Newton's law over all closed contacts, see `vx.Contact`: those that hold count as
plastic, and stay or are torn open. After a jump it is decided by the accelerations which of the closed contacts
that are at rest hold: complementarity of contact forces and accelerations. Of those whose rows depend on each other, as
the legs of a table with four, no more hold than bear a force; the others are `KEPT_CLOSED`. Where one lets go it is decided in the
same way, by the rates of forces and accelerations, which of these bear instead.

Bounces that are light, and sure to end, are completed at once, as in `diagonal_impacts.py`. Where light bounces of several
contacts feed each other (a stack that is dropped), they are completed together: contact forces do not change
the momentum along what all these contacts leave free, and that of dampers while the gaps close is known. So what is
skipped is of the third order in the speeds, as for one contact; the times at which they stick are known to some last
bounces. A relative velocity that is nothing but rounding makes its impact plastic: bouncing
sets that nothing presses together come to an end as well.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Scalar
from .._jax.xla import compute_once, is_any
from .._machine.derivatives import contact_forces, derivatives, rates
from .._machine.machine import Machine, state_before_contact
from .._machine.state import KEPT_CLOSED, State
from .._system.checks import is_touching
from .complementarity import complementary
from .sticking import chatter_is_complete, chatter_time, is_light, is_pressed
from .transition import Instant


def first_state(
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """The state at t0. Contacts that are hit then are hit by the first step."""
    contacts = machine.contacts
    x, v = machine.relative_to_stops(phase, x, v)
    phase_rate = machine.phase_rate(phase)
    position, speed = contacts.rounded(t0)
    # Values that went through the coordinates of the machine carry the rounding of a product.
    touching = is_touching(contacts.gaps(x, phase), 4 * (position + contacts.size(jnp.abs(x))))
    x = contacts.placed(x, touching, phase)
    approach = contacts.towards(v, phase_rate)
    at_rest = touching & is_touching(approach, 4 * (speed + contacts.size(jnp.abs(v))))
    v = contacts.held_still(v, at_rest, phase_rate)
    state = state_before_contact(machine, phase, x, v, jnp.zeros(touching.shape, bool))
    leaving = touching & ~at_rest & (approach < 0)
    contact = jnp.where(leaving, jnp.int8(1), state.contact)
    gap = jnp.where(touching, 0, state.gap)
    state = eqx.tree_at(lambda s: (s.gap, s.contact), state, (gap, contact))
    if not machine.can_stick:
        return state
    closed, contact = _decided(machine, state, at_rest, contact, jnp.any(at_rest, axis=0))
    hold = contacts.hold(closed)
    force, *later = contact_forces(machine, state, hold, derivatives(machine, state, hold))
    held = closed & is_pressed(force, tuple(later))
    contact = jnp.where(closed & ~held, jnp.int8(3), contact)
    state = eqx.tree_at(lambda s: (s.held, s.contact), state, (held, contact))
    held, contact = _handed_on(machine, state, closed & ~held, held, contact)
    return eqx.tree_at(lambda s: (s.held, s.contact), state, (held, contact))


def resolve(machine: Machine, state: State, is_event: Bool[Array, "stops ..."]) -> tuple[State, Instant]:
    """Apply the impacts of this instant, then decide who sticks and who is let go."""
    v_minus = machine.approach(state)
    hit = is_event & ~state.held & (v_minus > 0)
    none, zeros = jnp.zeros_like(hit), jnp.zeros_like(state.gap)
    arrived = jnp.zeros_like(state.time, bool)
    instant = Instant(hit, none, none, v_minus, v_minus, zeros, arrived, state.time, zeros)
    after, instant, torn = jax.lax.cond(
        is_any(hit),
        lambda: compute_once(_impact, machine, state, instant),
        lambda: (state, instant, none),
    )
    if not machine.can_stick:
        return after, instant
    is_doubtful = state.held | (state.contact >= 2) | (hit & is_light(instant.velocity_plus))
    return jax.lax.cond(
        is_any(is_doubtful),
        lambda: _stick_and_release(machine, after, instant, is_event, torn),
        lambda: (after, instant),
    )


def _impact(
    machine: Machine, state: State, instant: Instant
) -> tuple[State, Instant, Bool[Array, "stops ..."]]:
    """The state after the impacts, the velocities and impulses of them, and the held contacts that they tear open."""
    contacts, hit = machine.contacts, instant.hit
    speed = jnp.where(hit, instant.velocity_minus, 0)
    restitution = jnp.where(speed > contacts.noise(state.v), contacts.restitution_at(speed), 0)
    q = -(1 + restitution) * speed
    closed = state.held | state.is_kept_closed
    _, impulse, rest = complementary(contacts.compliance, q, hit | closed)
    v = state.v - contacts.freed(contacts.back(impulse))
    is_open = closed & (rest > 0)
    torn = state.held & is_open
    plus = jnp.where(hit, -restitution * speed - rest, instant.velocity_plus)
    x = contacts.placed(state.x, hit | closed, state.phase)
    # Counted on and not measured afresh: a contact close by keeps the digits of its gap.
    is_closed = hit | closed | (state.gap == 0)
    gap = jnp.where(is_closed, 0, state.gap - contacts.along(x - state.x))
    # Other contacts that are closed now open, or are hit in the same instant, by what these impacts changed.
    approach = contacts.towards(v, machine.phase_rate(state.phase))
    noise = contacts.noise(v)
    is_left = ~hit & ~closed & (state.contact > 0)
    contact = jnp.where(is_left, jnp.where(approach > noise, jnp.int8(0), jnp.int8(2)), state.contact)
    contact = jnp.where(hit | is_open | (is_left & (approach < -noise)), jnp.int8(1), contact)
    after = eqx.tree_at(lambda s: (s.x, s.v, s.gap, s.contact), state, (x, v, gap, contact))
    instant = eqx.tree_at(lambda i: (i.velocity_plus, i.impulse), instant, (plus, jnp.where(hit, impulse, 0)))
    return after, instant, torn


def _stick_and_release(
    machine: Machine,
    state: State,
    instant: Instant,
    is_event: Bool[Array, "stops ..."],
    torn: Bool[Array, "stops ..."],
) -> tuple[State, Instant]:
    """Decide, after all impacts of this instant, which contacts come to hold and which are let go."""
    contacts, hit = machine.contacts, instant.hit
    is_jump = jnp.any(hit, axis=0)
    was_held = state.held & ~torn
    let_go = is_event & was_held
    held = was_held & ~let_go
    state = eqx.tree_at(lambda s: s.held, state, held)
    nothing = jnp.zeros_like(hit), jnp.zeros_like(state.gap)
    completed, duration = jax.lax.cond(
        is_any(hit), lambda: compute_once(_completed, machine, state, instant), lambda: nothing
    )
    # At rest on a contact: held, at the end of their bounces, plastic, or let go at this very instant.
    is_plastic = hit & (instant.velocity_plus == 0)
    at_rest = held | (is_jump & (completed | is_plastic | (~hit & ~let_go & (state.contact >= 2))))
    contact = jnp.where(let_go, jnp.int8(3), state.contact)
    now_held, contact = jax.lax.cond(
        is_any(is_jump),
        lambda: compute_once(_decided, machine, state, at_rest | is_plastic, contact, is_jump),
        lambda: (held, contact),
    )
    num_free = jnp.sum(let_go | state.is_kept_closed, axis=0)
    is_handed_on = ~is_jump & jnp.any(let_go, axis=0) & (num_free > 1)
    now_held, contact = jax.lax.cond(
        is_any(is_handed_on),
        lambda: compute_once(_handed_on, machine, state, let_go & is_handed_on, now_held, contact),
        lambda: (now_held, contact),
    )
    stuck, thrown = now_held & ~was_held, was_held & ~now_held
    x, v = jax.lax.cond(
        is_any(now_held),
        lambda: contacts.settled(state.x, state.v, now_held, state.phase, machine.damping),
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


def _completed(
    machine: Machine, state: State, instant: Instant
) -> tuple[Bool[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Contacts whose bounces are completed at once, and how long those would last.

    Either all that bounce lightly together, or else each that was hit, by itself.
    """
    contacts, hit = machine.contacts, instant.hit
    approach = machine.approach(state)
    is_hit = hit & is_light(instant.velocity_plus)
    is_near = ~hit & ~state.held & ~state.is_kept_closed & is_light(approach) & is_light(state.gap)
    both = jnp.stack([is_hit | is_near, is_hit])
    end = lambda _, bouncing: (None, _end_of_bounces(machine, state, instant, bouncing))  # noqa: E731
    _, (is_complete, durations) = jax.lax.scan(end, None, both)
    is_linked = jnp.any((contacts.compliance != 0) & is_hit[None], axis=1)
    is_joint = jnp.any(is_near & is_linked, axis=0) & jnp.all(is_complete[0] | ~both[0], axis=0)
    completed, duration = (jnp.where(is_joint, a[0], a[1]) for a in (is_complete, durations))
    return completed, duration


def _end_of_bounces(
    machine: Machine, state: State, instant: Instant, bouncing: Bool[Array, "stops ..."]
) -> tuple[Bool[Array, "stops ..."], Float[Array, "stops ..."]]:
    """Whether the bounces of contacts are light and sure to end, all the others of them held, and how long they last."""
    contacts = machine.contacts
    hold = contacts.hold(state.held | bouncing)
    now = rates(machine, state, hold)
    pull = contacts.pull(now.force, hold, state.phase)
    pull_rate = contacts.pull(now.force_rate, hold, machine.phase_rate(state.phase))
    # The speed at which the contact is met next.
    fall = jnp.sqrt(machine.approach(state) ** 2 + 2 * jnp.maximum(pull * state.gap, 0))
    speed = jnp.where(instant.hit, jnp.abs(instant.velocity_plus), fall)
    duration = chatter_time(speed, pull, contacts.light_restitution)
    is_complete = bouncing & chatter_is_complete(speed, pull, pull_rate, duration, machine.rate)
    # A row that depends on others bears no force of its own, and rests when they do.
    is_spare = bouncing & contacts.is_spare(hold) & is_light(speed)
    return is_complete | (is_spare & jnp.any(is_complete, axis=0)), jnp.where(is_spare, 0, duration)


def _decided(
    machine: Machine,
    state: State,
    at_rest: Bool[Array, "stops ..."],
    contact: Int[Array, "stops ..."],
    is_jump: Bool[Array, "..."],
) -> tuple[Bool[Array, "stops ..."], Int[Array, "stops ..."]]:
    """Which of the contacts at rest hold after a jump, and how the others are left."""
    contacts = machine.contacts
    opening = -contacts.free_pull(machine.total_force(state), state.phase)
    held, _, opening = complementary(contacts.compliance, opening, at_rest)
    left = jnp.where(opening > 0, jnp.int8(2), jnp.int8(3))
    left = jnp.where(at_rest, jnp.where(held, jnp.int8(0), left), contact)
    is_beside = ~held & (state.gap == 0) & jnp.any(held, axis=0)
    depends = jax.lax.cond(is_any(is_beside), lambda: contacts.depend_on(held), lambda: jnp.zeros_like(held))
    left = jnp.where(is_beside & depends, jnp.int8(KEPT_CLOSED), left)
    return jnp.where(is_jump, held, state.held), jnp.where(is_jump, left, contact)


def _handed_on(
    machine: Machine,
    state: State,
    let_go: Bool[Array, "stops ..."],
    held: Bool[Array, "stops ..."],
    contact: Int[Array, "stops ..."],
) -> tuple[Bool[Array, "stops ..."], Int[Array, "stops ..."]]:
    """Which contacts hold where several lose their force, or others are shut, and how the rest are left.

    No force jumps: those that come to hold bear nothing yet, and their rates obey what forces do after a jump.
    """
    contacts, is_asked = machine.contacts, jnp.any(let_go, axis=0)
    hold = contacts.hold(state.held)
    phase_rate = machine.phase_rate(state.phase)
    opening = -contacts.pull(rates(machine, state, hold).force_rate, hold, phase_rate)
    is_free = (let_go | state.is_kept_closed) & is_asked
    bearing, _, _ = complementary(
        contacts.compliance_beside(hold), opening, is_free & ~contacts.depend_on(state.held)
    )
    held = held | bearing
    left = jnp.where(contacts.depend_on(held), jnp.int8(KEPT_CLOSED), jnp.int8(3))
    return held, jnp.where(is_free, jnp.where(bearing, jnp.int8(0), left), contact)
