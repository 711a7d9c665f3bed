"""Events of cycles of machines with friction or compliant contacts: guards and resets as `_hybrid` has them."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.friction_chatter import complete_chatter
from .._hybrid.friction_impacts import rebound_with_friction
from .._hybrid.friction_limits import (
    GRIP_AHEAD,
    GRIP_BEHIND,
    TIED_AHEAD,
    TIED_BEHIND,
    sliding_velocity,
)
from .._hybrid.guards import select_active
from .._hybrid.law import rebound
from .._hybrid.limits import CLOSE, IMPACT, OPEN, SLIP, STICK, TURN
from .._hybrid.switching_resets import Zeros, logged
from .._hybrid.tied_friction import in_laws
from .._hybrid.transition import Instant, no_switches
from .._jax.arrays import Scalar
from .._machine.derivatives import rates
from .._machine.machine import Machine
from .._machine.small_matrices import diagonal
from .._machine.state import AHEAD, BEHIND, HELD, SPRING, State, laws_as_numbers
from .._machine.switching import JENKINS
from .sequence import LEAVE, NOTHING, SECOND, Sequence, effective, held_in


class SwitchedEnd(NamedTuple):
    """End of a flight of a machine with friction or compliant contacts, and the state after its event.

    Attributes:
        value: of the guard that vanishes.
        speed: at which it vanishes: of approach to a contact, or of the change of a sliding velocity over a radian of the
            load; at a turn the force beyond the grip if friction stuck; 0 for guards of forces.
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


def is_second(kind: Int[Array, ""]) -> Bool[Array, ""]:
    """True for events at which the second guard of an element vanishes."""
    return kind >= SECOND


def switched_end(
    machine: Machine,
    end: State,
    gap: Float[Array, " contacts"],
    event: tuple[Int[Array, ""], Int[Array, ""]],
    after: Int[Array, " contacts"],
) -> SwitchedEnd:
    """Value of the guard at the end of a flight, and the state after the event there.

    Args:
        machine: the machine.
        end: the end of the flight, in the mode of the flight, with gaps from the positions.
        gap: gaps accumulated since the last contact.
        event: kind and element.
        after: what the elements do after the event.
    """
    kind, element = event
    contacts, here = machine.contacts, machine.in_mode(end)
    counted, hold = eqx.tree_at(lambda s: s.gap, end, gap), here.hold(end.held)
    at_event = jnp.arange(contacts.num) == element
    has_no_gap = contacts.has_no_gap
    both = jnp.concatenate([at_event & ~is_second(kind), at_event & is_second(kind)])
    read = lambda of_guards: jnp.sum(jnp.where(both, of_guards, 0))  # noqa: E731
    value = read(select_active(here, counted, lambda limit: limit.value(here, counted, hold)))
    now = rates(here, counted, hold)
    slope = read(select_active(here, counted, lambda limit: limit.slope(here, counted, hold, now)))
    of_motion = at_event & ~is_second(kind) & ~end.held
    if contacts.num_sliders:
        of_motion = of_motion | (at_event & contacts.are(JENKINS))
    speed = -slope / jnp.where(jnp.any(has_no_gap & at_event), machine.frequency, 1)
    hit = at_event & (kind == IMPACT)
    x, v, grip = after_event(machine, end, hit, after)
    # Gaps and positions agree also where the cycle is not found yet: Newton's method would solve one event after another.
    is_met = of_motion & ~has_no_gap & (kind != NOTHING)
    x = contacts.with_closed_gaps(x, is_met, end.phase)
    moved = contacts.gap_moved(gap, is_met, x - end.x)
    gap = jnp.where((after == HELD) & ~has_no_gap, 0, jnp.where(has_no_gap, 1, moved))
    speed = jnp.where((kind != NOTHING) & jnp.any(of_motion), speed, 0)
    speed = jnp.where(kind == TURN, _push_beyond_grip(machine, end, at_event, after), speed)
    return SwitchedEnd(value, speed, x, v, gap, grip)


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
    where it is a limit of others.
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


