"""Kernels: the compiled functions of a cycle that branches request, batched over many branches."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Scalar
from .._machine.numbers import numbers_of
from .._orbits.cycle import Unknowns, residual, state_at
from .._orbits.search import StroboscopicMap, frame_offset
from .._orbits.sequence import NOTHING, Sequence, is_same_sequence, sequence_of
from .._system.waves import phase_at
from .._trajectory.loop import Choices
from .._trajectory.single_call import run_for_log
from .._trajectory.solution import RESULTS
from .admissibility import LeastMargins, Margins, margins_at, margins_of_cycle
from .corrector import Corrected, correct, evaluate_at
from .parameter_family import ExtendedCycle, Family

# Padded numbers of events for which kernels are compiled.
_ROOMS = 16, 64, 256, 1024
# SPARE: room for bounces that a simulation has and its cycle has not.
# _STICKS: room for sticks in the log of a simulation, as a share of that for events.
SPARE, _STICKS = 4, 0.5
MOST_EVENTS = _ROOMS[-1] - SPARE


class CorrectedCycle(NamedTuple):
    """A corrected cycle, its margins between events, their rates along the branch, its start in space, (2 n,)."""

    found: Corrected
    watched: LeastMargins
    rates: Margins
    start: Float[Array, " state"]


class SimulatedMotion(NamedTuple):
    """Motion of the machine started on a cycle.

    Attributes:
        is_alike: True if it has the events of the cycle at the same times, except for the last bounces of a chatter.
        sequence: its events.
        flights: durations, in forcing periods.
    """

    is_alike: Bool[Array, ""]
    sequence: Sequence
    flights: Float[Array, " events"]


class BranchRates(NamedTuple):
    """Rates along a branch of the impact speeds, (events,), and of the gaps at a given time, (stops,)."""

    speeds: Float[Array, " events"]
    gaps: Float[Array, " stops"]


def corrected_cycle(
    family: Family, sequence: Sequence, guess: ExtendedCycle, weights: ExtendedCycle, target: Scalar
) -> CorrectedCycle:
    """The cycle of a sequence with `weights . place = target`."""
    found = correct(family, sequence, guess, weights, target)
    place = jax.tree.map(lambda a, b: jnp.where(found.is_converged, a, b), found.place, guess)
    return _seen(family, sequence, found, place)


def as_corrected_cycle(
    family: Family, sequence: Sequence, place: ExtendedCycle, tangent: ExtendedCycle
) -> CorrectedCycle:
    """A given cycle as a corrected one, at a point where Newton's method along the branch is singular."""
    return _seen(family, sequence, evaluate_at(family, sequence, place, tangent), place)


def _seen(family: Family, sequence: Sequence, found: Corrected, place: ExtendedCycle) -> CorrectedCycle:
    problem, unknowns = family.problem(sequence, place.p), family.unknowns(place)
    watched = margins_of_cycle(problem, unknowns)

    def levels_at(place: ExtendedCycle) -> Margins:
        return margins_at(family.problem(sequence, place.p), family.unknowns(place), watched)

    rates = jax.jvp(levels_at, (place,), (found.tangent,))[1]
    return CorrectedCycle(found, watched, rates, unknowns.z - frame_offset(problem))


def simulate_cycle(family: Family, sequence: Sequence, place: ExtendedCycle) -> SimulatedMotion:
    """Simulate the machine from the start of a cycle."""
    away = frame_offset(family.problem(sequence, place.p))
    return _run(family, sequence, place, family.unknowns(place).z - away)


def cycle_of_motion(
    family: Family, sequence: Sequence, start: Float[Array, " state"], p: Scalar
) -> tuple[ExtendedCycle, SimulatedMotion]:
    """Simulate the machine from a start in space: its cycle and its events, with the room of a sequence."""
    z = (start + frame_offset(family.problem(sequence, p))) / family.scale
    place = ExtendedCycle(z, jnp.zeros(len(sequence.kind)), p)
    followed = _run(family, sequence, place, start)
    return place._replace(flights=followed.flights), followed


