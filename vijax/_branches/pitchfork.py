"""Pitchforks: branch points at which orbits lose a symmetry.

A symmetric branch is crossed by one of asymmetric orbits, in pairs of mirror images. On the latter the parameter turns
there, as at a fold; its two halves are the mirror images. At a point where two branches cross, with the null vectors phi of
the Jacobian and psi of its transpose, psi F_uu phi phi is zero by the symmetry: the image of the crossing branch is itself,
turned around. Without a symmetry of the machine such points are exceptions, so only branches of symmetric machines are
searched for them, at the price of a branch point at each of their folds.
"""

import numpy as np

from .._orbits.sequence import Sequence
from .._system.parameters import known_machine_at
from .closing import repetitions_of
from .cycle_derivatives import curvature, derivative_at, slope, square_jacobian
from .kinds import Kind
from .parameter_family import ExtendedCycle, ParameterFamily
from .point import BranchPoint, DirectedBranch
from .requests import HostCall, Requests, ask
from .singular import branch_point_near
from .tolerances import AT_BIFURCATION, LOCATED, NEGLIGIBLE, SAME_ROUNDS


def _is_symmetric(point: BranchPoint) -> Requests[bool]:
    """True if the machine has symmetries at the parameter of a point."""

    def has_any(family: ParameterFamily) -> bool:
        try:
            machine = known_machine_at(family.system, family.path, point.place.p * family.span)
            return bool(machine.symmetries())
        except ValueError:  # there are too many to list, or the force is unknown
            return True

    return (yield from ask(HostCall(has_any, point.sequence)))


def pitchfork_at_fold(
    walk: DirectedBranch, point: BranchPoint, fold: BranchPoint
) -> Requests[BranchPoint | None]:
    """The pitchfork at which a branch of asymmetric orbits turns, near a located fold; None if it is a fold."""
    if not (yield from _is_symmetric(fold)):
        return None
    found = yield from branch_point_near(point, fold.place, AT_BIFURCATION)
    named = None if found is None else (yield from with_kind_of_crossing(walk, found))
    return named if named is not None and named.kind == Kind.PITCHFORK else None


def with_kind_of_crossing(walk: DirectedBranch, point: BranchPoint) -> Requests[BranchPoint]:
    """A point where two branches cross, with its kind, `PITCHFORK` or `BRANCH_POINT`."""
    if not (yield from _is_symmetric(point)):
        return point
    phi, psi = yield from null_vectors(point.sequence, point.place)
    rounds = yield from repetitions_of(point.sequence, point.place, walk.num_periods)
    if not _repeats(phi, rounds):
        return point  # a period doubling of the cycle that this one repeats
    second = yield from derivative_at(curvature, point.sequence, point.place, phi, phi)
    is_zero = abs(psi @ second) <= NEGLIGIBLE * np.linalg.norm(second)
    return point._replace(kind=Kind.PITCHFORK) if is_zero else point


def is_listed(walk: DirectedBranch, point: BranchPoint) -> bool:
    """True for a fold or a crossing if the last bifurcation of a walk is a pitchfork right there."""
    if point.kind not in (Kind.FOLD, Kind.BRANCH_POINT, Kind.PITCHFORK):
        return False
    last = next((known for known in reversed(walk.points) if known.kind), None)
    return (
        isinstance(last, BranchPoint)
        and last.kind == Kind.PITCHFORK
        and len(last.sequence.kind) == len(point.sequence.kind)
        and last.place.distance(point.place) < LOCATED
    )


def null_vectors(sequence: Sequence, place: ExtendedCycle) -> Requests[tuple[ExtendedCycle, np.ndarray]]:
    """Null vectors of the Jacobian at fixed parameter: the direction, and that of the transpose, as it is without padding.

    The sign of the direction follows from its entries: that of a decomposition is rounding.
    """
    left, _, right = np.linalg.svd((yield from square_jacobian(sequence, place)))
    size, direction = len(place.z), right[-1] * np.sign(leading_entry(right[-1]))
    return ExtendedCycle(direction[:size], direction[size:], np.zeros(())), left[:, -1]


def leading_entry(vector: np.ndarray) -> float:
    """The first entry of a vector that is not far below the largest: several may be equal, as by a symmetry."""
    sizes = np.abs(vector)
    return float(vector[np.argmax(sizes > sizes.max() / 2)])


def crossing_direction(sequence: Sequence, place: ExtendedCycle) -> Requests[ExtendedCycle]:
    """Direction of the branch that crosses one along the null vector at fixed parameter, towards larger values of it."""
    size, along_p = len(place.z), ExtendedCycle(0 * place.z, 0 * place.flights, np.ones(()))
    matrix = yield from square_jacobian(sequence, place)
    by_parameter = yield from derivative_at(slope, sequence, place, along_p)
    both = np.linalg.svd(np.column_stack([matrix, by_parameter]))[2][-2:]
    # Of the plane of both the direction across that of fixed parameter has the largest change of it.
    across = both[:, -1] @ both / np.linalg.norm(both[:, -1])
    return ExtendedCycle(across[:size], across[size:-1], across[-1])


def _repeats(direction: ExtendedCycle, rounds: int) -> bool:
    """True if a direction moves the events of all rounds of a cycle alike."""
    times = np.cumsum(direction.flights).reshape(rounds, -1)
    return bool(np.abs(times - times[:1]).max(initial=0) <= SAME_ROUNDS * np.abs(times).max(initial=0))
