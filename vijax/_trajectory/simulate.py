"""Simulation of one trajectory."""

import warnings
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, ArrayLike

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._hybrid.sticking import can_any_stick
from .._jax.arrays import Count, Numbers, as_float, as_numpy_float, whole_number
from .._jax.concrete import check_values, concrete, evaluate_eagerly, is_traced
from .._jax.errors import checked, none_true, number_of_doubts
from .._jax.users_line import users_line
from .._jax.xla import padding_allowed
from .._machine.numbers import base_of, numbers_of
from .._machine.preparation import AUTOMATIC_MAX_STEPS
from .._progress import says_what_compiles
from .._system.checks import validate_start
from .._system.system import AnySystem, ImpactSystem, machine_of, with_args
from .chunked import MOST_EVENTS, follow_known
from .concrete_machine import known_machine, remembered
from .loop import UNLIMITED_STEPS, Choices, LoopArguments
from .one_call import EVENTS
from .results import RESULTS, result_sentences
from .single_call import run_single_call
from .solution import Solution
from .unfelt_force import warn_of_unfelt_force


@says_what_compiles
@padding_allowed
def simulate(
    system: AnySystem,
    t0: ArrayLike,
    t1: ArrayLike,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    *,
    ts: Numbers | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_events: Count | None = None,
    max_steps: Count | None = None,
    max_reverse_steps: Count | None = None,
    throw: bool = True,
) -> Solution:
    """Follow one trajectory from t0 to t1, through every impact, chatter, stick and release.

    Between events the motion of a linear machine is exact to rounding, and every step is proved free of impacts, so no
    impact is missed however light. Works under `jax.jit` and `jax.vmap`.

    Derivatives, forward and reverse, go through every event. Where the sequence of events is about to change, above
    all at a grazing impact, they are one-sided, those of the sequence that happened: `Solution.grazing` says how
    close that was. They are faster if mass, damping and stiffness are not differentiated. If they grow to 1e20 and
    more, over a long chaotic span, a warning is issued once; under `jax.jit` only with `throw`.

    Args:
        system: the machine.
        t0: start time.
        t1: end time, not before t0.
        x0: positions at t0, (n,); zero if left out. May lie on a stop.
        v0: velocities at t0, (n,); zero if left out.
        ts: times at which to save the state, in increasing order; t1 if left out.
        flow: the motion between events; if left out, exact for a linear machine, `vx.TaylorFlow()` for one with a
            `force`.
        args: passed to the `force` of the machine: numbers and arrays in any nesting.
        max_events: length of the event log. If left out, 1024 or as many as the motion has, up to a million; always 1024
            under `jax.jit` and other transformations, where the shapes of results are known before.
        max_steps: bound on the number of steps. If left out, far more than a sound motion takes: 100 000, plus 100 per
            unit of (t1 - t0) * (highest frequency or decay rate).
        max_reverse_steps: without effect, deprecated: derivatives have no bound on the steps.
        throw: raise if the result is not `successful`, whichever part of it is used, under `jax.jit` too; otherwise
            return the code.

    Returns:
        The trajectory, see `vx.Solution`.

    Raises:
        ValueError: for shapes that do not fit, a start beyond a stop, t1 < t0, ts out of order, or numbers that are not
            finite. For traced values a RuntimeError instead, or without `throw` the code `unsound_start`.
        RuntimeError: with `throw`, for every result but `successful`.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)
        impacts = sol.events.t[sol.events.kind == vx.IMPACT]
        ```

    References:
        Wagg & Bishop (2004), Sec. 3.
    """
    warn_about_reverse_steps(max_reverse_steps)
    settings = Settings(max_events, max_steps, () if throw else None)
    sol = simulate_with(system, t0, t1, x0, v0, settings, ts=ts, flow=flow, args=args).of_masses
    return _with_base(sol, machine_of(system))


def simulate_all(
    system: AnySystem,
    t0: ArrayLike,
    t1: ArrayLike,
    x0: Numbers,
    v0: Numbers,
    *,
    ts: Numbers | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_events: Count | None = None,
    throw: bool = True,
) -> Solution:
    """`simulate` with positions and velocities of all coordinates, those of Jenkins elements last."""
    settings = Settings(max_events, None, () if throw else None)
    return simulate_with(system, t0, t1, x0, v0, settings, ts=ts, flow=flow, args=args)


class Settings(NamedTuple):
    """Settings of a trajectory, see `simulate`.

    Attributes:
        allowed: results that do not raise, besides `successful`; None for all.
    """

    max_events: Count | None
    max_steps: Count | None
    allowed: tuple[RESULTS, ...] | None


