"""The impact map: from one impact with a stop to the next."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_float, whole_number
from .._jax.concrete import concrete, is_traced
from .._jax.errors import checked, none_true, number_of_doubts
from .._jax.nan_mask import known_or_nan
from .._jax.xla import padding_allowed
from .._machine.numbers import numbers_of
from .._system.checks import check_shape, refuse, validate_start, whole_start
from .._system.system import AnySystem, ImpactSystem, machine_of, with_args
from .._trajectory.concrete_machine import known_machine
from .._trajectory.impact_loop import ImpactRequest, follow_to_impact
from .._trajectory.results import RESULTS, result_sentences
from .._trajectory.simulate import bound_of_steps, warn_about_reverse_steps
from .maps import wrong_stop

# Forcing periods after which to give up.
_PERIODS = 1000
_NONE = (
    "The motion comes to no such impact before `t1`: it no longer reaches the stop, or is held by it. Look at it "
    "with `vx.simulate`, or give it more time by a later `t1`."
)


@padding_allowed
def next_impact(
    system: AnySystem,
    t0: ArrayLike,
    x0: Numbers,
    v0: Numbers,
    stop: Count,
    num_impacts: Count = 1,
    *,
    t1: ArrayLike | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_steps: Count | None = None,
    max_reverse_steps: Count | None = None,
    throw: bool = True,
) -> tuple[Float[Array, ""], Float[Array, " n"], Float[Array, " n"]]:
    """Return time and state just before the next impact with a stop, as a differentiable function.

    From one such impact to the next it is the impact map: the Poincare map of the section in which the mass meets the
    stop. Its coordinates are the time, the velocity of that mass, and the state of the others. Its result is a valid
    start. Its Jacobian has one column of zeros, for the position of the mass, which is that of the stop. On a
    periodic orbit its other eigenvalues are the Floquet multipliers, as those of `monodromy_matrix` are.

    Impacts with other stops, chatter, sticking and release are followed as in `simulate`, and derivatives go through
    them, as through the time of the impact itself. As there, derivatives are one-sided where the sequence of events is
    about to change: where an impact grazes. Of the infinitely many impacts of a complete chatter those count that
    `vx.simulate` logs; the one after the last of them follows the release.

    Args:
        system: the machine.
        t0: time of the start.
        x0: positions, (n,). On the stop, or anywhere: then it is the first impact after a start in flight.
        v0: velocities, (n,). If the mass moves into the stop, the impact at t0 comes first and does not count; if it
            moves out, that impact has already happened.
        stop: index of the stop.
        num_impacts: 1 for the next impact with it, 2 for the one after that, ...
        t1: time at which to give up; 1000 forcing periods after t0, if left out.
        flow: as for `simulate`.
        args: likewise.
        max_steps: likewise.
        max_reverse_steps: likewise.
        throw: raise if there is no such impact; otherwise time, state and their derivatives are NaN. Such a lane of a
            batch does not change the other lanes.

    Returns:
        Time, positions, (n,), and velocities just before the impact, (n,); with Jenkins elements those of their sliders behind them.

    Raises:
        ValueError: if there is no such stop, no `t1` for a load without a frequency, or the start is wrong, see
            `simulate`.
        RuntimeError: with `throw`, if there is no such impact until t1, or the motion ends before, see `RESULTS`.

    Example:
        ```python
        import vijax as vx
        ball = vx.models.bouncing_ball(0.8, gravity=10.0)
        t, x, v = vx.next_impact(ball, 0.0, [0.0], [-5.0], stop=0)  # 0.8 s later, at -4 m/s
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2; S. Foale & S. R. Bishop, Phil. Trans. R. Soc. A 338 (1992).
    """
    system = machine_of(system)
    bound = with_args(system, args)
    warn_about_reverse_steps(max_reverse_steps)
    begin, x, v = (as_float(a) for a in (t0, x0, v0))
    x, v = whole_start(bound, x, v)
    end = default_end_time(bound, begin) if t1 is None else as_float(t1)
    for name, value in (("t0", begin), ("t1", end)):
        check_shape(name, value, ())
    doubts = refuse([wrong_stop(bound, stop)])
    doubts += validate_start(bound, begin, end, end[None], x, v)
    wanted = ImpactRequest(
        t0=begin,
        t1=end,
        x0=x,
        v0=v,
        stop=jnp.asarray(stop),
        num_impacts=np.asarray(whole_number("num_impacts", num_impacts, 1)),
        max_steps=bound_of_steps(max_steps),
        is_sound=none_true(doubts),
    )
    if is_traced((bound, flow, wanted)):
        numbers, motion = numbers_of(bound), choose_flow(bound, can_stick=True, wanted=flow)
    else:
        known = known_machine(system, args)
        numbers, motion = known.numbers, known.flow(flow, can_stick=True)
    found = follow_to_impact(numbers, motion, wanted)
    impact = found.t, found.x, found.v
    if not throw:
        return known_or_nan(found.is_there, impact)
    is_late = ~found.is_there & (found.result == RESULTS.successful)
    return checked(impact, *number_of_doubts([*doubts, (is_late, _NONE)], *result_sentences(found.result)))


def default_end_time(system: ImpactSystem, t0: Array) -> Array:
    """The time at which to give up by default."""
    frequency = system.forcing.frequency
    known = concrete(frequency)
    if known is not None and not known > 0:
        raise ValueError("The load has no frequency: say by `t1` how long to wait for the impact.")
    return t0 + _PERIODS * system.forcing.period
