"""Motion up to an impact with a given stop: the loop of `next_impact`.

The loop ends at the impact. A search in the log of a trajectory would need a bound on the time and on the events before
the impact, and would follow, and differentiate, the motion up to that bound.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals, Scalar
from .._jax.xla import AbstractTask, differentiable, while_any
from .._machine.machine import (
    AUTOMATIC_MAX_STEPS,
    Machine,
    default_max_steps,
    in_periods,
    moving_on_contacts,
    prepare,
)
from .._machine.numbers import MachineNumbers
from .._machine.state import State
from .loop import is_finite
from .results import RESULTS
from .step import flight_to, initial_state, outcome


class ImpactRequest(eqx.Module):
    """Request for an impact.

    Attributes:
        t0: start of the motion.
        t1: time at which the search ends.
        x0: positions at the start, (n,).
        v0: velocities at the start, (n,).
        stop: stop whose impacts count.
        num_impacts: number of the requested impact; the first after t0 is 1.
        max_steps: bound on the steps, `AUTOMATIC_MAX_STEPS` for one by the rate of the machine.
        is_sound: whether the start is valid; if not, no step is taken.
    """

    t0: Reals
    t1: Reals
    x0: Reals
    v0: Reals
    stop: Reals
    num_impacts: Reals
    max_steps: Reals
    is_sound: Reals


class Arrival(eqx.Module):
    """End of the motion.

    Attributes:
        t: time.
        x: positions, (n,).
        v: velocities just before the transition, (n,).
        is_there: whether this is the requested impact.
        result: result code; `successful` also if there was no such impact.
    """

    t: Scalar
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    is_there: Bool[Array, ""]
    result: RESULTS


class _Carry(NamedTuple):
    """State after the last step, velocities just before its transition, numbers of impacts and steps, and flags."""

    state: State
    v: Float[Array, " n"]
    impacts: Int[Array, ""]
    steps: Int[Array, ""]
    is_over: Bool[Array, ""]
    is_finite: Bool[Array, ""]


class _Task(AbstractTask):
    """Loop body with everything it depends on, so that derivatives see it."""

    flow: AbstractFlow
    machine: Machine
    phase0: Float[Array, "2 harmonics"]
    stop: Int[Array, ""]
    num_impacts: Int[Array, ""]
    last_period: Int[Array, ""]
    last_time: Scalar
    resolution: Scalar
    max_steps: Int[Array, ""]

    def is_there(self, carry: _Carry) -> Bool[Array, ""]:
        """True once the motion reached the impact."""
        return carry.impacts >= self.num_impacts

    def is_live(self, carry: _Carry) -> Bool[Array, ""]:
        """True while the motion is finite and has not reached the impact, `t1` or the bound on steps."""
        is_on = carry.is_finite & ~carry.is_over & (carry.steps < self.max_steps)
        return is_on & ~self.is_there(carry)

    def step(self, carry: _Carry) -> _Carry:
        """Take one step of the motion."""
        state, live = carry.state, self.is_live(carry)
        is_last_period = state.periods >= self.last_period
        target = jnp.where(is_last_period, self.last_time, self.machine.period)
        flight = flight_to(self.flow, self.machine, state, target, self.resolution)
        after, instant = outcome(self.machine, flight)
        # An impact at the start does not count.
        is_later = (state.periods > 0) | (instant.time > 0)
        after = self.machine.start_period(after, self.phase0, instant.arrived & ~is_last_period)
        finite = is_finite(after)
        return _Carry(
            state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
            v=jnp.where(live, flight.end.v, carry.v),
            impacts=carry.impacts + (live & instant.hit[self.stop] & is_later),
            steps=carry.steps + live,
            is_over=carry.is_over | (live & instant.arrived & is_last_period),
            is_finite=carry.is_finite & (finite | ~live),
        )


def follow_to_impact(numbers: MachineNumbers, flow: AbstractFlow, wanted: ImpactRequest) -> Arrival:
    """Follow a motion to the requested impact, differentiably."""
    return differentiable(_follow, (numbers, flow, wanted))


def _follow(whole: tuple[MachineNumbers, AbstractFlow, ImpactRequest]) -> Arrival:
    numbers, flow, wanted = whole
    task, carry = _begin(numbers, flow, wanted)
    last = while_any(task, carry)
    is_there = task.is_there(last)
    result = RESULTS.where(is_there | last.is_over, RESULTS.successful, RESULTS.max_steps_reached)
    result = RESULTS.where(last.is_finite, result, RESULTS.non_finite)
    result = RESULTS.where(wanted.is_sound, result, RESULTS.unsound_start)
    state = last.state
    x, v = task.machine.in_space(eqx.tree_at(lambda s: s.v, state, last.v))
    t = wanted.t0 + state.periods * task.machine.period + state.time
    return Arrival(t, x, v, is_there, result)


def _begin(numbers: MachineNumbers, flow: AbstractFlow, wanted: ImpactRequest) -> tuple[_Task, _Carry]:
    w, span = wanted, jax.lax.stop_gradient(wanted.t1 - wanted.t0)
    machine = prepare(numbers, jnp.where(span > 0, span, 1), (w.t0, w.x0, w.v0), can_stick=True)
    flow = flow.prepare(machine)
    phase0 = machine.phase_at_start(w.t0)
    # The map from impact to impact has its states on the stop.
    first = moving_on_contacts(machine, initial_state(flow, machine, phase0, w.x0, w.v0, w.t0))
    last_period, last_time = in_periods(machine, span)
    task = _Task(
        flow=flow,
        machine=machine,
        phase0=phase0,
        stop=w.stop,
        num_impacts=w.num_impacts,
        last_period=last_period,
        last_time=last_time,
        resolution=4 * jnp.finfo(w.t0.dtype).eps * jnp.maximum(jnp.abs(w.t0), jnp.abs(w.t1)),
        max_steps=jnp.where(
            w.max_steps == AUTOMATIC_MAX_STEPS, default_max_steps(machine, span), w.max_steps
        ),
    )
    nothing = jnp.array(0)
    return task, _Carry(first, first.v, nothing, nothing, jnp.array(False), w.is_sound)
