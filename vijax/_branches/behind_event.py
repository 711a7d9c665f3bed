"""First point of a branch behind an event where its sequence changes."""

from collections.abc import Callable

import numpy as np

from .._orbits.sequence import Sequence
from .kernels import trimmed
from .kinds import EndKind, Kind
from .parameter_family import ExtendedCycle
from .point import BranchPoint, End, correct_with_free_parameter, corrected, is_followed
from .requests import Requests
from .test_functions import TestFunction, tests_of
from .tolerances import EARLIER_IMPACTS, JUMP_NEARER, NEARER, NEGATIVE, NO_JUMP, STEP_OFF, VANISHES_TOGETHER


def vanishing_with(event: BranchPoint, test: TestFunction) -> list[int]:
    """Numbers of the events or stops of all test functions like a given one that vanish at an event, its own included.

    A symmetric machine touches two stops at once, for instance.
    """
    positions, velocities = np.split(np.abs(event.seen.start), 2)
    sizes: dict[str, float] = {Kind.TOUCH: positions.max(), Kind.GRAZING: velocities.max()}
    size = VANISHES_TOGETHER * (1.0 if test.of_flight else sizes.get(test.kind, 0.0))
    return [
        one.index
        for one in tests_of(event.sequence)
        if (one.kind, one.of_flight) == (test.kind, test.of_flight)
        and (one.index == test.index or abs(one.of(event.seen)) < size)
    ]


def with_earlier_impacts(
    event: BranchPoint, sequence: Sequence, place: ExtendedCycle, impacts: list[int]
) -> Requests[BranchPoint | None]:
    """The followed point behind an event with several new impacts, which come earlier by a given time; None if none is.

    The tangent at the event does not tell in which proportion they do.
    """
    is_impact = np.isin(np.arange(len(place.flights)), impacts).astype(float)
    sum_of_times = np.cumsum(is_impact[::-1])[::-1]
    weights = ExtendedCycle(0 * place.z, sum_of_times, 0 * place.p)
    for earlier in EARLIER_IMPACTS:
        guess = place._replace(flights=place.flights - earlier * np.diff(is_impact, prepend=0.0))
        new = yield from followed_beside(event, sequence, guess, weights)
        if new is not None:
            return new if new.tangent.along(weights) < 0 else new.turned()
    return None


def followed_beside(
    event: BranchPoint, sequence: Sequence, guess: ExtendedCycle, weights: ExtendedCycle
) -> Requests[BranchPoint | None]:
    """The point behind an event in the plane of a guess; None unless the machine follows it and it is joined to the event."""
    seen = yield from corrected(sequence, guess, weights, guess.along(weights))
    if not seen.found.is_converged:
        return None
    new = BranchPoint.of(sequence, seen, event.arc)
    if not ((yield from is_followed(new)) and (yield from is_joined(event, new))):
        return None
    return new._replace(arc=event.arc + new.place.distance_of_starts(event.place))


def corrected_on_sequence(
    sequence: Sequence, place: ExtendedCycle, event: BranchPoint
) -> Requests[BranchPoint | End]:
    """The point of an event, corrected on another sequence."""
    seen = yield from correct_with_free_parameter(sequence, place)
    if not seen.found.is_converged:
        return End(EndKind.NOT_CONVERGED)
    return event._replace(sequence=sequence, place=trimmed(seen.found.place, len(sequence.kind)), seen=seen)


def oriented(
    sequence: Sequence, place: ExtendedCycle, event: BranchPoint, ahead: Callable[[BranchPoint], float]
) -> Requests[BranchPoint | End]:
    """The point on the new sequence, in the direction in which a value of its tangent is positive."""
    at = yield from corrected_on_sequence(sequence, place, event)
    return at if isinstance(at, End) else (yield from step_off(at, ahead(at) > 0))


def step_off(
    at: BranchPoint, is_ahead: bool = True, lengths: tuple[float, ...] = STEP_OFF
) -> Requests[BranchPoint | End]:
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
    return End(EndKind.SEVERAL_EVENTS)


def keeps_margins(event: BranchPoint, new: BranchPoint) -> bool:
    """True if no test function has become negative behind an event: a run tells no impact from one of a speed below zero.

    The guard of an element whose load others take over may be negative all along.
    """
    before = {
        (test.least, test.index): test.of(event.seen) for test in tests_of(event.sequence) if test.least
    }
    return all(
        test.of(new.seen) > -NEGATIVE or before.get((test.least, test.index), 0.0) < -NEGATIVE
        for test in tests_of(new.sequence)
    )


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
        seen = yield from corrected(new.sequence, guess, towards, guess.along(towards))
        place = trimmed(seen.found.place, len(new.sequence.kind))
        is_near = np.abs(place.z - event.place.z).max() < NEARER * left
        is_between = abs(place.p - event.place.p) <= max(abs(new.place.p - event.place.p), left)
        if not (seen.found.is_converged and is_near and is_between):
            return False
    return True