def _run(
    family: Family, sequence: Sequence, place: ExtendedCycle, start: Float[Array, " state"]
) -> SimulatedMotion:
    room = len(sequence.kind)
    numbers = numbers_of(family.system_at(place.p))
    room_of_log = room + int(_STICKS * room)
    strobe = StroboscopicMap(numbers, family.flow, family.num_periods, family.phase, room_of_log)
    choices = Choices(can_stick=True, room=room_of_log)
    log, result, _ = run_for_log(numbers, family.flow, strobe.request(start), choices)
    whole, flights = sequence_of(log, strobe.t0, strobe.period)
    other, flights = (
        Sequence(whole.kind[:room], whole.stop[:room], whole.held[: room + 1]),
        flights[:room],
    )
    is_whole = (result == RESULTS.successful) & (jnp.sum(whole.is_event) <= room)
    is_alike = is_whole & is_same_sequence(sequence, place.flights, other, flights)
    return SimulatedMotion(is_alike, other, flights)


def locate_start(
    family: Family, sequence: Sequence, place: ExtendedCycle, time: Scalar
) -> Float[Array, " state"]:
    """Scaled state of a cycle, `time` forcing periods after its start."""
    return state_at(family.problem(sequence, place.p), family.unknowns(place), time) / family.scale


def rates_along(
    family: Family, sequence: Sequence, place: ExtendedCycle, direction: ExtendedCycle, time: Scalar
) -> BranchRates:
    """Derivatives of the impact speeds, and of the gaps at `time`, in a direction."""

    def of(place: ExtendedCycle) -> BranchRates:
        problem, unknowns = family.problem(sequence, place.p), family.unknowns(place)
        x, _ = jnp.split(state_at(problem, unknowns, time), 2)
        machine, turns = problem.machine, problem.phase + time
        phase = phase_at(2 * jnp.pi * turns, machine.waves.num_harmonics)
        return BranchRates(residual(problem, unknowns).speed, machine.contacts.gaps(x, phase))

    return jax.jvp(of, (place,), (direction,))[1]


def jacobian(family: Family, sequence: Sequence, place: ExtendedCycle) -> Float[Array, "equations unknowns"]:
    """Scaled Jacobian of all equations by the start and the durations, rows and columns of padding included."""
    size = len(place.z)
    problem = family.problem(sequence, place.p)

    def of(y: Array) -> Array:
        found = residual(problem, Unknowns(y[:size] * family.scale, y[size:]))
        return jnp.concatenate([found.closing / family.scale, found.events])

    return jax.jacfwd(of)(jnp.concatenate([place.z, place.flights]))


class KernelCall(NamedTuple):
    """Request of a branch: a kernel and its arguments, without padding."""

    program: Callable
    sequence: Sequence
    arguments: tuple


def room_for(num_events: int) -> int:
    """Padded number of events."""
    room = next((room for room in _ROOMS if room >= num_events + SPARE), None)
    if room is None:
        raise ValueError(f"A branch came to a cycle of {num_events} events, and {MOST_EVENTS} are the most.")
    return room


def padded(sequence: Sequence, arguments: tuple, room: int) -> tuple:
    """Pad a sequence, and the cycles among the arguments."""
    more = room - len(sequence.kind)
    if not more:
        return sequence, *arguments
    kind = np.append(sequence.kind, np.full(more, NOTHING))
    held = np.concatenate([sequence.held, np.repeat(sequence.held[-1:], more, axis=0)])
    long = Sequence(kind, np.append(sequence.stop, np.zeros(more, int)), held)
    return long, *(
        a._replace(flights=np.append(a.flights, np.zeros(more))) if isinstance(a, ExtendedCycle) else a
        for a in arguments
    )


def trimmed(tree: Any, num_events: int) -> Any:
    """Remove the padding of a sequence or a cycle."""
    if isinstance(tree, ExtendedCycle):
        return tree._replace(flights=tree.flights[:num_events])
    return Sequence(tree.kind[:num_events], tree.stop[:num_events], tree.held[: num_events + 1])
