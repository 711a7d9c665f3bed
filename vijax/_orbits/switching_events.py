"""Events of cycles: guards and resets as `_hybrid` has them."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.entries import logged, time_of_bounces
from .._hybrid.friction_impacts import rebound_with_friction
from .._hybrid.friction_limits import (
    GRIP_AHEAD,
    GRIP_BEHIND,
    TIED_AHEAD,
    TIED_BEHIND,
    sliding_velocity,
)
from .._hybrid.guards import guards_of, select_active
from .._hybrid.law import rebound
from .._hybrid.limits import CLOSE, IMPACT, OPEN, SLIP, STICK, TURN
from .._hybrid.tied_friction import in_laws
from .._hybrid.transition import Instant, no_switches
from .._jax.arrays import Scalar
from .._machine.contacts import Held
from .._machine.kinds import COMPLIANT, FRICTION
from .._machine.machine import Machine
from .._machine.small_matrices import diagonal
from .._machine.state import AHEAD, BEHIND, HELD, SPRING, State, laws_as_numbers
from .sequence import LEAVE, NOTHING, SECOND, Sequence, effective, held_in

# What each element does, (contacts,): a number, of rigid contacts alone a flag of those that hold; see `Sequence.mode`.
Doing = Int[Array, " contacts"] | Bool[Array, " contacts"]


class EndOfFlight(NamedTuple):
    """End of a flight, and the state after its event.

    Attributes:
        value: of the guard that vanishes.
        speed: at which it vanishes, see `Limit`; at a turn the force beyond the grip if friction stuck; 0, or rounding, for
            guards of forces.
        x: positions after the event, (n,).
        v: velocities after it, (n,).
        gap: gaps after it, (contacts,).
        grip: share of its largest impulse that friction which an impact brings to rest does not need, negative where it slips
            on, (contacts,); -1 for what has no part in an impact. None without friction of contacts.
    """

    value: Scalar
    speed: Scalar
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    gap: Float[Array, " contacts"]
    grip: Any = None


class Event(NamedTuple):
    """The event at the end of a flight, and the modes before and after it, see `Sequence`; for `zeros` `leading_zeros_of`."""

    kind: Int[Array, ""]
    stop: Int[Array, ""]
    mode: Doing
    mode_after: Doing
    zeros: Any = None


def is_second(kind: Int[Array, ""]) -> Bool[Array, ""]:
    """True for events at which the second guard of an element vanishes."""
    return kind >= SECOND


def end_of_flight(machine: Machine, end: State, gap: Float[Array, " contacts"], event: Event) -> EndOfFlight:
    """Value of the guard at the end of a flight, and the state after the event there.

    Args:
        machine: the machine.
        end: the end of the flight, in the mode of the flight, with gaps from the positions.
        gap: gaps accumulated since the last contact.
        event: the event.
    """
    kind, contacts, here = event.kind, machine.contacts, machine.in_mode(end)
    counted, hold = eqx.tree_at(lambda s: s.gap, end, gap), here.hold(end.held)
    at_event, is_padding = jnp.arange(contacts.num) == event.stop, kind == NOTHING
    at_guard = at_event
    if len(guards_of(machine)) > 1:
        at_guard = jnp.concatenate([at_event & ~is_second(kind), at_event & is_second(kind)])
    read = lambda of_guards: jnp.sum(jnp.where(at_guard, of_guards, 0))  # noqa: E731
    value = read(select_active(here, counted, lambda limit: limit.value(here, counted, hold)))
    speed = jnp.where(is_padding, 0, read(_speeds(here, counted, hold)))
    if FRICTION in contacts.kinds:
        speed = jnp.where(kind == TURN, _push_beyond_grip(machine, end, at_event, event.mode_after), speed)
    met = hit = at_event & (kind == IMPACT)
    if COMPLIANT in contacts.kinds:  # whose gaps vanish at other events too
        met = at_guard[: contacts.num] & ~end.held & contacts.has_gap & ~is_padding
    # Gaps and positions agree also where the cycle is not found yet: Newton's method would solve one event after another.
    x, v, grip = after_event(machine, end, hit, met, event.mode_after)
    gap = contacts.gap_placed(gap, met, held_in(event.mode_after), x - end.x, x, end.phase)
    return EndOfFlight(value, speed, x, v, gap, grip)


def _speeds(machine: Machine, state: State, hold: Held) -> Float[Array, " guards"]:
    """Speeds at which the guards of all elements vanish, zero or rounding those of forces."""
    found, none = [], jnp.zeros_like(state.gap)
    groups = guards_of(machine)
    for first, *others in groups:
        speeds = none if first.speed is None else first.speed(machine, state, hold)
        for limit in others:
            own = none if limit.speed is None else limit.speed(machine, state, hold)
            # The speed of a rigid contact that holds is rounding; that of friction that sticks would be the belt's.
            if limit.speed is not None or len(groups) > 1:
                speeds = jnp.where(limit.is_active(machine, state), own, speeds)
        found.append(speeds)
    return found[0] if len(found) == 1 else jnp.concatenate(found)


def _push_beyond_grip(
    machine: Machine, end: State, at_event: Bool[Array, " contacts"], after: Int[Array, " contacts"]
) -> Scalar:
    """Force by which friction at a turn would exceed its grip if it stuck, positive where it does not stick."""
    numbers = jnp.where(end.held, HELD, jnp.where(at_event, HELD, laws_as_numbers(end)))
    stuck = in_laws(machine, end, numbers)
    here = machine.in_mode(stuck)
    hold = here.hold(stuck.held)
    both = (TIED_AHEAD, TIED_BEHIND) if machine.has_tied_friction else (GRIP_AHEAD, GRIP_BEHIND)
    ahead, behind = (limit.value(here, stuck, hold) for limit in both)
    return -jnp.sum(jnp.where(at_event, jnp.where(after == AHEAD, ahead, behind), 0))


def leading_zeros_of(sequence: Sequence, num_sliders: int) -> Int[Array, " events"]:
    """Number of zeros that the guard at the end of a flight has at its beginning, where the event before set it to zero.

    The residual is the guard divided by as many durations, so that a flight of no duration is a regular solution only
    where it is a limit of others. Guards of rigid contacts are not divided.
    """
    kind, stop = sequence.kind, sequence.stop
    before, own = jnp.roll(kind, 1), (stop == jnp.roll(stop, 1)) & (jnp.arange(len(kind)) > 0)
    is_among = lambda kind, kinds: jnp.any(kind[:, None] == jnp.array(kinds)[None], axis=1)  # noqa: E731
    is_motion = own & is_among(kind, (OPEN, CLOSE, STICK, TURN, LEAVE))
    order = jnp.where(is_among(before, (OPEN, CLOSE, TURN)), 1, jnp.where(before % SECOND == SLIP, 2, 0))
    if not num_sliders:
        return jnp.where(is_motion & (before != NOTHING), order, 0)
    # A slider that sticks is free, and its limits are those of a gap: it may come back to the one that it left at rest.
    mode, old = (_mode_of_element(sequence, shift) for shift in (0, 1))
    order = jnp.where(old == SPRING, jnp.where(before % SECOND == SLIP, 0, order), order)
    slips_ahead = (kind == SLIP) & (old == AHEAD) | (kind == SLIP + SECOND) & (old == BEHIND)
    returns = own & (before == STICK) & (mode == SPRING) & slips_ahead
    return jnp.where(returns, 2, jnp.where(is_motion & (before != NOTHING), order, 0))


def _mode_of_element(sequence: Sequence, before: int) -> Int[Array, " events"]:
    """Mode of the element of each event on the flight that ends with it, or so many flights earlier."""
    mode = jnp.roll(jnp.asarray(sequence.mode)[:-1], before, axis=0)
    return jnp.take_along_axis(mode, jnp.asarray(sequence.stop)[:, None], axis=1)[:, 0]


def with_stretches_of(machine: Machine, v: Float[Array, " n"], mode: Doing) -> Float[Array, " n"]:
    """Velocities with the stretches of Jenkins elements that slip, in a mode of `Sequence`."""
    if not machine.contacts.num_sliders:
        return v
    return machine.contacts.with_stretches(v, (mode == AHEAD).astype(int) - (mode == BEHIND).astype(int))


def after_event(
    machine: Machine,
    end: State,
    hit: Bool[Array, " contacts"],
    met: Bool[Array, " contacts"],
    after: Doing,
) -> tuple[Float[Array, " n"], Float[Array, " n"], Any]:
    """Positions and velocities after an impact, if one happens, and after the elements that then hold came to rest.

    Args:
        machine: the machine.
        end: the state before the event.
        hit: flags of the contacts that are hit.
        met: flags of those whose gap is zero, the former among them.
        after: what the elements do after the event.

    Returns:
        Both, and `grip` of `EndOfFlight`.
    """
    contacts, grip, phase_rate = machine.contacts, None, machine.phase_rate(end.phase)
    if machine.has_tied_friction:  # which has an impulse too where it slips and its contact comes to rest
        x, v, impulse = rebound_with_friction(machine, end, hit)
        x = contacts.with_closed_gaps(x, met, end.phase)
        grip = _grip_left(machine, eqx.tree_at(lambda s: s.v, end, v), impulse)
        contacts = contacts.directed(in_laws(machine, end, after).mode.direction)
    else:
        x = contacts.with_closed_gaps(end.x, met, end.phase)
        v = contacts.reflected(end.v, hit, _stays(machine, end, after), phase_rate)
    v = contacts.without_speeds(v, held_in(after), phase_rate)
    return x, with_stretches_of(machine, v, after), grip


def _stays(machine: Machine, end: State, after: Array) -> Bool[Array, " contacts"]:
    """Flags of the rigid contacts that stay closed at an event."""
    if end.mode is None:
        return end.held & after
    rests = end.held | end.is_kept_closed
    return rests & (effective(after) == HELD) & machine.contacts.is_rigid


def _grip_left(
    machine: Machine, after: State, impulse: Float[Array, " contacts"]
) -> Float[Array, " contacts"]:
    """`grip` of `EndOfFlight` from the impulses of all elements; zero where friction just stops within the impact."""
    contacts = machine.contacts
    normal = contacts.at_normal(impulse)
    # Where it sticks no velocity is left, and where it slips no impulse: the impulse that would stop it is beyond by this.
    missing = jnp.abs(sliding_velocity(machine, after)) / diagonal(contacts.compliance)
    most = contacts.laws.coefficient * normal
    left, whole = most - jnp.abs(impulse) - missing, most + jnp.abs(impulse) + missing
    acts = contacts.are_tied & (normal > 0) & (whole > 0)
    return jnp.where(acts, left / jnp.where(acts, whole, 1), -1)


def instant_of(machine: Machine, end: State, event: Event, time: Scalar) -> Instant:
    """Log entry of an event at the end of a flight."""
    contacts, kind, after = machine.contacts, event.kind, event.mode_after
    at_event = jnp.arange(contacts.num) == event.stop
    hit = at_event & (kind == IMPACT)
    none, zeros, rubbed = jnp.zeros_like(hit), jnp.zeros_like(end.gap), None
    x, v = rebound(machine, end, hit, _stays(machine, end, after))
    struck = eqx.tree_at(lambda s: (s.x, s.v), end, (x, v))
    speed, now = sliding_velocity(machine, end), sliding_velocity(machine, struck)
    impulse = contacts.impulses(end.v - v)
    if machine.has_tied_friction:
        *_, impulse = rebound_with_friction(machine, end, hit)
        rubbed = jnp.where(contacts.are_tied & contacts.at_normal(hit), impulse, 0)
    if FRICTION in contacts.kinds:  # an impact may turn friction of the same mass
        direction = jnp.where(end.mode.direction != 0, jnp.sign(now), 0).astype(jnp.int8)
        struck = eqx.tree_at(lambda s: s.mode.direction, struck, direction)
    arrived = jnp.array(False)
    instant = Instant(hit, none, none, speed, now, zeros, arrived, time, impulse, no_switches(end), rubbed)
    duration = jax.lax.stop_gradient(time_of_bounces(machine, struck, instant))
    ended = jnp.where(at_event & (kind != NOTHING), 1 + is_second(kind), 0)
    if contacts.kinds.count(FRICTION) > 1:  # the turn of one is that of all beside it
        ended = jnp.where((kind == TURN) & (event.mode != after), 1, ended)
    return logged(machine, end, in_laws(machine, struck, after), instant, ended, duration)
