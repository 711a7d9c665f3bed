"""Events of the simulated machine: where no word leads on behind a corner, and for the last bounces of a chatter."""

import numpy as np

from .._orbits.sequence import NOTHING, Sequence
from .behind_event import is_joined, keeps_margins
from .kernels import SimulatedMotion, padded, trimmed
from .kinds import public_kind
from .parameter_family import ExtendedCycle
from .point import BranchPoint, End, at_parameter, corrected, is_followed
from .requests import Requests, ask, simulation_of
from .section import in_section
from .sequence_edits import are_alike
from .tolerances import LIGHTEST_FLIGHT, TRIALS_AHEAD

# Room for new events: an interrupted stick ends in another chatter.
_MORE = 40, 200


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
