"""Chatter of rigid contacts in machines with friction or compliant contacts.

Friction along the row of a bouncing mass turns at every apex. With p the pull towards the contact without friction, the
mass flies away with the deceleration p + F and falls back with p - F, so that each bounce is slower than the one before
by the factor r q, q = sqrt((p - F) / (p + F)), and all of them last

    T = u (1 / (p + F) + 1 / sqrt((p + F) (p - F))) / (1 - r q),

u the speed after the first. With F >= p the mass stops at an apex.

A preloaded compliant contact has no restitution, but friction lets light bounces at d = 0 die out all the same, if p is
between F and the preload less F.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.xla import compute_once, is_any
from .._machine.contacts import Held
from .._machine.derivatives import rates
from .._machine.kinds import COMPLIANT, FRICTION, RIGID
from .._machine.machine import Machine
from .._machine.small_matrices import diagonal
from .._machine.state import State
from .friction_limits import sliding_velocity
from .sticking import chatter_is_complete, is_disturbed, is_light, is_nearly_hit, is_negligible
from .transition import Instant

# Largest velocity of sliding, relative to that of the bounces, that they turn: the forces change it by some tens of the
# latter until all bounces are over.
_TURNED = 100.0
# Share by which rows that are not parallel differ.
_PARALLEL = 1e-9
# Largest speed of the lightest bounces, against what presses their contact within a radian of the fastest motion.
_SHORT = 1e-6


class Chatter(NamedTuple):
    """Bounces that are completed at once, (contacts,) each.

    Attributes:
        completed: flags of contacts whose bounces are.
        comes_to_rest: flags of friction elements that come to rest with them.
        duration: time to the end of the bounces, also of these friction elements.
    """

    completed: Bool[Array, "contacts ..."]
    comes_to_rest: Bool[Array, "contacts ..."]
    duration: Float[Array, "contacts ..."]


def lightest_bounces(machine: Machine, state: State, instant: Instant) -> Bool[Array, "contacts ..."]:
    """Flags of contacts that bounce, and of friction that slips, so lightly that what they have left to move is rounding.

    In any unit: their speeds and gaps against what the forces do within a radian of the fastest motion. Contacts whose impulses
    press friction may open each other, and gain speed: of these the speed itself must be rounding.
    """
    contacts, mode = machine.contacts, state.mode
    in_motion = machine.in_mode(state)
    pull = contacts.size(jnp.abs(contacts.inverse_mass_times(in_motion.total_force(state))))
    eps = float(jnp.finfo(state.x.dtype).eps)
    least = jnp.where(contacts.presses_friction, eps, eps**0.5) if machine.has_tied_friction else eps**0.5
    is_slow = jnp.abs(sliding_velocity(machine, state)) * in_motion.rate <= least * pull
    is_near = jnp.abs(state.gap) * in_motion.rate**2 <= least**1.75 * pull
    friction, compliant = contacts.are(FRICTION), contacts.are(COMPLIANT)
    bounces = contacts.is_rigid | (compliant & (contacts.laws.preload > 0))
    is_open = ~state.held & ~state.is_kept_closed
    flags = is_open & is_slow & jnp.where(friction, mode.direction != 0, bounces & is_near)
    return flags & jnp.any(instant.hit, axis=0)


def die_out(
    machine: Machine,
    state: State,
    lightest: Bool[Array, "contacts ..."],
    held: Bool[Array, "contacts ..."],
    kept: Bool[Array, "contacts ..."],
) -> Bool[Array, "..."]:
    """Test whether the lightest bounces end at rest: the forces there press all of these contacts, and friction stays.

    Energy and work of the forces on the gaps then fall with every bounce and slip, however these follow each other.
    `held` and `kept` are the elements that hold, and that others keep closed, once all are at rest.
    """
    contacts, laws = machine.contacts, machine.contacts.laws
    in_motion = machine.in_mode(state)
    hold = (in_motion.contacts if machine.has_tied_friction else contacts).hold(held)
    force = in_motion.total_force(state)
    reaction = contacts.contact_force(force, hold, state.phase)
    pull = contacts.pull(force, hold, state.phase)
    most = jnp.where(contacts.is_rigid, jnp.inf, jnp.where(contacts.are(FRICTION), laws.force, laws.preload))
    friction = contacts.are(FRICTION)
    speed = jnp.abs(sliding_velocity(machine, state)) * in_motion.rate
    presses = (reaction > 0) & (speed <= _SHORT * pull) & (reaction < most)
    stays = jnp.where(friction, jnp.abs(reaction) < most, presses) & held
    loses = friction | contacts.are(COMPLIANT) | (contacts.light_restitution < 1)
    return jnp.all(~lightest | ((stays | kept) & loses), axis=0) & jnp.any(lightest, axis=0)


def chatter_of(machine: Machine, state: State, instant: Instant) -> Chatter:
    """Bounces of rigid contacts that end at this instant, see `complete_chatter`."""
    if RIGID not in machine.contacts.laws.kinds:
        return no_chatter(state)
    return jax.lax.cond(
        is_any(instant.hit),
        lambda: compute_once(complete_chatter, machine, state, instant),
        lambda: no_chatter(state),
    )


def no_chatter(state: State) -> Chatter:
    """No bounces."""
    none = jnp.zeros_like(state.held)
    return Chatter(none, none, jnp.zeros_like(state.gap))


def complete_chatter(machine: Machine, state: State, instant: Instant) -> Chatter:
    """Find light bounces that are sure to end: of linked contacts together if all of them do, otherwise of the hit ones."""
    contacts, hit = machine.contacts, instant.hit
    is_hit = hit & is_light(instant.velocity_plus)
    in_motion = machine.in_mode(state)
    is_near = ~hit & is_nearly_hit(in_motion, state)
    both = jnp.stack([is_hit | is_near, is_hit])
    _, each = jax.lax.scan(lambda _, own: (None, _bounces(machine, state, instant, own)), None, both)
    is_linked = jnp.any((contacts.compliance != 0) & is_hit[None], axis=1)
    is_joint = jnp.any(is_near & is_linked, axis=0) & jnp.all(each.completed[0] | ~both[0], axis=0)
    completed, turns, duration = (jnp.where(is_joint, a[0], a[1]) for a in each)
    is_met = ~is_joint & is_disturbed(in_motion, state, hit, completed, duration)
    # Other friction that stops before they are over.
    sliding = sliding_velocity(machine, state)
    slides = contacts.are(FRICTION) & (state.mode.direction != 0)
    time = jnp.max(jnp.where(completed, duration, 0), axis=0, initial=0.0)
    pull = contacts.free_pull(in_motion.total_force(state), state.phase)
    stops_first = slides & ~turns & (jnp.abs(sliding) <= time * jnp.abs(pull))
    links = (contacts.compliance**2 > 0) & completed[None]
    is_met = is_met | jnp.any(stops_first & jnp.any(links, axis=1), axis=0)
    completed = completed & (~is_met | is_negligible(in_motion, state, jnp.abs(instant.velocity_plus)))
    duration = jnp.where(completed, duration, 0)
    stops = turns & jnp.any((contacts.compliance != 0) & completed[None], axis=1)
    longest = jnp.max(duration, axis=0, initial=0.0)
    return Chatter(completed, stops, jnp.where(stops, longest, duration))


def _bounces(machine: Machine, state: State, instant: Instant, bouncing: Array) -> Chatter:
    """Those of some contacts whose light bounces are sure to end while the others hold, and the friction that they turn."""
    contacts, hit, approach = machine.contacts, instant.hit, machine.approach(state)
    # Friction that the bounces turn: as light as they are, and along the same motion. It slides on where all slide together.
    square, own = contacts.compliance**2, diagonal(contacts.compliance)
    is_parallel = (square > 0) & bouncing[None] & (square >= (1 - _PARALLEL) * own[:, None] * own[None])
    first = jnp.abs(jnp.where(hit, instant.velocity_plus, approach))
    most = _TURNED * jnp.max(jnp.where(is_parallel, first[None], 0), axis=1)
    sliding, direction = sliding_velocity(machine, state), state.mode.direction
    slides = contacts.are(FRICTION) & (direction != 0)
    turns = slides & is_light(sliding) & (jnp.abs(sliding) <= most)
    both = jnp.stack([direction, jnp.where(turns, -direction, direction)])
    hold = (machine.in_mode(state) if machine.has_tied_friction else machine).hold(state.held | bouncing)

    def pulls(_: None, direction: Array) -> tuple[None, tuple[Array, Array]]:
        return None, _pulls(machine, eqx.tree_at(lambda s: s.mode.direction, state, direction), hold)

    _, ((away, fall), (_, fall_rate)) = jax.lax.scan(pulls, None, both)
    # Of a contact that is not hit, the speed of its next impact.
    next_speed = jnp.sqrt(approach**2 + 2 * jnp.maximum(fall * state.gap, 0))
    speed = jnp.where(hit, jnp.abs(instant.velocity_plus), next_speed)
    is_falling = (fall > 0) & (away > 0)
    up, down = (jnp.where(is_falling, a, 1) for a in (away, fall))
    loss = 1 - contacts.light_restitution * jnp.sqrt(down / up)
    is_ending = is_falling & (loss > 0)
    duration = speed * (1 / up + 1 / jnp.sqrt(up * down)) / jnp.where(is_ending, loss, 1)
    duration = jnp.where(is_ending, duration, jnp.inf)
    is_complete = chatter_is_complete(speed, fall, fall_rate, duration, machine.in_mode(state).rate)
    # A dependent row carries no force, and rests when the rows it depends on do.
    is_spare = bouncing & contacts.is_redundant(hold) & is_light(speed)
    completed = bouncing & (is_complete | (is_spare & jnp.any(bouncing & is_complete, axis=0)))
    return Chatter(completed, turns, jnp.where(is_spare, 0, duration))


def rest_at_limits(
    machine: Machine, state: State, at_limit: Bool[Array, "contacts ..."]
) -> tuple[Bool[Array, "contacts ..."], Bool[Array, "contacts ..."]]:
    """Compliant contacts that come to rest at their limits, and friction that does with them, see `comes_to_rest`."""
    none = jnp.zeros_like(at_limit)
    if not {COMPLIANT, FRICTION} <= set(machine.contacts.laws.kinds):
        return none, none
    return jax.lax.cond(
        is_any(at_limit),
        lambda: compute_once(comes_to_rest, machine, state, at_limit),
        lambda: (none, none),
    )


def comes_to_rest(
    machine: Machine, state: State, at_limit: Bool[Array, "contacts ..."]
) -> tuple[Bool[Array, "contacts ..."], Bool[Array, "contacts ..."]]:
    """Find preloaded contacts at d = 0 whose light bounces die out by friction, and that friction."""
    contacts, laws, direction = machine.contacts, machine.contacts.laws, state.mode.direction
    # Bounces of the speed u reach u^2 / (2 p), below the rounding of p / rate^2.
    least = float(jnp.finfo(state.x.dtype).eps) ** 0.5
    in_motion = machine.in_mode(state)
    speed = jnp.abs(sliding_velocity(machine, state)) * in_motion.rate
    acceleration = jnp.abs(contacts.inverse_mass_times(in_motion.total_force(state)))
    is_still = speed <= least * contacts.size(acceleration)
    is_linked = contacts.compliance != 0
    bouncing = at_limit & is_still & (laws.preload > 0)
    rubs = (direction != 0) & is_still & (laws.force > 0) & jnp.any(is_linked & bouncing[None], axis=1)
    bouncing = bouncing & jnp.any(is_linked & rubs[None], axis=1)
    hold = (machine.in_mode(state) if machine.has_tied_friction else machine).hold(state.held | bouncing)
    free = eqx.tree_at(lambda s: s.mode.closed, state, state.mode.closed & ~bouncing)

    def pulls(_: None, direction: Array) -> tuple[None, Array]:
        return None, _pulls(machine, eqx.tree_at(lambda s: s.mode.direction, free, direction), hold)[0]

    both = jnp.stack([direction, jnp.where(rubs, -direction, direction)])
    _, pull = jax.lax.scan(pulls, None, both)
    load = diagonal(hold.inertia)[None] * pull
    is_ending = bouncing & (jnp.min(load, axis=0) > 0) & (jnp.max(load, axis=0) < laws.preload)
    is_ending = is_ending & (speed <= least * jnp.min(pull, axis=0))
    return is_ending, rubs & jnp.any(is_linked & is_ending[None], axis=1)


def _pulls(
    machine: Machine, state: State, hold: Held
) -> tuple[Float[Array, "contacts ..."], Float[Array, "contacts ..."]]:
    """Acceleration towards each contact while the others of `hold` are closed, and its rate."""
    machine = machine.in_mode(state)
    now, pull = rates(machine, state, hold), machine.contacts.pull
    phase_rate = machine.phase_rate(state.phase)
    return pull(now.force, hold, state.phase), pull(now.force_rate, hold, phase_rate)
