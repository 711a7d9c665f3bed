"""Kernels: the compiled functions of a cycle that branches request, batched over many branches."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Scalar, with_rows_first, with_rows_last
from .._jax.packing import Packed, pack
from .._machine.numbers import numbers_of
from .._orbits.autonomous import after_last_event, from_middle, start_in_middle
from .._orbits.cycle import Moment, Problem, moved_by, state_at, traverse
from .._orbits.search import StroboscopicMap, frame_offset
from .._orbits.sequence import Instants, Sequence, is_same_sequence, sequence_of
from .._trajectory.loop import Choices
from .._trajectory.results import RESULTS
from .._trajectory.single_call import run_for_log
from .admissibility import Margins, margins_at, margins_of_cycle
from .batch_corrector import can_correct_many, correct_many
from .batch_margins import margins_of_cycles, rates_of_cycles
from .batch_moments import moments_of_cycles
from .corrector import Corrected, correct, evaluate_at
from .margin_scan import LeastMargins
from .multiplier_functions import of_neighbours
from .padding import room_of_log
from .parameter_family import ExtendedCycle, ParameterFamily

# Length of `CorrectedCycle.past`.
PAST = 5


class CorrectedCycle(NamedTuple):
    """A corrected cycle.

    Attributes:
        found: the cycle.
        watched: its margins between events.
        rates: of the margins along the branch.
        start: its start in space, (2 n,).
        neighbours: functions of it that vanish beside others, see `of_neighbours`, (4,).
        past: those of the point from which a step led here, and the length of the step; NaN if none did.
    """

    found: Corrected
    watched: LeastMargins
    rates: Margins
    start: Float[Array, " state"]
    neighbours: Float[Array, " functions"]
    past: Float[Array, " past"]


class SimulatedMotion(NamedTuple):
    """Motion of the machine started on a cycle.

    Attributes:
        is_alike: True if it has the events of the cycle at the same times, except for the last bounces of a chatter.
        sequence: its events.
        flights: durations, in forcing periods.
        z: its start, scaled, relative to the stops, (2 n,).
    """

    is_alike: Bool[Array, ""]
    sequence: Sequence
    flights: Float[Array, " events"]
    z: Float[Array, " state"]


def corrected_cycle(
    family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle, weights: ExtendedCycle, target: Scalar
) -> CorrectedCycle:
    """The cycle of a sequence with `weights . place = target`."""
    found, course = correct(family, sequence, guess, weights, target)
    place, tangent = _place_of(found, guess), found.tangent
    rates = course.rates(jnp.append(tangent.z, tangent.p), tangent.flights, family.scale)
    moments = (course.begins, found.speeds), rates
    equations = CycleEquations.of(family, sequence, place)
    watched = margins_of_cycle(equations.problem, family.unknowns(place), course.begins)
    return _with_rates(family, equations, found, place, moments, watched)


def corrected_cycles(
    families: ParameterFamily,
    sequences: Sequence,
    guesses: ExtendedCycle,
    weights: ExtendedCycle,
    targets: Array,
) -> CorrectedCycle:
    """`corrected_cycle` of many branches, along the first axis."""
    given = families, sequences, guesses, weights, targets
    if not can_correct_many(families):
        return jax.vmap(corrected_cycle)(*given)
    try:
        with jax.numpy_rank_promotion("allow"):  # numbers of all lanes go with those of each
            found = with_rows_first(correct_many(*with_rows_last(given)))
            places = jax.vmap(_place_of)(found, guesses)
            moments = moments_of_cycles(families, sequences, places, found.tangent)
        watched = margins_of_cycles(families, sequences, places, moments[0].begins)
        own = families, sequences, places, found.tangent.p, moments, watched
        is_plain = watched.gap.shape[1] and sequences.num_groups == 1
        moved = rates_of_cycles(*own) if is_plain else jax.vmap(_rates_along)(*own)
    except NotImplementedError:  # a law of restitution may be made of anything
        return jax.vmap(corrected_cycle)(*given)
    starts = jax.vmap(_start_of)(families, sequences, places)
    past = jnp.full((len(starts), PAST), jnp.nan, starts.dtype)
    return CorrectedCycle(found, watched, moved, starts, jax.vmap(of_neighbours)(found), past)


def _place_of(found: Corrected, guess: ExtendedCycle) -> ExtendedCycle:
    """The corrected place, or the guess where it is none."""
    return jax.tree.map(lambda a, b: jnp.where(found.is_converged, a, b), found.place, guess)


def as_corrected_cycle(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, tangent: ExtendedCycle
) -> CorrectedCycle:
    """A given cycle as a corrected one, at a point where Newton's method along the branch is singular."""
    found = evaluate_at(family, sequence, place, tangent)
    equations = CycleEquations.of(family, sequence, place)
    moments = _moments(family, equations, found, place)
    watched = margins_of_cycle(equations.problem, family.unknowns(place), moments[0][0])
    return _with_rates(family, equations, found, place, moments, watched)