def with_stretches_of(
    machine: Machine, v: Float[Array, " n"], mode: Int[Array, " contacts"]
) -> Float[Array, " n"]:
    """Velocities with the stretches of Jenkins elements that slip, in a mode of `Sequence`."""
    if not machine.contacts.num_sliders:
        return v
    return machine.contacts.with_stretches(v, (mode == AHEAD).astype(int) - (mode == BEHIND).astype(int))


def after_event(
    machine: Machine, end: State, hit: Bool[Array, " contacts"], after: Int[Array, " contacts"]
) -> tuple[Float[Array, " n"], Float[Array, " n"], Any]:
    """Positions and velocities after an impact, if one happens, and after the elements that then hold came to rest.

    The third is `grip` of `SwitchedEnd`.
    """
    contacts, grip = machine.contacts, None
    if machine.has_tied_friction:  # which has an impulse too where it slips and its contact comes to rest
        x, v, impulse = rebound_with_friction(machine, end, hit)
        grip = _grip_left(machine, eqx.tree_at(lambda s: s.v, end, v), impulse)
        contacts = contacts.directed(in_laws(machine, end, after).mode.direction)
    else:
        stays = (end.held | end.is_kept_closed) & (effective(after) == HELD)
        x, v = rebound(machine, end, hit, stays & contacts.is_rigid)
    v = contacts.without_speeds(v, held_in(after), end.phase)
    return x, with_stretches_of(machine, v, after), grip


def _grip_left(
    machine: Machine, after: State, impulse: Float[Array, " contacts"]
) -> Float[Array, " contacts"]:
    """`grip` of `SwitchedEnd` from the impulses of all elements; zero where friction just stops within the impact."""
    contacts = machine.contacts
    normal = contacts.at_normal(impulse)
    # Where it sticks no velocity is left, and where it slips no impulse: the impulse that would stop it is beyond by this.
    missing = jnp.abs(sliding_velocity(machine, after)) / diagonal(contacts.compliance)
    most = contacts.laws.coefficient * normal
    left, whole = most - jnp.abs(impulse) - missing, most + jnp.abs(impulse) + missing
    acts = contacts.are_tied & (normal > 0) & (whole > 0)
    return jnp.where(acts, left / jnp.where(acts, whole, 1), -1)


def switched_instant(
    machine: Machine,
    end: State,
    event: tuple[Int[Array, ""], Int[Array, ""]],
    after: Int[Array, " contacts"],
    time: Scalar,
) -> Instant:
    """Log entry of an event."""
    kind, element = event
    contacts = machine.contacts
    at_event = (jnp.arange(contacts.num) == element) & (kind != NOTHING)
    hit = at_event & (kind == IMPACT)
    speed, none, zeros = sliding_velocity(machine, end), jnp.zeros_like(hit), jnp.zeros_like(end.gap)
    x, v = rebound(machine, end, hit, (end.held | end.is_kept_closed) & (effective(after) == HELD))
    struck = eqx.tree_at(lambda s: (s.x, s.v), end, (x, v))
    now = sliding_velocity(machine, struck)
    plus = jnp.where(hit, now, speed)
    # An impact may turn friction of the same mass.
    direction = jnp.where(end.mode.direction != 0, jnp.sign(now), 0).astype(jnp.int8)
    struck = eqx.tree_at(lambda s: s.mode.direction, struck, direction)
    impulse, rubbed = jnp.where(hit, contacts.impulses(end.v - v), 0), None
    if machine.has_tied_friction:
        *_, both = rebound_with_friction(machine, end, hit)
        impulse = jnp.where(hit, both, 0)
        rubbed = jnp.where(contacts.are_tied & contacts.at_normal(hit), both, 0)
    switched = no_switches(end)
    instant = Instant(hit, none, none, speed, plus, zeros, jnp.array(False), time, impulse, switched, rubbed)
    duration = jax.lax.stop_gradient(complete_chatter(machine, struck, instant).duration)
    zero = Zeros(at_event & ~is_second(kind), at_event & is_second(kind))
    return logged(machine, end, in_laws(machine, struck, after), instant, zero, duration)
