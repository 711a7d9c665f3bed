"""Lengths of Taylor steps of a machine with a force.

1. Jorba and Zou: the last two orders are small against the motion within the step. No length of the machine is needed: the
   motion within the step is h |v| + h^2 |a| / 2 + ..., and below all stands the rounding of the positions.
2. The derivatives of the motion are right too, see `derivative_limit`: at rest all coefficients vanish, but the derivatives
   of the flow do not.
3. Force and polynomial agree at the end of the step (`is_consistent`): a force that is about to begin, such as exp(50 (x - 1)),
   shows in no coefficient.
4. Functions of time alone that are not harmonic are bounded on a disc of complex times (`time_limit`): a pulse that is still far
   shows in no coefficient either.
5. Terms of positions and velocities that are no polynomials are bounded on a disc of complex times as well (`is_bounded`): a
   force in a narrow range of positions, which one step passes over, shows neither in a coefficient nor at the end of the step.
"""

from collections.abc import Callable
from functools import partial
from math import factorial, log2
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jax.arrays import Flag, Scalar, add_up, matvec
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .._series.motion_bound import motion_bound
from .._series.order_loop import added_by_halves
from .._series.plan import Plan
from .._series.series import force_at
from .._series.time_bound import has_time_bound, time_bound
from .branches import is_entering
from .force_series import ForceSeries, in_space, largest
from .orders import Orders, slope_of, value_of
from .shortening import MOST_HALVINGS, shortened

# Share of the step that the last coefficients allow.
_SHARE = 0.9
# Impulse of the contradiction at the end of a step, in tolerances: its mean over the step is far smaller, but not that of a power
# that begins. What such a power adds to the derivatives of the motion begins with a lower power of time, so it must be far smaller.
_SLACK, _OF_CLOSING = 1e3, 1e-7
# Radius of the disc on which functions of time are bounded, in lengths of the step.
_DISC = 6.0
# Radius of the disc on which the force along the motion is bounded, in lengths of the step, and its largest impulse there, relative to
# the motion in the step: terms beyond order P are below _LARGEST / _DISC_OF_MOTION^P.
_DISC_OF_MOTION, _LARGEST = 3.0, 1e3


def motion_limit(machine: Machine, x: Orders, tolerance: float) -> Scalar:
    """Rule 1: longest step for which the last two coefficients of the positions are below the tolerance."""
    eps = float(jnp.finfo(x[0].dtype).eps)
    return _limit_of_last(lambda k: _largest_of_masses(machine, x[k]), len(x) - 1, [eps, *[tolerance] * 3])


def _largest_of_masses(machine: Machine, a: Float[Array, "n ..."]) -> Scalar:
    """Largest magnitude over the masses: stretches of Jenkins elements follow these, and have other units."""
    return jnp.max(jnp.abs(a[: len(a) - machine.contacts.num_sliders]), axis=0)


def _limit_of_last(of: Callable[[int], Array], order: int, tolerances: list[float]) -> Scalar:
    """Longest step for which the last two terms up to an order are below one of the first, each times its tolerance."""
    bias = _BITS[str(of(0).dtype)][2]
    known = [(k, _log2(of(k)) + log2(least)) for k, least in enumerate(tolerances[: order - 1])]
    limits = []
    for k in (order - 1, order):
        last = _log2(of(k))
        room = largest([(allowed - last) * (1 / (k - j)) for j, allowed in known])
        limits.append(jnp.where(last <= 1 - bias, bias, room))
    return _SHARE * _exp2(jnp.minimum(*limits))


