"""One branch, followed in one direction: what is met on a step, and how the branch goes on from there.

Steps on which nothing is met are left to `batched_steps.py`.

`follow_branch` is a generator: it asks for corrected cycles, see `kernels.py`, and is sent the answers, so that many
branches are followed side by side although each is told as if it were alone.
"""

from typing import NamedTuple

import numpy as np

from .._orbits.sequence import Sequence
from .._trajectory.event_log import RELEASE
from .batched_steps import (
    PROBE,
    SHORTEST,
    PlainSteps,
    is_resolved,
    is_sound,
    known_alone,
    next_length,
)
from .closing import first_repeated, is_at_start, rounds_of
from .degenerate_grazing import grazing_of_shorter_cycle
from .grazing_cascade import FEW, MANY, behind, is_limit, limit_of, shortest_stick
from .kernels import Followed, KernelCall, confirm, cycle_of_motion, trimmed
from .locate import first_event, special_points
from .parameter_family import ExtendedCycle
from .point import (
    TRUSTED,
    Asked,
    BranchPoint,
    Ended,
    Full,
    Walk,
    as_it_is,
    at_parameter,
    between,
    predicted_point,
)
from .sequence_switching import as_machine_has_it, by_machine, by_sequence, in_section, off, with_its_bounces
from .test_functions import Test, crossings, tests_of
from .vanishing_flights import end_of_vanishing_flight, hop_that_ends

# Several events on a step longer than this are separated by shorter steps.
_SEPARATE = 1e-4
# A stick as short as this, in forcing periods, vanishes right there.
_MOMENT = 1e-5
# An event this near to a bound is met there.
_ON_BOUND = 1e-8
# How far an orbit that is given is from the cycle that it is, and from its parameter.
_NEAR, _AT = 1e-3, 1e-9
# Steps back to where a stick vanishes.
_MOST_BACK = 100


def point_at_orbit(sequence: Sequence, start: np.ndarray, p: float) -> Asked:
    """The point of a branch at an orbit, given by its start in space; None if there is none.

    Args:
        sequence: with room for its events.
        start: positions and velocities, (2 n,).
        p: the scaled parameter.
    """
    place, followed = yield KernelCall(cycle_of_motion, sequence, (start, np.asarray(p)))
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    sequence, place = trimmed(followed.sequence, num_events), trimmed(place, num_events)
    # At a fold the parameter does not tell one cycle from the next.
    for ask in (at_parameter(sequence, place, p), as_it_is(sequence, place)):
        seen = yield from ask
        away = np.abs(seen.found.place.z - place.z).max()
        if seen.found.is_converged and away < _NEAR and abs(seen.found.place.p - p) < _AT:
            return BranchPoint.of(sequence, seen, 0.0)
    return None


def follow_branch(walk: Walk, start: BranchPoint) -> Asked:
    """Follow a branch from a point in the direction of its tangent; points are added to the walk."""
    try:
        yield from _follow(walk, start)
    except Ended as why:
        walk.end = str(why)


def _follow(walk: Walk, start: BranchPoint) -> Asked:
    walk.rounds = yield from rounds_of(start.sequence, start.place, int(walk.num_periods))
    point, ds = start, PROBE
    while not walk.is_full:
        point, ds = yield PlainSteps(walk, start, point, ds)
        if walk.is_full:
            break
        step, ds = yield from _whole_step(walk, point, ds)
        if step is None:
            point, ds = (yield from _behind_hop(walk, point)), PROBE
            continue
        yield from _add_special(walk, point, step)
        if step.event is not None:
            point, ds = (yield from _beyond(walk, *step.event)), min(ds, PROBE)
            continue
        if (yield from is_at_start(walk, start, point, step.last)):
            raise Ended("closed")
        walk.points.append(step.told)
        point, ds = (yield from with_its_bounces(step.told, step.followed)), step.next_length
        if _has_lost_stick(step.told, point):  # the branch ends between the two
            point = step.told
    walk.end = "max_points"


def _has_lost_stick(told: BranchPoint, point: BranchPoint) -> bool:
    """Whether the last bounces of a chatter are there, but not the stick behind them any more."""
    before, after = (np.count_nonzero(one.sequence.kind == RELEASE) for one in (told, point))
    return bool(after < before and 0 < shortest_stick(told) < _MOMENT)


