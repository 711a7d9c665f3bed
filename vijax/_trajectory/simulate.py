"""One trajectory."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._contact.sticking import can_any_stick
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._machine.machine import Machine, ample_steps, in_periods, prepare
from .._machine.state import State, start_period
from .._refusal import checked, lock
from .._system.checks import validate_start
from .._system.system import ImpactSystem, with_args
from .._types import Count, Numbers, Scalar, as_float, at_once, concrete, whole_number
from .._xla import AbstractTask, compile_lightly, padding_allowed, while_any
from .event_log import Log, empty_log, event_log, write
from .grazing import Grazing, nothing_met, update_grazing
from .solution import RESULTS, Solution, told
from .step import advance, begin


@padding_allowed
def simulate(
    system: ImpactSystem,
    t0: ArrayLike,
    t1: ArrayLike,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    *,
    ts: Numbers | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_events: Count = 1024,
    max_steps: Count | None = None,
    max_reverse_steps: Count = 65_536,
    throw: bool = True,
) -> Solution:
    """Follow one trajectory from t0 to t1, through every impact, chatter, stick and release.

    Between events the motion of a linear machine is exact to rounding, and every step is proved free of
    impacts, so none is missed however light. Works under `jax.jit` and `jax.vmap`.

    Derivatives, forward and reverse, go through every event. Where the sequence of events is about to
    change, at a grazing impact above all, they are one-sided, those of the sequence that happened:
    `Solution.grazing` tells how close that was. They are taken faster where mass, damping and
    stiffness are not among what is differentiated.

    Args:
        system: the machine.
        t0: start time.
        t1: end time, not before t0.
        x0: positions at t0, (n,); zero if left out. May lie on a stop.
        v0: velocities at t0, (n,); zero if left out.
        ts: times at which to save the state, in increasing order; t1 if left out.
        flow: the motion between events. If left out, exact for a linear machine, and `vx.DiffraxFlow()` for
            one with a `force`.
        args: passed to the `force` of the machine: numbers and arrays in any nesting.
        max_events: length of the event log.
        max_steps: bound on the number of steps. If left out, far more than any sound motion
            takes: 100 000, and 100 per unit of (t1 - t0) * (highest frequency or decay rate).
        max_reverse_steps: the most steps that derivatives in reverse mode (`jax.grad`, `jax.jacrev`) go
            back through; memory grows with its logarithm. Forward mode (`jax.jacfwd`) has no such limit.
        throw: raise if the result is not `successful`, whatever of it is asked for, under `jax.jit` too;
            otherwise return the code. Derivatives in reverse mode of a motion of more than `max_reverse_steps`
            raise too, and are NaN without `throw`.

    Returns:
        The trajectory, see `vx.Solution`.

    Raises:
        ValueError: for shapes that do not fit, a start beyond a stop, t1 < t0, ts out of order, or numbers
            that are not finite. While values are traced a RuntimeError instead, or without `throw` the
            code `unsound_start`.
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
    settings = Settings(max_events, max_steps, max_reverse_steps, () if throw else None)
    return follow(system, t0, t1, x0, v0, settings, ts=ts, flow=flow, args=args)


class Settings(NamedTuple):
    """How a trajectory is followed: see `simulate`.

    Attributes:
        allowed: the results that are not raised beside `successful`; None for all.
    """

    max_events: Count
    max_steps: Count | None
    max_reverse_steps: Count
    allowed: tuple[RESULTS, ...] | None


