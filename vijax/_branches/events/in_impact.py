"""Corners at which the word stays: friction of a contact begins or ceases to stick within an impact."""

from ..point import BranchPoint, corrected, is_followed
from ..requests import Requests
from ..test_functions import TestFunction
from ..tolerances import CORNER_NEAR, TRIALS_AHEAD


def past_impact(event: BranchPoint, test: TestFunction) -> Requests[BranchPoint | None]:
    """Continue behind an impact in which friction begins or ceases to stick, with the same events; None if it does not.

    The branch has a corner there: behind it, it may go on or come back.
    """
    tangent, along = event.tangent, event.place.along(event.tangent)
    for side in (1, -1):
        for ds in TRIALS_AHEAD:
            guess = event.place.moved(tangent, ds)
            seen = yield from corrected(event.sequence, guess, tangent, along + side * ds)
            new = BranchPoint.of(event.sequence, seen, event.arc + ds)
            is_near = seen.found.is_converged and new.place.distance(event.place) < CORNER_NEAR * ds
            if is_near and test.of(seen) < 0 and (yield from is_followed(new)):
                return new if side > 0 else new.turned()
    return None
