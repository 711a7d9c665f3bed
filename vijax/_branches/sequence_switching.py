"""Continue a branch on another sequence where an event appears, vanishes, or passes another or the cycle's start."""

from collections.abc import Callable

import numpy as np

from .._hybrid.limits import IMPACT
from .._orbits.sequence import NOTHING, Sequence
from .behind_event import (
    corrected_on_sequence,
    is_joined,
    keeps_margins,
    oriented,
    step_off,
    vanishing_with,
    with_earlier_impacts,
)
from .kernels import SimulatedMotion, locate_state, padded, trimmed
from .kinds import EndKind, Kind, public_kind
from .parameter_family import ExtendedCycle
from .point import BranchPoint, DirectedBranch, End, at_parameter, corrected, is_followed
from .requests import KernelCall, Requests, ask, location_on, simulation_of
from .sequence_edits import (
    are_alike,
    in_rounds,
    passed_section,
    shifted,
    with_events,
    with_order_exchanged,
    with_stick,
    without_event,
    without_stick,
)
from .switching_changes import by_switching, events_behind_touches
from .test_functions import TestFunction
from .tolerances import LIGHTEST_FLIGHT, TRIALS_AHEAD

# Number of rounds of a cycle that change at once, and of forcing periods of all rounds.
Rounds = tuple[int, float]

# Room for new events: an interrupted stick ends in another chatter.
_MORE = 40, 200


def by_sequence(walk: DirectedBranch, test: TestFunction, event: BranchPoint) -> Requests[BranchPoint | End]:
    """Continue behind an event on the new sequence, in the direction given by a derivative.

    On a cycle that traverses a shorter one several times, the change may happen in one round or in all rounds.
    """
    # Cycles behind a touch are simulated, which needs all their events between start and end.
    if test.kind == Kind.TOUCH:
        within = yield from in_section(event, walk.num_periods)
        if isinstance(within, End):
            return within
        event = within
    if event.sequence.is_switching:
        new = yield from by_switching(event, test)
        if new is not None:
            return new
    for rounds in sorted({1, walk.rounds}) if test.kind in _CHANGES else ():
        new = yield from _CHANGES[test.kind](event, test, (rounds, walk.num_periods))
        if isinstance(new, BranchPoint):
            walk.rounds = rounds
            return new
    return End(test.kind)


def _with_impact(event: BranchPoint, test: TestFunction, how: Rounds) -> Requests[BranchPoint | End]:
    """Continue behind a vanishing gap with an impact there, and at every other stop that is touched."""
    stops = vanishing_with(event, test)
    if len(stops) > 1:
        new = yield from with_earlier_impacts(event, *events_behind_touches(event, stops))
        if new is not None:
            return new
    stop = test.index
    at = event.seen.watched.touch_of(stop)
    sequence, place, first = with_events(event.sequence, event.place, IMPACT, stop, at, how)
    return (yield from _with_growing_speed(sequence, place, event, first))


def _without_impact(event: BranchPoint, test: TestFunction, how: Rounds) -> Requests[BranchPoint | End]:
    """Continue behind an impact that loses its speed, without it, and without those of other stops that lose theirs."""
    sequence, place, k = event.sequence, event.place, test.index
    stop, time, lost = int(sequence.stop[k]), float(place.flights[: k + 1].sum()), vanishing_with(event, test)
    each = [one for one in lost if one == k or sequence.stop[one] != stop]
    for number in sorted({i for one in each for i in in_rounds(one, len(sequence.kind), how)})[::-1]:
        sequence, place = without_event(sequence, place, number)
    at = yield from corrected_on_sequence(sequence, place, event)
    if isinstance(at, End):
        return at
    request = KernelCall(locate_state, sequence, (at.place, at.tangent, np.asarray(time)))
    located = yield from ask(request)
    return (yield from step_off(at, float(located.gap_rates[stop]) > 0))


