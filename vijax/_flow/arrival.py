"""Arrival at an event: the time to it from the end of a step, by a Taylor series there."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.guards import guards_of_steps, is_idle, leading_zeros, select_active
from .._hybrid.limits import Limit
from .._jax.arrays import Scalar, smallest
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .series import derivative, horner
from .switching_step import TERMS, near_of


class ArrivalRules(NamedTuple):
    """Rules of the arrival at events.

    Attributes:
        terms: Taylor terms by which an event is reached.
        near: time to the event of a limit below which they leave less than rounding, in time scales of the motion, by dtype.
        bend: largest share of the root of a parabola that its next term moves; from farther away it must be smaller.
        is_estimated: True where a step ends on an estimate of the event, which it may pass; otherwise it ends before.
    """

    terms: int
    near: Callable[[Limit, str], float]
    bend: float
    is_estimated: bool


_PROVED = ArrivalRules(5, lambda limit, dtype: limit.near[dtype], 1e-3, is_estimated=False)
_ESTIMATED = ArrivalRules(TERMS, near_of, 1e-4, is_estimated=True)


def arrival_of(machine: Machine) -> ArrivalRules:
    """Rules for a machine: those that switch several times a period go right to an estimate, see `switching_step.py`."""
    return _ESTIMATED if machine.contacts.is_switching else _PROVED


def delays_to_events(
    machine: Machine,
    state: State,
    series: tuple[Array, ...],
    hold: Held,
    is_root: Bool[Array, "stops ..."],
    ahead: Scalar,
    idle: Bool[Array, "stops ..."] | None,
    order: Int[Array, "stops ..."] | None,
) -> Float[Array, "stops ..."]:
    """Time to the next event of every stop, if it is near; else infinite.

    A step that ends on a root of its bound falls slightly short of the event. From there the Taylor polynomial of the
    gap or contact force has its root to rounding. The same holds for every other stop with an event as near.

    Args:
        machine: the machine as arrays.
        state: state at the end of the step.
        series: Taylor coefficients of positions, forces and phase there.
        hold: contacts that hold.
        is_root: stops on whose event the step ended, to rounding, or of machines that switch close to it.
        ahead: longest time to an event.
        idle: flags of guards without events, None if each has some.
        order: number of leading coefficients of guards that vanish at the start of the step, where it ends on an estimate.
    """
    num_terms = len(series[0])

    def padded(limit: Limit) -> list[Any]:
        guard = limit.series(machine, state, hold, series)
        return [*guard, *[0.0] * (num_terms - len(guard))]

    h = select_active(machine, state, padded, guards_of_steps)
    value, slope, curve, bend = h[:4]
    square = slope * slope - 4 * curve * value
    is_simple = (slope < 0) & (4 * square > slope * slope)
    root = jnp.sqrt(jnp.where(is_simple, square, 1))
    delay = 2 * value / (root - jnp.where(is_simple, slope, 0))
    if order is not None:
        # One that falls all along from where it and its slope vanish, and rises then, has touched zero, up to rounding.
        is_simple = is_simple & ~((order >= 2) & (curve > 0))
    elif machine.contacts.is_coupled:
        # After a step within one instant: what has just been let go opens, whatever the rounding error of its speed.
        is_simple = is_simple & (leading_zeros(state) == 0)
    arrival = arrival_of(machine)
    is_simple = is_simple & (jnp.abs(bend) * delay * delay <= arrival.bend * root)
    # Two steps of Newton's method with one division: the parabola has the slope -root at its zero, and the reciprocal
    # of the slope after the first step follows from that of the root.
    inverse = 1 / root
    delay = delay + horner(h, delay) * inverse
    delay = delay + horner(h, delay) * inverse * (2 + horner(derivative(h), delay) * inverse)
    dtype = str(state.x.dtype)
    near = select_active(machine, state, lambda limit: arrival.near(limit, dtype), guards_of_steps)
    # One distance for all: an event must not be met while an earlier one of another stop is still too far. A single
    # number where all guards are alike.
    nearest = jnp.min(near, axis=0, initial=jnp.inf) if jnp.ndim(near) else near
    near = nearest * machine.timescale
    if arrival.is_estimated:  # the step may have ended behind the event
        is_near = is_simple & (jnp.abs(delay) <= near) & (delay <= ahead)
    else:
        is_near = is_simple & (jnp.abs(delay) <= jnp.minimum(near, ahead))
    is_near = is_near if idle is None else is_near & ~idle
    # An estimate of the event may be one behind the end of the motion.
    is_here = is_root & ~(is_simple & (delay > ahead)) if arrival.is_estimated else is_root
    if len(value) > 1:
        first = smallest(jnp.where(is_near, delay, jnp.inf))
        is_other = ~is_near & ~is_here & ~(is_idle(state, machine) if idle is None else idle)
        waits = is_near & jnp.any(is_other & _may_vanish(h, first), axis=0)
        is_near, is_here = is_near & ~waits, is_here & ~waits
    return jnp.where(is_near, delay, jnp.where(is_here, 0, jnp.inf))


def _may_vanish(h: list[Array], ahead: Scalar) -> Bool[Array, "guards ..."]:
    """Flags of guards that may vanish within a time: a gap that closes just before its mass stands still, for instance."""
    value, slope, curve, bend = h[:4]
    until = jnp.where(ahead < jnp.inf, jnp.maximum(ahead, 0), 0)
    lowest = jnp.where(curve > 0, jnp.clip(-slope / jnp.where(curve > 0, 2 * curve, 1), 0, until), until)
    least = jnp.maximum(value, 0) + lowest * (slope + lowest * curve)
    return ((slope < 0) | (curve < 0)) & (least < jnp.abs(bend) * until**3)
