"""Periodic orbits of machines that no load drives: self-excited cycles, whose period is unknown.

A clock, a mass on a belt, a wheel that shimmies: the machine sets its own pace. Its motion between events is linear, so every
isolated cycle has events, and it is described as beginning right after one of them, see `Problem.is_autonomous`. The durations
of the flights add up to the period, and no phase is left to choose: the equations are as many as the unknowns, those of a
driven cycle but for the flight that closes it. Rejected: the period as one more unknown with a phase condition, which needs
another equation in every linear solve.

The pencil of such a cycle is that of the return to the section of its last event. It has the multipliers of the cycle, with a
zero in place of the 1 of the direction along it. `with_phase` puts that back.

The search: run from the guess, find two flights between the same events with almost the same state in their middle, and apply
Newton's method to the cycle between the two. A run over one period from the cycle that it finds decides whether it is followed.
Public orbits begin in the middle of a flight, where no rounding decides which events a run shows.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._flow.interface import AbstractFlow
from .._flow.taylor import TaylorFlow
from .._hybrid.limits import IMPACT
from .._jax.arrays import Scalar
from .._jax.concrete import check_values, concrete, is_staged, stop_gradients
from .._jax.xla import compile_derivatives_lightly, compile_lightly, compile_quickly
from .._machine.numbers import numbers_of
from .._system.forcing import Harmonic
from .._system.periodicity import refuse_without_period
from .._system.system import ImpactSystem
from .._trajectory.event_log import EventLog
from .._trajectory.loop import Choices
from .._trajectory.results import RESULTS
from .._trajectory.simulate import simulate
from .._trajectory.single_call import run_for_log
from .._trajectory.solution import Solution
from .candidate_cycle import multipliers_of
from .cycle import Problem, Unknowns, log_of_cycle, prepared, progression_of, residual, state_at, traverse
from .find import OrbitSolution
from .newton import implicit_orbit, pencil_of, polish, scale_of
from .orbit import ORBIT_RESULTS
from .rigid_modes import free_drifts, free_shifts, num_of
from .search import StroboscopicMap
from .sequence import Instants, Sequence, is_same_sequence, num_stops_of, sequence_of

# Distance of two states in the middle of flights, relative to the motion, below which the motion nearly repeats.
_NEARLY = 0.05
# First span of the run from the guess, in time scales of the machine; it grows by `_LONGER` until the motion repeats.
_FIRST, _LONGER, _MOST_SPANS = 64.0, 4.0, 7
_MOST_TRIALS = 6
# Distance by which a run over one period may miss its start, relative to the motion.
_CLOSE = 1e-9


class _Found(NamedTuple):
    """A cycle that Newton's method found, with a time unit near its period.

    Attributes:
        sequence: its events, the last of which begins it.
        unknowns: the state after that event, and the durations of the flights, in units.
        is_cycle: true if Newton's method converged.
        is_orbit: true if the machine follows it.
    """

    sequence: Sequence
    unknowns: Unknowns
    is_cycle: Bool[Array, ""]
    is_orbit: Bool[Array, ""]


def is_undriven(system: ImpactSystem) -> bool:
    """True if no load sets a period: its frequency is 0, and known."""
    refuse_without_period(system)
    frequency = concrete(check_values(system.forcing.frequency))
    return frequency is not None and not frequency > 0


def with_unit(system: ImpactSystem, unit: float | Array) -> ImpactSystem:
    """A machine that nothing drives with a forcing period all the same, the unit of time of its equations."""
    constant = sum(
        load.mean + jnp.sum((load.amplitude * jnp.cos(load.phase)).reshape(-1, len(load.mean)), axis=0)
        for load in system.forcing.loads
        if isinstance(load, Harmonic)
    )
    return eqx.tree_at(
        lambda s: s.forcing, system, Harmonic(jnp.zeros_like(constant), 2 * np.pi / unit, mean=constant)
    )


def autonomous_orbit(
    system: ImpactSystem,
    start: tuple[Array, Array],
    flow: AbstractFlow | None,
    room: int,
) -> tuple[OrbitSolution, Scalar]:
    """The cycle near a guess, and its period.

    Args:
        system: the machine, its force bound.
        start: positions and velocities of the guess.
        flow: the flow; a Taylor series if left out.
        room: maximum number of events of a cycle.
    """
    _refuse(system, flow)
    still = stop_gradients(system)
    motion, end = flow or TaylorFlow(), None
    for guess, unit in _repetitions(still, start, flow, room):
        strobe = _strobe(with_unit(still, unit), motion, room)
        found = _cycle_from(strobe, guess)
        if end is None or found.is_cycle:
            end = found, unit
        if found.is_orbit:
            break
    if end is None:
        return _no_orbit(system, start, room), jnp.asarray(jnp.nan)
    found, unit = end
    strobe = _strobe(with_unit(system, unit), motion, room)
    solution, periods = _solution_of(strobe, found)
    return solution, periods * unit


def _refuse(system: ImpactSystem, flow: AbstractFlow | None) -> None:
    if is_staged():
        raise ValueError(
            "The cycle of a machine without load is found outside of `jax.jit`: its period is not known."
        )
    if system.hysteresis:
        raise ValueError(
            "Cycles of machines without load are found for machines without `hysteresis`: follow this one by `vx.simulate`, or "
            "drive it by a load."
        )
    if system.force is not None or (flow is not None and not flow.has_flow_map):
        raise ValueError(
            "Cycles of machines without load are found for linear motion between events: this one has a `force`. Follow it "
            "by `vx.simulate`."
        )
    for j, stop in enumerate(system.stops):
        if stop.motion is not None and np.any(np.asarray(stop_gradients(stop.motion.amplitude))):
            raise ValueError(
                f"`stops[{j}]` moves, but the load has no frequency: give the load that of the stop, and amplitudes 0."
            )


def _strobe(system: ImpactSystem, flow: AbstractFlow, room: int) -> StroboscopicMap:
    return StroboscopicMap(numbers_of(system), flow, jnp.asarray(1.0), jnp.asarray(0.0), room)


def _repetitions(
    system: ImpactSystem, start: tuple[Array, Array], flow: AbstractFlow | None, room: int
) -> list[tuple[Array, float]]:
    """States after which the motion from a guess nearly repeats, and the time until it does."""
    rate = float(simulate(system, 0.0, 0.0, *start, flow=flow).machine.rate)
    span = _FIRST / rate if np.isfinite(rate) and rate > 0 else _FIRST
    for _ in range(_MOST_SPANS):
        sol = simulate(system, 0.0, span, *start, flow=flow, max_events=4 * room, throw=False)
        found = _repetitions_in(sol)
        if found or sol.result != RESULTS.successful:
            return found
        span = span * _LONGER
    return []


def _repetitions_in(sol: Solution) -> list[tuple[Array, float]]:
    """Pairs of flights between the same events, with nearly the same state in their middle.

    First the earliest pair, near the guess, then the latest ones, where the motion has settled.
    """
    num = int(sol.num_events)
    t = np.asarray(sol.events.t)[:num]
    t = t[t < float(sol.known_until)]
    if len(t) < 3:
        return []
    kinds = np.stack([np.asarray(sol.events.kind), np.asarray(sol.events.stop)])[:, : len(t)]
    middle, length = (t[1:] + t[:-1]) / 2, np.diff(t)
    z = np.concatenate(
        [np.asarray(a) for a in sol.evaluate(np.concatenate([middle, t[:-1] + length / 4]))], axis=1
    )
    size, z = np.ptp(z, axis=0), z[: len(middle)]
    size = np.maximum(size, 1e-3 * size.max())
    pairs = []
    for i in range(len(middle)):
        is_alike = (kinds[:, i + 1 : -1] == kinds[:, i, None]) & (kinds[:, i + 2 :] == kinds[:, i + 1, None])
        far = (np.abs(z[i + 1 :] - z[i]) / np.where(size > 0, size, 1)).max(axis=1)
        near = np.flatnonzero(is_alike.all(axis=0) & (far < _NEARLY))
        if near.size:
            pairs.append((i, i + 1 + int(near[0])))
    chosen = dict.fromkeys([*pairs[:1], *pairs[::-1][: _MOST_TRIALS - 2], *pairs[1:2]])
    found = []
    for i, j in chosen:
        k = i + int(np.argmax(length[i:j]))  # begin in the longest flight
        found.append((jnp.asarray(z[k]), float(middle[j] - middle[i])))
    return found


def _cycle_from(strobe: StroboscopicMap, guess: Float[Array, " state"]) -> _Found:
    """The cycle of the events of a run over one unit, and whether a run over its period shows the same ones."""
    found = _newton(strobe, _run(strobe, guess, jnp.asarray(1.0)))
    if not found.is_cycle:
        return found
    middle = _middle(strobe, found)
    return found._replace(is_orbit=_is_followed(strobe, found, middle, _run(strobe, middle.z, middle.length)))


class _UnforcedRun(NamedTuple):
    """A run: its start and end, its events and the durations of its flights."""

    start: Array
    end: Array
    sequence: Sequence
    flights: Array


class _Middle(NamedTuple):
    """The state in the middle of the first flight of a cycle, its period, its progression and largest multiplier."""

    z: Array
    length: Scalar
    progression: Array
    growth: Scalar


@compile_lightly
def _run(strobe: StroboscopicMap, start: Float[Array, " state"], length: Scalar) -> _UnforcedRun:
    """Run over a length, in units."""
    strobe = eqx.tree_at(lambda s: s.num_periods, strobe, length)
    choices = Choices(can_stick=True, room=strobe.room)
    log, _, end = run_for_log(strobe.numbers, strobe.flow, strobe.request(start), choices)
    return _UnforcedRun(start, end, *sequence_of(Instants.of(log), strobe.t0, strobe.period, strobe.numbers))


@compile_quickly
def _newton(strobe: StroboscopicMap, run: _UnforcedRun) -> _Found:
    """The cycle of the events of a run over one unit, by Newton's method."""
    sequence, flights = run.sequence, run.flights
    count = jnp.sum(sequence.is_event)
    problem = _problem(strobe, sequence)
    polished = polish(problem, Unknowns(*after_last_event(problem, run.start, flights, jnp.ones(()))))
    durations = polished.unknowns.flights
    is_ordered = jnp.all((durations > -_CLOSE) | ~sequence.is_event) & (jnp.sum(durations) > 0)
    is_cycle = polished.is_converged & is_ordered & (count > 0)
    return _Found(sequence, polished.unknowns, is_cycle, jnp.array(False))