def follow(
    system: ImpactSystem,
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
    """`simulate` with its knobs as `Settings`."""
    n, system = system.num_masses, with_args(system, args)
    begin, end = as_float(t0), as_float(t1)
    times = end[None] if ts is None else as_float(ts)
    x, v = (jnp.zeros(n) if a is None else as_float(a) for a in (x0, v0))
    for name, value in (("x0", x), ("v0", v)):
        if value.shape != (n,):
            raise ValueError(f"Argument `{name}` must have shape ({n},), but has shape {value.shape}.")
    if times.ndim != 1:
        raise ValueError(f"Argument `ts` must have shape (times,), but has shape {times.shape}.")
    values = (system, begin, end, times, x, v)
    dtype = jnp.result_type(*jax.tree.leaves(values))
    system, begin, end, times, x, v = jax.tree.map(at_once(lambda a: a.astype(dtype)), values)
    doubts = validate_start(system, begin, end, times, x, v)
    can_stick = can_any_stick(system, x, v)
    solution = _run(
        system,
        begin,
        end,
        times,
        x,
        v,
        choose_flow(system, can_stick=can_stick, wanted=flow),
        _bound_of_steps(settings.max_steps),
        ~jnp.any(jnp.stack([is_wrong for is_wrong, _ in doubts])) if doubts else jnp.array(True),
        max_events=whole_number("max_events", settings.max_events),
        max_reverse_steps=whole_number("max_reverse_steps", settings.max_reverse_steps, 1),
        raises=settings.allowed is not None,
        can_stick=can_stick,
    )
    if settings.allowed is None:
        return solution
    number, sentences = told(solution.result, settings.allowed)
    for is_wrong, sentence in doubts[::-1]:
        number = jnp.where(is_wrong, len(sentences), number)
        sentences.append(sentence)
    return checked(solution, number, sentences)


def _bound_of_steps(max_steps: Any) -> Array | None:
    if max_steps is None or concrete(max_steps) is None:
        return max_steps
    return jnp.asarray(whole_number("max_steps", max_steps))


class _Task(AbstractTask):
    """The loop body and all that it depends on, so that derivatives see it."""

    flow: AbstractFlow
    machine: Machine
    t0: Scalar
    phase0: Float[Array, "2 harmonics"]
    goal_periods: Int[Array, " goals"]
    goal_times: Float[Array, " goals"]
    resolution: Scalar
    max_steps: Int[Array, ""]

    def is_live(self, carry: "_Carry") -> Bool[Array, ""]:
        """Whether there is anything left to do."""
        is_on = carry.is_finite & (carry.steps < self.max_steps)
        return is_on & (carry.goal < self.goal_times.size)

    def step(self, carry: "_Carry") -> "_Carry":
        """One step of the motion, its events logged and its state saved where asked for."""
        state, live = carry.state, self.is_live(carry)
        goal = jnp.minimum(carry.goal, self.goal_times.size - 1)
        is_last_period = state.periods >= self.goal_periods[goal]
        target = jnp.where(is_last_period, self.goal_times[goal], self.machine.period)
        after, instant = advance(self.flow, self.machine, state, target, self.resolution)
        is_saved = live & instant.arrived & is_last_period
        slot = jnp.where(is_saved, carry.goal, self.goal_times.size)
        is_finite = jnp.all(jnp.isfinite(after.x + after.v)) & jnp.isfinite(after.time)
        grazing = update_grazing(self.machine, state, after, instant, carry.grazing)
        after = start_period(after, self.phase0, instant.arrived & ~is_last_period)
        x, v = self.machine.in_space(after)
        time = self.t0 + state.periods * self.machine.period + instant.time
        return _Carry(
            state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
            log=write(carry.log, after, instant, time, live),
            xs=carry.xs.at[slot].set(x, mode="drop"),
            vs=carry.vs.at[slot].set(v, mode="drop"),
            goal=carry.goal + is_saved,
            steps=carry.steps + live,
            is_finite=is_finite | ~live,
            grazing=jax.tree.map(lambda new, old: jnp.where(live, new, old), grazing, carry.grazing),
        )


class _Carry(eqx.Module):
    """Carry of the loop."""

    state: State
    log: Log
    xs: Float[Array, "goals n"]
    vs: Float[Array, "goals n"]
    goal: Int[Array, ""]
    steps: Int[Array, ""]
    is_finite: Bool[Array, ""]
    grazing: Grazing


@compile_lightly
def _run(
    system: ImpactSystem,
    t0: Scalar,
    t1: Scalar,
    ts: Float[Array, " times"],
    x0: Float[Array, " n"],
    v0: Float[Array, " n"],
    flow: AbstractFlow,
    max_steps: Int[Array, ""] | None,
    is_sound: Bool[Array, ""],
    *,
    max_events: int,
    max_reverse_steps: int,
    raises: bool,
    can_stick: bool,
) -> Solution:
    span = t1 - t0
    machine = prepare(system, jnp.where(span > 0, span, 1), (t0, x0, v0), can_stick=can_stick)
    flow = flow.prepare(machine)
    if max_steps is None:
        max_steps = ample_steps(machine, span)
    phase0 = machine.phase_at(t0)
    goal_periods, goal_times = in_periods(machine, jnp.append(ts, t1) - t0)
    resolution = 4 * jnp.finfo(t0.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1))

    task = _Task(
        flow=flow,
        machine=machine,
        t0=t0,
        phase0=phase0,
        goal_periods=goal_periods,
        goal_times=goal_times,
        resolution=resolution,
        max_steps=jnp.asarray(max_steps),
    )
    first = begin(flow, machine, phase0, x0, v0, t0)
    room = jnp.zeros((goal_times.size, x0.size), x0.dtype)
    carry = _Carry(
        state=first,
        log=empty_log(first, t0, max_events),
        xs=room,
        vs=room,
        goal=jnp.array(0),
        steps=jnp.array(0),
        is_finite=is_sound,
        grazing=nothing_met(t0),
    )
    refuse = partial(_factor_in_reverse, raises=raises)
    last = while_any(task, carry, max_reverse_steps=max_reverse_steps, refuse=refuse)
    return _finish(task, last, ts, t1, is_sound, max_events)