def simulate_with(
    system: AnySystem,
    t0: ArrayLike,
    t1: ArrayLike,
    x0: Numbers | None,
    v0: Numbers | None,
    settings: Settings,
    *,
    ts: Numbers | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
) -> Solution:
    """`simulate` with its options as `Settings`; positions and velocities are those of all coordinates."""
    max_steps, own = bound_of_steps(settings.max_steps), machine_of(system)
    known, given = remembered(own, args), (flow, [t0, t1, ts, x0, v0], max_steps)
    if is_traced(given if known else (own, args, given)):
        convert, known, own = as_float, None, with_args(own, args)
        own = jax.tree.map(evaluate_eagerly(lambda a: a.astype(own.mass.dtype)), own)
    else:
        convert, known = as_numpy_float, known or known_machine(own, args)
        own = known.system
    max_events = _room_of_log(settings.max_events, is_known=known is not None)
    zeros = np.zeros(own.num_masses)
    begin, end = convert(t0, "t0"), convert(t1, "t1")
    times = end[None] if ts is None else convert(ts, "ts")
    x, v = (convert(zeros if a is None else a, name) for name, a in (("x0", x0), ("v0", v0)))
    for name, value in (("x0", x), ("v0", v)):
        if value.shape != zeros.shape and value.shape != (own.num_coordinates,):
            raise ValueError(f"Argument `{name}` must have shape {zeros.shape}, but has shape {value.shape}.")
    if own.hysteresis:
        x, v = own.start_of(x, v)
    if times.ndim != 1:
        raise ValueError(f"Argument `ts` must have shape (times,), but has shape {times.shape}.")
    if known and ts is None and known.admits(begin, end, x, v):
        doubts = []
    else:
        start = own, begin, end, times, x, v
        doubts = validate_start(*(start if known else check_values(start)))
    can_stick = (known is not None and known.can_always_stick) or can_any_stick(own, x, v)
    request = LoopArguments(
        t0=begin,
        t1=end,
        x0=x,
        v0=v,
        goals=times,
        num_goals=np.asarray(times.size),
        is_last=np.asarray(True),
        max_steps=max_steps,
        max_events=np.asarray(max_events),
        max_turns=np.asarray(UNLIMITED_STEPS),
        is_sound=none_true(doubts),
    )
    if known:
        solution = follow_known(known.packed(flow, can_stick=can_stick), request)
        warn_of_unfelt_force(own, (begin, end), (x, v), solution)
    else:
        # Whether stops move alike is decided here: to the derivatives no number is known.
        has_motions = any(stop.motion is not None for stop in own.stops)
        solution = run_single_call(
            numbers_of(own) if has_motions else own,
            choose_flow(own, can_stick=can_stick, wanted=flow),
            request,
            Choices(can_stick, max_events, raises=settings.allowed is not None),
        )
    if settings.allowed is None or (known and not np.asarray(solution.result._value)):
        return solution  # the first result is `successful`
    return checked(solution, *number_of_doubts(doubts, *result_sentences(solution.result, settings.allowed)))


def _with_base(sol: Solution, system: ImpactSystem) -> Solution:
    """A trajectory that knows which part of its load a moving base makes: the prepared machine has their sum alone."""
    if not any(load.from_base for load in system.forcing.loads):
        return sol
    return eqx.tree_at(lambda one: one.base, sol, base_of(system), is_leaf=lambda leaf: leaf is None)


def _room_of_log(max_events: Count | None, *, is_known: bool) -> int:
    """Most events that are logged: where the numbers are known, a log grows with the motion."""
    if max_events is None:
        return MOST_EVENTS if is_known else EVENTS
    return whole_number("max_events", max_events)


def warn_about_reverse_steps(max_reverse_steps: Count | None) -> None:
    """Warn of an argument that has no effect any more."""
    if max_reverse_steps is None:
        return
    whole_number("max_reverse_steps", max_reverse_steps, 1)
    warnings.warn(
        "Argument `max_reverse_steps` has no effect any more, and will go: derivatives have no bound on the steps. Leave it "
        "out.",
        DeprecationWarning,
        stacklevel=users_line(),
    )


def bound_of_steps(max_steps: Any) -> Array | np.ndarray:
    """Bound on steps in the form that the loops take; may be traced."""
    if max_steps is None:
        return np.asarray(AUTOMATIC_MAX_STEPS)
    is_known = concrete(max_steps) is not None
    return np.asarray(whole_number("max_steps", max_steps)) if is_known else max_steps
