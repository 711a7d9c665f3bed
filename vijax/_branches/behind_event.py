"""First point of a branch behind an event where its sequence changes."""

from collections.abc import Callable

import numpy as np

from .._orbits.sequence import Sequence
from .kernels import trimmed
from .kinds import End
from .parameter_family import ExtendedCycle
from .point import (
    BranchEnd,
    BranchPoint,
    KernelRequests,
    at_parameter,
    correct_with_free_parameter,
    corrected,
)
from .test_functions import tests_of

# Lengths of the step off a point where the sequence changes; the first that stays on the branch counts.
_OFF = 1e-7, 1e-8, 1e-9, 1e-10
# Distance behind an event that is no jump, and share of the way to it at which a larger one must be smaller.
_JUMP, _NEARER = 1e-5, 0.1


def corrected_on_sequence(sequence: Sequence, place: ExtendedCycle, event: BranchPoint) -> KernelRequests:
    """The point of an event, corrected on another sequence."""
    seen = yield from correct_with_free_parameter(sequence, place)
    if not seen.found.is_converged:
        raise BranchEnd(End.NOT_CONVERGED)
    return event._replace(sequence=sequence, place=trimmed(seen.found.place, len(sequence.kind)), seen=seen)


def oriented(
    sequence: Sequence, place: ExtendedCycle, event: BranchPoint, ahead: Callable[[BranchPoint], float]
) -> KernelRequests:
    """The point on the new sequence, in the direction in which a value of its tangent is positive."""
    at = yield from corrected_on_sequence(sequence, place, event)
    return (yield from step_off(at, ahead(at) > 0))


def step_off(at: BranchPoint, is_ahead: bool = True, lengths: tuple[float, ...] = _OFF) -> KernelRequests:
    """A point close behind, in the direction of the tangent or the opposite one."""
    tangent = at.tangent if is_ahead else at.tangent.turned()
    for ds in lengths:
        guess = at.place.moved(tangent, ds)
        seen = yield from corrected(at.sequence, guess, tangent, at.place.along(tangent) + ds)
        new = BranchPoint.of(at.sequence, seen, at.arc + ds)
        # Behind a grazing a branch may be so curved that Newton's method converges to another of its points.
        is_near = seen.found.is_converged and new.place.distance(guess) < ds
        if is_near and min((test.of(seen) for test in tests_of(at.sequence)), default=1) > 0:
            return new
    raise BranchEnd(End.SEVERAL_EVENTS)


def is_joined(event: BranchPoint, new: BranchPoint) -> KernelRequests:
    """False if the cycles on the events of a new point keep their distance from an event as their parameter comes near."""
    away = np.abs(new.place.z - event.place.z).max()
    if away < _JUMP:
        return True
    p = event.place.p + _NEARER * (new.place.p - event.place.p)
    seen = yield from at_parameter(new.sequence, new.place._replace(p=np.asarray(p)), float(p))
    is_nearer = np.abs(seen.found.place.z - event.place.z).max() < away / 2
    return bool(is_nearer or not seen.found.is_converged)