def _factor_in_reverse(is_cut: Bool[Array, ""], *, raises: bool) -> Scalar:
    """Factor of reverse-mode derivatives: 1, or NaN or an error if the loop back was too short."""
    factor = jnp.where(is_cut, jnp.nan, 1.0)
    if raises:
        number, sentences = told(RESULTS.where(is_cut, RESULTS.max_reverse_steps_reached, RESULTS.successful))
        factor = factor * lock(number, sentences)
    return factor


def _finish(
    task: _Task,
    last: _Carry,
    ts: Float[Array, " times"],
    t1: Scalar,
    is_sound: Bool[Array, ""],
    max_events: int,
) -> Solution:
    machine, t0 = task.machine, task.t0
    state, log = last.state, last.log
    is_reached = (jnp.arange(ts.size) < last.goal)[:, None]
    is_done = last.goal > ts.size
    is_full = log.num_events > max_events
    result = RESULTS.where(is_full, RESULTS.max_events_reached, RESULTS.successful)
    result = RESULTS.where(is_done, result, RESULTS.max_steps_reached)
    result = RESULTS.where(last.is_finite, result, RESULTS.non_finite)
    result = RESULTS.where(is_sound, result, RESULTS.unsound_start)
    x1, v1 = machine.in_space(state)
    time = t0 + state.periods * machine.period + state.time
    last_row = log.restarts.t[jnp.minimum(log.rows, max_events + 1) - 1]
    return Solution(
        ts=ts,
        xs=jnp.where(is_reached, last.xs[:-1], x1),
        vs=jnp.where(is_reached, last.vs[:-1], v1),
        x1=x1,
        v1=v1,
        stuck1=state.held,
        events=event_log(machine, log, max_events),
        num_events=jnp.minimum(log.num_events, max_events),
        num_steps=last.steps,
        num_rejected=task.flow.num_rejected(state.memory),
        grazing=last.grazing,
        result=result,
        t0=t0,
        t1=t1,
        machine=machine,
        flow=task.flow,
        restarts=log.restarts,
        max_steps=task.max_steps,
        known_until=jnp.where(is_full, last_row, jnp.where(is_done, t1, time)),
    )
