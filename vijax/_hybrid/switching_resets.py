"""Resets of machines with friction, Jenkins elements or compliant contacts, at events and at the start.

Impacts come first, by the law of `coupled_impacts.py` among rigid contacts: friction and springs give no impulse. Then
compliant contacts close and open, and friction arrives at rest or is torn off. At last all elements at rest are decided
together, see `decision.py`.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Flag, Scalar, matvec, with_derivative_of
from .._jax.concrete import stop_gradients
from .._jax.xla import compute_once, is_any, of_parts
from .._machine.first_state import state_before_contact
from .._machine.kinds import COMPLIANT, FRICTION, JENKINS, RIGID
from .._machine.machine import Machine
from .._machine.state import FROZEN, KEPT_CLOSED, SATURATED, UNLOADED, Mode, State
from .._system.checks import is_touching
from .compliant_limits import compliant_switched
from .coupled_impacts import impact, without_rounding
from .decision import AtRest, Decision, decide, no_decision
from .entries import logged
from .friction_chatter import chatter_of, die_out, lightest_bounces, rest_at_limits
from .friction_impacts import impact_with_friction
from .friction_limits import sliding_velocity
from .guards import has_one_guard
from .hysteresis_limits import at_limits, limits_at_start, sliders_driven, sliders_settled
from .just_after import forces_of_elements
from .own_switches import switched_at_own_times
from .sticking import is_rounding, usual_speeds
from .tied_friction import loaded, unloaded
from .transition import Instant, Zeros, no_switches


def first_state(
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    t0: Scalar | float = 0.0,
) -> State:
    """State at t0. Contacts hit at t0 are hit by the first step; elements at rest that can hold do so from t0."""
    contacts = machine.contacts
    compliant, friction = contacts.are(COMPLIANT), contacts.are(FRICTION)
    position, speed_size = contacts.rounded(t0)
    gaps = contacts.gaps(x, phase)
    has_no_gap = friction if JENKINS not in contacts.laws.kinds else contacts.has_no_gap
    touching = ~has_no_gap & is_touching(gaps, 4 * (position + contacts.size(jnp.abs(x))))
    x = with_derivative_of(contacts.with_closed_gaps(x, touching, phase), x)
    phase_rate = machine.phase_rate(phase)
    speeds = contacts.speeds(v, phase_rate)
    size = speed_size + contacts.size(jnp.abs(v)) + jnp.abs(contacts.laws.velocity)
    # Where masses rest, their velocities are rounding errors of those that the machine has elsewhere.
    state = state_before_contact(machine, phase, x, v, jnp.zeros(touching.shape, bool))
    usual = usual_speeds(machine, state) + jnp.where(friction, machine.rate * contacts.size(jnp.abs(x)), 0)
    at_rest = (touching | friction) & is_touching(speeds, 4 * (size + usual))
    v = with_derivative_of(contacts.without_speeds(v, at_rest, phase_rate), v)
    state = eqx.tree_at(lambda s: s.v, state, v)
    gap, speeds = with_derivative_of(jnp.where(touching, 0, state.gap), gaps), jnp.where(at_rest, 0, speeds)
    past = compliant & ((gap < 0) | (touching & (speeds > 0)))
    closed = past & (contacts.spring_force(gap, speeds) > 0) | (past & touching)
    direction = jnp.where(friction & ~at_rest, jnp.sign(speeds), 0).astype(jnp.int8)
    contact = jnp.where(touching & ~at_rest & ((speeds < 0) | compliant), jnp.int8(1), state.contact)
    mode = Mode(closed, past & ~closed, direction, state.mode.begins, state.mode.paradox)
    state = eqx.tree_at(lambda s: (s.gap, s.contact, s.mode), state, (gap, contact, mode))
    sliders = None
    if JENKINS in contacts.laws.kinds:
        sliders = at_limits(machine, state, limits_at_start(machine, state), jnp.zeros_like(at_rest))
        state = sliders_driven(machine, state, sliders)
    if machine.has_tied_friction:
        presses = at_rest | closed
        state = unloaded(machine, state, presses)
        at_rest = at_rest & (contacts.at_normal(presses) | ~contacts.are_tied)
    state = _settled(machine, state, AtRest(at_rest, jnp.zeros_like(direction)))
    return state if sliders is None else sliders_settled(machine, state, sliders)


def resolve(
    machine: Machine, state: State, is_event: Bool[Array, "guards ..."], jumps: Flag | None = None
) -> tuple[State, Instant]:
    """Apply the impacts of this instant, then switch the laws of elements, and decide which hold.

    The load may jump, see `past_knots`.
    """
    num = machine.contacts.num
    is_now = jnp.any(is_event, axis=0)
    is_now = is_now if jumps is None else is_now | jumps
    # The frozen elements are decided anew at every event.
    is_open = is_now & (state.contact == FROZEN)
    state = eqx.tree_at(lambda s: s.contact, state, jnp.where(is_open, jnp.int8(0), state.contact))
    events = Zeros(is_event[:num], is_event[num:])
    speed = sliding_velocity(machine, state)
    hit = events.first & machine.contacts.are(RIGID) & ~state.held & ~state.is_kept_closed & (speed > 0)
    hit = without_rounding(hit, speed)
    none, zeros = jnp.zeros_like(hit), jnp.zeros_like(state.gap)
    arrived = jnp.zeros_like(state.time, bool)
    instant = Instant(hit, none, none, speed, speed, zeros, arrived, state.time, zeros, no_switches(state))
    after, torn, impulse, sticks = state, none, zeros, None
    if machine.has_tied_friction:
        instant = eqx.tree_at(lambda i: i.friction_impulse, instant, zeros, is_leaf=lambda leaf: leaf is None)
        after, instant, torn, impulse, sticks = jax.lax.cond(
            is_any(hit),
            lambda: compute_once(impact_with_friction, machine, state, instant),
            lambda: (state, instant, none, zeros, none),
        )
    elif RIGID in machine.contacts.laws.kinds:
        after, instant, torn, impulse = jax.lax.cond(
            is_any(hit),
            lambda: compute_once(impact, machine, state, instant),
            lambda: (state, instant, none, zeros),
        )
    return jax.lax.cond(
        is_any(is_event if jumps is None else is_now),
        lambda: of_parts(_switch, machine, state, after, instant, events, torn, impulse, jumps, sticks),
        lambda: (after, instant),
    )


def forces_between_events(machine: Machine, state: State) -> Float[Array, "contacts ..."]:
    """Forces of all elements: which of those at rest carry a load may change between events."""
    rests = state.held | state.is_kept_closed
    at_rest = AtRest(rests, jnp.zeros_like(state.mode.direction))
    state = _settled(machine, state, at_rest)
    return forces_of_elements(machine.in_mode(state), state)


def _switch(
    machine: Machine,
    before: State,
    state: State,
    instant: Instant,
    events: Zeros,
    torn: Bool[Array, "stops ..."],
    impulse: Float[Array, "stops ..."],
    jumps: Flag | None,
    sticks: Bool[Array, "stops ..."] | None,
) -> tuple[State, Instant]:
    """Switch the laws of elements after all impacts of this instant, and decide which elements at rest hold.

    `sticks` are flags of friction of contacts that the impacts bring to rest; None if there is none.
    """
    contacts, hit = machine.contacts, instant.hit
    rigid, compliant, friction = (contacts.are(kind) for kind in (RIGID, COMPLIANT, FRICTION))
    # In a batch the trajectories without an event come here as well: they stay as they are.
    is_now = jnp.any(events.first | events.second, axis=0)
    is_now = is_now if jumps is None else is_now | jumps
    speed = sliding_velocity(machine, state)
    was_at_rest = before.held | before.is_kept_closed
    # Elements whose speed this instant's impacts change.
    is_struck = ~rigid & _is_struck(machine, impulse)
    is_set_off = was_at_rest & is_struck
    stays = was_at_rest & ~torn & ~is_set_off

    sliders = None
    if JENKINS in contacts.laws.kinds:
        sliders = at_limits(machine, before, events, is_struck)
        state = sliders_driven(machine, state, sliders)
    at_limit = jnp.zeros_like(hit)
    if COMPLIANT in contacts.laws.kinds:
        state, at_limit, events = compliant_switched(machine, state, events, is_set_off, speed, is_now)
    struck = _Struck(speed, is_struck, stays)
    state, arrives, events, size = _friction_switched(machine, before, state, events, struck, is_now, sticks)

    chatter, lightest = chatter_of(machine, state, instant), jnp.zeros_like(hit)
    ends, rubbed = rest_at_limits(machine, state, at_limit)
    is_plastic = hit & (instant.velocity_plus == 0)
    # Elements that have left at this very instant, with no speed, are still at rest.
    has_left = (state.contact >= jnp.where(friction, 1, 2)) & ~hit & ~torn & ~is_struck
    has_left = has_left if sliders is None else has_left & ~contacts.are(JENKINS)
    has_left = has_left if sticks is None else has_left & (state.contact != UNLOADED)
    settles = stays | arrives | chatter.completed | chatter.comes_to_rest | is_plastic | ends | rubbed
    settles = settles | has_left | (compliant & at_limit & (speed == 0) & ~was_at_rest)
    duration = chatter.duration
    if RIGID in contacts.laws.kinds:
        lightest = lightest_bounces(machine, state, instant) & ~settles
    if sticks is not None:
        # Contacts whose friction is decided with them rest without a proof that their bounces end.
        settles = settles | lightest & contacts.presses_friction
        lightest = lightest & ~contacts.are_tied & ~contacts.presses_friction
        state, settles, duration = loaded(machine, state, settles, size, chatter)
        lightest = lightest & ~settles
    at_bound = stays & before.held & ~jnp.any(hit, axis=0)
    side = _side_of_bound(events, at_bound, friction)
    after = jax.lax.cond(
        is_any(settles | lightest),
        lambda: compute_once(_settled, machine, state, AtRest(settles, side), lightest),
        lambda: state,
    )
    if sliders is not None:
        after = compute_once(sliders_settled, machine, after, sliders)
    if contacts.num > 1:
        after = eqx.tree_at(lambda s: s.v, after, switched_at_own_times(machine, before, after, is_struck))
    after = jax.tree.map(lambda new, old: jnp.where(is_now, new, old), after, before)
    ended = jnp.where(events.first, 1, 2 * events.second)
    return after, logged(machine, before, after, instant, ended, duration)


def _side_of_bound(events: Zeros, at_bound: Array, friction: Array) -> Int[Array, "contacts ..."]:
    """Sign of the bound that the force of flagged elements has reached; 0 for all else.

    First guards are those of the lower bound of a contact, and of the upper one of friction.
    """
    side = jnp.where(events.first, -1, jnp.where(events.second, 1, 0))
    return jnp.where(at_bound, jnp.where(friction, -side, side), 0).astype(jnp.int8)


class _Struck(NamedTuple):
    """Elements behind the impacts of an instant.

    Attributes:
        speed: speeds of approach and sliding velocities, (contacts,).
        flags: flags of the elements whose speed the impacts change, (contacts,).
        stays: flags of the elements that stay at rest.
    """

    speed: Float[Array, "contacts ..."]
    flags: Bool[Array, "contacts ..."]
    stays: Bool[Array, "contacts ..."]


def _friction_switched(
    machine: Machine,
    before: State,
    state: State,
    events: Zeros,
    struck: _Struck,
    is_now: Flag,
    sticks: Bool[Array, "stops ..."] | None,
) -> tuple[State, Bool[Array, "contacts ..."], Zeros, Float[Array, "contacts ..."]]:
    """State with friction that arrives at rest or is set off, flags of what arrives, zeros, and sizes of the velocities."""
    contacts = machine.contacts
    friction = contacts.are(FRICTION)
    direction = state.mode.direction
    # An impact without rebound may end the sliding of an element along its row. Elements side by side arrive together.
    size = contacts.size(jnp.abs(before.v)) + jnp.abs(contacts.laws.velocity)
    size = size + jnp.where(struck.flags, 0, usual_speeds(machine, before))
    arrives = (
        is_now
        & friction
        & (direction != 0)
        & (events.first & ~struck.flags | is_rounding(struck.speed, size))
    )
    events = Zeros(events.first | arrives & ~struck.flags, events.second)
    is_stopped = friction & struck.flags & is_rounding(struck.speed, size)
    is_stopped = is_stopped if sticks is None else is_stopped | sticks
    arrives = arrives | is_stopped
    new = jnp.where(friction & struck.flags, jnp.sign(struck.speed), direction)
    direction = jnp.where(arrives, 0, new).astype(jnp.int8)
    # Friction that an impact moves slides at once, also where it rested beside a contact or has just let go.
    contact = jnp.where(friction & struck.flags, jnp.int8(0), state.contact)
    names = lambda s: (s.mode.direction, s.held, s.contact)  # noqa: E731
    state = eqx.tree_at(names, state, (direction, struck.stays & before.held, contact))
    if sticks is not None:
        state = unloaded(machine, state, struck.stays | state.mode.closed)
    return state, arrives, events, size


def _is_struck(machine: Machine, impulse: Float[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
    """Flags of elements whose speed the impulses of all contacts change, by more than rounding."""
    compliance = machine.contacts.compliance
    change = matvec(compliance, impulse)
    size = matvec(jnp.abs(compliance), jnp.abs(impulse))
    return jnp.abs(change) > 64 * len(compliance) * float(jnp.finfo(size.dtype).eps) * size


def _without(state: State, elements: Bool[Array, "contacts ..."]) -> State:
    """State in whose mode some elements have no part."""
    mode = state.mode
    without = Mode(
        mode.closed & ~elements,
        mode.inside & ~elements,
        jnp.where(elements, jnp.int8(0), mode.direction),
        mode.begins,
        mode.paradox,
    )
    return eqx.tree_at(lambda s: (s.mode, s.held), state, (without, state.held & ~elements))


def _settled(machine: Machine, state: State, at_rest: AtRest, lightest: Array | None = None) -> State:
    """State with the elements at rest decided; those of the lightest bounces among them, if these end so."""
    contacts = machine.contacts
    if lightest is None or RIGID not in contacts.laws.kinds:
        found = decide(machine, _without(state, at_rest.elements), at_rest)
    else:
        found, at_rest = _decided_with(machine, state, at_rest, lightest)
    state = _without(state, at_rest.elements)
    friction, mode, elements = contacts.are(FRICTION), state.mode, at_rest.elements
    yields = elements & ~friction & (found.act == 1)
    slips = jnp.where(found.kept, SATURATED, 1) * found.act
    direction = jnp.where(elements & friction, slips, mode.direction).astype(jnp.int8)
    paradox = None if mode.paradox is None else mode.paradox | found.is_paradox
    moves = jnp.where(found.jumps, jnp.int8(2), jnp.int8(3))
    # The force of a damper vanishes to one order less than the depth.
    begins = jnp.where(found.held, found.begins[1], mode.begins)
    begins = jnp.where(yields, jnp.where(contacts.laws.preload == 0, moves - 1, jnp.int8(0)), begins)
    mode = Mode(mode.closed | yields, mode.inside, direction, begins, paradox)
    state = eqx.tree_at(lambda s: s.mode, state, mode)
    held = state.held | found.held
    if paradox is not None:
        state = unloaded(machine, state, held | found.kept | mode.closed)
        contacts = contacts.directed(state.mode.direction)
    x, v = jax.lax.cond(
        is_any(held),
        lambda: contacts.brought_to_rest(state.x, state.v, held, state.phase, machine.in_mode(state).damping),
        lambda: (state.x, state.v),
    )
    gap = jnp.where((held | found.kept) & ~friction, 0, state.gap)
    # The guard of friction is a velocity, and vanishes to one order less than a gap.
    moves = moves - friction.astype(jnp.int8)
    # Nor does one that holds give way at once: what is zero of its room is no event. Both rooms may have one guard.
    first, second = found.begins
    holds = jnp.maximum(first, second) if has_one_guard(machine) else first
    contact = jnp.where(found.held, holds, jnp.where(found.kept, jnp.int8(KEPT_CLOSED), moves))
    contact = jnp.where(elements, contact, state.contact)
    # On a belt a gap still changes.
    is_still = is_rounding(contacts.speeds(v, machine.phase_rate(state.phase)), contacts.size(jnp.abs(v)))
    is_frozen = found.depends & ~state.held & (is_still | friction)
    contact = jnp.where(is_frozen, jnp.int8(FROZEN), contact)
    names = lambda s: (s.x, s.v, s.gap, s.held, s.contact)  # noqa: E731
    after = eqx.tree_at(names, state, (x, v, gap, held, contact))
    return after if paradox is None else unloaded(machine, after, held | found.kept | mode.closed)


def _decided_with(
    machine: Machine, state: State, at_rest: AtRest, lightest: Bool[Array, "contacts ..."]
) -> tuple[Decision, AtRest]:
    """Decision with the lightest bounces at rest where they die out, and without them elsewhere."""
    machine, state = stop_gradients((machine, state))

    def goes_on(carry: tuple) -> Array:
        _, _, is_found, count = carry
        return is_any(~is_found) & (count < 2)

    def once_more(carry: tuple) -> tuple:
        last, among, is_found, count = carry
        among = jnp.where(is_found, among, at_rest.elements | (lightest & (count == 0)))
        without = _without(state, among)
        # The rounding that is left of their speeds presses and pulls nothing.
        v = machine.contacts.without_speeds(state.v, among, machine.phase_rate(state.phase))
        without = eqx.tree_at(lambda s: s.v, without, v)
        found = decide(machine, without, AtRest(among, at_rest.at_bound))
        ends = (
            ~jnp.any(lightest, axis=0)
            | (count > 0)
            | die_out(machine, without, lightest, found.held, found.kept)
        )
        found = jax.tree.map(lambda a, b: jnp.where(is_found, a, b), last, found)
        return found, among, is_found | ends, count + 1

    none = jnp.zeros_like(lightest)
    is_paradox = None if state.mode.paradox is None else jnp.zeros_like(state.mode.paradox)
    start = no_decision(at_rest)._replace(is_paradox=is_paradox)
    first = (start, none, jnp.zeros_like(none[0]), jnp.array(0))
    found, among, *_ = jax.lax.while_loop(goes_on, once_more, first)
    return found, AtRest(among, at_rest.at_bound)