@compile_quickly
def _middle(strobe: StroboscopicMap, found: _Found) -> _Middle:
    problem, unknowns = _problem(strobe, found.sequence), found.unknowns
    multipliers = jnp.abs(multipliers_of(problem, pencil_of(problem, unknowns)))
    growth = jnp.max(jnp.where(jnp.isfinite(multipliers), multipliers, 1))
    z = start_in_middle(problem, unknowns)
    return _Middle(z, jnp.sum(unknowns.flights), progression_of(problem, unknowns), growth)


@compile_quickly
def _is_followed(
    strobe: StroboscopicMap, found: _Found, middle: _Middle, run: _UnforcedRun
) -> Bool[Array, ""]:
    """True where a run from the middle of the first flight shows the events of the cycle and closes."""
    flights = from_middle(found.unknowns).flights
    is_alike = is_same_sequence(found.sequence, flights, run.sequence, run.flights)
    displaced = jnp.concatenate([middle.progression, 0 * middle.progression])
    size = scale_of(_problem(strobe, found.sequence), middle.z)
    closing = jnp.max(jnp.abs(run.end - run.start - displaced) / size)
    return is_alike & (closing < _CLOSE * middle.growth)


def _problem(strobe: StroboscopicMap, sequence: Sequence) -> Problem:
    machine, flow = prepared(strobe.numbers, strobe.flow, strobe.num_periods)
    shifts = free_shifts(strobe.numbers), free_drifts(strobe.numbers)
    return Problem(machine, flow, sequence, strobe.num_periods, strobe.phase, *shifts, is_autonomous=True)