class CycleEquations(NamedTuple):
    """Equations of a cycle, linear in the parameter."""

    problem: Problem
    change: Any
    p: Scalar

    @classmethod
    def of(cls, family: ParameterFamily, sequence: Sequence, place: ExtendedCycle) -> "CycleEquations":
        """The equations at the parameter of a cycle."""
        return cls(*family.linear_problem(sequence, place.p), place.p)

    def at(self, p: Scalar) -> Problem:
        """The equations at a parameter."""
        own = self.problem.machine, self.problem.flow
        machine, flow = moved_by(own, self.change, p - self.p)
        return eqx.tree_at(lambda problem: (problem.machine, problem.flow), self.problem, (machine, flow))


# Moments at which the flights of a cycle begin, with the approach speeds at their ends; and their rates along the branch.
_Moments = tuple[tuple[Moment, Array], tuple[Moment, Array]]


def _moments(
    family: ParameterFamily, equations: CycleEquations, found: Corrected, place: ExtendedCycle
) -> _Moments:
    count = jnp.sum(equations.problem.sequence.is_event)

    def moments_at(at: ExtendedCycle) -> tuple[Moment, Array]:
        return traverse(equations.at(at.p), family.unknowns(at), count)

    return jax.jvp(moments_at, (place,), (found.tangent,))


def _with_rates(
    family: ParameterFamily,
    equations: CycleEquations,
    found: Corrected,
    place: ExtendedCycle,
    moments: _Moments,
    watched: LeastMargins,
) -> CorrectedCycle:
    """The corrected cycle with its margins, and their rates along the branch."""
    rates = _rates_at(equations, place.p, found.tangent.p, moments, watched)
    start = _start_in_space(family, equations.problem, place)
    past = jnp.full(PAST, jnp.nan, start.dtype)
    return CorrectedCycle(found, watched, rates, start, of_neighbours(found), past)


def _rates_at(
    equations: CycleEquations, p: Scalar, along: Scalar, moments: Any, watched: LeastMargins
) -> Margins:
    """Rates of margins, from moments and their rates and from the rate of the parameter."""

    def levels_at(moments: Any, p: Scalar) -> Margins:
        begins, speeds = moments
        return margins_at(equations.at(p), begins, speeds, watched)

    now, rates = moments
    return jax.jvp(levels_at, (now, p), (rates, along))[1]


def _rates_along(
    family: ParameterFamily,
    sequence: Sequence,
    place: ExtendedCycle,
    along: Scalar,
    moments: Any,
    watched: LeastMargins,
) -> Margins:
    return _rates_at(CycleEquations.of(family, sequence, place), place.p, along, moments, watched)


def _start_in_space(family: ParameterFamily, problem: Problem, place: ExtendedCycle) -> Array:
    unknowns = family.unknowns(place)
    start = start_in_middle(problem, unknowns) if family.is_autonomous else unknowns.z
    return start - frame_offset(problem)


def _start_of(family: ParameterFamily, sequence: Sequence, place: ExtendedCycle) -> Array:
    return _start_in_space(family, family.problem(sequence, place.p), place)


class Begun(NamedTuple):
    """Start and length of a run.

    Attributes:
        start: its start in space, (2 n,).
        length: its length, in forcing periods.
    """

    start: Float[Array, " state"]
    length: Scalar


