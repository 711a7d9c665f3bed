"""Events of a motion by approximate steps: located on the polynomial inside a step, then stepped to.

    trial step -> is it accurate? -> does its polynomial stay clear of every stop?
        yes: take it        no: try again, up to the first crossing

The polynomial inside a step is less accurate than its end, by up to two orders. So it never decides on an event: it
only sets the length of the next trial. That trial ends, with the full accuracy of the solver, so close to the event
that the first terms of a Taylor series from its end land on the event to rounding. Where the polynomial misses a stop
by less than its error, the trial is repeated at a quarter of its length: no light impact is missed, and no near miss
is taken for an impact.

One iteration of the loop is one trial. So no lane of a batch waits for the rejected steps or the events of another, and
an iteration costs about as much as a step without events. Every step restarts the solver: nothing of the motion before
an impact enters the motion after it.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from .._jax.arrays import Flag, Scalar, over_lanes
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State, with_memory
from .event_margins import (
    EventMargins,
    StepInterior,
    crossings_in_step,
    event_margins_at,
    is_due,
    phase_change,
    times_to_events,
)
from .exact_step import simultaneity_tolerance, state_after_step
from .interface import AbstractFlow, Flight, StepMotion
from .mode_series import LONGEST_STEP_AND_TERMS
from .switching_margins import guard_margins_at, guards_crossed_in_step

# Fraction of the accurate step length below which a step is taken whatever its polynomial shows.
_SHORTEST = 1e-9


class Memory(eqx.Module):
    """Memory from trial to trial.

    Attributes:
        step: step length for accuracy; 0 before the first trial.
        cut: length of the next trial where an event, or a doubtful one, requires a shorter step; else infinite.
        control: memory of the step size controller.
        rejected: number of trials so far that were not accurate enough.
    """

    step: Scalar
    cut: Scalar
    control: PyTree
    rejected: Int[Array, "..."]


class Attempt(eqx.Module):
    """Trial step of one trajectory.

    Attributes:
        displacement: x(step) - x(0), (n,); 0 for held masses.
        gain: v(step) - v(0), (n,), before `AbstractContacts.gained` removes that of held masses.
        inside: both inside the step.
        is_good: whether it is accurate enough.
        following: length to try next, after this step or instead of it.
        control: memory of the step size controller.
    """

    displacement: Float[Array, " n"]
    gain: Float[Array, " n"]
    inside: StepInterior
    is_good: Flag
    following: Scalar
    control: PyTree


class Trial(eqx.Module):
    """Attempt, its length, and the length for accuracy alone."""

    attempt: Attempt
    step: Scalar
    wanted: Scalar


class SteppingFlow(AbstractFlow):
    """Motion by approximate steps, each with a polynomial inside.

    To add one, write `attempt`, `step_by` and, if the step size controller has a memory, `control`.
    """

    @abc.abstractmethod
    def attempt(self, machine: Machine, state: State, hold: Held, step: Scalar) -> Attempt:
        """Try a step of one trajectory under `machine.total_force`, with the contacts of `hold` closed."""

    @abc.abstractmethod
    def step_by(
        self, machine: Machine, state: State, hold: Held, step: Scalar
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Displacement and gain of velocity of the same step; differentiable forward and reverse."""

    def control(self, like: Scalar) -> PyTree:
        """Initial memory of the step size controller, arrays in the shape of `like`."""
        del like

    def first_step(self, machine: Machine) -> Scalar:
        """Length of the first trial."""
        return 0.1 / machine.rate

    def memory(self, like: Scalar) -> Memory:
        """Memory before the first trial."""
        zero = jnp.zeros_like(like)
        return Memory(zero, zero + jnp.inf, self.control(like), jnp.zeros(zero.shape, int))

    def num_rejected(self, memory: Memory) -> Int[Array, "..."]:
        """Number of trials that were not accurate enough."""
        return memory.rejected

    def fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        """Try one step in every lane."""
        return over_lanes(type(self)._fly, state.x, self, machine, state, remaining, resolution)

    def propagate(self, machine: Machine, state: State, hold: Held, step: Scalar) -> StepMotion:
        """Take one step of the solver."""
        displacement, gain = over_lanes(type(self).step_by, state.x, self, machine, state, hold, step)
        gain = machine.contacts.gain_with_hold(gain, hold)
        return displacement, state.v + gain, phase_change(machine, state.phase, step)

    def coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        """Try one step in every lane, ignoring the stops."""
        return over_lanes(type(self)._coast, state.x, self, machine, state, remaining)

    def _fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        hold = machine.hold(state.held)
        trial = self._try(machine, state, hold, remaining)
        arrived = _moved(machine, state, trial, hold)
        margins_at = guard_margins_at if machine.contacts.is_switching else event_margins_at
        now, end = margins_at(machine, state, hold), margins_at(machine, arrived, hold)
        due, late = is_due(now, state), times_to_events(end, trial.wanted)
        is_clear, cut = _clearance(machine, state, hold, now, end, late, trial)
        is_taken = trial.attempt.is_good & is_clear & ~jnp.any(due)
        is_near = is_taken & (late <= remaining + resolution - trial.step)
        late = jnp.where(due, 0, jnp.where(is_near, late, jnp.inf))
        delay = jnp.min(late, initial=jnp.inf)
        is_event = (late <= delay + simultaneity_tolerance(machine)) & (late < jnp.inf)
        delay = jnp.where(delay < jnp.inf, jnp.maximum(delay, -trial.step), 0)
        landed = _choose(is_taken, _landed(machine, arrived, end, delay), state)
        landed = with_memory(landed, _learnt(state.memory, trial, is_taken, jnp.any(is_event), cut))
        duration = jnp.where(is_taken, trial.step + delay, 0)
        return Flight(
            _or_lost(machine, trial, landed), duration, is_event, is_taken & (trial.step >= remaining)
        )

    def _coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        hold = machine.hold(state.held)
        trial = self._try(machine, state, hold, remaining)
        is_taken = trial.attempt.is_good
        end = _choose(is_taken, _moved(machine, state, trial, hold), state)
        end = with_memory(end, _learnt(state.memory, trial, is_taken, is_taken, state.memory.cut))
        length = jnp.where(is_taken, trial.step, jnp.where(_is_lost(machine, trial), remaining, 0))
        return _or_lost(machine, trial, end), length

    def _try(self, machine: Machine, state: State, hold: Held, remaining: Scalar) -> Trial:
        memory = state.memory
        first = jnp.where(memory.step > 0, memory.step, self.first_step(machine))
        wanted = jnp.minimum(first, longest_step(machine))
        step = jnp.minimum(jnp.minimum(wanted, memory.cut), remaining)
        return Trial(self.attempt(machine, state, hold, step), step, wanted)


