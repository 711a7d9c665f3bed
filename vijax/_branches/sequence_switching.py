"""Continue a branch on another sequence where an event appears, vanishes, or passes another or the cycle's start."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .._hybrid.limits import IMPACT, STICK, TURN
from .._machine.state import AHEAD, BEHIND
from .._orbits.sequence import NOTHING, Sequence
from .kernels import (
    KernelCall,
    LocatedState,
    SimulatedMotion,
    locate_state,
    location_on,
    padded,
    simulation_of,
    trimmed,
)
from .kinds import End, Kind, public_kind
from .parameter_family import ExtendedCycle
from .point import (
    BranchEnd,
    BranchPoint,
    DirectedBranch,
    KernelRequests,
    at_parameter,
    correct_with_free_parameter,
    corrected,
)
from .sequence_edits import (
    are_alike,
    in_rounds,
    passed_section,
    shifted,
    with_event,
    with_events,
    with_events_merged,
    with_order_exchanged,
    with_other_kind,
    with_stick,
    without_event,
    without_stick,
)
from .test_functions import TestFunction, tests_of

# Bifurcations at which a stick, or a slip between two, has no duration.
_OF_STICKS = (Kind.CROSSING_SLIDING, Kind.GRAZING_SLIDING, Kind.SWITCHING_SLIDING, Kind.ADDING_SLIDING)
# Modes of friction that slips, each with that of the opposite direction.
_OTHER_WAY = {AHEAD: BEHIND, BEHIND: AHEAD}
# Number of rounds of a cycle that change at once, and of forcing periods of all rounds.
Rounds = tuple[int, float]

# Lengths of the step off a point where the sequence changes; the first that stays on the branch counts.
_OFF = 1e-7, 1e-8, 1e-9, 1e-10
# The same off a slow impact beside friction: the machine takes one below 1e-6 for the end of a chatter.
_OFF_LIGHT = 1e-4, 1e-5, 1e-6
# Shortest flight, in forcing periods, of a cycle to whose chatters bounces are added: the rest of them is rounding.
_LIGHTEST = 1e-7
# Distance behind an event that is no jump, and share of the way to it at which a larger one must be smaller.
_JUMP, _NEARER = 1e-5, 0.1
# Time within which two events are at once, in forcing periods.
_AT_ONCE = 1e-6
# Room for new events: an interrupted stick ends in another chatter.
_MORE = 40, 200
# Distances at which the machine is simulated where no step leads off.
_TRIALS = 1e-6, 1e-5, 1e-4, 1e-3


def by_sequence(walk: DirectedBranch, test: TestFunction, event: BranchPoint) -> KernelRequests:
    """Continue behind an event on the new sequence, in the direction given by a derivative.

    On a cycle that traverses a shorter one several times, the change may happen in one round or in all rounds.
    """
    loses_impact = bool(test.kind == Kind.GRAZING and event.sequence.kind[test.index] == IMPACT)
    if event.sequence.is_switching:
        if event.kind == Kind.DOUBLE_IMPACT and not test.of_flight:
            raise BranchEnd(
                Kind.DOUBLE_IMPACT
            )  # two events at once, one of which is not yet among those of the cycle
        other = _other_reversal(event, test, loses_impact)
        if other is not None:
            return (yield from _with_other_reversal(event, *other))
        if _stops_at_impact(event.sequence, test):
            return (yield from _with_other_slip(event, test.index))
        if not loses_impact:
            return (yield from _with_merged_events(event, test))
    if test.kind not in _CHANGES:
        raise BranchEnd(test.kind)
    for rounds in sorted({1, walk.rounds}):
        try:
            new = yield from _CHANGES[test.kind](event, test.index, (rounds, walk.num_periods))
        except BranchEnd as why:
            if rounds == walk.rounds:
                raise why
            continue
        walk.rounds = rounds
        return new


def _with_impact(event: BranchPoint, stop: int, how: Rounds) -> KernelRequests:
    """Continue behind a vanishing gap with an impact there."""
    watched = event.seen.watched
    at = int(watched.gap_flight[stop]), float(watched.gap_time[stop])
    sequence, place, first = with_events(event.sequence, event.place, IMPACT, stop, at, how)
    return (yield from _with_growing_speed(sequence, place, event, first))


def _without_impact(event: BranchPoint, k: int, how: Rounds) -> KernelRequests:
    """Continue behind an impact that loses its speed, without it."""
    sequence, place = event.sequence, event.place
    stop, time = int(sequence.stop[k]), float(place.flights[: k + 1].sum())
    for number in in_rounds(k, len(sequence.kind), how)[::-1]:
        sequence, place = without_event(sequence, place, number)
    at = yield from _corrected_on_sequence(sequence, place, event)
    request = KernelCall(locate_state, sequence, (at.place, at.tangent, np.asarray(time)))
    located: LocatedState = yield request
    return (yield from step_off(at, float(located.gap_rates[stop]) > 0))


def _in_other_order(event: BranchPoint, k: int, how: Rounds) -> KernelRequests:
    """Continue behind two simultaneous impacts in the other order."""
    sequence, place = event.sequence, event.place
    if not _are_impacts(sequence, k):
        raise BranchEnd(Kind.DOUBLE_IMPACT)
    for number in in_rounds(k, len(sequence.kind), how):
        sequence, place = with_order_exchanged(sequence, place, number)
    return (yield from _oriented(sequence, place, event, lambda at: float(at.tangent.flights[k])))


def _with_stick(event: BranchPoint, stop: int, how: Rounds) -> KernelRequests:
    """Continue behind an impact of zero restitution that no longer frees its mass, with a stick."""
    sequence, place = event.sequence, event.place
    flight = int(event.seen.watched.rise_flight[stop])
    for number in in_rounds(flight - 1, len(sequence.kind), how)[::-1]:
        sequence, place = with_stick(sequence, place, number)
    return (yield from _oriented(sequence, place, event, lambda at: float(at.tangent.flights[flight])))


def _without_stick(event: BranchPoint, k: int, how: Rounds) -> KernelRequests:
    """Continue behind a stick of zero duration without it, if its impact has zero restitution."""
    sequence, place = event.sequence, event.place
    if not event.seen.watched.is_plastic[sequence.stop[k]]:  # ever more bounces follow: `grazing_cascade.py`
        raise BranchEnd(Kind.CHATTER_COMPLETION)
    for number in in_rounds(k, len(sequence.kind), how)[::-1]:
        sequence, place = without_stick(sequence, place, number)
    at = yield from _corrected_on_sequence(sequence, place, event)
    try:
        return (yield from step_off(at, True))
    except BranchEnd:
        return (yield from step_off(at, False))


def _other_reversal(
    event: BranchPoint, test: TestFunction, loses_impact: bool
) -> tuple[Sequence, ExtendedCycle] | None:
    """The events behind a grazing where friction or compliant contacts act: the mass may turn there, by the impact or not."""
    sequence, place = event.sequence, event.place
    if loses_impact:
        k = test.index
        turned = np.flatnonzero(sequence.mode[k] != sequence.mode[k + 1])
        if len(turned) != 1:
            return None
        sequence = with_other_kind(sequence, k, TURN, int(turned[0]))
        ends = k + 1 < len(sequence.kind) and sequence.stop[k + 1] == turned[0]
        stops_at_once = ends and abs(place.flights[k + 1]) < _AT_ONCE
        return with_events_merged(sequence, place, k + 1) if stops_at_once else (sequence, place)
    if test.kind != Kind.TOUCH:
        return None
    watched = event.seen.watched
    at = int(watched.gap_flight[test.index]), float(watched.gap_time[test.index])
    is_turn = (sequence.kind == TURN) & (np.abs(np.cumsum(place.flights) - at[1]) < _AT_ONCE)
    if is_turn.any():
        return with_other_kind(sequence, int(np.argmax(is_turn)), IMPACT, test.index), place
    return with_event(sequence, place, IMPACT, test.index, *at)


def _with_other_reversal(event: BranchPoint, sequence: Sequence, place: ExtendedCycle) -> KernelRequests:
    """Continue behind a grazing on the events of `_other_reversal`."""
    at = yield from _corrected_on_sequence(sequence, place, event)
    for is_ahead in (True, False):
        try:
            new = yield from step_off(at, is_ahead, _OFF_LIGHT)
        except BranchEnd:
            continue
        simulated: SimulatedMotion = yield simulation_of(new.sequence, new.place)
        if simulated.is_alike:
            return new
    raise BranchEnd(Kind.GRAZING)


def _stops_at_impact(sequence: Sequence, test: TestFunction) -> bool:
    """True if the slip from an impact to a stick loses its duration: the impact leaves no sliding velocity."""
    if not (test.of_flight and test.kind == Kind.DOUBLE_IMPACT):
        return False
    k = test.index
    is_slip = sequence.mode[k, sequence.stop[k]] in _OTHER_WAY
    return bool(sequence.kind[k - 1] == IMPACT and sequence.kind[k] == STICK and is_slip)


def _with_other_slip(event: BranchPoint, k: int) -> KernelRequests:
    """Continue behind a stick right after an impact with a slip in the other direction between the two."""
    mode, stop = event.sequence.mode.copy(), event.sequence.stop[k]
    mode[k, stop] = _OTHER_WAY[mode[k, stop]]
    sequence = event.sequence._replace(mode=mode)
    return (yield from _oriented(sequence, event.place, event, lambda at: float(at.tangent.flights[k])))


def _with_merged_events(event: BranchPoint, test: TestFunction) -> KernelRequests:
    """Continue behind two events of one element that meet, without them, or with one event in their place."""
    sequence, k = event.sequence, test.index
    if test.kind == Kind.GRAZING:
        k = later_of_meeting(event, k)
    elif not (test.of_flight and test.kind in _OF_STICKS):
        raise BranchEnd(test.kind)  # an event appears, or two elements switch at once
    stop, num = int(sequence.stop[k]), sequence.mode.shape[1]
    at = yield from _corrected_on_sequence(*with_events_merged(sequence, event.place, k), event)
    rates, least = at.seen.rates, at.seen.watched.force
    guard = min((stop, stop + num), key=lambda j: abs(least[j]))
    rates_of: dict[str, Any] = {
        Kind.CROSSING_SLIDING: rates.speeds[k - 1],
        Kind.SWITCHING_SLIDING: rates.force[guard],
        Kind.ADDING_SLIDING: rates.force[guard],
    }
    rate = rates_of[test.kind] if test.kind in rates_of else rates.gap[stop]
    return (yield from step_off(at, float(rate) > 0))


def later_of_meeting(event: BranchPoint, k: int) -> int:
    """Number of the later of two events of one compliant contact of which `k` is one, with no time between."""
    flights, stop = np.append(event.place.flights, np.inf), np.append(event.sequence.stop, -1)
    pairs = [i for i in (k, k + 1) if i and stop[i] == stop[i - 1]]
    if not pairs:
        raise BranchEnd(Kind.GRAZING)
    return min(pairs, key=lambda i: abs(flights[i]))


# Continuation behind each kind of event.
_CHANGES: dict[str, Callable] = {
    Kind.TOUCH: _with_impact,
    Kind.GRAZING: _without_impact,
    Kind.DOUBLE_IMPACT: _in_other_order,
    Kind.ONSET: _with_stick,
    Kind.CHATTER_COMPLETION: _without_stick,
}


def continue_by_simulation(event: BranchPoint) -> KernelRequests:
    """The point a short way ahead, with the events of the simulated machine."""
    for ds in _TRIALS:
        guess = event.place.moved(event.tangent, ds)
        followed = yield from _followed(event.sequence, guess)
        new = yield from _on_simulated_events(event._replace(place=guess), followed)
        if all(np.array_equal(a, b) for a, b in zip(new.sequence, event.sequence, strict=True)):
            continue  # the event is still ahead
        simulated: SimulatedMotion = yield simulation_of(new.sequence, new.place)
        is_near = np.abs(new.place.z - guess.z).max() < 10 * ds
        if simulated.is_alike and is_near and (yield from _is_joined(event, new)):
            return new._replace(kind="", arc=event.arc + ds)
    # Behind a kink the branch may not come to these planes.
    for ds in _TRIALS:
        for side in (1, -1):
            new = yield from _at_parameter_beside(event, side * ds)
            if new is not None:
                return new
    raise BranchEnd(public_kind(event.kind))


def _at_parameter_beside(event: BranchPoint, dp: float) -> KernelRequests:
    """The cycle of the machine with other events than before an event, at a parameter beside; None if there is none."""
    new: BranchPoint | None = yield from cycle_of_simulation(
        event, event.place._replace(p=event.place.p + dp)
    )
    if new is None or are_alike(new.sequence, event.sequence):
        return None
    away = np.linalg.norm(np.append(new.place.z - event.place.z, dp))
    if away > 10 * abs(dp) or not (yield from _is_joined(event, new)):
        return None
    new = new._replace(arc=event.arc + float(away))
    return new if new.tangent.p * dp > 0 else new.turned()


def _is_joined(event: BranchPoint, new: BranchPoint) -> KernelRequests:
    """False if the cycles on the events of a new point keep their distance from an event as their parameter comes near."""
    away = np.abs(new.place.z - event.place.z).max()
    if away < _JUMP:
        return True
    p = event.place.p + _NEARER * (new.place.p - event.place.p)
    seen = yield from at_parameter(new.sequence, new.place._replace(p=np.asarray(p)), float(p))
    is_nearer = np.abs(seen.found.place.z - event.place.z).max() < away / 2
    return bool(is_nearer or not seen.found.is_converged)


def cycle_of_simulation(point: BranchPoint, guess: ExtendedCycle) -> KernelRequests:
    """The cycle that the machine follows near a guess, at its parameter; None if it follows none."""
    followed = yield from _followed(point.sequence, guess)
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    sequence = trimmed(followed.sequence, num_events)
    place = guess._replace(flights=followed.flights[:num_events])
    seen = yield from at_parameter(sequence, place, float(guess.p))
    if not seen.found.is_converged:
        return None
    found = BranchPoint.of(sequence, seen, point.arc)
    simulated: SimulatedMotion = yield simulation_of(sequence, found.place)
    return found if simulated.is_alike else None


def _followed(sequence: Sequence, place: ExtendedCycle) -> KernelRequests:
    """Simulate the machine from a cycle, with room for new events: few at first, as a program has that room anyway."""
    for more in _MORE:
        longer, wide = padded(sequence, (place,), len(sequence.kind) + more)
        followed: SimulatedMotion = yield simulation_of(longer, wide)
        if np.any(followed.sequence.kind[: len(longer.kind)] == NOTHING):
            break
    return followed


def in_section(point: BranchPoint, num_periods: float) -> KernelRequests:
    """The point with all its events between the start and the end of the cycle."""
    by = passed_section(point.place, num_periods)
    if by == 0:
        return point
    if not np.isfinite(num_periods):  # the event that begins the cycle has met the next one
        raise BranchEnd(End.SEVERAL_EVENTS)
    time = 0.0 if by > 0 else num_periods
    located: LocatedState = yield location_on(point.sequence, point.place, time)
    sequence, place = shifted(point.sequence, point.place, by, num_periods, np.asarray(located.z))
    at = yield from _corrected_on_sequence(sequence, place, point)
    # The tangent keeps its direction: event times and parameter change as before.
    before, after = np.cumsum(point.tangent.flights), np.cumsum(at.tangent.flights)
    is_ahead = np.roll(before, -by) @ after + point.tangent.p * at.tangent.p > 0
    return at if is_ahead else at.turned()


def with_simulated_bounces(point: BranchPoint, followed: SimulatedMotion) -> KernelRequests:
    """The point with as many bounces in its chatters as the machine has there."""
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    is_light = np.min(point.place.flights, initial=np.inf) < _LIGHTEST
    more = num_events - len(point.sequence.kind)
    if not followed.is_alike or more == 0 or (is_light and more > 0):
        return point
    return (yield from _on_simulated_events(point, followed))


def _on_simulated_events(point: BranchPoint, followed: SimulatedMotion) -> KernelRequests:
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
) -> KernelRequests:
    """The point on the new sequence, in the direction in which the speed of an impact grows."""
    at = yield from _corrected_on_sequence(sequence, place, event)
    return (yield from step_off(at, float(at.seen.rates.speeds[impact]) > 0))


def _oriented(
    sequence: Sequence, place: ExtendedCycle, event: BranchPoint, ahead: Callable[[BranchPoint], float]
) -> KernelRequests:
    """The point on the new sequence, in the direction in which a value of its tangent is positive."""
    at = yield from _corrected_on_sequence(sequence, place, event)
    return (yield from step_off(at, ahead(at) > 0))


def _corrected_on_sequence(sequence: Sequence, place: ExtendedCycle, event: BranchPoint) -> KernelRequests:
    """The point of an event, corrected on another sequence."""
    seen = yield from correct_with_free_parameter(sequence, place)
    if not seen.found.is_converged:
        raise BranchEnd(End.NOT_CONVERGED)
    return event._replace(sequence=sequence, place=trimmed(seen.found.place, len(sequence.kind)), seen=seen)


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
