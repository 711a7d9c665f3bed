"""The section of a cycle: events that pass its start or its end are counted on the other side."""

import numpy as np

from .behind_event import corrected_on_sequence
from .kinds import EndKind
from .point import BranchPoint, End
from .requests import Requests, ask, location_on
from .sequence_edits import passed_section, shifted


def in_section(point: BranchPoint, num_periods: float) -> Requests[BranchPoint | End]:
    """The point with all its events between the start and the end of the cycle."""
    by = passed_section(point.place, num_periods)
    if by == 0:
        return point
    if not np.isfinite(num_periods):  # the event that begins the cycle has met the next one
        return End(EndKind.SEVERAL_EVENTS)
    time = 0.0 if by > 0 else num_periods
    z = yield from ask(location_on(point.sequence, point.place, time))
    sequence, place = shifted(point.sequence, point.place, by, num_periods, np.asarray(z))
    at = yield from corrected_on_sequence(sequence, place, point)
    if isinstance(at, End):
        return at
    # The tangent keeps its direction: event times and parameter change as before.
    before, after = np.cumsum(point.tangent.flights), np.cumsum(at.tangent.flights)
    is_ahead = np.roll(before, -by) @ after + point.tangent.p * at.tangent.p > 0
    return at if is_ahead else at.turned()
