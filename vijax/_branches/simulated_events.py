"""Events of the simulated machine: at a bound where events vanish, and for the last bounces of a chatter."""

import numpy as np

from .._orbits.sequence import NOTHING, Sequence
from .kernels import SimulatedMotion
from .padding import padded, trimmed
from .parameter_family import ExtendedCycle
from .point import BranchPoint, at_parameter, corrected, is_followed
from .requests import Requests, ask, simulation_of
from .tolerances import LIGHTEST_FLIGHT

# Room for new events: an interrupted stick ends in another chatter.
_MORE = 40, 200


def cycle_of_simulation(point: BranchPoint, guess: ExtendedCycle) -> Requests[BranchPoint | None]:
    """The cycle that the machine follows near a guess, at its parameter; None if it follows none."""
    followed = yield from _followed(point.sequence, guess)
    sequence, place = _on_events_of(followed, guess)
    cycle = yield from at_parameter(sequence, place, float(guess.p))
    if not cycle.found.is_converged:
        return None
    found = BranchPoint.of(sequence, cycle, point.arc)
    return found if (yield from is_followed(found)) else None


def _on_events_of(followed: SimulatedMotion, place: ExtendedCycle) -> tuple[Sequence, ExtendedCycle]:
    """A cycle with the events of a simulated motion."""
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    return trimmed(followed.sequence, num_events), place._replace(flights=followed.flights[:num_events])


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
    sequence, place = _on_events_of(followed, point.place)
    # The weights leave out the flights, whose number changes with the bounces.
    weights = ExtendedCycle(point.tangent.z, 0 * place.flights, point.tangent.p)
    cycle = yield from corrected(sequence, place, weights, place.along(weights))
    return BranchPoint.of(sequence, cycle, point.arc) if cycle.found.is_converged else point