def _whole_step(walk: Walk, point: BranchPoint, ds: float) -> Asked:
    """A step on which all is known that happens, and its length, halved until it is; None if none is short enough."""
    while ds >= SHORTEST:
        try:
            step = yield from _step(walk, point, ds)
        except Full:
            raise
        except Ended:  # what happens on it could not be located
            step = None
        if step is not None:
            return step, ds
        ds /= 2
    return None, ds


def _behind_hop(walk: Walk, point: BranchPoint) -> Asked:
    """The point from which the branch goes on where no step is short enough, for a hop vanishes; else it ends."""
    event = yield from end_of_vanishing_flight(point)
    if event is None:
        return (yield from _end(walk, point))
    return (yield from _add_and_go_on(walk, point, event))


def _add_and_go_on(walk: Walk, point: BranchPoint, event: BranchPoint) -> Asked:
    """The point behind one where a force touches zero: the mass is held."""
    if not walk.bounds[0] <= event.place.p <= walk.bounds[1]:
        yield from _end_at_bound(walk, point, point.place, event, is_event=True)
    yield from _to_passed(walk, (yield from _add(walk, event)))
    return (yield from off(event))


def _add_special(walk: Walk, point: BranchPoint, step: "Step") -> Asked:
    """Add the bifurcations of a step, and end where the branch does."""
    last = step.last if step.event is None else step.event[1]
    for found in [*step.special, last]:
        is_near = bool(abs(found.place.p - walk.nearest_bound(float(found.place.p))) < _ON_BOUND)
        # A restitution of 0 is such a bound: impacts whose speed it makes vanish there, all at once.
        is_at_it = is_near and found is last and step.event is not None
        if is_at_it or not walk.bounds[0] <= found.place.p <= walk.bounds[1]:
            yield from _to_bound(walk, point, found, is_event=is_at_it)
        if found is last:
            return
        yield from _to_passed(walk, (yield from _add(walk, found)))
        if found.kind == "period_doubling":
            raise Ended("period_doubling")


def _end(walk: Walk, point: BranchPoint) -> Asked:
    """End where no step is short enough."""
    if 0 < shortest_stick(point) < _MOMENT:
        # Sticks vanish faster than they shorten: what is left of the way is rounding.
        if walk.points and walk.points[-1].arc == point.arc:
            walk.points.pop()
        yield from _add(walk, point._replace(kind="chatter_completion"))
        raise Ended("chatter_completion")
    yield from _to_limit(walk, FEW)
    # The light impacts of a cascade are those of a chatter.
    grazing = None if walk.cascade else (yield from grazing_of_shorter_cycle(point))
    if grazing is not None:
        yield from _add(walk, grazing)
        raise Ended("gr")
    raise Ended("left_the_stops")


class Step(NamedTuple):
    """A step along a branch.

    Attributes:
        last: the point at its end, or just before the first event.
        told: the point at its end with its events in the cycle.
        followed: what the machine does that is started there.
        event: the first change of the sequence, and the point where it is; or None.
        special: bifurcations on the way, in their order.
        next_length: of the next step.
    """

    last: BranchPoint
    told: BranchPoint
    followed: Followed
    event: tuple[Test, BranchPoint] | None
    special: list[BranchPoint]
    next_length: float


def _step(walk: Walk, point: BranchPoint, ds: float) -> Asked:
    """A step from a point, or None if it is too long to know all that happens on it."""
    new = yield from _ahead(point, ds)
    if new is None:
        return None
    before, after = known_alone(point), known_alone(new)
    if not is_resolved(before, after, ds)[0]:
        return None
    met = crossings(tests_of(point.sequence), point.seen, new.seen)
    if any(test.kind == "chatter_completion" and not _is_plastic(point, test) for test in met):
        return None  # there are ever more bounces on the way
    told, followed = yield from _told_by_machine(walk, new)
    if not (met or told.is_admissible) or (len(met) > 1 and ds > _SEPARATE):
        return None
    event, last = yield from first_event(point, new, met)
    special = yield from special_points(walk, point, last)
    if special is None and ds > _SEPARATE:
        return None
    length = float(next_length(new.seen.found, before, after, ds)[0])
    return Step(last, told, followed, event, special or [], length)


def _is_plastic(point: BranchPoint, test: Test) -> bool:
    """Whether the stop of an event has no rebound."""
    return bool(point.seen.watched.is_plastic[point.sequence.stop[test.index]])