def start_in_middle(problem: Problem, unknowns: Unknowns) -> Float[Array, " state"]:
    """State in the middle of the first flight."""
    return state_at(problem, unknowns, jnp.sum(unknowns.flights[:1]) / 2)


def from_middle(unknowns: Unknowns) -> Unknowns:
    """The cycle with the durations of one that begins in the middle of its first flight."""
    return unknowns._replace(flights=unknowns.flights.at[:1].divide(2))


def after_last_event(
    problem: Problem, start: Float[Array, " state"], flights: Float[Array, " events"], length: Scalar
) -> tuple[Float[Array, " state"], Float[Array, " events"]]:
    """State after the last event of a run from the middle of a flight, and the durations of the flights from there.

    Args:
        problem: the equations of the events of the run.
        start: its start.
        flights: durations of its flights.
        length: its length, about a period.
    """
    count = jnp.sum(problem.sequence.is_event)
    begins = traverse(problem, Unknowns(start, flights), count)[0]
    return begins.z[count], flights.at[:1].add(length - jnp.sum(flights))


def log_and_progression(
    problem: Problem, unknowns: Unknowns, room: int
) -> tuple[EventLog, Float[Array, " n"]]:
    """Log of a cycle that begins in the middle of its first flight, with room for `room` events, and its progression."""
    middle = from_middle(unknowns)._replace(z=start_in_middle(problem, unknowns))
    return log_of_cycle(problem, middle, room), progression_of(problem, unknowns)


