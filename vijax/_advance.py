"""One step of one trajectory: the longest that is proved free of events, or up to the next one.

`advance` is all that moves a trajectory. `simulate` and `sweep` call it in their loops, which know
nothing of contacts; it knows nothing of their logs. It goes through

    expand the motion -> safe step for every stop -> move -> what happened at the end

An instant may hold several events: all its impacts are applied first, and only then is it decided
who sticks and who is let go, because one impact can release a mass (through the dampers)
that another impact of the same instant presses again.

For derivatives the length of a step is a constant, except where it ends on something that moves
with the parameters: an impact or a release (one Newton step, `_land`) or the target time itself.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._contact.restitution import rebound
from ._contact.sticking import chatter_is_complete, chatter_time
from ._machine import Machine, State
from ._motion.bounds import Bound, deflated, either, safe_step, short
from ._motion.flow import AbstractFlow
from ._types import Flag, Scalar, not_negative, stack
from ._xla import compute_once


class Instant(eqx.Module):
    """What happened at the end of a step.

    Attributes:
        hit: impacts, (stops,).
        stuck: masses that came to rest on their stop, (stops,).
        released: masses that were let go, (stops,).
        velocity_minus: velocity of each stop's mass before, (stops,).
        velocity_plus: and after, before it sticks, (stops,).
        chatter: how long after this instant the skipped bounces of the stuck end, (stops,).
        arrived: whether the step ended at the target time.
        time: local time of the instant.
    """

    hit: Bool[Array, "stops ..."]
    stuck: Bool[Array, "stops ..."]
    released: Bool[Array, "stops ..."]
    velocity_minus: Float[Array, "stops ..."]
    velocity_plus: Float[Array, "stops ..."]
    chatter: Float[Array, "stops ..."]
    arrived: Flag
    time: Scalar


def advance(
    flow: AbstractFlow,
    machine: Machine,
    state: State,
    target: Scalar,
    resolution: Scalar,
) -> tuple[State, Instant]:
    """Take one step towards the local time `target`, up to the first event if one comes before.

    Args:
        flow: the motion between events.
        machine: the numbers of the machine.
        state: where the trajectory is.
        target: local time at which to stop.
        resolution: times closer than this are one instant.

    Returns:
        The state after the step, and what happened there.
    """
    remaining = not_negative((target - state.time) - state.time_low)
    ahead = remaining + resolution
    limit, steps, is_event = compute_once(machine.always, _steps_to_events, flow, machine, state, ahead)
    step = jnp.min(steps, axis=0, initial=jnp.inf)
    one_instant = 8 * jnp.finfo(step.dtype).eps / machine.rate
    is_event = is_event & (steps <= step + one_instant)
    arrived = ~jnp.any(is_event, axis=0) & (jnp.minimum(step, limit) >= remaining)
    step = jnp.where(arrived, remaining, jax.lax.stop_gradient(jnp.minimum(step, limit)))
    moved = _move(flow, machine, state, step)
    moved = _land(machine, moved, is_event)
    after, instant = _resolve(machine, moved, is_event)
    return after, eqx.tree_at(lambda i: i.arrived, instant, arrived)


def _steps_to_events(
    flow: AbstractFlow, machine: Machine, state: State, limit: Scalar
) -> tuple[Scalar, Float[Array, "stops ..."], Bool[Array, "stops ..."]]:
    """For every stop the longest step that is proved free of its events, and if it ends on one."""
    motion = flow.expand(machine, state, machine.held_masses(state.held))
    now, limit = motion.now, jnp.minimum(limit, motion.limit)
    x_rest, force_rest = motion.rest(limit)
    steps, events = [], []
    for j, (i, sign) in enumerate(zip(machine.masses, machine.signs, strict=True)):
        gap = (state.gap[j], -sign * state.v[i], -sign * now.acceleration[i] / 2, -sign * now.jerk[i] / 6)
        bound = deflated(gap, x_rest[i], state.contact[j], limit)
        if machine.can_stick:
            pressing = jnp.maximum(sign * now.force[i], 0)
            curvature = sign * now.force_curvature[i] / 2
            contact_force = Bound(pressing, sign * now.force_rate[i], curvature, force_rest[i])
            bound = either(state.held[j], contact_force, bound)
        step, is_root = safe_step(bound, limit)
        nearly = short(state.x.dtype) / machine.rate
        is_event = is_root & (step <= nearly)
        # Where a leading coefficient is lost in rounding the bound allows no step; the motion does.
        steps.append(jnp.where(is_event, step, jnp.maximum(step, jnp.minimum(nearly, limit))))
        events.append(is_event)
    if not steps:
        return limit, state.gap, state.held
    return limit, stack(steps), stack(events)


def _move(flow: AbstractFlow, machine: Machine, state: State, step: Scalar) -> State:
    """Follow the smooth motion for `step`."""
    motion = flow.expand(machine, state, machine.held_masses(state.held))
    displacement, v, phase = motion.move(step)
    time, low = _two_sum(state.time, step)
    return State(
        periods=state.periods,
        time=time,
        time_low=state.time_low + low,
        phase=phase,
        x=state.x + displacement,
        v=v,
        gap=state.gap - machine.at_stops(displacement),
        held=state.held,
        contact=jnp.where(step > 0, jnp.int8(0), state.contact),
    )


def _two_sum(a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
    """The rounded sum and its rounding error (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def _land(machine: Machine, state: State, is_event: Bool[Array, "stops ..."]) -> State:
    """Move on to the exact instant of the event: one Newton step, whose derivative is that of the time.

    The step is below rounding in its effect on everything but the time of a light impact. First and
    second derivatives of that time are exact.
    """
    force = machine.force(state.phase, state.x, state.v)
    a = _accelerations(machine, state, force)
    force_rate = machine.force_rate(state.phase, state.v, a)
    jerk = _accelerations(machine, state, force_rate)
    value, slope, curve = state.gap, -machine.at_stops(state.v), -machine.at_stops(a)
    if machine.can_stick:
        bend = machine.force_rate(machine.phase_rate(state.phase), a, jerk)
        value = jnp.where(state.held, machine.at_stops(force), value)
        curve = jnp.where(state.held, machine.at_stops(bend), curve)
        slope = jnp.where(state.held, machine.at_stops(force_rate), slope)
    usable = is_event & (slope < 0)
    safe_slope = jnp.where(usable, slope, -1)
    # Newton, and for second derivatives Halley: the root of value + slope d + curve d^2 / 2.
    newton = -value / safe_slope
    newton = jnp.where(usable, newton - curve * newton**2 / (2 * safe_slope), jnp.inf)
    delay = jnp.min(newton, axis=0, initial=jnp.inf)
    nearly = short(state.x.dtype) / machine.rate
    delay = jnp.where(jnp.abs(delay) <= nearly, delay, 0)
    time, low = _two_sum(state.time, delay)
    displacement = delay * (state.v + delay * a / 2)
    turn = machine.phase_rate(state.phase)
    return eqx.tree_at(
        lambda s: (s.time, s.time_low, s.phase, s.x, s.v, s.gap),
        state,
        (
            time,
            state.time_low + low,
            state.phase + delay * (turn + delay * machine.phase_rate(turn) / 2),
            state.x + displacement,
            state.v + delay * (a + delay * jerk / 2),
            state.gap - machine.at_stops(displacement),
        ),
    )


def _accelerations(machine: Machine, state: State, force: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """Acceleration by a force (or jerk by its rate), zero for held masses."""
    return jnp.where(machine.held_masses(state.held), 0, machine.inverse_mass * force)


def _resolve(machine: Machine, state: State, is_event: Bool[Array, "stops ..."]) -> tuple[State, Instant]:
    """Apply the impacts of this instant, then decide who sticks and who is let go."""
    v_minus = machine.at_stops(state.v)
    hit = is_event & ~state.held & (v_minus > 0)
    x, v = rebound(machine, state.x, state.v, hit)
    # The gap on the other side of a mass that was hit is measured afresh, its own is zero.
    afresh = stack([machine.has_any(hit)[i] for i in machine.masses]) if machine.masses else hit
    gap = jnp.where(hit, 0, jnp.where(afresh, machine.gaps(x), state.gap))
    contact = jnp.where(hit, jnp.int8(1), state.contact)
    after = eqx.tree_at(lambda s: (s.x, s.v, s.gap, s.contact), state, (x, v, gap, contact))
    none, zeros = jnp.zeros_like(hit), jnp.zeros_like(gap)
    arrived = jnp.zeros_like(state.time, bool)
    instant = Instant(hit, none, none, v_minus, machine.at_stops(v), zeros, arrived, state.time)
    return _stick_and_release(machine, after, instant, is_event) if machine.can_stick else (after, instant)


def _stick_and_release(
    machine: Machine, state: State, instant: Instant, is_event: Bool[Array, "stops ..."]
) -> tuple[State, Instant]:
    """Decide, all impacts of this instant applied, who comes to rest on a stop and who leaves one."""
    let_go = is_event & state.held
    state = eqx.tree_at(lambda s: s.held, state, state.held & ~let_go)
    force = machine.force(state.phase, state.x, state.v)
    a = _accelerations(machine, state, force)
    force_rate = machine.force_rate(state.phase, state.v, a)
    approach = machine.at_stops(machine.inverse_mass * force)
    approach_rate = machine.at_stops(machine.inverse_mass * force_rate)

    speed = jnp.abs(instant.velocity_plus)
    chatter = chatter_time(speed, approach, machine.restitution)
    stuck = instant.hit & chatter_is_complete(speed, approach, approach_rate, chatter, machine.rate)
    is_jump = jnp.any(instant.hit, axis=0)
    thrown = state.held & (approach < 0) & is_jump
    # Let go at this very instant, and pressed again before it could leave.
    pressed_again = ~state.held & (state.contact >= 2) & (approach > 0) & is_jump
    pulled = instant.hit & ~stuck & (speed == 0)
    contact = jnp.where(stuck | pressed_again, jnp.int8(0), state.contact)
    contact = jnp.where(let_go | pulled, jnp.int8(3), contact)
    contact = jnp.where(thrown | (pulled & (approach < 0)), jnp.int8(2), contact)

    v = jnp.where(machine.has_any(stuck), 0, state.v)
    held = (state.held & ~thrown) | stuck | pressed_again
    after = eqx.tree_at(lambda s: (s.v, s.held, s.contact), state, (v, held, contact))
    instant = eqx.tree_at(
        lambda i: (i.stuck, i.released, i.chatter),
        instant,
        (stuck, let_go | thrown, jnp.where(stuck, chatter, 0)),
    )
    return after, instant
