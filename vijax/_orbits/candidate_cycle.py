"""A candidate cycle from one run of the motion, by the equations of its events or by its stroboscopic map."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

from .._hybrid.limits import TURN
from .._jax.arrays import Scalar
from .._jax.xla import is_any
from .._machine.kinds import FRICTION
from .condensation import Pencil
from .cycle import Problem, Unknowns, residual
from .floquet import floquet_multipliers, with_phase
from .newton import polish, scale_of
from .rigid_modes import all_shifts, closing_pin
from .sequence import NOTHING, Sequence, num_erased

# Newton step of the map, relative to the size of the motion, below which the next iterate is exact to rounding.
_NEAR = 1e-8


class Cycle(eqx.Module):
    """A solution of the equations of a sequence; an orbit if the machine really follows that sequence.

    Attributes:
        start: positions and velocities at its start, in the fixed frame, (2 n,).
        unknowns: the start in the frame of the stops, and the durations of the flights.
        sequence: its events.
        multipliers: Floquet multipliers, (2 n,).
        residual: closing error, relative to the size of the motion.
    """

    start: Float[Array, " state"]
    unknowns: Unknowns
    sequence: Sequence
    multipliers: Complex[Array, " state"]
    residual: Scalar


def cycle_by_sequence(problem: Problem, guess: Unknowns) -> tuple[Cycle, Array, Array, Bool[Array, ""]]:
    """Polish a guess: the cycle, the state at which to enter it, the first Newton step, a flag of convergence."""
    polished = polish(problem, guess)
    z, sequence, size = polished.unknowns.z, problem.sequence, scale_of(problem, polished.unknowns.z)
    # A cycle that begins within a chatter is faster elsewhere: the speeds of its impacts count in its size.
    speeds = polished.residual.speed
    if FRICTION in problem.machine.contacts.kinds:  # at a turn it is a force
        speeds = jnp.where(sequence.kind == TURN, 0, speeds)
    fastest = jnp.max(jnp.abs(speeds), initial=0)
    size = size * jnp.maximum(1, fastest / size[-1])
    cycle = Cycle(
        start=z,
        unknowns=polished.unknowns,
        sequence=sequence,
        multipliers=multipliers_of(problem, polished.pencil),
        residual=jnp.max(jnp.abs(polished.residual.closing) / size),
    )
    return cycle, _entry(problem, polished.unknowns), polished.first, polished.is_converged


def multipliers_of(problem: Problem, pencil: Pencil) -> Complex[Array, " state"]:
    """Floquet multipliers of a cycle from the pencil of its neighbours."""
    erased = num_erased(problem.sequence, problem.machine.contacts.num_sliders)
    shifts = all_shifts(problem.shifts, problem.drift)
    if problem.is_autonomous:
        return with_phase(floquet_multipliers(pencil, erased + 1, shifts))
    return floquet_multipliers(pencil, erased, shifts)


def _entry(problem: Problem, cycle: Unknowns) -> Array:
    """The state of a cycle at the phase where it begins, in the frame of the stops.

    This is its start, unless Newton's method has moved an event past this phase. Then the event happens before the
    cycle begins, or after it ends, and a run from the start would show it twice or not at all.
    """
    sequence, num_periods = problem.sequence, problem.num_periods
    times = jnp.cumsum(cycle.flights)
    is_early = jnp.any(sequence.is_event & (times < 0))
    has_passed = is_early | jnp.any(sequence.is_event & (times > num_periods))

    def later() -> Array:
        """The state at this phase after the early events, or before the late ones."""
        end = jnp.where(is_early, 0, num_periods)
        is_kept = jnp.cumsum(sequence.is_event & (times <= end)) == 1 + jnp.arange(len(times))
        last = jnp.sum(is_kept)
        mode = sequence.mode[jnp.minimum(jnp.arange(len(times) + 1), last)]
        kept = Sequence(jnp.where(is_kept, sequence.kind, NOTHING), sequence.stop, mode)
        part = eqx.tree_at(lambda p: (p.sequence, p.num_periods), problem, (kept, end))
        return cycle.z + residual(part, Unknowns(cycle.z, jnp.where(is_kept, cycle.flights, 0))).closing

    z = jax.lax.cond(is_any(has_passed), later, lambda: cycle.z)
    return jnp.where(has_passed, z, cycle.z)


def cycle_by_map(
    problem: Problem, guess: Unknowns, end: Array, jacobian: Array
) -> tuple[Cycle, Array, Array, Bool[Array, ""]]:
    """As `cycle_by_sequence`, by one Newton step on the stroboscopic map."""
    z, identity, size = guess.z, jnp.eye(len(guess.z)), scale_of(problem, guess.z)
    step = jnp.linalg.solve(identity - closing_pin(problem.shifts) - jacobian, end - z)
    cycle = Cycle(
        start=z + step,
        unknowns=Unknowns(z + step, guess.flights),
        sequence=problem.sequence,
        multipliers=floquet_multipliers(
            Pencil(jacobian, identity),
            num_erased(problem.sequence, problem.machine.contacts.num_sliders),
            problem.shifts,
        ),
        residual=jnp.max(jnp.abs(end - z) / size),
    )
    return cycle, cycle.start, step, jnp.max(jnp.abs(step) / size) < _NEAR
