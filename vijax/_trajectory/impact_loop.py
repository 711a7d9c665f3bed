"""Motion up to an impact with a given stop: the loop of `next_impact`.

The loop ends at the impact. A search in the log of a trajectory would need a bound on the time and on the events before
the impact, and would follow, and differentiate, the motion up to that bound.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals, Scalar
from .._jax.xla import differentiable, while_any
from .._machine.first_state import moving_on_contacts
from .._machine.numbers import MachineNumbers
from .loop import UNLIMITED_STEPS, Carry, LoopArguments, LoopTask, begin_loop, first_carry
from .records import ImpactCount
from .results import RESULTS


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


def follow_to_impact(numbers: MachineNumbers, flow: AbstractFlow, wanted: ImpactRequest) -> Arrival:
    """Follow a motion to the requested impact, differentiably."""
    return differentiable(_follow, (numbers, flow, wanted))


def _follow(whole: tuple[MachineNumbers, AbstractFlow, ImpactRequest]) -> Arrival:
    numbers, flow, wanted = whole
    task, carry, impacts = _begin(numbers, flow, wanted)
    last = while_any(task, carry)
    seen, is_over = last.seen["impacts"], last.goal >= task.num_goals
    is_there = impacts.is_there(seen)
    result = RESULTS.where(is_there | is_over, RESULTS.successful, RESULTS.max_steps_reached)
    result = RESULTS.where(last.is_finite, result, RESULTS.non_finite)
    result = RESULTS.where(wanted.is_sound, result, RESULTS.unsound_start)
    state = last.state
    x, v = task.machine.in_space(eqx.tree_at(lambda s: s.v, state, seen.v))
    t = wanted.t0 + state.periods * task.machine.period + state.time
    return Arrival(t, x, v, is_there, result)


def _begin(
    numbers: MachineNumbers, flow: AbstractFlow, wanted: ImpactRequest
) -> tuple[LoopTask, Carry, ImpactCount]:
    """Loop up to an impact, its first carry, and what counts the impacts."""
    w, none, impacts = wanted, jnp.array(0), ImpactCount(wanted.stop, wanted.num_impacts)
    request = LoopArguments(
        t0=w.t0,
        t1=jax.lax.stop_gradient(w.t1 - w.t0) + w.t0,
        x0=w.x0,
        v0=w.v0,
        goals=jnp.zeros(0, w.t0.dtype),
        num_goals=none,
        is_last=jnp.array(True),
        max_steps=w.max_steps,
        max_events=none,
        max_turns=jnp.array(UNLIMITED_STEPS),
        is_sound=w.is_sound,
    )
    task, first = begin_loop(numbers, flow, request, {"impacts": impacts}, can_stick=True)
    # The map from impact to impact has its states on the stop.
    return task, first_carry(task, moving_on_contacts(task.machine, first), w.is_sound), impacts
