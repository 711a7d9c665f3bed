"""One trajectory."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ._advance import Instant, advance
from ._contact.start import first_state, is_touching
from ._machine import Machine, State, prepare
from ._motion.flow import AbstractFlow
from ._motion.choose import choose_flow
from ._solution import IMPACT, RELEASE, RESULTS, STICK, EventLog, Restarts, Solution
from ._system.system import ImpactSystem
from ._types import Flag, Scalar, as_float, concrete
from ._xla import while_any


def simulate(
    system: ImpactSystem,
    t0: ArrayLike,
    t1: ArrayLike,
    x0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    *,
    ts: ArrayLike | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_events: int = 1024,
    max_steps: int | None = None,
    throw: bool = True,
) -> Solution:
    """Follow one trajectory from t0 to t1, through every impact, chatter, stick and release.

    Between events the motion is exact to rounding, and every step is proved free of impacts, so
    none is missed however light. Works under `jax.jit` and `jax.vmap`.

    Args:
        system: the machine.
        t0: start time.
        t1: end time, not before t0.
        x0: positions at t0, (n,); zero if left out. May lie on a stop.
        v0: velocities at t0, (n,); zero if left out.
        ts: times at which to save the state, in increasing order; t1 if left out.
        flow: the motion between events; `TaylorFlow()`, exact for linear machines, if left out.
        args: passed to the forces of the machine; linear machines have none that take it.
        max_events: length of the event log.
        max_steps: bound on the number of steps. If left out, far more than any sound motion
            takes: 100 000, and 100 per unit of (t1 - t0) * (highest frequency or decay rate).
        throw: raise if the result is not `successful`; otherwise return the code.

    Returns:
        The trajectory, see `vx.Solution`.

    Raises:
        ValueError: for shapes that do not fit, a start beyond a stop, t1 < t0, or ts out of order.
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
    del args
    n = system.num_masses
    t0, t1 = as_float(t0), as_float(t1)
    ts = t1[None] if ts is None else as_float(jnp.asarray(ts))
    x0 = jnp.zeros(n) if x0 is None else as_float(jnp.asarray(x0))
    v0 = jnp.zeros(n) if v0 is None else as_float(jnp.asarray(v0))
    for name, value in (("x0", x0), ("v0", v0)):
        if value.shape != (n,):
            raise ValueError(f"Argument `{name}` must have shape ({n},), but has shape {value.shape}.")
    if ts.ndim != 1:
        raise ValueError(f"Argument `ts` must have shape (times,), but has shape {ts.shape}.")
    if max_events < 0:
        raise ValueError(f"Argument `max_events` must not be negative, but is {max_events}.")
    dtype = jnp.result_type(system.mass, t0, t1, ts, x0, v0)
    system, t0, t1, ts, x0, v0 = jax.tree.map(lambda a: a.astype(dtype), (system, t0, t1, ts, x0, v0))
    t0, x0 = _check_door(system, t0, t1, ts, x0)
    can_stick = can_any_stick(system, x0, v0)
    solution = _run(
        system,
        t0,
        t1,
        ts,
        x0,
        v0,
        choose_flow(system, can_stick=can_stick) if flow is None else flow,
        None if max_steps is None else jnp.asarray(max_steps),
        jnp.array(True),
        max_events=max_events,
        can_stick=can_stick,
    )
    if throw:
        result = solution.result.error_if(solution.result, solution.result != RESULTS.successful)
        solution = eqx.tree_at(lambda s: s.result, solution, result)
    return solution


def can_any_stick(system: ImpactSystem, x0: Array, v0: Array) -> bool:
    """Whether any stop might ever hold its mass: r < 1, or the mass starts at rest on it.

    Known only from concrete values; while any is traced the answer is yes.
    """
    for stop in system.stops:
        r, position, x, v = (concrete(a) for a in (stop.restitution, stop.position, x0, v0))
        if r is None or (r < 1).any():
            return True
        if position is None or x is None or v is None:
            return True
        if ((np.abs(x[stop.mass] - position) <= 1e-3 * np.abs(position)) & (v[stop.mass] == 0)).any():
            return True
    return False


def _check_door(
    system: ImpactSystem, t0: Scalar, t1: Scalar, ts: Float[Array, " times"], x0: Float[Array, " n"]
) -> tuple[Scalar, Float[Array, " n"]]:
    """Refuse what is wrong from the start; return t0 and x0, bound to the checks under tracing."""
    checks_of_time = [(t1 < t0, "Argument `t1` must not lie before `t0`.")]
    if ts.size:
        in_order = jnp.all(jnp.diff(ts) >= 0) & (ts[0] >= t0) & (ts[-1] <= t1)
        checks_of_time.append((~in_order, "Argument `ts` must be in increasing order, within [t0, t1]."))
    for is_wrong, sentence in checks_of_time:
        t0 = _refuse(t0, is_wrong, sentence)
    for j, stop in enumerate(system.stops):
        gap = stop.sign * (stop.position - x0[stop.mass])
        is_beyond = (gap < 0) & ~is_touching(gap, stop.position)
        sentence = (
            f"The start lies beyond a stop: `x0[{stop.mass}]` is past `stops[{j}]`. "
            f"Start mass {stop.mass} on its free side ({stop.side} stop), or on the stop."
        )
        x0 = _refuse(x0, is_beyond, sentence)
    return t0, x0