def _ahead(point: BranchPoint, ds: float) -> Asked:
    """The next point, or None if the branch is too curved for such a step."""
    new: BranchPoint = yield from predicted_point(point, ds)
    return new if is_sound(new.seen.found, new.tangent.along(point.tangent), ds) else None


def _told_by_machine(walk: Walk, point: BranchPoint) -> Asked:
    """The point with its events in the cycle, whether the machine follows it, and what it does."""
    point = yield from in_section(point, walk.num_periods)
    followed: Followed = yield KernelCall(confirm, point.sequence, (point.place,))
    is_trusted = np.abs(point.seen.found.multipliers[0]) < TRUSTED
    return point._replace(is_admissible=bool(followed.is_alike or not is_trusted)), followed


def _add(walk: Walk, point: BranchPoint) -> Asked:
    """Add a point to the walk, as it is with all its events in the cycle."""
    point = yield from in_section(point, walk.num_periods)
    walk.points.append(point)
    return point


def _beyond(walk: Walk, test: Test, event: BranchPoint) -> Asked:
    """The point from which the branch goes on behind an event."""
    hop = yield from hop_that_ends(test, event)
    if hop is not None:
        return (yield from _add_and_go_on(walk, event, hop))
    yield from _to_passed(walk, (yield from _add(walk, event)))
    same = [entry for entry in walk.cascade if entry[0] == test.index]
    walk.cascade = [*same, (test.index, event)] if test.kind == "touch" else []
    yield from _to_limit(walk, MANY)
    try:
        return (yield from by_sequence(walk, test, event))
    except Ended:
        return (yield from by_machine(event, test.kind))


def _to_passed(walk: Walk, last: BranchPoint) -> Asked:
    """End where the last bifurcation was passed before; keep each once."""
    again = yield from first_repeated(walk, last)
    if again is not None:
        del walk.points[again:]
        raise Ended("closed")


def _to_limit(walk: Walk, least: int) -> Asked:
    """End at the limit of the last grazings, if they are so many and lead to one."""
    grazings = [point for _, point in walk.cascade]
    limit = limit_of(grazings, least)
    start = (yield from behind(limit, grazings[-1])) if limit else None
    if limit is None or start is None:
        return
    event = grazings[-1]
    back = Walk(walk.num_periods, walk.bounds, _MOST_BACK)
    yield from follow_branch(back, start)
    last = back.points[-1] if back.end == "chatter_completion" else None
    if isinstance(last, BranchPoint) and is_limit(last.place, limit, event.place):
        way = np.append(last.place.z - event.place.z, last.place.p - event.place.p)
        arc = max(walk.points[-1].arc, event.arc + float(np.linalg.norm(way)))
        walk.points.append(last._replace(arc=arc))
        raise Ended("chatter_completion")


def _to_bound(walk: Walk, point: BranchPoint, new: BranchPoint, *, is_event: bool) -> Asked:
    """Add the point at the bound of the parameter that lies between two, or at which an event is, and end."""
    p = walk.nearest_bound(float(new.place.p))
    share = (p - point.place.p) / (new.place.p - point.place.p)
    if share <= 0:
        raise Ended("bounds")
    guess, arc = between(point, new, share), point.arc + share * (new.arc - point.arc)
    yield from _end_at_bound(walk, point, guess, new._replace(arc=arc), is_event=is_event)


def _end_at_bound(
    walk: Walk, point: BranchPoint, guess: ExtendedCycle, new: BranchPoint, *, is_event: bool
) -> Asked:
    """Add the point at the bound next to a new one, which has its length of the branch, and end."""
    p = np.asarray(walk.nearest_bound(float(new.place.p)))
    at = yield from _at_bound(point, guess._replace(p=p), is_event=is_event)
    exact = at.seen.found.place._replace(p=p)
    seen = at.seen._replace(found=at.seen.found._replace(place=exact))
    yield from _add(walk, BranchPoint.of(at.sequence, seen, new.arc))
    raise Ended("bounds")


def _at_bound(point: BranchPoint, guess: ExtendedCycle, *, is_event: bool) -> Asked:
    """The cycle at a bound; where events vanish there, what the machine does."""
    p = float(guess.p)
    if not is_event:
        seen = yield from at_parameter(point.sequence, guess, p)
        if seen.found.is_converged:
            return BranchPoint.of(point.sequence, seen, point.arc)
    found = yield from as_machine_has_it(point, guess)
    if found is None:
        raise Ended("not_converged")
    return found
