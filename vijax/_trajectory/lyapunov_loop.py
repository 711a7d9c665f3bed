"""Loop that follows a motion and the growth of small perturbations of its state, period by period."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals, array_namespace
from .._jax.xla import AbstractTask, compile_lightly, while_any
from .._machine.machine import Machine
from .._machine.numbers import MachineNumbers
from .._machine.preparation import AUTOMATIC_MAX_STEPS, default_max_steps, prepare
from .._machine.state import State
from .loop import is_finite, run_without_derivatives
from .one_call import empty_progress
from .results import RESULTS
from .step import initial_state
from .tangent_frame import Tangents, advance_with, first_tangents

# Number of blocks of periods; their scatter gives the error of a mean.
BLOCKS = 20


class ExponentRequest(eqx.Module):
    """Request for Lyapunov exponents.

    Attributes:
        x0: positions at the start, (n,).
        v0: velocities at the start, (n,).
        transient: number of periods before the counted ones.
        num_periods: number of counted periods.
        max_steps: bound on the steps, `AUTOMATIC_MAX_STEPS` for one by the rate of the machine.
        is_sound: whether the start is valid; if not, no step is taken.
    """

    x0: Reals
    v0: Reals
    transient: Reals
    num_periods: Reals
    max_steps: Reals
    is_sound: Reals


class Growth(eqx.Module):
    """Progress of a motion, with the growth of its perturbations.

    Attributes:
        state: the motion.
        tangents: perturbations, with their growth since the last end of a period.
        totals: growth in the counted periods, block by block, (blocks, 2 n).
        steps: number of steps so far.
        is_finite: whether the motion stayed finite.
    """

    state: State
    tangents: Tangents
    totals: Float[Array, "blocks vectors"]
    steps: Int[Array, ""]
    is_finite: Bool[Array, ""]


class _Task(AbstractTask):
    """Loop body with everything it depends on."""

    flow: AbstractFlow
    machine: Machine
    phase0: Float[Array, "2 harmonics"]
    transient: Int[Array, ""]
    num_periods: Int[Array, ""]
    last_step: Int[Array, ""]

    def is_live(self, carry: Growth) -> Bool[Array, ""]:
        """True while the motion is finite and steps and periods are left."""
        is_on = carry.is_finite & (carry.steps < self.last_step)
        return is_on & (carry.state.periods < self.transient + self.num_periods)

    def step(self, carry: Growth) -> Growth:
        """Advance the motion and its perturbations by one step."""
        state, machine, live = carry.state, self.machine, self.is_live(carry)
        resolution = 4 * jnp.finfo(state.x.dtype).eps * machine.period
        after, instant, tangents = advance_with(
            carry.tangents, self.flow, machine, state, machine.period, resolution
        )
        number = state.periods - self.transient
        is_counted = live & instant.arrived & (number >= 0)
        is_ours = is_counted & (jnp.arange(BLOCKS) == number * BLOCKS // jnp.maximum(self.num_periods, 1))
        finite = is_finite(after)
        onward = machine.start_period(after, self.phase0, instant.arrived)
        moved = onward, tangents.start_period(machine, onward, instant.arrived, number < 0)
        state, kept = jax.tree.map(lambda new, old: jnp.where(live, new, old), moved, (state, carry.tangents))
        return Growth(
            state=state,
            tangents=kept,
            totals=carry.totals + jnp.where(is_ours[:, None], tangents.growth, 0),
            steps=carry.steps + live,
            is_finite=carry.is_finite & (finite | ~live),
        )


def follow_growth(
    numbers: MachineNumbers, flow: AbstractFlow, request: ExponentRequest
) -> tuple[Growth, Bool[Array, ""]]:
    """Follow a motion to its end.

    Args:
        numbers: numbers of the machine.
        flow: the motion between events.
        request: request for exponents.

    Returns:
        Progress at the end, and whether periods are left.
    """
    task, carry = _begin(numbers, flow, request, None, None)
    return _told(task, while_any(task, carry))


def _begin(
    numbers: MachineNumbers, flow: AbstractFlow, request: ExponentRequest, so_far: Growth | None, turns: Reals
) -> tuple[_Task, Growth]:
    r = jax.tree.map(jnp.asarray, request)
    zero = jnp.zeros_like(r.x0[0])
    one_period = 2 * jnp.pi / numbers.frequency
    machine = prepare(numbers, one_period, (zero, r.x0, r.v0), can_stick=True)
    flow, phase0 = flow.prepare(machine), machine.phase_at_start(zero)
    count = jnp.zeros_like(r.transient)
    nothing = jnp.zeros((BLOCKS, 2 * r.x0.size), r.x0.dtype)
    first = initial_state(flow, machine, phase0, r.x0, r.v0)
    carry = Growth(first, first_tangents(machine, first), nothing, count, r.is_sound)
    if so_far is not None:
        carry = jax.tree.map(lambda new, old: jnp.where(so_far.steps > 0, old, new), carry, so_far)
    span = (r.transient + r.num_periods) * machine.period
    bound = jnp.where(r.max_steps == AUTOMATIC_MAX_STEPS, default_max_steps(machine, span), r.max_steps)
    last = bound if turns is None else jnp.minimum(bound, carry.steps + turns)
    return _Task(flow, machine, phase0, r.transient, r.num_periods, last), carry


def _told(task: _Task, last: Growth) -> tuple[Growth, Bool[Array, ""]]:
    is_left = last.is_finite & (last.state.periods < task.transient + task.num_periods)
    return last, is_left


@compile_lightly
def follow_some_growth(
    numbers: MachineNumbers, flow: AbstractFlow, request: ExponentRequest, so_far: Growth, turns: Reals
) -> tuple[Growth, Bool[Array, ""]]:
    """`follow_growth` for concrete numbers, some steps further; from the start if no step was taken."""
    return _told(*run_without_derivatives(_begin, (numbers, flow, request, so_far, turns)))


def no_growth(numbers: MachineNumbers, flow: AbstractFlow) -> Growth:
    """Input of the first call, in the shapes of the result of a call."""
    left, size = empty_progress(numbers, flow), 2 * numbers.mass.shape[-1]
    shapes = (size, size), (size,), (BLOCKS, size)
    frame, growth, totals = jax.device_put([np.zeros(shape, numbers.mass.dtype) for shape in shapes])
    return Growth(left.state, Tangents(frame, growth), totals, left.steps, left.is_finite)


def result_of(growth: Growth, request: ExponentRequest, is_left: Bool[Array, ""]) -> RESULTS:
    """Result code of the motion."""
    result = RESULTS.where(is_left, RESULTS.max_steps_reached, RESULTS.successful)
    result = RESULTS.where(growth.is_finite, result, RESULTS.non_finite)
    return RESULTS.where(request.is_sound, result, RESULTS.unsound_start)


def exponents(totals: Reals, num_periods: int, period: Reals) -> tuple[Reals, Reals]:
    """Lyapunov exponents and their standard errors, the largest first.

    Args:
        totals: growth in the blocks of `in_blocks`, (blocks, 2 n, ...).
        num_periods: number of periods in all.
        period: forcing period, (...).
    """
    library = array_namespace(totals, period)
    count = _periods_of_blocks(num_periods)
    mean = totals.sum(axis=0) / (num_periods * period)
    is_erased = mean == -np.inf
    finite = library.where(is_erased, 0, mean)
    count = count.reshape(-1, *(1,) * mean.ndim)
    scatter = library.where(is_erased, 0, totals) - finite[None] * (count * period)
    used = int((count > 0).sum())
    spread = used / (used - 1) if used > 1 else np.nan
    error = library.sqrt(spread * (scatter**2).sum(axis=0)) / (num_periods * period)
    error = library.where(is_erased, 0, error)
    order = library.argsort(-mean, axis=0, stable=True)
    return library.take_along_axis(mean, order, axis=0), library.take_along_axis(error, order, axis=0)


def in_blocks(growth: np.ndarray) -> np.ndarray:
    """Growth in each period, (2 n, periods, points), summed in blocks, (blocks, 2 n, points)."""
    ends = np.cumsum(_periods_of_blocks(growth.shape[1]))
    parts = np.split(growth, ends[:-1], axis=1)
    return np.stack([part.sum(axis=1) for part in parts])


def _periods_of_blocks(num_periods: int) -> np.ndarray:
    """Number of periods p of each block, those with p * BLOCKS // num_periods = 0, 1, ..."""
    first = -(-np.arange(BLOCKS + 1) * num_periods // BLOCKS)
    return np.diff(first)
