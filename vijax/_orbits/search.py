"""The search for an orbit: its state, and its update by one run of the motion.

A run of n periods from a start gives a sequence of events, and with it two possible steps. Newton's method on the
equations of that sequence (`candidate_cycle.py`) goes to the cycle of the sequence, if there is one near, even across
grazing. Its first step alone is the Newton step of the stroboscopic map. The cycle is tried first, as its basin is far
wider. It is an orbit once a run from it shows the same events. If that run does not, and comes no nearer to closing,
the single step is taken, halved until the run comes nearer. If that fails down to `_LEAST`, as among the grazing
impacts of a chatter, the motion is followed for another n periods, and the search starts again at their end. Where this
brings it no nearer to closing, the motion has settled on an orbit of more periods, and the search starts again in the middle
between the start of a run and its end: a doubled orbit lies on both sides of the one that it came from.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals, Scalar, array_namespace
from .._jax.xla import is_any
from .._machine.kinds import COMPLIANT
from .._machine.numbers import MachineNumbers
from .._machine.preparation import AUTOMATIC_MAX_STEPS
from .._system.waves import phase_at
from .._trajectory.loop import UNLIMITED_STEPS, Choices, LoopArguments
from .._trajectory.results import RESULTS
from .._trajectory.single_call import run_for_log, run_single_call, run_with_jacobian
from .._trajectory.solution import Solution
from .candidate_cycle import Cycle, cycle_by_map, cycle_by_sequence
from .cycle import Problem, Unknowns, prepared
from .newton import scale_of
from .rigid_modes import free_drifts, free_shifts, of_positions
from .sequence import (
    NOTHING,
    Instants,
    Sequence,
    effective,
    empty_sequence,
    is_same_sequence,
    sequence_of,
)

MAX_RUNS = 40  # runs of a search
_LEAST = 0.05  # smallest fraction of a step that is tried
_SETTLES = 0.9  # largest ratio of the closing errors of two starts of a motion that settles
# `_CLOSE`: largest closing error of a closed run, relative to the size of the motion.
# `_STILL`: largest distance from a cycle of the start of a run on it, likewise relative.
_CLOSE, _STILL = 1e-9, 1e-12


class Search(eqx.Module):
    """State of a search.

    Attributes:
        trial: start of the next run, in the fixed frame, (2 n,).
        base: start from which steps are taken, (2 n,).
        step: Newton step from the base, (2 n,).
        end: end of the run from the base, (2 n,).
        factor: fraction of the step to try next, 0 if nothing is left to try.
        closing: closing error of the run from the base.
        origin: start of the first run since the search began, or began again.
        arrival: end of that run.
        opening: its closing error.
        settled: that of the time before, from which the motion was followed; else infinite.
        cycle: the last cycle found.
        has_cycle: true if there is one.
        is_orbit: true if the machine follows it.
        is_full: true if the last run had more events than there is room for.
        num_runs: number of runs so far.
        last: events and jacobian of the last run, see `FollowedMap`; None where nobody reads them.
    """

    trial: Float[Array, " state"]
    base: Float[Array, " state"]
    step: Float[Array, " state"]
    end: Float[Array, " state"]
    factor: Scalar
    closing: Scalar
    origin: Float[Array, " state"]
    arrival: Float[Array, " state"]
    opening: Scalar
    settled: Scalar
    cycle: Cycle
    has_cycle: Bool[Array, ""]
    is_orbit: Bool[Array, ""]
    is_full: Bool[Array, ""]
    num_runs: Int[Array, ""]
    last: Any = None

    @property
    def is_on(self) -> Reals:
        """True while there is something left to try."""
        return ~(self.is_orbit | self.is_full) & (self.num_runs < MAX_RUNS) & (self.factor > 0)


def begin_search(guess: Float[Array, " state"], kinds: tuple[int, ...], room: int) -> Search:
    """A search from a guess, with room for `room` events of elements of some kinds."""
    zero, no = jnp.zeros((), guess.dtype), jnp.array(False)
    unknowns = Unknowns(guess, jnp.zeros(room, guess.dtype))
    cycle = Cycle(
        guess,
        unknowns,
        empty_sequence(room, kinds),
        guess + 0j,
        zero + jnp.inf,
    )
    never = zero + jnp.inf
    return Search(
        trial=guess,
        base=guess,
        step=jnp.zeros_like(guess),
        end=guess,
        factor=zero + 1,
        closing=never,
        origin=guess,
        arrival=guess,
        opening=never,
        settled=never,
        cycle=cycle,
        has_cycle=no,
        is_orbit=no,
        is_full=no,
        num_runs=jnp.array(0),
    )


def with_room(search: Search, room: int) -> Search:
    """A search of one lane, with more room for events."""
    more = room - len(search.cycle.unknowns.flights)
    sequence = search.cycle.sequence
    longer = Sequence(
        kind=jnp.pad(sequence.kind, (0, more), constant_values=NOTHING),
        stop=jnp.pad(sequence.stop, (0, more)),
        mode=jnp.pad(sequence.mode, ((0, more), (0, 0)), mode="edge"),
    )
    flights = jnp.pad(search.cycle.unknowns.flights, (0, more))
    return eqx.tree_at(lambda s: (s.cycle.sequence, s.cycle.unknowns.flights), search, (longer, flights))


class StroboscopicMap(eqx.Module):
    """The map of a machine over n forcing periods, from a phase of the load on.

    Attributes:
        numbers: numbers of the machine.
        flow: its flow.
        num_periods: n.
        phase: phase at the start, in forcing periods.
        room: maximum number of events.
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
        """Time of the start."""
        return self.phase * self.period

    def request(self, z: Float[Array, " state"]) -> LoopArguments:
        """Arguments of a run from a state in the fixed frame."""
        return run_request(self.t0, self.t0 + self.num_periods * self.period, z, self.room)

    def follow(self, z: Float[Array, " state"]) -> Solution:
        """Run from a state, differentiable."""
        return run_single_call(
            self.numbers, self.flow, self.request(z), Choices(can_stick=True, room=self.room)
        )

    def end(self, z: Float[Array, " state"]) -> Float[Array, " state"]:
        """State at the end of a run."""
        sol = self.follow(z)
        return jnp.concatenate([sol.x1, sol.v1])

    def run(self, z: Float[Array, " state"]) -> "FollowedMap":
        """Run from a state, with the derivative of its end where the flow has no flow map."""
        choices = Choices(can_stick=True, room=self.room)
        asked = self.numbers, self.flow, self.request(z), choices
        if self.flow.has_flow_map:
            log, result, end = run_for_log(*asked)
            return FollowedMap(Instants.of(log), result, end)
        solution, log, jacobian = run_with_jacobian(*asked)
        end = jnp.concatenate([solution.x1, solution.v1])
        return FollowedMap(Instants.of(log), solution.result, end, jacobian, solution.events)


