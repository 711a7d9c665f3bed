"""First point of a branch behind an event where its sequence changes."""

from collections.abc import Callable

import numpy as np

from .._orbits.sequence import Sequence
from .kinds import EndKind
from .padding import trimmed
from .parameter_family import ExtendedCycle
from .point import BranchPoint, End, correct_with_free_parameter, corrected
from .requests import Requests
from .test_functions import tests_of
from .tolerances import JUMP_NEARER, NEARER, NO_JUMP, STEP_OFF, STEPS_FROM_GUESS

# From a point to the point that takes its place, or None.
Accepts = Callable[[BranchPoint], Requests[BranchPoint | None]]


def corrected_on_sequence(
    sequence: Sequence, place: ExtendedCycle, event: BranchPoint
) -> Requests[BranchPoint | End]:
    """The point of an event, corrected on another sequence."""
    cycle = yield from correct_with_free_parameter(sequence, place)
    if not cycle.found.is_converged:
        return End(EndKind.NOT_CONVERGED)
    return event._replace(
        sequence=sequence, place=trimmed(cycle.found.place, len(sequence.kind)), cycle=cycle
    )


def step_off(at: BranchPoint, is_ahead: bool, accepted: Accepts) -> Requests[BranchPoint | None]:
    """The first accepted point close behind, in the direction of the tangent or the opposite one; None if there is none."""
    tangent = at.tangent if is_ahead else at.tangent.turned()
    for ds in STEP_OFF:
        guess = at.place.moved(tangent, ds)
        cycle = yield from corrected(at.sequence, guess, tangent, at.place.along(tangent) + ds)
        new = BranchPoint.of(at.sequence, cycle, at.arc + ds)
        # Behind a grazing a branch may be so curved that Newton's method converges to another of its points.
        if cycle.found.is_converged and new.place.distance(guess) < STEPS_FROM_GUESS * ds:
            found = yield from accepted(new)
            if found is not None:
                return found
    return None


def with_margins(point: BranchPoint) -> Requests[BranchPoint | None]:
    """The point if all its margins are positive; else None."""
    yield from ()
    return point if min((test.of(point.cycle) for test in tests_of(point.sequence)), default=1) > 0 else None


def is_joined(event: BranchPoint, new: BranchPoint) -> Requests[bool]:
    """True if the cycles on the events of a new point lead to an event, as the start of a cycle comes near its own.

    Planes across the line between both starts are met ever nearer to the event, step by step, because near it durations may
    vanish as roots. Another branch does not come to them, or comes at parameters farther away.
    """
    away = np.abs(event.place.z - new.place.z).max()
    towards = ExtendedCycle(
        (event.place.z - new.place.z) / max(away, NO_JUMP), 0 * new.place.flights, 0 * new.place.p
    )
    place, left = new.place, away
    while left > max(NO_JUMP, JUMP_NEARER * away):
        left /= 2
        guess = place._replace(z=event.place.z - left * towards.z)
        cycle = yield from corrected(new.sequence, guess, towards, guess.along(towards))
        place = trimmed(cycle.found.place, len(new.sequence.kind))
        is_near = np.abs(place.z - event.place.z).max() < NEARER * left
        is_between = abs(place.p - event.place.p) <= max(abs(new.place.p - event.place.p), left)
        if not (cycle.found.is_converged and is_near and is_between):
            return False
    return True
