"""The search for an orbit: its state, and its update by one run of the motion.

A run of n periods from a start tells the sequence of its events, which gives two ways on. Newton's method on
the equations of that sequence (`candidate_cycle.py`) goes to the cycle of the sequence, if there is one near, across
grazing and whatever lies between; its first step alone is the Newton step of the stroboscopic map. The cycle
is tried first, as its basin is far wider. It counts once a run from it shows the same events. If that run
does not, and comes no nearer to closing, the single step is taken, halved until the run comes nearer. If it
does not soon, as among the grazings that a chatter is made of, the motion is followed for another n periods, and all
begins again at their end.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals, Scalar
from .._jax.xla import is_any
from .._machine.machine import OWN_BOUND
from .._machine.numbers import MachineNumbers
from .._system.waves import phase_at
from .._trajectory.loop import NO_PAUSE, LoopArguments
from .._trajectory.single_call import CallSettings, run_for_log, run_single_call
from .._trajectory.solution import RESULTS, Solution
from .candidate_cycle import Cycle, cycle_by_map, cycle_by_sequence
from .cycle import Problem, Unknowns, prepared
from .newton import size_of
from .rigid_modes import free_shifts
from .sequence import NOTHING, Sequence, happens_alike, nothing_happens, sequence_of

# The most runs of a search, and how small a fraction of a step is tried.
MAX_RUNS = 40
_LEAST = 0.05
# Closing error of a closed run, relative to the size of the motion; how near to a cycle a run begins on it.
_CLOSE, _STILL = {"float64": 1e-9, "float32": 1e-4}, {"float64": 1e-12, "float32": 1e-5}


class Search(eqx.Module):
    """What is known.

    Attributes:
        trial: the start of the next run, in space, (2 n,).
        base: the start from which steps are taken, (2 n,).
        step: the Newton step from there, (2 n,).
        end: where the run from the base ended, (2 n,).
        factor: part of the step that is tried next, 0 if nothing is left to try.
        closing: how far the run from the base was from closing.
        cycle: the last one found.
        has_cycle: whether there is one.
        is_orbit: whether the machine follows it.
        is_full: whether the last run had more events than there is room for.
        num_runs: runs so far.
    """

    trial: Float[Array, " state"]
    base: Float[Array, " state"]
    step: Float[Array, " state"]
    end: Float[Array, " state"]
    factor: Scalar
    closing: Scalar
    cycle: Cycle
    has_cycle: Bool[Array, ""]
    is_orbit: Bool[Array, ""]
    is_full: Bool[Array, ""]
    num_runs: Int[Array, ""]

    @property
    def is_on(self) -> Reals:
        """Whether there is anything left to try."""
        return ~(self.is_orbit | self.is_full) & (self.num_runs < MAX_RUNS) & (self.factor > 0)


def begin_search(guess: Float[Array, " state"], num_stops: int, room: int) -> Search:
    """A search from a guess, with room for so many events."""
    zero, no = jnp.zeros((), guess.dtype), jnp.array(False)
    unknowns = Unknowns(guess, jnp.zeros(room, guess.dtype))
    cycle = Cycle(guess, unknowns, nothing_happens(room, num_stops), guess + 0j, zero + jnp.inf)
    start, still = (guess, guess), (jnp.zeros_like(guess), guess)
    return Search(*start, *still, zero + 1, zero + jnp.inf, cycle, no, no, no, jnp.array(0))


def with_room(search: Search, room: int) -> Search:
    """A search of one lane, with room for more events."""
    more = room - len(search.cycle.unknowns.flights)
    sequence = search.cycle.sequence
    longer = Sequence(
        kind=jnp.pad(sequence.kind, (0, more), constant_values=NOTHING),
        stop=jnp.pad(sequence.stop, (0, more)),
        held=jnp.pad(sequence.held, ((0, more), (0, 0)), mode="edge"),
    )
    flights = jnp.pad(search.cycle.unknowns.flights, (0, more))
    return eqx.tree_at(lambda s: (s.cycle.sequence, s.cycle.unknowns.flights), search, (longer, flights))


class Strobe(eqx.Module):
    """The map of a machine over n forcing periods, from a phase of the load on.

    Attributes:
        numbers: of the machine.
        flow: its motion.
        num_periods: n.
        phase: where it begins, in forcing periods.
        room: for how many events there is room.
    """

    numbers: MachineNumbers
    flow: AbstractFlow
    num_periods: Reals
    phase: Reals
    room: int = eqx.field(static=True)

    @property
    def period(self) -> Reals:
        """The forcing period."""
        return 2 * jnp.pi / self.numbers.frequency

    @property
    def t0(self) -> Reals:
        """When it begins."""
        return self.phase * self.period

    def request(self, z: Float[Array, " state"]) -> LoopArguments:
        """To follow the motion from a state in space."""
        x, v = jnp.split(z, 2)
        t1 = self.t0 + self.num_periods * self.period
        return LoopArguments(
            t0=self.t0,
            t1=t1,
            x0=x,
            v0=v,
            goals=t1[None],
            num_goals=np.asarray(1),
            is_last=np.asarray(True),
            max_steps=np.asarray(OWN_BOUND),
            max_events=np.asarray(self.room),
            max_turns=np.asarray(NO_PAUSE),
            is_sound=jnp.all(jnp.isfinite(z)),
        )

    def follow(self, z: Float[Array, " state"]) -> Solution:
        """The motion from a state, differentiable."""
        asked = CallSettings(self.room, can_stick=True, max_reverse_steps=65_536, raises=False)
        return run_single_call(self.numbers, self.flow, self.request(z), asked)

    def end(self, z: Float[Array, " state"]) -> Float[Array, " state"]:
        """Where the motion from a state ends."""
        sol = self.follow(z)
        return jnp.concatenate([sol.x1, sol.v1])


class Run(NamedTuple):
    """What a run showed.

    Attributes:
        problem: the equations of its events.
        start: where it began, in space, (2 n,).
        flights: the durations of its flights, in forcing periods, (events,).
        closing: how far it was from closing, relative to the size of the motion.
        end: where it ended, in space, (2 n,).
    """

    problem: Problem
    start: Array
    flights: Array
    closing: Scalar
    end: Array


def search_step(strobe: Strobe, search: Search) -> Search:
    """Follow the motion from the trial, and update the search."""
    log, result, end = run_for_log(
        strobe.numbers, strobe.flow, strobe.request(search.trial), room=strobe.room, can_stick=True
    )
    machine, flow = prepared(strobe.numbers, strobe.flow, strobe.num_periods)
    sequence, flights = sequence_of(log, strobe.t0, machine.period)
    problem = Problem(machine, flow, sequence, strobe.num_periods, strobe.phase, free_shifts(strobe.numbers))
    size = size_of(problem, search.trial)
    is_whole = result == RESULTS.successful
    closing = jnp.where(is_whole, jnp.max(jnp.abs(end - search.trial) / size), jnp.inf)
    run = Run(problem, search.trial, flights, closing, end)
    is_orbit = is_whole & search.has_cycle & _is_followed(search.cycle, search.cycle.start, run, _CLOSE)
    search = eqx.tree_at(
        lambda s: (s.is_orbit, s.is_full, s.num_runs),
        search,
        (is_orbit, result == RESULTS.max_events_reached, search.num_runs + 1),
    )
    # Most lanes of a batch become orbits in the same run.
    return jax.lax.cond(is_any(~is_orbit), lambda: _next(strobe, run, search), lambda: search)


def _next(strobe: Strobe, run: Run, search: Search) -> Search:
    """The search with its next trial, unless the run from the last was an orbit."""
    problem, end, closing = run.problem, run.end, run.closing
    is_nearer = closing < search.closing
    # What comes no nearer is not used: in a batch, no other lane waits until its equations are given up.
    kind = jnp.where(is_nearer & ~search.is_orbit, problem.sequence.kind, NOTHING)
    problem = eqx.tree_at(lambda p: p.sequence.kind, problem, kind)
    away = away_from_stops(problem)
    guess = Unknowns(search.trial + away, run.flights)
    if strobe.flow.has_flow_map:
        cycle, entry, first, is_converged = cycle_by_sequence(problem, guess)
    else:
        jacobian = jax.jacfwd(strobe.end)(search.trial)
        cycle, entry, first, is_converged = cycle_by_map(problem, guess, end + away, jacobian)
    cycle = eqx.tree_at(lambda c: c.start, cycle, cycle.start - away)
    # Nothing closes where a stop holds its mass at one end of the run alone: the next run begins where this one ended.
    # (Its bounces would vanish into the start of the cycle, and be there as impacts without speed.)
    held = problem.sequence.held
    is_open = jnp.any(held[0] != held[-1])
    first = jnp.where(is_open, end - search.trial, first)
    is_found = is_nearer & is_converged & ~is_open
    # A run that began on the cycle itself, as one from where a sweep has settled, needs no other.
    is_orbit = search.is_orbit | (is_found & _is_followed(cycle, entry - away, run, _STILL))
    known = (search.trial, search.base), (first, search.step), (end, search.end)
    base, step, end = (jnp.where(is_nearer, *pair) for pair in known)
    factor = jnp.where(is_nearer, 1.0, search.factor)
    is_stuck, is_lost = factor < _LEAST, ~is_nearer & jnp.isinf(search.closing)
    trial = jnp.where(is_found, entry - away, jnp.where(is_stuck, end, base + factor * step))
    following = Search(
        trial=_inside(problem, trial + away) - away,
        base=base,
        step=step,
        end=end,
        factor=jnp.where(is_found | is_stuck, 1.0, jnp.where(is_lost, 0.0, factor / 2)),
        closing=jnp.where(is_stuck, jnp.inf, jnp.where(is_nearer, closing, search.closing)),
        cycle=jax.tree.map(lambda a, b: jnp.where(is_found, a, b), cycle, search.cycle),
        has_cycle=search.has_cycle | is_found,
        is_orbit=is_orbit,
        is_full=search.is_full,
        num_runs=search.num_runs,
    )
    return jax.tree.map(lambda a, b: jnp.where(search.is_orbit, a, b), search, following)


def _is_followed(cycle: Cycle, start: Array, run: Run, near: dict[str, float]) -> Bool[Array, ""]:
    """Whether a run that began near the start of a cycle went once round it."""
    size = size_of(run.problem, run.start)
    # A run leaves an unstable orbit, by growing rounding errors.
    growth = jnp.max(jnp.where(jnp.isfinite(cycle.multipliers), jnp.abs(cycle.multipliers), 1))
    is_from_it = jnp.max(jnp.abs(run.start - start) / size) < near[str(size.dtype)]
    is_alike = happens_alike(cycle.sequence, cycle.unknowns.flights, run.problem.sequence, run.flights)
    return is_from_it & is_alike & (run.closing < _CLOSE[str(size.dtype)] * jnp.maximum(growth, 1))


def away_from_stops(problem: Problem) -> Array:
    """The start as seen from the stops less the start in space."""
    machine = problem.machine
    nothing = jnp.zeros_like(machine.mean)
    phase = phase_at(2 * jnp.pi * problem.phase, machine.waves.num_harmonics)
    return jnp.concatenate(machine.seen_from_stops(phase, nothing, nothing))


def _inside(problem: Problem, z: Array) -> Array:
    """A start as seen from the stops, brought back to the stops that it lies beyond."""
    contacts = problem.machine.contacts
    x, v = jnp.split(z, 2)
    phase = phase_at(2 * jnp.pi * problem.phase, problem.machine.waves.num_harmonics)
    return jnp.concatenate([contacts.placed(x, contacts.gaps(x, phase) < 0, phase), v])