def run_request(t0: Reals, t1: Reals, z: Reals, room: int) -> LoopArguments:
    """Arguments of a run between two times from a state in the fixed frame, of NumPy or of JAX."""
    library, n = array_namespace(t0, z), len(z) // 2
    return LoopArguments(
        t0=t0,
        t1=t1,
        x0=z[:n],
        v0=z[n:],
        goals=t1[None],
        num_goals=np.asarray(1),
        is_last=np.asarray(True),
        max_steps=np.asarray(AUTOMATIC_MAX_STEPS),
        max_events=np.asarray(room),
        max_turns=np.asarray(UNLIMITED_STEPS),
        is_sound=library.all(library.isfinite(z)),
    )


class FollowedMap(NamedTuple):
    """A run over n periods.

    Attributes:
        instants: its events.
        result: what became of it.
        end: its end, in the fixed frame, (2 n,).
        jacobian: the derivative of the end by the start, (2 n, 2 n); None for flows with a flow map.
        events: its log; None likewise.
    """

    instants: Instants
    result: RESULTS
    end: Float[Array, " state"]
    jacobian: Any = None
    events: Any = None


class Run(NamedTuple):
    """Result of a run.

    Attributes:
        problem: equations of its events.
        start: its start, in the fixed frame, (2 n,).
        flights: durations of its flights, in forcing periods, (events,).
        closing: closing error, relative to the size of the motion.
        end: its end, in the fixed frame, (2 n,).
        jacobian: see `FollowedMap`.
    """

    problem: Problem
    start: Array
    flights: Array
    closing: Scalar
    end: Array
    jacobian: Any


def search_step(
    strobe: StroboscopicMap,
    search: Search,
    follow: Callable[[Float[Array, " state"]], FollowedMap] | None = None,
) -> Search:
    """Run from the trial by `follow`, `strobe.run` if it is left out, and update the search."""
    followed = (follow or strobe.run)(search.trial)
    instants, result, end, jacobian, events = followed
    machine, flow = prepared(strobe.numbers, strobe.flow, strobe.num_periods)
    sequence, flights = sequence_of(instants, strobe.t0, machine.period, strobe.numbers)
    shifts = free_shifts(strobe.numbers), free_drifts(strobe.numbers)
    problem = Problem(machine, flow, sequence, strobe.num_periods, strobe.phase, *shifts)
    size = scale_of(problem, search.trial)
    if problem.drift is not None:  # ends are told up to a displacement
        end = end - of_positions(problem.drift) @ (end - search.trial)
    is_whole = result == RESULTS.successful
    closing = jnp.where(is_whole, jnp.max(jnp.abs(end - search.trial) / size), jnp.inf)
    run = Run(problem, search.trial, flights, closing, end, jacobian)
    is_orbit = is_whole & search.has_cycle & _is_traversed(search.cycle, search.cycle.start, run, _CLOSE)
    search = eqx.tree_at(
        lambda s: (s.is_orbit, s.is_full, s.num_runs),
        search,
        (is_orbit, result == RESULTS.max_events_reached, search.num_runs + 1),
    )
    if search.last is not None:
        search = eqx.tree_at(lambda s: s.last, search, (events, jacobian))
    # Most lanes of a batch become orbits in the same run.
    return jax.lax.cond(is_any(~is_orbit), lambda: _next(strobe, run, search), lambda: search)


