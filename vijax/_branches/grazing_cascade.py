"""Limit of a cascade of grazings along a branch, at which a chatter is completed.

Behind a grazing that adds a bounce to an incomplete chatter lies the next one, nearer by about the coefficient of
restitution, and so on. Their limit, where the chatter is completed, is not reached along the branch, but from behind:
there the mass sticks for a while, and cycles are followed back to where their stick vanishes.
"""

import numpy as np

from .._hybrid.limits import RELEASE
from .._orbits.sequence import Sequence
from .padding import SPARE, padded, room_for, trimmed
from .parameter_family import ExtendedCycle
from .point import BranchPoint, at_parameter, is_followed
from .requests import Requests, ask, simulation_of
from .tolerances import BEHIND_CASCADE, CASCADE_CERTAIN, CASCADE_RATIO, LIMIT_AWAY, NEAR

# MANY: number of grazings of one stop that make a cascade, if each is nearer to the next than to the one before.
# FEW: the same where no other continuation of the branch is found.
MANY, FEW = 8, 4
# Corrections at each distance behind the limit.
_TRIALS = 4


def limit_of(grazings: list[BranchPoint], least: int) -> ExtendedCycle | None:
    """Limit of grazings by A. C. Aitken's extrapolation, without flights; None if not convergent or too few."""
    if len(grazings) < FEW:
        return None
    p = np.array([point.place.p for point in grazings[-4:]], float)
    steps = np.diff(p)
    ratios = steps[1:] / np.where(steps[:-1] == 0, np.inf, steps[:-1])
    if not np.all((ratios > 0) & (ratios < CASCADE_RATIO)):
        return None
    before, last = (point.place for point in grazings[-2:])
    share = ratios[-1] / (1 - ratios[-1])
    if len(grazings) < least and not abs(share * steps[-1]) < CASCADE_CERTAIN * abs(p[-1] - p[0]):
        return None
    return ExtendedCycle(last.z + share * (last.z - before.z), np.zeros(0), last.p + share * steps[-1])


def is_limit(found: ExtendedCycle, limit: ExtendedCycle, last: ExtendedCycle) -> bool:
    """True if a cycle is the limit of grazings."""
    away, left = found.p - limit.p, last.p - limit.p
    return bool(abs(away) < LIMIT_AWAY * abs(left) and np.all(np.abs(found.z - limit.z) < NEAR + abs(left)))


def cycle_behind_limit(limit: ExtendedCycle, last: BranchPoint) -> Requests[BranchPoint | None]:
    """A cycle with a stick behind a limit, its tangent towards the limit; None if there is none."""
    way = limit.p - last.place.p
    for share in BEHIND_CASCADE:
        found = yield from _with_stick(limit, last, limit.p + share * way)
        if found is not None:
            return found if found.tangent.p * way < 0 else found.turned()
    return None


def _with_stick(limit: ExtendedCycle, last: BranchPoint, p: float) -> Requests[BranchPoint | None]:
    """The simulated cycle with a stick at `p`, corrected until the machine follows it; None if there is none."""
    place = limit._replace(p=np.asarray(p))
    room = room_for(4 * len(last.sequence.kind)) - SPARE
    longer = padded(last.sequence, (), room)[0]
    for _ in range(_TRIALS):
        wide = place._replace(flights=np.zeros(room))
        followed = yield from ask(simulation_of(longer, wide))
        sequence: Sequence = trimmed(followed.sequence, int(np.count_nonzero(followed.sequence.kind >= 0)))
        if RELEASE not in sequence.kind:
            return None
        place = place._replace(flights=followed.flights[: len(sequence.kind)])
        cycle = yield from at_parameter(sequence, place, p)
        if not cycle.found.is_converged:
            return None
        found = BranchPoint.of(sequence, cycle, last.arc)
        if (yield from is_followed(found)):
            return found
        place = found.place
    return None


def shortest_stick(point: BranchPoint) -> float:
    """Duration of the shortest stick, in forcing periods; 0 if there is none."""
    sequence, times = point.sequence, np.append(0.0, np.cumsum(point.place.flights))
    found = [
        times[k + 1] - times[np.flatnonzero(~sequence.held[: k + 1, stop])[-1] + 1]
        for k, stop in enumerate(sequence.stop)
        if sequence.kind[k] == RELEASE and not sequence.held[: k + 1, stop].all()
    ]
    return float(min(found, default=0.0))
