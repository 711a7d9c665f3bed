"""Many trajectories side by side in one loop.

Each lane goes through its transient and its recorded periods at its own pace; the loop ends with its
slowest lane. Impacts are written to one flat array by a single scatter, an index of which lies
outside, and is dropped, for every lane that has nothing to record. (A second loop for the recorded
periods alone saves that scatter in the transient, but doubles the compile time and makes every lane
wait for the slowest twice.)
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._advance import Instant, advance
from .._contact.start import first_state
from .._machine import Machine, State, prepare, start_period
from .._motion.flow import AbstractFlow
from .._system.system import ImpactSystem
from .._xla import AbstractTask, while_any


class Record(eqx.Module):
    """What is kept of the recorded periods, lanes first in `impacts`, last elsewhere.

    Attributes:
        impacts: time since the transient, velocity before, stop; (lanes, max_impacts, 3).
        num_impacts: impacts of each stop, (stops, lanes), also those that found no room.
        num_sticks: likewise.
    """

    impacts: Float[Array, "lanes impacts 3"]
    num_impacts: Int[Array, "stops lanes"]
    num_sticks: Int[Array, "stops lanes"]


class _Carry(eqx.Module):
    state: State
    room: Float[Array, "rows 3"]
    num_impacts: Int[Array, "stops lanes"]
    num_sticks: Int[Array, "stops lanes"]
    steps: Int[Array, " lanes"]
    is_finite: Bool[Array, " lanes"]


class _Task(AbstractTask):
    """What the loop does with its carry."""

    flow: AbstractFlow
    machine: Machine
    phase0: Float[Array, "2 harmonics lanes"]
    transient: Int[Array, ""]
    num_periods: Int[Array, ""]
    max_steps: Int[Array, ""]
    max_impacts: int = eqx.field(static=True)

    def is_live(self, carry: _Carry) -> Bool[Array, " lanes"]:
        """Lanes that have something left to do."""
        is_on = carry.is_finite & (carry.steps < self.max_steps)
        return is_on & (carry.state.periods < self.num_periods)

    def step(self, carry: _Carry) -> _Carry:
        """One step of every lane."""
        machine, state, live = self.machine, carry.state, self.is_live(carry)
        resolution = 4 * jnp.finfo(state.x.dtype).eps * machine.period
        after, instant = advance(self.flow, machine, state, machine.period, resolution)
        is_finite = jnp.isfinite(after.time) & jnp.all(jnp.isfinite(after.x + after.v), axis=0)
        counted = live & (state.periods >= self.transient)
        passed = (state.periods - self.transient) * machine.period + instant.time
        hit = instant.hit & counted
        after = start_period(after, self.phase0, instant.arrived)
        return _Carry(
            state=jax.tree.map(lambda new, old: jnp.where(live, new, old), after, state),
            room=_write(machine, carry, hit, passed, instant, self.max_impacts),
            num_impacts=carry.num_impacts + hit,
            num_sticks=carry.num_sticks + (instant.stuck & counted),
            steps=carry.steps + live,
            is_finite=is_finite | ~live,
        )


@eqx.filter_jit
def run_lanes(
    flow: AbstractFlow,
    system: ImpactSystem,
    x0: Float[Array, "n lanes"],
    v0: Float[Array, "n lanes"],
    bounds: tuple[Int[Array, ""], Int[Array, ""], Int[Array, ""]],
    always: Bool[Array, ""],
    *,
    max_impacts: int,
    can_stick: bool,
) -> tuple[State, Record, Int[Array, " lanes"], Bool[Array, " lanes"]]:
    """Follow every lane from phase 0 through its transient and its recorded forcing periods.

    Args:
        flow: the motion between events.
        system: the machine; leaves carry lanes, or a single one for all, as their last axis.
        x0: where each lane starts.
        v0: and how fast.
        bounds: periods that are not recorded, periods that are, and the most steps of a lane.
        always: True; see `compute_once`.
        max_impacts: room for the impacts of one lane.
        can_stick: whether any stop of any lane might hold its mass.

    Returns:
        The last state, the record, the number of steps of each lane, and whether it stayed finite.
    """
    transient, record, max_steps = bounds
    lanes = x0.shape[1]
    period = 2 * jnp.pi / system.forcing.frequency
    machine = prepare(system, period, always, can_stick=can_stick)
    flow = flow.prepare(machine)
    num_periods = transient + record
    start = jnp.zeros((machine.cosine.shape[0], lanes), x0.dtype)
    phase0 = jnp.stack([start + 1, start])

    task = _Task(flow, machine, phase0, transient, num_periods, max_steps, max_impacts)
    first = first_state(flow, machine, phase0, x0, v0)
    none = jnp.zeros(first.gap.shape, int)
    carry = _Carry(
        state=first,
        room=jnp.full((lanes * max_impacts, 3), jnp.nan, x0.dtype),
        num_impacts=none,
        num_sticks=none,
        steps=jnp.zeros(lanes, int),
        is_finite=jnp.ones(lanes, bool),
    )
    last = while_any(task, carry)
    impacts = last.room.reshape(lanes, max_impacts, 3)
    return last.state, Record(impacts, last.num_impacts, last.num_sticks), last.steps, last.is_finite


def _write(
    machine: Machine,
    carry: _Carry,
    hit: Bool[Array, "stops lanes"],
    passed: Float[Array, " lanes"],
    instant: Instant,
    max_impacts: int,
) -> Float[Array, "rows 3"]:
    """Append the impacts of this step, those of several stops of one lane in their order."""
    stops, lanes = hit.shape
    if stops == 0 or max_impacts == 0:
        return carry.room
    before = jnp.sum(carry.num_impacts, axis=0) + jnp.cumsum(hit, axis=0) - hit
    outside = carry.room.shape[0]
    row = jnp.where(hit & (before < max_impacts), jnp.arange(lanes) * max_impacts + before, outside)
    signs = jnp.asarray(machine.signs, passed.dtype)[:, None]
    names = jnp.broadcast_to(jnp.arange(stops, dtype=passed.dtype)[:, None], hit.shape)
    velocity = signs * instant.velocity_minus
    values = jnp.stack([jnp.broadcast_to(passed, hit.shape), velocity, names], axis=-1)
    return carry.room.at[row.ravel()].set(values.reshape(-1, 3), mode="drop")
