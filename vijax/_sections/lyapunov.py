"""Lyapunov exponents of a motion."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_float, as_numpy_float, in_full_precision, whole_number
from .._jax.concrete import is_traced
from .._jax.errors import checked, none_true, number_of_doubts
from .._jax.nan_mask import known_or_nan
from .._jax.xla import padding_allowed
from .._machine.numbers import numbers_of
from .._progress import says_what_compiles, tqdm
from .._system.checks import validate_start, whole_start
from .._system.periodicity import check_period
from .._system.system import AnySystem, machine_of, with_args
from .._trajectory.concrete_machine import known_machine
from .._trajectory.lyapunov_loop import (
    ExponentRequest,
    Growth,
    exponents,
    follow_growth,
    follow_some_growth,
    no_growth,
    result_of,
)
from .._trajectory.results import RESULTS, result_sentences
from .._trajectory.simulate import bound_of_steps

# Steps of one call, a second or less: between calls Ctrl-C works, and progress is shown.
_TURNS = 1 << 17


@says_what_compiles
@padding_allowed
def lyapunov_exponents(
    system: AnySystem,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    *,
    transient: Count = 100,
    num_periods: Count = 1000,
    args: object = None,
    flow: AbstractFlow | None = None,
    max_steps: Count | None = None,
    with_error: bool = False,
    throw: bool = True,
    progress: bool = True,
) -> Float[Array, " exponents"] | tuple[Float[Array, " exponents"], Float[Array, " exponents"]]:
    """Return all Lyapunov exponents of a motion: the mean growth rates of small perturbations of its state.

    A motion with a positive exponent is chaotic. On a periodic orbit the exponents are ln |mu| / (n T) of its
    multipliers. Impacts, chatter and release enter by the derivative of each step, exact to rounding. When a stop
    begins to hold a mass, two directions are lost, and by an impact with r = 0 one: their exponents are minus
    infinity, unless this was in the transient. Without either, the sum of the exponents of any motion is the rate of
    change of volume, -tr(M^-1 C) + sum over impacts of 2 ln r, per unit of time.

    Works under `jax.jit` and `jax.vmap`; for many machines `vx.sweep(..., lyapunov=True)` is faster.

    Args:
        system: the machine; its load must have a frequency, and its `force`, if it has one, the same period.
        x0: positions at phase 0 of the load, (n,); zero if left out.
        v0: velocities, likewise.
        transient: forcing periods in which the motion settles, and perturbations turn to the directions that grow.
        num_periods: forcing periods over which growth is averaged, 1 or more.
        args: as for `simulate`.
        flow: likewise.
        max_steps: likewise.
        with_error: return standard errors as well.
        throw: raise if the motion does not reach the end; otherwise the exponents are NaN.
        progress: show a progress bar if it takes longer than a second.

    Returns:
        The exponents per unit of time, the largest first, (2 n,). With `with_error` also their standard errors, from
        the scatter of 20 consecutive blocks of periods; 0 for minus infinity, and NaN if there is only one period.
        Blocks much shorter than the correlation time of the motion make them too small.

    Raises:
        ValueError: if the load has no frequency, the `force` does not have the period of the load, or the start lies
            beyond a stop.
        RuntimeError: with `throw`, if the motion does not reach the end, see `RESULTS`.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_b(2.0)
        exponents, error = vx.lyapunov_exponents(system, [0.0, 0.0], [0.0, 0.1], with_error=True)
        ```

    References:
        G. Benettin et al., Meccanica 15 (1980); P. C. Mueller, Chaos, Solitons & Fractals 5 (1995), for jumps.
    """
    system = machine_of(in_full_precision(system))
    n = system.num_masses
    x, v = (np.zeros(n) if a is None else a for a in (x0, v0))
    bound = with_args(system, args)
    check_period(bound, x, v)
    settling, averaged = whole_number("transient", transient), whole_number("num_periods", num_periods, 1)
    is_known = not is_traced((system, args, flow, x, v, max_steps))
    x, v = ((as_numpy_float if is_known else as_float)(a) for a in (x, v))
    x, v = whole_start(bound, x, v)
    zero = np.zeros((), x.dtype)
    doubts = validate_start(bound, zero, zero, zero[None], x, v)
    counts = np.asarray(settling), np.asarray(averaged)
    request = ExponentRequest(x, v, *counts, max_steps=bound_of_steps(max_steps), is_sound=none_true(doubts))
    if is_known:
        known = known_machine(system, args)
        growth, is_left = _follow_known(known.numbers, known.flow(flow, can_stick=True), request, progress)
    else:
        motion = choose_flow(bound, can_stick=True, wanted=flow)
        growth, is_left = follow_growth(numbers_of(bound), motion, request)
    result = result_of(growth, request, is_left)
    found = exponents(growth.totals, averaged, system.forcing.period)
    if throw:
        found = checked(found, *number_of_doubts(doubts, *result_sentences(result)))
    else:
        found = known_or_nan(result == RESULTS.successful, found)
    return found if with_error else found[0]


def _follow_known(
    numbers: Any, flow: AbstractFlow, request: ExponentRequest, progress: bool
) -> tuple[Growth, Array]:
    """Follow a motion of concrete numbers, one call after another."""
    growth = no_growth(numbers, flow)
    total, most = int(request.transient + request.num_periods), np.asarray(_TURNS)
    with tqdm(total=total, unit="period", disable=not progress, delay=1) as bar:
        while True:
            before = int(growth.steps)
            growth, is_left = follow_some_growth(numbers, flow, request, growth, most)
            bar.update(int(growth.state.periods) - bar.n)
            if not is_left or int(growth.steps) < before + _TURNS:
                return growth, is_left