def _in_other_order(event: BranchPoint, test: TestFunction, how: Rounds) -> Requests[BranchPoint | End]:
    """Continue behind two simultaneous impacts in the other order."""
    sequence, place, k = event.sequence, event.place, test.index
    if not _are_impacts(sequence, k):
        return End(Kind.DOUBLE_IMPACT)
    for number in in_rounds(k, len(sequence.kind), how):
        sequence, place = with_order_exchanged(sequence, place, number)
    return (yield from oriented(sequence, place, event, lambda at: float(at.tangent.flights[k])))


def _with_stick(event: BranchPoint, test: TestFunction, how: Rounds) -> Requests[BranchPoint | End]:
    """Continue behind an impact of zero restitution that no longer frees its mass, with a stick."""
    sequence, place = event.sequence, event.place
    flight = int(event.seen.watched.rise_flight[test.index])
    for number in in_rounds(flight - 1, len(sequence.kind), how)[::-1]:
        sequence, place = with_stick(sequence, place, number)
    return (yield from oriented(sequence, place, event, lambda at: float(at.tangent.flights[flight])))


def _without_stick(event: BranchPoint, test: TestFunction, how: Rounds) -> Requests[BranchPoint | End]:
    """Continue behind a stick of zero duration without it, if its impact has zero restitution."""
    sequence, place, k = event.sequence, event.place, test.index
    if not event.seen.watched.is_plastic[sequence.stop[k]]:  # ever more bounces follow: `grazing_cascade.py`
        return End(Kind.CHATTER_COMPLETION)
    for number in in_rounds(k, len(sequence.kind), how)[::-1]:
        sequence, place = without_stick(sequence, place, number)
    at = yield from corrected_on_sequence(sequence, place, event)
    if isinstance(at, End):
        return at
    new = yield from step_off(at, True)
    return new if isinstance(new, BranchPoint) else (yield from step_off(at, False))


# Continuation behind each kind of event.
_CHANGES: dict[str, Callable[[BranchPoint, TestFunction, Rounds], Requests[BranchPoint | End]]] = {
    Kind.TOUCH: _with_impact,
    Kind.GRAZING: _without_impact,
    Kind.DOUBLE_IMPACT: _in_other_order,
    Kind.ONSET: _with_stick,
    Kind.CHATTER_COMPLETION: _without_stick,
}


def continue_by_simulation(event: BranchPoint, num_periods: float) -> Requests[BranchPoint | End]:
    """The point a short way ahead, with the events of the simulated machine."""
    # The events of a run are between start and end of the cycle: so are those with which they are compared.
    within = yield from in_section(event, num_periods)
    event = within if isinstance(within, BranchPoint) else event
    for ds in TRIALS_AHEAD:
        guess = event.place.moved(event.tangent, ds)
        followed = yield from _followed(event.sequence, guess)
        new = yield from _on_simulated_events(event._replace(place=guess), followed)
        if are_alike(new.sequence, event.sequence):
            continue  # the event is still ahead
        is_near = np.abs(new.place.z - guess.z).max() < 10 * ds and keeps_margins(event, new)
        if is_near and (yield from is_followed(new)) and (yield from is_joined(event, new)):
            return new._replace(kind="", arc=event.arc + ds)
    # Behind a kink the branch may not come to these planes.
    for ds in TRIALS_AHEAD:
        for side in (1, -1):
            new = yield from _at_parameter_beside(event, side * ds)
            if new is not None:
                return new
    return End(public_kind(event.kind))


def _at_parameter_beside(event: BranchPoint, dp: float) -> Requests[BranchPoint | None]:
    """The cycle of the machine with other events than before an event, at a parameter beside; None if there is none."""
    new: BranchPoint | None = yield from cycle_of_simulation(
        event, event.place._replace(p=event.place.p + dp)
    )
    if new is None or are_alike(new.sequence, event.sequence):
        return None
    away = new.place.distance_of_starts(event.place)
    if away > 10 * abs(dp) or not keeps_margins(event, new) or not (yield from is_joined(event, new)):
        return None
    new = new._replace(arc=event.arc + away)
    return new if new.tangent.p * dp > 0 else new.turned()


