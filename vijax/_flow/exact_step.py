"""The smooth part of a step: as far as is proved free of events, or exactly to the next one.

    expand the motion -> safe step for every stop -> move -> land on the event, if one is near

Derivatives: the length of a flight is a constant, except where it ends on something that moves with
the parameters, the target time or an event. The time of an event moves by -(change of value) / slope
of the gap or contact force that is zero there. That is the rule of differentiation of `fly`;
it is made of differentiable functions, so second derivatives follow from it.
"""

import abc
from collections.abc import Callable
from itertools import zip_longest

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._hybrid.limits import GAP, Limit, limits_of, of_active
from .._jax.arrays import Scalar, short, smallest
from .._jax.xla import compute_once, is_any
from .._machine.contacts import Held
from .._machine.derivatives import rates
from .._machine.machine import Machine
from .._machine.state import State
from .interface import AbstractFlow, Expansion, Flight
from .safe_step import Bound, deflated, safe_step
from .series import derivative, horner, sum_series, taylor_series

# Taylor terms by which an event is reached that is `Limit.near`.
_TERMS = 5


def fly(flow: AbstractFlow, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
    """Fly towards a time that lies `remaining` ahead, see `AbstractFlow.fly`; differentiable."""
    # The rule of differentiation would trace the known numbers of the machine.
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
    return flow.fly(machine_of(numbers), state, remaining, resolution)


@_fly.def_jvp
def _fly_jvp(primals, tangents):
    _, numbers, state, remaining, _, machine_of = primals
    flight, machine = _fly(*primals), machine_of(numbers)
    end, limits = flight.end, limits_of(machine)

    def after_the_same_time(flow: AbstractFlow, numbers: Machine, state: State):
        machine = machine_of(numbers)
        hold = machine.hold(state.held)
        moved = flow.propagate(machine, state, hold, flight.duration)
        end = displaced(machine, state, *moved, flight.duration)
        value = of_active(limits, state, lambda limit: limit.value(machine, end, hold))
        return end.x, end.v, end.phase, end.gap, value

    _, (x, v, phase, gap, value) = eqx.filter_jvp(after_the_same_time, primals[:3], tangents[:3])
    hold, phase_rate = machine.hold(state.held), machine.phase_rate(end.phase)
    now = rates(machine, end, hold)
    gap_rate = GAP.slope(machine, end, hold, now)
    slope = of_active(limits, state, lambda limit: limit.slope(machine, end, hold, now))
    is_crossing = flight.is_event & (slope < 0)
    delays = -_plus(value, jnp.zeros_like(slope)) / jnp.where(is_crossing, slope, -1)
    later = jnp.where(flight.is_last, _plus(tangents[3], jnp.zeros_like(remaining)), 0)
    for j in range(machine.contacts.num):
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
    return flight, eqx.tree_at(where, nothing, moved, is_leaf=lambda leaf: leaf is None)


def _plus(tangent: Array | None, other: Array) -> Array:
    """A sum in which None stands for a tangent that is zero."""
    return other if tangent is None else tangent + other


class ExpandingFlow(AbstractFlow):
    """A motion whose derivatives are known exactly, and bounded ahead: see `Expansion`."""

    is_linear = True
    fits_one_kernel = True

    @abc.abstractmethod
    def expand(self, machine: Machine, state: State, hold: Held) -> Expansion:
        """Expand the motion at `state` with the contacts of `hold` closed."""

    def fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        """Take the longest step that is proved free of events, and land on the one it ends close to."""
        hold = machine.hold(state.held)
        ahead = remaining + resolution
        motion = compute_once(self.expand, machine, state, hold)
        step, is_root = compute_once(_safe_step, machine, state, motion, hold, ahead)
        is_last = step >= remaining
        step = jnp.where(is_last, remaining, step)
        moved = compute_once(_move, machine, state, motion, hold, step)
        series = compute_once(_near_future, machine, moved, hold)
        delays = compute_once(_delays, machine, moved, series, hold, is_root, ahead - step)
        delay = smallest(delays)
        is_event = (delays <= delay + one_instant(machine)) & (delays < jnp.inf)
        # Not to before the step began: events of one instant come in the order in which they cause each other.
        delay = jnp.where(delay < jnp.inf, jnp.maximum(delay, -step), 0)
        landed = compute_once(_land, machine, moved, series, delay)
        return Flight(landed, step + delay, is_event, is_last)

    def propagate(
        self, machine: Machine, state: State, hold: Held, step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Expand and move at once."""
        motion = compute_once(self.expand, machine, state, hold)
        return compute_once(_moved, machine, state, motion, hold, step)

    def coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        """Go on by one step, whatever the stops say."""
        hold = machine.hold(state.held)
        motion = self.expand(machine, state, hold)
        step = jnp.minimum(remaining, motion.limit)
        return _move(machine, state, motion, hold, step), step


def _safe_step(
    machine: Machine, state: State, motion: Expansion, hold: Held, limit: Scalar
) -> tuple[Scalar, Bool[Array, "stops ..."]]:
    """The longest step proved free of events, and for every stop whether the step ends on its event."""
    limit = jnp.minimum(limit, motion.limit)
    if not machine.contacts.num:
        return limit, state.held
    if machine.can_stick:
        is_any_held = is_any(state.held)
        now = machine, state, motion, limit
        bound = jax.lax.cond(is_any_held, lambda: _bound(*now, hold), lambda: _bound_of_gap(*now))
    else:
        bound = compute_once(_bound_of_gap, machine, state, motion, limit)
    nearly = short(state.x.dtype) * machine.timescale
    steps, is_root = safe_step(bound, limit, nearly)
    # What has just left comes back later, or else its leading coefficient is rounding; never at once, or before.
    is_root = is_root & (steps <= nearly) & ((state.contact == 0) | (steps > 0))
    if machine.contacts.is_coupled:
        steps, is_root = jnp.where(state.is_shut, limit, steps), is_root & ~state.is_shut
    # Where a leading coefficient is lost in rounding the bound allows no step; the motion does.
    steps = jnp.where(is_root, steps, jnp.maximum(steps, jnp.minimum(nearly, limit)))
    step = jnp.minimum(limit, smallest(steps))
    return step, is_root & (steps <= step + one_instant(machine))


def one_instant(machine: Machine) -> Scalar:
    """Events closer than this are simultaneous."""
    return 8 * jnp.finfo(machine.rate.dtype).eps * machine.timescale


def _bound(machine: Machine, state: State, motion: Expansion, limit: Scalar, hold: Held) -> Bound:
    """Bound the guard of every contact from below."""
    rests = compute_once(motion.rest, machine, limit)
    of = lambda guard: _bound_of(guard, rests, machine, state, motion, limit, hold)  # noqa: E731
    return of_active(limits_of(machine), state, of)


def _bound_of_gap(machine: Machine, state: State, motion: Expansion, limit: Scalar) -> Bound:
    """Bound the gaps alone, where no mass is held."""
    x_rest = compute_once(_rest_of_gap, motion, machine, limit)
    return _bound_of(GAP, (x_rest, x_rest), machine, state, motion, limit, None)


def _rest_of_gap(motion: Expansion, machine: Machine, limit: Scalar) -> Float[Array, "n ..."]:
    return motion.rest(machine, limit)[0]


def _bound_of(
    guard: Limit,
    rests: tuple[Array, Array],
    machine: Machine,
    state: State,
    motion: Expansion,
    limit: Scalar,
    hold: Held,
) -> Bound:
    coefficients = guard.coefficients(machine, state, hold, motion.now)
    rest = guard.rest(machine, rests, hold)
    if guard.begins_at_zero:
        return deflated(coefficients, rest, state.contact, limit)
    value, slope, curve = coefficients
    return Bound(jnp.maximum(value, 0), slope, curve, rest)


def _move(machine: Machine, state: State, motion: Expansion, hold: Held, step: Scalar) -> State:
    """Follow the smooth motion for `step`."""
    return displaced(machine, state, *_moved(machine, state, motion, hold, step), step)


def _moved(
    machine: Machine, state: State, motion: Expansion, hold: Held, step: Scalar
) -> tuple[Array, Array, Array]:
    """The displacement, the velocities and the change of the phase after `step`."""
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
    return taylor_series(machine, state, hold, _TERMS, unroll=True)


def _delays(
    machine: Machine,
    state: State,
    series: tuple[Array, ...],
    hold: Held,
    is_root: Bool[Array, "stops ..."],
    ahead: Scalar,
) -> Float[Array, "stops ..."]:
    """Time to the next event of every stop, if it is near; else infinite.

    A step that ends on a root of its bound falls short of the event by little, and from there the Taylor
    polynomial of the gap or contact force has its root to rounding. The same holds for every other stop
    whose event may be as near.

    Args:
        machine: the numbers of the machine.
        state: at the end of the step.
        series: Taylor coefficients of position, force and phase there.
        hold: what is held.
        is_root: stops on whose event the step ended, to rounding.
        ahead: how far ahead an event may be.
    """
    limits = limits_of(machine)
    guards = [limit.series(machine, state, hold, series) for limit in limits]
    columns = zip_longest(*guards, fillvalue=0.0)
    padded = dict(zip((limit.event for limit in limits), map(list, zip(*columns, strict=True)), strict=True))
    h = of_active(limits, state, lambda limit: padded[limit.event])
    value, slope, curve, bend = h[:4]
    square = slope * slope - 4 * curve * value
    is_simple = (slope < 0) & (4 * square > slope * slope)
    root = jnp.sqrt(jnp.where(is_simple, square, 1))
    delay = 2 * value / (root - jnp.where(is_simple, slope, 0))
    is_simple = is_simple & (jnp.abs(bend) * delay * delay <= 1e-3 * root)
    for _ in range(2):
        rate = jnp.where(is_simple, horner(derivative(h), delay), -1)
        delay = delay - horner(h, delay) / rate
    dtype = str(state.x.dtype)
    near = of_active(limits, state, lambda limit: limit.near[dtype]) * machine.timescale
    is_near = is_simple & (jnp.abs(delay) <= jnp.minimum(near, ahead))
    is_near = is_near & ~state.is_shut if machine.contacts.is_coupled else is_near
    return jnp.where(is_near, delay, jnp.where(is_root, 0, jnp.inf))


def _land(machine: Machine, state: State, series: tuple[Array, ...], delay: Scalar) -> State:
    """Go on by `delay`, which is short."""
    return displaced(machine, state, *sum_series(series[0], series[2], delay), delay)


def displaced(
    machine: Machine,
    state: State,
    displacement: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    change: Float[Array, "2 harmonics ..."],
    step: Scalar,
) -> State:
    """The state after a step, by the displacement, the velocities there, and the change of the phase."""
    time, low = _two_sum(state.time, step)
    kept, closed = jnp.int8(0), state.held
    if machine.contacts.is_coupled:
        kept, closed = jnp.where(state.is_shut, state.contact, kept), closed | state.is_shut
    return eqx.tree_at(
        lambda s: (s.time, s.time_low, s.phase, s.x, s.v, s.gap, s.contact),
        state,
        (
            time,
            state.time_low + low,
            state.phase + change,
            state.x + displacement,
            v,
            machine.contacts.gap_after(state.gap, closed, displacement, change),
            jnp.where(step > 0, kept, state.contact),
        ),
    )


def _two_sum(a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
    """The rounded sum and its rounding error (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)