def _refuse(value: Array, is_wrong: Flag, sentence: str) -> Array:
    """Raise where the verdict is known, else raise when it is computed."""
    verdict = concrete(is_wrong)
    if verdict is None:
        return eqx.error_if(value, is_wrong, sentence)
    if verdict.any():
        raise ValueError(sentence)
    return value


class _Log(eqx.Module):
    """One row per instant that had an event, the start first."""

    restarts: Restarts
    instants: Instant
    rows: Int[Array, ""]
    num_events: Int[Array, ""]


class _Carry(eqx.Module):
    state: State
    log: _Log
    xs: Float[Array, "times n"]
    vs: Float[Array, "times n"]
    goal: Int[Array, ""]
    steps: Int[Array, ""]
    is_finite: Bool[Array, ""]


@eqx.filter_jit
def _run(
    system: ImpactSystem,
    t0: Scalar,
    t1: Scalar,
    ts: Float[Array, " times"],
    x0: Float[Array, " n"],
    v0: Float[Array, " n"],
    flow: AbstractFlow,
    max_steps: Int[Array, ""] | None,
    always: Bool[Array, ""],
    *,
    max_events: int,
    can_stick: bool,
) -> Solution:
    span = t1 - t0
    machine = prepare(system, jnp.where(span > 0, span, 1), always, can_stick=can_stick)
    if max_steps is None:
        max_steps = 100_000 + jnp.minimum(100 * span * machine.rate, 2e9).astype(int)
    angle = machine.harmonics * machine.frequency * t0
    phase0 = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    goals = jnp.append(ts, t1)
    goal_periods = jnp.floor((goals - t0) / machine.period)
    goal_times = jnp.maximum((goals - t0) - goal_periods * machine.period, 0)
    goal_periods = goal_periods.astype(int)
    resolution = 4 * jnp.finfo(t0.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1))

    def is_live(carry: _Carry) -> Bool[Array, ""]:
        return (carry.goal < goals.size) & carry.is_finite & (carry.steps < max_steps)

    def step(carry: _Carry) -> _Carry:
        state, live = carry.state, is_live(carry)
        is_last_period = state.periods >= goal_periods[carry.goal]
        target = jnp.where(is_last_period, goal_times[carry.goal], machine.period)
        after, instant = advance(flow, machine, state, target, resolution)
        is_saved = live & instant.arrived & is_last_period
        slot = jnp.where(is_saved, carry.goal, goals.size)
        is_finite = jnp.all(jnp.isfinite(after.x) & jnp.isfinite(after.v)) & jnp.isfinite(after.time)
        after = start_period(after, phase0, instant.arrived & ~is_last_period)
        time = t0 + state.periods * machine.period + instant.time
        carry = _Carry(
            state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
            log=_write(carry.log, after, instant, time, live),
            xs=carry.xs.at[slot].set(after.x, mode="drop"),
            vs=carry.vs.at[slot].set(after.v, mode="drop"),
            goal=carry.goal + is_saved,
            steps=carry.steps + live,
            is_finite=is_finite | ~live,
        )
        return carry

    first = first_state(flow, machine, phase0, x0, v0)
    room = jnp.zeros((goals.size, x0.size), x0.dtype)
    carry = _Carry(
        state=first,
        log=_empty_log(first, t0, max_events),
        xs=room,
        vs=room,
        goal=jnp.array(0),
        steps=jnp.array(0),
        is_finite=jnp.array(True),
    )
    last = while_any(is_live, step, carry)
    return _finish(system, machine, flow, last, ts, t0, t1, max_events)


def start_period(state: State, phase0: Float[Array, "2 harmonics ..."], is_over: Flag) -> State:
    """Where a forcing period is over, count it and set time and phase back, so that neither drifts."""
    return eqx.tree_at(
        lambda s: (s.periods, s.time, s.time_low, s.phase),
        state,
        (
            state.periods + is_over,
            jnp.where(is_over, 0, state.time),
            jnp.where(is_over, 0, state.time_low),
            jnp.where(is_over, phase0, state.phase),
        ),
    )


