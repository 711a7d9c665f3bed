"""Search for a periodic orbit near a guess."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, array_namespace, as_float, refuse_single_precision, whole_number
from .._jax.concrete import check_values, has_tracer, is_traced
from .._jax.errors import checked, number_of_doubts, warn_when_run
from .._jax.xla import padding_allowed
from .._machine.numbers import numbers_of
from .._progress import says_what_compiles
from .._system.checks import validate_start, whole_start
from .._system.periodicity import check_period
from .._system.system import AnySystem, with_args
from .._trajectory.concrete_machine import known_machine
from .._trajectory.results import result_sentences
from .autonomous import autonomous_orbit, is_undriven
from .find import find
from .maps import angle_of
from .orbit import PeriodicOrbit
from .search import StroboscopicMap

_NO_ORBIT = (
    "`vx.periodic_orbit` goes on, as `throw=False`, but what is computed from this orbit, such as a loss, is NaN or that of no motion. "
    "Where an optimiser has left the orbit, halve its step until `orbit.result` is successful again."
)


@says_what_compiles
@padding_allowed
def periodic_orbit(
    system: AnySystem,
    x0: Numbers,
    v0: Numbers,
    num_periods: Count = 1,
    *,
    phase: ArrayLike = 0.0,
    args: object = None,
    flow: AbstractFlow | None = None,
    max_events: Count = 256,
    throw: bool = True,
) -> PeriodicOrbit:
    """Find the periodic orbit near a guess, stable or not.

    The motion is simulated from the guess, and Newton's method is applied to the equations of the events that it
    shows: impacts, complete chatter, sticking, release, or none. The cycle that it finds is simulated in turn; it is
    an orbit if the same events happen. Where no spring and no contact resists a shift of the masses, the orbit has the
    shift of the guess.

    Where the load has no frequency the machine sets its own pace: a clock, a mass on a belt. The cycle that the motion from
    the guess first repeats is found with its period; it begins in the middle of a flight, `num_periods` is 0, and one of its
    multipliers is 1. This search runs outside of `jax.jit`.

    Works under `jax.jit` and `jax.vmap`. Derivatives of the orbit, its events and its multipliers by all numbers of the
    machine, forward and reverse, come from the implicit function theorem; there are none by the guess.

    Args:
        system: the machine; its `force`, if it has one, must have the period of the load.
        x0: positions of the guess, (n,).
        v0: velocities, (n,).
        num_periods: n, the forcing periods after which the orbit repeats. One that repeats sooner counts as well. Without
            forcing it has no meaning, nor has `phase`.
        phase: phase W t of the load where the orbit begins, in radians.
        args: as for `simulate`.
        flow: likewise.
        max_events: maximum number of events of a cycle.
        throw: raise if no orbit is found; otherwise return the result code and the nearest candidate, with a warning under
            `jax.jit`, `jax.vmap` and derivatives.

    Returns:
        The orbit, see `vx.PeriodicOrbit`.

    Raises:
        ValueError: if the guess lies beyond a stop, 64-bit numbers are off, or a machine without forcing has a `force`, moving
            stops, or is traced by `jax.jit`.
        RuntimeError: with `throw`, for every result but `successful`.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.wagg_bishop_a(0.8)
        sol = vx.simulate(system, 0.0, 50 * system.forcing.period)
        orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
        orbit.multipliers
        ```

    References:
        Wagg & Bishop (2004), Sec. 4.4; S. Foale & S. R. Bishop, Phil. Trans. R. Soc. A 338 (1992).
    """
    refuse_single_precision("periodic_orbit", system)
    n = whole_number("num_periods", num_periods, 1)
    room = whole_number("max_events", max_events, 1)
    x, v = as_float(x0), as_float(v0)
    bound = with_args(system, args)
    x, v = whole_start(bound, x, v)
    if is_undriven(bound):
        found, period = autonomous_orbit(bound, (x, v), flow, room)
        orbit = PeriodicOrbit(
            **vars(found), system=system, num_periods=0, period=period, phase=0 * period, args=args, flow=flow
        )
        return _told(orbit, [], throw=throw)
    check_period(bound, x, v)
    angle, frequency, period = angle_of(phase), bound.forcing.frequency, bound.forcing.period
    is_unknown = is_traced((bound, flow, x, v, angle))
    if not is_unknown:  # each operation on JAX's arrays would be a program
        x, v, angle, frequency, period = map(np.asarray, (x, v, angle, frequency, period))
    t0 = angle / frequency
    t1 = t0 + n * period
    known = None if is_unknown else known_machine(system, args)
    is_sound = known is not None and known.admits(t0, t1, x, v)
    doubts = [] if is_sound else validate_start(*check_values((bound, t0, t1, t1[None], x, v)))
    if known is None:
        numbers, motion, machine = numbers_of(bound), choose_flow(bound, can_stick=True, wanted=flow), None
    else:
        numbers, motion = known.numbers, known.flow(flow, can_stick=True)
        machine = known.packed(flow, can_stick=True)
    library = array_namespace(x, v, angle)
    strobe = StroboscopicMap(numbers, motion, library.asarray(float(n)), angle / (2 * np.pi), room)
    found = find(strobe, library.concatenate([x, v]), machine)
    period, angle = jnp.asarray(n * period), jnp.asarray(angle)
    orbit = PeriodicOrbit(
        **vars(found), system=system, num_periods=n, period=period, phase=angle, args=args, flow=flow
    )
    return _told(orbit, doubts, throw=throw)


def _told(orbit: PeriodicOrbit, doubts: Sequence[tuple[Any, str]], *, throw: bool) -> PeriodicOrbit:
    """The orbit, with an error or a warning if it is none."""
    number, sentences = number_of_doubts(doubts, *result_sentences(orbit.result))
    if throw:
        return checked(orbit, number, sentences)
    if has_tracer(orbit):  # nobody looks at its result
        warn_when_run(number, [f"{sentence} {_NO_ORBIT}" for sentence in sentences])
    return orbit