def derivative_limit(
    by_x: Any, by_v: Any, order: int, tolerance: float, *, has_powers: bool = False
) -> Scalar:
    """Rule 2: longest step for which the derivatives of the motion by its start are right.

    They obey w'' = K(t) w + D(t) w'. With k_m, d_m the largest row sums of the m-th coefficients, their own coefficients are
    below those of phi'' = k phi + d phi': one scalar recurrence for all directions and any number of masses, to which the
    rule of the last two coefficients applies. Where a power begins, steps are far shorter than the time scale of the machine: there
    the last coefficients of phi' must be small against its first ones too, or series are used beyond their radius of convergence.

    Args:
        by_x: k_m for every m, None where it is known to be zero; or an array, of one order if all others are.
        by_v: d_m likewise.
        order: number of orders.
        tolerance: bound of the last terms.
        has_powers: whether there are powers that begin.
    """
    rate = jnp.sqrt(by_x[0]) + by_v[0]
    later = (*by_x[1:], *by_v[1:]) if isinstance(by_x, list) else (*[0] * (len(by_x) + len(by_v) - 2),)
    if all(a is None for a in later):
        most = (tolerance * factorial(order)) ** (1 / order)
        return most / jnp.maximum(rate, _tiny(rate))
    neighbours: Any = _neighbours if isinstance(by_x, list) else _neighbours_by_loop
    phi = neighbours(by_x, by_v, rate, order)
    room = [(log2(tolerance) - _log2(phi[k])) * (1 / k) for k in (order - 1, order)]
    limit = _SHARE * _exp2(jnp.minimum(*room))
    if not has_powers:
        return limit
    return jnp.minimum(limit, _limit_of_last(lambda k: (k + 1) * phi[k + 1], order - 1, [tolerance] * 4))


def _neighbours(by_x: list[Any], by_v: list[Any], rate: Scalar, order: int) -> list[Scalar]:
    """Coefficients of phi."""
    zero = jnp.zeros_like(rate)
    phi, slope = [jnp.ones_like(rate), zero + rate], [zero + rate]
    for q in range(2, order + 1):
        total = zero
        for m in range(q - 1):
            for a, b in ((by_x[m], phi[q - 2 - m]), (by_v[m], slope[q - 2 - m])):
                total = total if a is None else total + a * b
        phi.append(total * (1 / (q * (q - 1))))
        slope.append(q * phi[q])
    return phi


def _neighbours_by_loop(
    by_x: Float[Array, " of_x"], by_v: Float[Array, " of_v"], rate: Scalar, order: int
) -> Float[Array, " orders"]:
    """`_neighbours` of arrays. Products of one sum stand beside each other, as in `Convolution`."""
    size = 1 << (order - 1).bit_length()
    sizes = jnp.stack([jnp.pad(a, (0, size - len(a))) for a in (by_x, by_v)], axis=1)

    def one(carry: tuple[Array, Scalar], now: tuple[Scalar, Scalar]) -> tuple[tuple[Array, Scalar], Scalar]:
        (ahead, before), (q, share) = carry, now
        phi = jnp.sum(added_by_halves(sizes * ahead)) * share
        return (jnp.concatenate([jnp.stack([before, q * phi])[None], ahead[:-1]]), phi), phi

    q = np.arange(2, order + 1)
    first = jnp.stack([jnp.ones_like(rate), rate])
    begin = jnp.pad(first[None], ((0, size - 1), (0, 0)))
    factors = jnp.asarray(q, rate.dtype), jnp.asarray(1 / (q * (q - 1)), rate.dtype)
    return jnp.concatenate([first, jax.lax.scan(one, (begin, rate), factors)[1]])


def time_limit(
    plan: Plan,
    machine: Machine,
    state: State,
    modes: tuple[Scalar, ...],
    limit: Scalar,
    order: int,
    tolerance: float,
) -> Scalar:
    """Rule 4: longest step, halved until functions of time alone are bounded on a disc of six times its length.

    What is bounded by M there has coefficients below M / (6 h)^k. It counts against the factor of the function, its amplitude: the
    machine may be at rest, without a scale.
    """
    if not has_time_bound(plan):
        return limit
    assert machine.extra is not None
    force, clock = machine.extra.force, machine.clock(state)
    most = 10 * tolerance * _DISC**order

    def is_bounded(limit: Scalar) -> Flag:
        return time_bound(plan, force, clock, _DISC * limit, like=state.x, modes=modes) <= most

    return shortened(limit, is_bounded, 1 / 2, MOST_HALVINGS)


def is_bounded(plan: Plan, machine: Machine, state: State, motion: ForceSeries, step: Scalar) -> Flag:
    """Rule 5: whether the force is bounded on a disc of three times the length of a step, so that nothing in it is unseen."""
    assert motion.series is not None
    radius = _DISC_OF_MOTION * step
    of_force, of_guards = motion_bound(plan, motion.series, radius, *_reach(machine, motion, radius), step)
    impulse = step * jnp.max(machine.contacts.inverse_mass_size(of_force), axis=0)
    speed = _largest_of_masses(machine, state.v) + step * _largest_of_masses(machine, 2 * motion.x[2])
    return (impulse <= _LARGEST * speed) & (of_guards <= _LARGEST)