def _empty_log(first: State, t0: Scalar, max_events: int) -> _Log:
    rows = max_events + 1

    def room(a: Array, fill: float | bool) -> Array:
        return jnp.full((rows, *a.shape), fill, a.dtype).at[0].set(a)

    gap, held = first.gap, first.held
    none, zeros = jnp.zeros_like(held), jnp.zeros_like(gap)
    nothing = Instant(none, none, none, zeros, zeros, zeros, jnp.array(False), t0)
    return _Log(
        restarts=Restarts(
            t=room(t0, jnp.inf),
            phase=room(first.phase, 0.0),
            x=room(first.x, 0.0),
            v=room(first.v, 0.0),
            held=room(held, False),
        ),
        instants=jax.tree.map(lambda a: room(a, 0), nothing),
        rows=jnp.array(1),
        num_events=jnp.array(0),
    )


def _write(log: _Log, after: State, instant: Instant, time: Scalar, live: Flag) -> _Log:
    """Write one row, if anything happened."""
    count = jnp.sum(instant.hit) + jnp.sum(instant.stuck) + jnp.sum(instant.released)
    is_row = live & (count > 0)
    row = jnp.where(is_row, log.rows, log.restarts.t.size)
    restart = Restarts(time, after.phase, after.x, after.v, after.held)
    instant = eqx.tree_at(lambda i: i.time, instant, time)
    write = lambda room, value: room.at[row].set(value, mode="drop")  # noqa: E731
    return _Log(
        restarts=jax.tree.map(write, log.restarts, restart),
        instants=jax.tree.map(write, log.instants, instant),
        rows=log.rows + is_row,
        num_events=log.num_events + jnp.where(live, count, 0),
    )


def _event_log(machine: Machine, instants: Instant, max_events: int) -> EventLog:
    """Spread the instants into single events, in the order of time."""
    shape = instants.hit.shape
    signs = jnp.asarray(machine.signs, instants.velocity_minus.dtype)
    zeros = jnp.zeros(shape, instants.velocity_minus.dtype)
    # Impacts of an instant come before its sticks and releases; a stick carries the end of its chatter.
    happened = jnp.stack([instants.hit, instants.stuck, instants.released], axis=1)
    times = instants.time[:, None, None] + jnp.stack([zeros, instants.chatter, zeros], axis=1)
    order = jnp.argsort(jnp.where(happened, times, jnp.inf).ravel(), stable=True)[:max_events]
    is_event = happened.ravel()[order]
    kinds = jnp.asarray([IMPACT, STICK, RELEASE])
    kind = jnp.broadcast_to(kinds[:, None], happened.shape).ravel()[order]
    stop = jnp.broadcast_to(jnp.arange(shape[1]), happened.shape).ravel()[order]
    read = lambda a: jnp.stack([signs * a, zeros, zeros], axis=1).ravel()[order]  # noqa: E731
    minus, plus = read(instants.velocity_minus), read(instants.velocity_plus)
    mass = (1 / machine.inverse_mass)[jnp.asarray(machine.masses, int)][stop] if shape[1] else minus
    floats = times.ravel()[order], minus, plus, mass * (plus - minus)
    t, minus, plus, impulse = (jnp.where(is_event, a, jnp.nan) for a in floats)
    stop, kind = (jnp.where(is_event, a, -1) for a in (stop, kind))
    return EventLog(t, stop, kind, minus, plus, impulse)


def _finish(
    system: ImpactSystem,
    machine: Machine,
    flow: AbstractFlow,
    last: _Carry,
    ts: Float[Array, " times"],
    t0: Scalar,
    t1: Scalar,
    max_events: int,
) -> Solution:
    state, log = last.state, last.log
    is_reached = (jnp.arange(ts.size) < last.goal)[:, None]
    is_done = last.goal > ts.size
    is_full = log.num_events > max_events
    result = RESULTS.where(is_full, RESULTS.max_events_reached, RESULTS.successful)
    result = RESULTS.where(is_done, result, RESULTS.max_steps_reached)
    result = RESULTS.where(last.is_finite, result, RESULTS.non_finite)
    time = t0 + state.periods * machine.period + state.time
    last_row = log.restarts.t[jnp.minimum(log.rows, max_events + 1) - 1]
    return Solution(
        ts=ts,
        xs=jnp.where(is_reached, last.xs[:-1], state.x),
        vs=jnp.where(is_reached, last.vs[:-1], state.v),
        x1=state.x,
        v1=state.v,
        stuck1=state.held,
        events=_event_log(machine, log.instants, max_events),
        num_events=jnp.minimum(log.num_events, max_events),
        num_steps=last.steps,
        result=result,
        t0=t0,
        t1=t1,
        machine=machine,
        flow=flow,
        restarts=log.restarts,
        known_until=jnp.where(is_full, last_row, jnp.where(is_done, t1, time)),
    )