def simulate_motion(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, start: Float[Array, " state"]
) -> SimulatedMotion:
    """Simulate the machine from a start in space, or from the start of a cycle where that is NaN."""
    begun = begin_motion(family, sequence, place, start)
    numbers, room = numbers_of(family.system_at(place.p)), room_of_log(len(sequence.kind))
    strobe = StroboscopicMap(numbers, family.flow, begun.length, family.phase, room)
    choices = Choices(can_stick=True, room=room)
    log, result, _ = run_for_log(numbers, family.flow, strobe.request(begun.start), choices)
    return read_motion(family, sequence, place, begun, Instants.of(log), result == RESULTS.successful)


def begin_motion(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, start: Float[Array, " state"]
) -> Begun:
    """The run of `simulate_motion`.

    Where no load sets the period, it begins in the middle of the first flight, and lasts as long as the cycle; from a start in
    space alone a unit of time.
    """
    problem, unknowns = family.problem(sequence, place.p), family.unknowns(place)
    if not family.is_autonomous:
        start = jnp.where(jnp.isnan(start), unknowns.z - frame_offset(problem), start)
        return Begun(start, jnp.asarray(family.num_periods))
    known = jnp.sum(place.flights)
    start = jnp.where(jnp.isnan(start), start_in_middle(problem, unknowns), start)
    return Begun(start, jnp.where(known > 0, known, family.num_periods))


class RunRequest(NamedTuple):
    """A run of a machine.

    Attributes:
        machine: its numbers and its flow, packed, see `KnownMachine`.
        begun: where it begins, and how long it is.
        times: at its start and its end, (2,).
    """

    machine: Packed
    begun: Begun
    times: Float[Array, "2"]


def run_of(family: ParameterFamily, cycle: CorrectedCycle) -> RunRequest:
    """The run from a corrected cycle, with the numbers of `begin_motion`."""
    known = jnp.sum(cycle.found.place.flights)
    length = jnp.asarray(family.num_periods)
    length = jnp.where(known > 0, known, length) if family.is_autonomous else length
    return _asked(family, cycle.found.place.p, Begun(cycle.start, length))


def run_from(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, start: Float[Array, " state"]
) -> RunRequest:
    """The run of `simulate_motion`."""
    return _asked(family, place.p, begin_motion(family, sequence, place, start))


def _asked(family: ParameterFamily, p: Scalar, begun: Begun) -> RunRequest:
    numbers = numbers_of(family.system_at(p))
    strobe = StroboscopicMap(numbers, family.flow, begun.length, family.phase, 0)
    times = jnp.stack([strobe.t0, strobe.t0 + begun.length * strobe.period])
    return RunRequest(pack((numbers, family.flow)), begun, times)


def read_motion(
    family: ParameterFamily,
    sequence: Sequence,
    place: ExtendedCycle,
    begun: Begun,
    instants: Instants,
    is_successful: Bool[Array, ""],
) -> SimulatedMotion:
    """The motion of a run, from its instants."""
    numbers, room = numbers_of(family.system_at(place.p)), len(sequence.kind)
    strobe = StroboscopicMap(numbers, family.flow, begun.length, family.phase, room)
    whole, flights = sequence_of(instants, strobe.t0, strobe.period, numbers)
    other = Sequence(whole.kind[:room], whole.stop[:room], whole.mode[: room + 1])
    is_whole, flights = is_successful & (jnp.sum(whole.is_event) <= room), flights[:room]
    if not family.is_autonomous:
        is_alike = is_same_sequence(sequence, place.flights, other, flights)
        z = begun.start + frame_offset(family.problem(sequence, place.p))
        return SimulatedMotion(is_whole & is_alike, other, flights, z / family.scale)
    is_alike = is_same_sequence(sequence, from_middle(family.unknowns(place)).flights, other, flights)
    z, flights = after_last_event(family.problem(other, place.p), begun.start, flights, begun.length)
    return SimulatedMotion(is_whole & is_alike, other, flights, z / family.scale)


def locate_state(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, time: Scalar
) -> Float[Array, " state"]:
    """Scaled state of a cycle `time` forcing periods after its start, (2 n,)."""
    return state_at(family.problem(sequence, place.p), family.unknowns(place), time) / family.scale
