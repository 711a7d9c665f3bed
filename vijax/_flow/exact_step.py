"""Smooth part of a step: as far as proved free of events, or exactly to the next event.

    expand the motion -> safe step for every stop -> move -> land on the event, if one is near

Derivatives: the duration of a flight is a constant, except where it ends at the target time or at an event, which move
with the parameters. The time of an event moves by -(change of value) / slope of the gap or contact force that is zero
there. This is the differentiation rule of `fly`. It consists of differentiable functions, so second derivatives follow.
"""

import abc
from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._hybrid.guards import events_of_steps, is_idle, leading_zeros, select_active
from .._hybrid.limits import GAP, Limit
from .._jax.arrays import Scalar, rounding_step, smallest
from .._jax.xla import compute_once, is_any
from .._machine.contacts import Held
from .._machine.derivatives import rates
from .._machine.machine import Machine
from .._machine.state import FROZEN, State
from .arrival import arrival_of, delays_to_events
from .guard_rests import GuardRests, guard_rests
from .interface import AbstractFlow, Expansion, Flight, StepMotion
from .safe_step import Bound, divided_bound, divided_bound_of_two, safe_step
from .series import sum_series, taylor_series
from .switching_step import switching_step


def fly(flow: AbstractFlow, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
    """Call `AbstractFlow.fly`, differentiable by the rule of this file."""
    # The differentiation rule would trace the concrete numbers of the machine.
    numbers, known = eqx.partition(machine, lambda a: isinstance(a, jax.Array))
    return _fly(flow, numbers, state, remaining, resolution, lambda numbers: eqx.combine(numbers, known))


@eqx.filter_custom_jvp
def _fly(
    flow: AbstractFlow,
    numbers: Machine,
    state: State,
    remaining: Scalar,
    resolution: Scalar,
    machine_of: Callable[[Machine], Machine],
) -> Flight:
    return flow.fly(machine_of(numbers).in_mode(state), state, remaining, resolution)


@_fly.def_jvp
def _fly_jvp(primals, tangents):
    _, numbers, state, remaining, _, machine_of = primals
    flight, machine = _fly(*primals), machine_of(numbers).in_mode(state)
    end = flight.end

    def after_the_same_time(flow: AbstractFlow, numbers: Machine, state: State):
        machine = machine_of(numbers).in_mode(state)
        hold = machine.hold(state.held)
        moved = flow.propagate(machine, state, hold, flight.duration)
        end = state_after_step(machine, state, *moved, flight.duration)
        value = select_active(machine, state, lambda limit: limit.value(machine, end, hold))
        return end.x, end.v, end.phase, end.gap, value

    _, (x, v, phase, gap, value) = eqx.filter_jvp(after_the_same_time, primals[:3], tangents[:3])
    hold, phase_rate = machine.hold(state.held), machine.phase_rate(end.phase)
    now = rates(machine, end, hold)
    gap_rate = GAP.slope(machine, end, hold, now)
    slope = select_active(machine, state, lambda limit: limit.slope(machine, end, hold, now))
    is_crossing = flight.is_event & (slope < 0)
    delays = -_plus(value, jnp.zeros_like(slope)) / jnp.where(is_crossing, slope, -1)
    later = jnp.where(flight.is_last, _plus(tangents[3], jnp.zeros_like(remaining)), 0)
    for j in range(len(delays)):
        later = jnp.where(is_crossing[j], delays[j], later)
    moved = (
        _plus(tangents[2].time, later),
        tangents[2].time_low,
        _plus(phase, phase_rate * later),
        _plus(x, end.v * later),
        _plus(v, now.acceleration * later),
        _plus(gap, gap_rate * later),
        later,
    )
    where = lambda f: (  # noqa: E731
        *(getattr(f.end, name) for name in ("time", "time_low", "phase", "x", "v", "gap")),
        f.duration,
    )
    nothing = jax.tree.map(lambda _: None, flight)
    change = eqx.tree_at(where, nothing, moved, is_leaf=lambda leaf: leaf is None)
    if flight.delays is None:
        return flight, change
    own = jnp.where(is_crossing, delays - later, 0)
    return flight, eqx.tree_at(lambda f: f.delays, change, own, is_leaf=lambda leaf: leaf is None)


def _plus(tangent: Array | None, other: Array) -> Array:
    """Sum in which None stands for a zero tangent."""
    return other if tangent is None else tangent + other


class ExpandingFlow(AbstractFlow):
    """Motion with exact derivatives and bounds ahead, see `Expansion`."""

    is_linear = True
    fits_one_kernel = True

    @abc.abstractmethod
    def expand(self, machine: Machine, state: State, hold: Held) -> Expansion:
        """Expand the motion at `state` with the contacts of `hold` closed."""

    def fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        """Take the longest step proved free of events, and land on an event close to its end."""
        hold = machine.hold(state.held)
        motion = compute_once(self.expand, machine, state, hold)
        return flight_along(machine, state, motion, hold, remaining, resolution)

    def propagate(self, machine: Machine, state: State, hold: Held, step: Scalar) -> StepMotion:
        """Expand the motion, then move."""
        motion = compute_once(self.expand, machine, state, hold)
        return compute_once(move_along, machine, state, motion, hold, step)

    def inside(
        self, machine: Machine, state: State, hold: Held
    ) -> Callable[[Scalar], tuple[Array, Array, Array]]:
        """Expand the motion once."""
        motion = compute_once(self.expand, machine, state, hold)
        return partial(move_along, machine, state, motion, hold)

    def coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        """Step as far as the expansion is valid."""
        hold = machine.hold(state.held)
        motion = self.expand(machine, state, hold)
        step = jnp.minimum(remaining, motion.limit)
        return _move(machine, state, motion, hold, step), step


def flight_along(
    machine: Machine,
    state: State,
    motion: Expansion,
    hold: Held,
    remaining: Scalar,
    resolution: Scalar,
    *,
    near_future: Callable | None = None,
    near: Machine | None = None,
    until: Scalar | None = None,
) -> Flight:
    """Flight along an expansion: the longest step proved free of events, landed on an event close to its end.

    Args:
        machine: the machine as arrays.
        state: state at the start.
        motion: expansion there.
        hold: contacts that hold.
        remaining: time left to the target.
        resolution: times closer than this are one instant.
        near_future: function of machine, state and hold: the first Taylor coefficients there; of a linear machine if left out.
        near: the machine with the time scale of its motion now; that of the machine if left out.
        until: time beyond which the expansion and the near future are of no use; none if left out.
    """
    near, near_future = near or machine, near_future or _near_future
    ahead = remaining + resolution
    limit, rests = jnp.minimum(ahead, motion.limit), None
    if machine.contacts.is_coupled:
        rests = compute_once(guard_rests, near, state, motion, hold, limit)
    is_estimated = arrival_of(machine).is_estimated
    find = switching_step if is_estimated else _safe_step
    step, is_root = compute_once(find, near, state, motion, hold, limit, rests)
    is_last = step >= remaining
    step = jnp.where(is_last, remaining, step)
    moved = compute_once(_move, machine, state, motion, hold, step)
    series = compute_once(near_future, machine, moved, hold)
    idle = None if rests is None else is_idle(moved, machine) | rests.vanishes
    ahead = ahead if until is None else jnp.minimum(ahead, until)
    order = leading_zeros(state, machine) if is_estimated else None
    delays = compute_once(delays_to_events, near, moved, series, hold, is_root, ahead - step, idle, order)
    delay = smallest(delays)
    is_event = (delays <= delay + simultaneity_tolerance(machine)) & (delays < jnp.inf)
    # Not before the start of the step: events of one instant come in causal order.
    delay = jnp.where(delay < jnp.inf, jnp.maximum(delay, -step), 0)
    landed = compute_once(_land, machine, moved, series, delay)
    return Flight(landed, step + delay, events_of_steps(machine, landed, is_event), is_last)


def _safe_step(
    machine: Machine, state: State, motion: Expansion, hold: Held, limit: Scalar, own: GuardRests | None
) -> tuple[Scalar, Bool[Array, "stops ..."]]:
    """Longest step proved free of events, and flags of the stops on whose event it ends."""
    if not machine.contacts.num:
        return limit, state.no_events
    if machine.can_stick:
        is_any_held = is_any(state.held)
        now = machine, state, motion, limit, own
        bound = jax.lax.cond(is_any_held, lambda: _bound(*now, hold), lambda: _bound_of_gap(*now))
    else:
        bound = compute_once(_bound_of_gap, machine, state, motion, limit, own)
    nearly = rounding_step(state.x.dtype) * machine.timescale
    steps, is_root = safe_step(bound, limit, nearly)
    # A mass that has just left returns later, never at once: a root at zero is a leading coefficient lost in rounding.
    is_root = is_root & (steps <= nearly) & ((leading_zeros(state) == 0) | (steps > 0))
    if own is not None:
        idle = is_idle(state) | own.vanishes
        steps, is_root = jnp.where(idle, limit, steps), is_root & ~idle
    # With a leading coefficient lost in rounding the bound allows no step, although the motion does.
    steps = jnp.where(is_root, steps, jnp.maximum(steps, jnp.minimum(nearly, limit)))
    step = jnp.minimum(limit, smallest(steps))
    return step, is_root & (steps <= step + simultaneity_tolerance(machine))


def simultaneity_tolerance(machine: Machine) -> Scalar:
    """Time within which events are simultaneous."""
    return 8 * jnp.finfo(machine.rate.dtype).eps * machine.timescale


def _bound(
    machine: Machine, state: State, motion: Expansion, limit: Scalar, own: GuardRests | None, hold: Held
) -> Bound:
    """Bound the guard of every contact from below."""
    rests = own or compute_once(motion.rest, machine, limit)
    of = lambda guard: _bound_of(guard, rests, machine, state, motion, hold)  # noqa: E731
    return select_active(machine, state, of)


def _bound_of_gap(
    machine: Machine, state: State, motion: Expansion, limit: Scalar, own: GuardRests | None
) -> Bound:
    """Lower bound of every gap, where no mass is held."""
    rests = own or (compute_once(_rest_of_gap, motion, machine, limit),)
    return _bound_of(GAP, rests, machine, state, motion, None)


def _rest_of_gap(motion: Expansion, machine: Machine, limit: Scalar) -> Float[Array, "n ..."]:
    return motion.rest(machine, limit)[0]


def _bound_of(
    guard: Limit,
    rests: GuardRests | tuple[Array, ...],
    machine: Machine,
    state: State,
    motion: Expansion,
    hold: Held,
) -> Bound:
    """Bound a guard by its Taylor coefficients and their remainder."""
    value, slope, curvature, *third = guard.derivatives(machine, state, hold, motion.now)
    if isinstance(rests, GuardRests):
        rest = rests.fourth if third else rests.third
    else:
        rest = guard.rest(machine, rests, hold)
    if guard.leading_zeros is not None and third:
        order = guard.leading_zeros(state)
        return divided_bound((value, slope, curvature / 2, third[0] * (1 / 6)), rest, order)
    if guard.leading_zeros is not None:
        return divided_bound_of_two((value, slope, curvature / 2), rest, guard.leading_zeros(state))
    return Bound(jnp.maximum(value, 0), slope, curvature / 2, rest, jnp.zeros_like(rest))


def _move(machine: Machine, state: State, motion: Expansion, hold: Held, step: Scalar) -> State:
    """State after the smooth motion over `step`."""
    return state_after_step(machine, state, *move_along(machine, state, motion, hold, step), step)


def move_along(
    machine: Machine, state: State, motion: Expansion, hold: Held, step: Scalar
) -> tuple[Array, Array, Array]:
    """Displacement, velocities and change of the phase after `step`, with the rows that hold kept closed."""
    displacement, v, change = motion.move(machine, state, step)
    contacts = machine.contacts
    if not (contacts.is_coupled and machine.can_stick):
        return displacement, v, change
    displacement, v = jax.lax.cond(
        is_any(state.held),
        lambda: contacts.kept(state.x, displacement, v, hold, state.phase + change),
        lambda: (displacement, v),
    )
    return displacement, v, change


def _near_future(machine: Machine, state: State, hold: Held) -> tuple[Array, ...]:
    return taylor_series(machine, state, hold, arrival_of(machine).terms, unroll=True)


def _land(machine: Machine, state: State, series: tuple[Array, ...], delay: Scalar) -> State:
    """State after a short `delay`."""
    return state_after_step(machine, state, *sum_series(series[0], series[2], delay), delay)


def state_after_step(
    machine: Machine,
    state: State,
    displacement: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    change: Float[Array, "2 harmonics ..."],
    step: Scalar,
) -> State:
    """State after a step, from its displacement, final velocities and change of the phase."""
    time, low = _two_sum(state.time, step)
    kept, closed, is_later = jnp.int8(0), state.held, step > 0
    if machine.contacts.is_coupled:
        kept, closed = jnp.where(state.is_frozen, state.contact, kept), closed | state.is_frozen
        # Within one instant what has been let go opens by less than the rounding error of its speed.
        is_later = step > simultaneity_tolerance(machine)
    gap = machine.contacts.gap_after(state.gap, closed, displacement, change)
    if state.mode is not None:
        # A gap is frozen for these numbers of the machine alone, not for those beside: it has a derivative.
        beside = machine.contacts.gap_after(state.gap, state.held, displacement, change)
        constant = jax.lax.stop_gradient(state.gap) + (beside - jax.lax.stop_gradient(beside))
        gap = jnp.where(state.contact == FROZEN, constant, gap)
        begins = jnp.where(is_later, jnp.int8(0), state.mode.begins)
        state = eqx.tree_at(lambda s: s.mode.begins, state, begins)
    return eqx.tree_at(
        lambda s: (s.time, s.time_low, s.phase, s.x, s.v, s.gap, s.contact),
        state,
        (
            time,
            state.time_low + low,
            state.phase + change,
            machine.moved(state.x, displacement),
            v,
            gap,
            jnp.where(is_later, kept, state.contact),
        ),
    )


def _two_sum(a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
    """Rounded sum and its rounding error (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)