def cycle_of_simulation(point: BranchPoint, guess: ExtendedCycle) -> Requests[BranchPoint | None]:
    """The cycle that the machine follows near a guess, at its parameter; None if it follows none."""
    followed = yield from _followed(point.sequence, guess)
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    sequence = trimmed(followed.sequence, num_events)
    place = guess._replace(flights=followed.flights[:num_events])
    seen = yield from at_parameter(sequence, place, float(guess.p))
    if not seen.found.is_converged:
        return None
    found = BranchPoint.of(sequence, seen, point.arc)
    return found if (yield from is_followed(found)) else None


def _followed(sequence: Sequence, place: ExtendedCycle) -> Requests[SimulatedMotion]:
    """Simulate the machine from a cycle, with room for new events: few at first, as a program has that room anyway."""
    for more in _MORE:
        longer, wide = padded(sequence, (place,), len(sequence.kind) + more)
        followed = yield from ask(simulation_of(longer, wide))
        if np.any(followed.sequence.kind[: len(longer.kind)] == NOTHING):
            break
    return followed


def in_section(point: BranchPoint, num_periods: float) -> Requests[BranchPoint | End]:
    """The point with all its events between the start and the end of the cycle."""
    by = passed_section(point.place, num_periods)
    if by == 0:
        return point
    if not np.isfinite(num_periods):  # the event that begins the cycle has met the next one
        return End(EndKind.SEVERAL_EVENTS)
    time = 0.0 if by > 0 else num_periods
    located = yield from ask(location_on(point.sequence, point.place, time))
    sequence, place = shifted(point.sequence, point.place, by, num_periods, np.asarray(located.z))
    at = yield from corrected_on_sequence(sequence, place, point)
    if isinstance(at, End):
        return at
    # The tangent keeps its direction: event times and parameter change as before.
    before, after = np.cumsum(point.tangent.flights), np.cumsum(at.tangent.flights)
    is_ahead = np.roll(before, -by) @ after + point.tangent.p * at.tangent.p > 0
    return at if is_ahead else at.turned()


def with_simulated_bounces(point: BranchPoint, followed: SimulatedMotion) -> Requests[BranchPoint]:
    """The point with as many bounces in its chatters as the machine has there."""
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    is_light = np.min(point.place.flights, initial=np.inf) < LIGHTEST_FLIGHT
    more = num_events - len(point.sequence.kind)
    if not followed.is_alike or more == 0 or (is_light and more > 0):
        return point
    return (yield from _on_simulated_events(point, followed))


def _on_simulated_events(point: BranchPoint, followed: SimulatedMotion) -> Requests[BranchPoint]:
    """The point with the events of the machine; itself if no cycle near it has them."""
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    sequence = trimmed(followed.sequence, num_events)
    place = point.place._replace(flights=followed.flights[:num_events])
    # The weights leave out the flights, whose number changes with the bounces.
    weights = ExtendedCycle(point.tangent.z, 0 * place.flights, point.tangent.p)
    seen = yield from corrected(sequence, place, weights, place.along(weights))
    return BranchPoint.of(sequence, seen, point.arc) if seen.found.is_converged else point


def _are_impacts(sequence: Sequence, k: int) -> bool:
    is_free = np.array_equal(sequence.mode[k - 1], sequence.mode[k + 1])
    return bool(is_free and sequence.kind[k] == IMPACT and sequence.kind[k - 1] == IMPACT)


def _with_growing_speed(
    sequence: Sequence,
    place: ExtendedCycle,
    event: BranchPoint,
    impact: int,
) -> Requests[BranchPoint | End]:
    """The point on the new sequence, in the direction in which the speed of an impact grows."""
    return (yield from oriented(sequence, place, event, lambda at: float(at.seen.rates.speeds[impact])))