def _next(strobe: StroboscopicMap, run: Run, search: Search) -> Search:
    """The search with its next trial, unless the last run showed an orbit."""
    problem, end, closing = run.problem, run.end, run.closing
    is_nearer = closing < search.closing
    # A run that comes no nearer is not used: without events, no other lane of a batch waits for its Newton steps.
    kind = jnp.where(is_nearer & ~search.is_orbit, problem.sequence.kind, NOTHING)
    problem = eqx.tree_at(lambda p: p.sequence.kind, problem, kind)
    away = frame_offset(problem)
    guess = Unknowns(search.trial + away, run.flights)
    if strobe.flow.has_flow_map:
        cycle, entry, first, is_converged = cycle_by_sequence(problem, guess)
    else:
        cycle, entry, first, is_converged = cycle_by_map(problem, guess, end + away, run.jacobian)
    cycle = eqx.tree_at(lambda c: c.start, cycle, cycle.start - away)
    # A run with other modes at its ends, such as a stop that holds, cannot close: the next run begins where this one ended.
    # (Its bounces would collapse into the start of the cycle, and stay there as impacts without speed.)
    mode = effective(problem.sequence.mode)
    is_open = jnp.any(mode[0] != mode[-1])
    first = jnp.where(is_open, end - search.trial, first)
    is_found = is_nearer & is_converged & ~is_open
    # A run that began on the cycle itself, such as from the settled end of a sweep, needs no second run.
    # The last run from the cycle tells its events and multipliers, if it is kept.
    is_told = search.last is None
    is_orbit = search.is_orbit | (is_told & is_found & _is_traversed(cycle, entry - away, run, _STILL))
    known = (search.trial, search.base), (first, search.step), (end, search.end)
    base, step, end = (jnp.where(is_nearer, *pair) for pair in known)
    factor = jnp.where(is_nearer, 1.0, search.factor)
    is_stuck, is_lost = factor < _LEAST, ~is_nearer & jnp.isinf(search.closing)
    is_first = jnp.isinf(search.closing) & is_nearer
    known = (search.trial, search.origin), (run.end, search.arrival), (closing, search.opening)
    origin, arrival, opening = (jnp.where(is_first, *pair) for pair in known)
    settles = opening < _SETTLES * search.settled
    afresh = jnp.where(settles, arrival, (origin + arrival) / 2)
    trial = jnp.where(is_found, entry - away, jnp.where(is_stuck, afresh, base + factor * step))
    following = Search(
        trial=_onto_stops(problem, trial + away) - away,
        base=base,
        step=step,
        end=end,
        factor=jnp.where(is_found | is_stuck, 1.0, jnp.where(is_lost, 0.0, factor / 2)),
        closing=jnp.where(is_stuck, jnp.inf, jnp.where(is_nearer, closing, search.closing)),
        origin=origin,
        arrival=arrival,
        opening=opening,
        settled=jnp.where(is_stuck & ~is_found, jnp.where(settles, opening, jnp.inf), search.settled),
        cycle=jax.tree.map(lambda a, b: jnp.where(is_found, a, b), cycle, search.cycle),
        has_cycle=search.has_cycle | is_found,
        is_orbit=is_orbit,
        is_full=search.is_full,
        num_runs=search.num_runs,
        last=search.last,
    )
    return jax.tree.map(lambda a, b: jnp.where(search.is_orbit, a, b), search, following)


def _is_traversed(cycle: Cycle, start: Array, run: Run, near: float) -> Bool[Array, ""]:
    """True where a run that began near the start of a cycle traversed it once."""
    size = scale_of(run.problem, run.start)
    # Rounding errors grow, and a run leaves an unstable orbit.
    growth = jnp.max(jnp.where(jnp.isfinite(cycle.multipliers), jnp.abs(cycle.multipliers), 1))
    is_from_it = jnp.max(jnp.abs(run.start - start) / size) < near
    is_alike = is_same_sequence(cycle.sequence, cycle.unknowns.flights, run.problem.sequence, run.flights)
    return is_from_it & is_alike & (run.closing < _CLOSE * jnp.maximum(growth, 1))


def frame_offset(problem: Problem) -> Array:
    """The start in the frame of the stops minus the start in the fixed frame."""
    machine = problem.machine
    nothing = jnp.zeros_like(machine.mean)
    phase = phase_at(2 * jnp.pi * problem.phase, machine.waves.num_harmonics)
    return jnp.concatenate(machine.relative_to_stops(phase, nothing, nothing))


def _onto_stops(problem: Problem, z: Array) -> Array:
    """A start in the frame of the stops, moved back onto the stops that it lies beyond."""
    contacts = problem.machine.contacts
    x, v = jnp.split(z, 2)
    phase = phase_at(2 * jnp.pi * problem.phase, problem.machine.waves.num_harmonics)
    is_beyond = contacts.gaps(x, phase) < 0
    if COMPLIANT in contacts.kinds:
        is_beyond = is_beyond & contacts.is_rigid
    return jnp.concatenate([contacts.with_closed_gaps(x, is_beyond, phase), v])