def longest_step(machine: Machine) -> Scalar:
    """Longest step for which `phase_change` is accurate."""
    fastest = machine.fastest
    return LONGEST_STEP_AND_TERMS[str(machine.rate.dtype)][0] / jnp.where(fastest > 0, fastest, 1e-9)


def _clearance(
    machine: Machine,
    state: State,
    hold: Held,
    now: EventMargins,
    end: EventMargins,
    late: Float[Array, " guards"],
    trial: Trial,
) -> tuple[Flag, Scalar]:
    """Test whether a step is free of events up to its end; the length to try instead if it is not."""
    step, wanted = trial.step, trial.wanted
    if not machine.contacts.num:
        return jnp.array(True), jnp.full_like(step, jnp.inf)
    is_near = late < jnp.inf
    prove = guards_crossed_in_step if machine.contacts.is_switching else crossings_in_step
    proof = prove(machine, state, hold, now, end, trial.attempt.inside, step, is_near)
    free = step * proof.free
    window = jnp.where(is_near, wanted * end.radius, 0)
    # Time before arrival in which an approaching mass is nearer to its stop than the error.
    before = jnp.where(end.slope < 0, 2 * proof.error / jnp.where(end.slope < 0, -end.slope, 1), 0)
    is_open = ~proof.is_crossed & (free >= step - window - before)
    crossing = jnp.min(jnp.where(proof.is_crossed, free, jnp.inf))
    shortest = _SHORTEST * wanted
    cut = jnp.maximum(jnp.where(crossing < step, crossing, step / 4), shortest)
    return jnp.all(is_open) | (step <= shortest), cut


def _learnt(memory: Memory, trial: Trial, is_taken: Flag, is_event: Flag, cut: Scalar) -> Memory:
    """Memory after a trial."""
    attempt, is_whole = trial.attempt, trial.step >= trial.wanted
    # A step cut short shows that its length is accurate, not that a longer one is inaccurate.
    grown = jnp.where(is_whole, attempt.following, jnp.maximum(attempt.following, trial.wanted))
    step = jnp.where(is_taken, grown, jnp.where(attempt.is_good, trial.wanted, attempt.following))
    control = _choose(is_taken | ~attempt.is_good, attempt.control, memory.control)
    # A step that was cut and then taken has no event, but the doubt that cut it may persist.
    cut = jnp.where(is_taken, 8 * memory.cut, jnp.where(attempt.is_good, cut, memory.cut))
    cut = jnp.where(is_event, jnp.inf, cut)
    return Memory(step, cut, control, memory.rejected + ~attempt.is_good)


def _moved(machine: Machine, state: State, trial: Trial, hold: Held) -> State:
    gain = machine.contacts.gain_with_hold(trial.attempt.gain, hold)
    change = phase_change(machine, state.phase, trial.step)
    return state_after_step(machine, state, trial.attempt.displacement, state.v + gain, change, trial.step)


def _landed(machine: Machine, state: State, end: EventMargins, delay: Scalar) -> State:
    """State after `delay`, which is short and may be negative."""
    a, jerk = end.motion.acceleration, end.motion.jerk
    displacement = delay * (state.v + delay * (a / 2 + delay * jerk / 6))
    v = state.v + delay * (a + delay * jerk / 2)
    return state_after_step(machine, state, displacement, v, phase_change(machine, state.phase, delay), delay)


def _choose(condition: Flag, a: PyTree, b: PyTree) -> PyTree:
    return jax.tree.map(lambda new, old: jnp.where(condition, new, old), a, b)


def _is_lost(machine: Machine, trial: Trial) -> Flag:
    """True where no step is short enough: the force is not finite, or the motion diverges."""
    least = 1e-3 * jnp.finfo(trial.step.dtype).eps / machine.rate
    return ~trial.attempt.is_good & ~(trial.attempt.following > least)


def _or_lost(machine: Machine, trial: Trial, state: State) -> State:
    return eqx.tree_at(lambda s: s.x, state, jnp.where(_is_lost(machine, trial), jnp.nan, state.x))