def _reach(machine: Machine, motion: ForceSeries, radius: Scalar) -> tuple[Array, Array]:
    """Largest distances of positions and velocities in space from their values now, within a radius of complex times."""
    x, v, phase, order = motion.x, motion.v, motion.phase, len(motion.x) - 1
    if machine.frame is not None:
        space = [in_space(machine, phase[k], x[k], v[k]) for k in range(order + 1)]
        x, v = ([both[j] for both in space] for j in (0, 1))
    size = lambda a: radius * value_of(jax.tree.map(jnp.abs, a[1:]), radius)  # noqa: E731
    return size(x), size(v)


def _felt(machine: Machine, state: State, motion: ForceSeries) -> Array:
    """Change of the force if every position and velocity changed by itself; its rounding follows from theirs.

    At rest on an equilibrium the terms of a force cancel inside of it, as in sin(x) at pi: its own size tells nothing.
    """
    series, (x, v) = motion.series, in_space(machine, state.phase, state.x, state.v)
    rows = [jnp.zeros_like(a) for a in state.x]
    for entries, of in ((series.by_x(0), x), (series.by_v(0), v)):
        for (i, j), entry in entries.items():
            rows[i] = rows[i] + jnp.abs(entry * of[j])
    return jnp.stack(rows)


def _tiny(like: Array) -> float:
    return float(jnp.finfo(like.dtype).tiny)


# 64-bit numbers as whole numbers are their logarithms, to 0.09, in units of 2^-52.
_BITS = {"float64": (jnp.int64, 52, 1023), "float32": (jnp.int32, 23, 127)}


def _log2(a: Array) -> Array:
    """Logarithm of a positive number to 0.09, by its bits; about -1023 for 0."""
    whole, digits, bias = _BITS[str(a.dtype)]
    bits = jax.lax.bitcast_convert_type(a, whole).astype(a.dtype)
    return bits * 2.0**-digits - bias


def _exp2(a: Array) -> Array:
    """Inverse of `_log2`."""
    whole, digits, bias = _BITS[str(a.dtype)]
    most = jnp.clip(a, 1 - bias, bias) + bias
    return jax.lax.bitcast_convert_type((most * 2.0**digits).astype(whole), a.dtype)


def is_consistent(
    plan: Plan,
    machine: Machine,
    state: State,
    hold: Held,
    modes: tuple[Array, ...],
    motion: ForceSeries,
    step: Scalar,
    tolerance: float,
) -> Flag:
    """Rule 3: whether the force at the end of a step is that of the polynomial.

    A power of a branch that begins now, as the force of a Hertz contact that closes, is not in the polynomial at all: the step must
    be so short that its whole impulse is nothing.
    """
    assert machine.extra is not None
    x, v, phase = (value_of(a, step) for a in (motion.x, motion.v, motion.phase))
    own = force_at(
        plan, machine.extra.force, machine.clock(state) + step, *in_space(machine, phase, x, v), modes
    )
    load = machine.load(phase)
    terms = load, matvec(machine.damping, v), matvec(machine.stiffness, x), own, _felt(machine, state, motion)
    a = machine.contacts.accelerations(load - terms[1] - terms[2] + own, hold, phase)
    size = partial(_largest_of_masses, machine)
    defect = size(a - value_of(slope_of(motion.v), step))
    speed = size(jnp.maximum(jnp.abs(v), jnp.abs(state.v)))
    rounding = size(machine.contacts.inverse_mass_size(add_up([jnp.abs(term) for term in terms])))
    motion_size = tolerance * (speed + step * size(a))
    blur = 4 * float(jnp.finfo(x.dtype).eps) * step * rounding
    most = _SLACK * (motion_size + blur)
    if plan.has_closing_powers:
        most = jnp.where(is_entering(state.memory), _OF_CLOSING * motion_size + blur, most)
    return jnp.isfinite(defect) & (step * defect <= most)