@compile_derivatives_lightly
def _solution_of(strobe: StroboscopicMap, found: _Found) -> tuple[OrbitSolution, Scalar]:
    """Result for a cycle, as a function of the machine, and its period in units."""
    problem = _problem(strobe, found.sequence)
    unknowns = implicit_orbit(problem, found.unknowns)
    periods = jnp.sum(unknowns.flights)
    begin = start_in_middle(problem, unknowns)
    multipliers = multipliers_of(problem, pencil_of(problem, unknowns))
    events, progression = log_and_progression(problem, unknowns, len(unknowns.flights))
    is_impact = (events.kind == IMPACT)[:, None]
    stops = jnp.arange(num_stops_of(strobe.numbers))[None]
    x0, v0 = jnp.split(begin, 2)
    closing = residual(problem, unknowns).closing / scale_of(problem, begin)
    result = ORBIT_RESULTS.where(found.is_cycle, ORBIT_RESULTS.left_the_stops, ORBIT_RESULTS.not_converged)
    num_ones = 1 + num_of(problem.drift)
    solution = OrbitSolution(
        x0=x0,
        v0=v0,
        events=events,
        progression=progression,
        num_impacts=jnp.sum(is_impact & (events.stop[:, None] == stops), axis=0),
        multipliers=jnp.where(found.is_cycle, multipliers, jnp.nan),
        is_stable=found.is_cycle & (jnp.sum(~(jnp.abs(multipliers) < 1)) == num_ones),
        is_admissible=found.is_orbit,
        residual=jnp.max(jnp.abs(closing)),
        num_runs=jnp.array(2),
        result=ORBIT_RESULTS.where(found.is_orbit, ORBIT_RESULTS.successful, result),
    )
    return solution, periods


def _no_orbit(system: ImpactSystem, start: tuple[Array, Array], room: int) -> OrbitSolution:
    """Result for a motion that never repeats."""
    n, unknown, nothing = system.num_coordinates, jnp.full(room, jnp.nan), jnp.full(room, -1)
    return OrbitSolution(
        x0=start[0],
        v0=start[1],
        events=EventLog(unknown, nothing, nothing, unknown, unknown, unknown),
        progression=jnp.zeros(n),
        num_impacts=jnp.zeros(system.num_stops, int),
        multipliers=jnp.full(2 * n, jnp.nan + 0j),
        is_stable=jnp.array(False),
        is_admissible=jnp.array(False),
        residual=jnp.asarray(jnp.inf),
        num_runs=jnp.array(1),
        result=ORBIT_RESULTS.not_converged,
    )
