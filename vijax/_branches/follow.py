"""Follow one branch in one direction: locate the events of a step, and continue the branch behind them.

Steps without events belong to `steps.py`. `follow_branch` is a generator: it yields requests for corrected
cycles, see `kernels.py`, and receives the answers. So many branches run side by side, while this code treats one alone.
"""

from dataclasses import dataclass

import numpy as np

from .._hybrid.limits import RELEASE
from .._orbits.sequence import Sequence
from .behind_event import step_off, with_margins
from .closing import first_repeated, is_at_start, repetitions_of
from .degenerate_grazing import grazing_of_shorter_cycle
from .events.cross import cross
from .grazing_cascade import FEW, MANY, cycle_behind_limit, is_limit, limit_of, shortest_stick
from .kernels import SimulatedMotion
from .kinds import EndKind, Kind, public_kind
from .located_steps import Step, is_at_corner, located_step, step_to_corner
from .margin_sizes import Sizes
from .padding import MOST_EVENTS, padded, trimmed
from .parameter_family import ExtendedCycle
from .point import (
    BranchPoint,
    DirectedBranch,
    End,
    TooManyEvents,
    at_parameter,
    between,
    correct_with_free_parameter,
)
from .requests import HostCall, Requests, ask, simulation_from
from .section import in_section
from .simulated_events import cycle_of_simulation, with_simulated_bounces
from .steps import PlainSteps, Tried
from .test_functions import (
    TestFunction,
    kind_at,
    tests_of,
)
from .tolerances import (
    EXACT,
    NEGLIGIBLE,
    ORBIT_NEAR,
    PROBE_STEP,
    ROUNDED,
    SAME,
    SHORTER_BEHIND,
    VANISHING_STICK,
)
from .vanishing_flights import end_of_vanishing_flight, hop_that_ends
from .walk import AbstractCurve, walk as walk_along

# Factor of the room for events of an orbit where it was too little.
_MORE = 2
# Most points of a walk back to where a stick vanishes.
_MOST_BACK = 100


def point_at_orbit(sequence: Sequence, start: np.ndarray, p: float) -> Requests[BranchPoint | None]:
    """The branch point at an orbit with a start in space, (2 n,), and a scaled parameter; None if there is none.

    `sequence` is padding with room for the events of the orbit, as far as they are known.
    """
    followed = yield from ask(simulation_from(sequence, start, p))
    while np.all(followed.sequence.kind >= 0) and len(followed.sequence.kind) < MOST_EVENTS:
        (sequence,) = padded(sequence, (), min(_MORE * len(followed.sequence.kind), MOST_EVENTS))
        followed = yield from ask(simulation_from(sequence, start, p))
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    sequence = trimmed(followed.sequence, num_events)
    place = trimmed(ExtendedCycle(followed.z, followed.flights, np.asarray(p)), num_events)
    # At a fold a fixed parameter does not determine the cycle, so `correct_with_free_parameter` leaves it free.
    for request in (at_parameter(sequence, place, p), correct_with_free_parameter(sequence, place)):
        cycle = yield from request
        away = np.abs(cycle.found.place.z - place.z).max()
        if cycle.found.is_converged and away < ORBIT_NEAR and abs(cycle.found.place.p - p) < ROUNDED:
            return BranchPoint.of(sequence, cycle, 0.0)
    return None


def follow_branch(walk: DirectedBranch, start: BranchPoint) -> Requests[None]:
    """Follow a branch from a point in the direction of its tangent, and add its points to the walk."""
    try:
        end = yield from _follow(walk, start)
    except TooManyEvents:
        end = End(EndKind.MAX_EVENTS)
    added = None if end.point is None else (yield from _add(walk, end.point))
    walk.end = str(added.kind if isinstance(added, End) else end.kind)


def _follow(walk: DirectedBranch, start: BranchPoint) -> Requests[End]:
    """Follow a branch to its end."""
    walk.rounds = yield from repetitions_of(start.sequence, start.place, walk.num_periods)
    first = yield from _behind_event_at_start(walk, start)
    if isinstance(first, End):
        return first
    end = yield from walk_along(_Branch(walk, start), first, PROBE_STEP)
    return end or End(EndKind.MAX_POINTS)


@dataclass(frozen=True)
class _Branch(AbstractCurve[BranchPoint, Step]):
    """A branch as the curve of a walk.

    Attributes:
        walk: receives the points.
        start: the first of them.
    """

    walk: DirectedBranch
    start: BranchPoint

    @property
    def is_full(self) -> bool:
        return self.walk.is_full

    def plain_steps(self, here: BranchPoint, ds: float) -> Requests[tuple[BranchPoint, float, Tried | None]]:
        """Take plain steps in one compiled program."""
        return ask(PlainSteps(self.walk, self.start, here, ds))

    def step(self, here: BranchPoint, ds: float, tried: Tried | None) -> Requests[Step | None]:
        """Make a step with its events; None if they are not resolved."""
        step = yield from located_step(self.walk, here, ds, tried)
        return None if isinstance(step, End) else step

    def take(self, here: BranchPoint, step: Step) -> Requests[tuple[BranchPoint, float] | End]:
        """Add the bifurcations of a step and its end, and continue behind its event."""
        end = yield from _add_special(self.walk, here, step)
        if end is not None:
            return end
        if step.event is not None:
            behind = yield from _continue_behind_event(self.walk, *step.event)
            return behind if isinstance(behind, End) else (behind, step.next_length)
        if (yield from is_at_start(self.walk, self.start, here, step.last)):
            return End(EndKind.CLOSED)
        assert step.confirmed is not None
        self.walk.points.append(step.confirmed.point)
        return (yield from _with_bounces(*step.confirmed)), step.next_length

    def beyond(self, here: BranchPoint) -> Requests[tuple[BranchPoint, float] | End]:
        """Go on at a corner that no step passes, or behind a vanishing hop."""
        step = yield from step_to_corner(self.walk, here)
        if isinstance(step, Step):
            return (yield from self.take(here, step))
        behind = step or (yield from _continue_behind_hop(self.walk, here))
        return behind if isinstance(behind, End) else (behind, PROBE_STEP)


def _with_bounces(point: BranchPoint, followed: SimulatedMotion) -> Requests[BranchPoint]:
    """The point from which to step on, with the bounces of the machine, unless the branch ends between the two."""
    bounced = yield from with_simulated_bounces(point, followed)
    return point if _has_lost_stick(point, bounced) else bounced


def _behind_event_at_start(walk: DirectedBranch, start: BranchPoint) -> Requests[BranchPoint | End]:
    """The start, or the point behind its event: given orbits may lie on one, where a test function is rounding and falls."""
    sizes = yield from ask(HostCall(Sizes.of, start.sequence))
    for test in tests_of(start.sequence):
        size = sizes.of_test(test, start.sequence)
        if (
            test.rate
            and abs(test.of(start.cycle)) < EXACT * size
            and test.rate(start.cycle) < -NEGLIGIBLE * size
        ):
            event = start._replace(kind=kind_at(test, start.sequence, start.cycle))
            return (yield from _continue_behind_event(walk, test, event))
    return start


def _has_lost_stick(confirmed: BranchPoint, point: BranchPoint) -> bool:
    """True if the last bounces of a chatter are added, but the stick behind them has vanished."""
    before, after = (np.count_nonzero(one.sequence.kind == RELEASE) for one in (confirmed, point))
    return bool(after < before and 0 < shortest_stick(confirmed) < VANISHING_STICK)


def _continue_behind_hop(walk: DirectedBranch, point: BranchPoint) -> Requests[BranchPoint | End]:
    """Continue behind a vanishing hop where no step is short enough; end the branch if there is no such hop."""
    event = yield from end_of_vanishing_flight(point)
    if event is None:
        return (yield from _end(walk, point))
    return (yield from _add_and_release_hold(walk, point, event))


def _add_and_release_hold(
    walk: DirectedBranch, point: BranchPoint, event: BranchPoint
) -> Requests[BranchPoint | End]:
    """Add a point where a contact force touches zero, and continue behind it, where the mass stays held."""
    if not walk.bounds[0] <= event.place.p <= walk.bounds[1]:
        return (yield from _end_at_bound(walk, point, point.place, event, is_event=True))
    end = yield from _add_if_new(walk, event)
    if end is not None:
        return end
    return (yield from step_off(event, True, with_margins)) or End(EndKind.SEVERAL_EVENTS)


def _add_special(walk: DirectedBranch, point: BranchPoint, step: "Step") -> Requests[End | None]:
    """Add the bifurcations of a step; the end at a bound, or at the period doubling where a doubled branch ends, or None."""
    last = step.last if step.event is None else step.event[1]
    for found in [*step.special, last]:
        is_near = bool(abs(found.place.p - walk.nearest_bound(float(found.place.p))) < SAME)
        # At the bound restitution = 0, for instance, all impacts whose speed it makes vanish do so at once.
        is_at_it = is_near and found is last and step.event is not None
        if is_at_it or not walk.bounds[0] <= found.place.p <= walk.bounds[1]:
            return (yield from _end_between(walk, point, found, is_event=is_at_it))
        if found is last:
            break
        end = yield from _add_if_new(walk, found)
        if end is not None or found.kind == Kind.HALF_PERIOD:
            return end or End(Kind.HALF_PERIOD)
    return None


def _end(walk: DirectedBranch, point: BranchPoint) -> Requests[End]:
    """The end of the branch where no step is short enough."""
    # Sticks vanish faster than they shorten: the rest of the way is rounding.
    is_stick = 0 < shortest_stick(point) < VANISHING_STICK
    if is_stick or is_at_corner(point):
        kind = Kind.CHATTER_COMPLETION if is_stick else Kind.IN_IMPACT
        if walk.points and walk.points[-1].arc == point.arc:
            walk.points.pop()
        return End(public_kind(kind), point._replace(kind=kind))
    limit = yield from _end_at_cascade_limit(walk, FEW)
    if limit is not None:
        return limit
    # The light impacts of a cascade belong to a chatter, not to a shorter cycle that grazes.
    is_alone = bool(walk.cascade) or point.sequence.num_groups > 1
    grazing = None if is_alone else (yield from grazing_of_shorter_cycle(point))
    return End(EndKind.LEFT_THE_STOPS) if grazing is None else End(Kind.GRAZING, grazing)


def _add(walk: DirectedBranch, point: BranchPoint) -> Requests[BranchPoint | End]:
    """Add a point to the walk, with all its events inside the cycle."""
    within = yield from in_section(point, walk.num_periods)
    if isinstance(within, BranchPoint):
        walk.points.append(within)
    return within


def _continue_behind_event(
    walk: DirectedBranch, test: TestFunction, event: BranchPoint
) -> Requests[BranchPoint | End]:
    """The point from which the branch continues behind an event."""
    hop = yield from hop_that_ends(test, event)
    if hop is not None:
        return (yield from _add_and_release_hold(walk, event, hop))
    end = yield from _add_if_new(walk, event)
    if end is not None:
        return end
    same = [entry for entry in walk.cascade if entry[0] == test.index]
    is_touch = test.kind == Kind.TOUCH and event.sequence.num_groups == 1
    walk.cascade = [*same, (test.index, event)] if is_touch else []
    limit = yield from _end_at_cascade_limit(walk, MANY)
    if limit is not None:
        return limit
    new = yield from cross(walk, test, event)
    if new is None:
        return End(public_kind(event.kind))
    rounds = yield from repetitions_of(new.sequence, new.place, walk.num_periods, SHORTER_BEHIND)
    # It meets the branch of a shorter cycle, whose bifurcations are not its own; motion without events, which has none,
    # continues it where it was not before.
    is_ahead = bool(new.tangent.p * event.tangent.p > 0)
    is_other = rounds > walk.rounds and (len(new.sequence.kind) > 0 or not is_ahead)
    walk.rounds = rounds
    return End(public_kind(event.kind)) if is_other else new


def _add_if_new(walk: DirectedBranch, point: BranchPoint) -> Requests[End | None]:
    """Add a bifurcation; the end of the branch if that was passed before, each bifurcation being kept once, or None."""
    last = yield from _add(walk, point)
    if isinstance(last, End):
        return last
    again = yield from first_repeated(walk, last)
    if again is None:
        return None
    del walk.points[again:]
    return End(EndKind.CLOSED)


def _end_at_cascade_limit(walk: DirectedBranch, least: int) -> Requests[End | None]:
    """The end at the limit of the last grazings, if there are at least so many and they converge; else None."""
    grazings = [point for _, point in walk.cascade]
    limit = limit_of(grazings, least)
    start = (yield from cycle_behind_limit(limit, grazings[-1])) if limit else None
    if limit is None or start is None:
        return None
    event = grazings[-1]
    back = DirectedBranch(walk.num_periods, walk.bounds, _MOST_BACK)
    yield from follow_branch(back, start)
    last = back.points[-1] if back.end == Kind.CHATTER_COMPLETION else None
    if not isinstance(last, BranchPoint) or not is_limit(last.place, limit, event.place):
        return None
    arc = max(walk.points[-1].arc, event.arc + last.place.distance_of_starts(event.place))
    return End(Kind.CHATTER_COMPLETION, last._replace(arc=arc))


def _end_between(
    walk: DirectedBranch, point: BranchPoint, new: BranchPoint, *, is_event: bool
) -> Requests[End]:
    """The end at the parameter bound between two points, or at the event on the bound."""
    p = walk.nearest_bound(float(new.place.p))
    share = (p - point.place.p) / (new.place.p - point.place.p)
    if share <= 0:
        return End(EndKind.BOUNDS)
    guess, arc = between(point, new, share), point.arc + share * (new.arc - point.arc)
    return (yield from _end_at_bound(walk, point, guess, new._replace(arc=arc), is_event=is_event))


def _end_at_bound(
    walk: DirectedBranch, point: BranchPoint, guess: ExtendedCycle, new: BranchPoint, *, is_event: bool
) -> Requests[End]:
    """The end at the bound nearest to a new point, with the arclength of the new point."""
    p = np.asarray(walk.nearest_bound(float(new.place.p)))
    at = yield from _at_bound(point, guess._replace(p=p), is_event=is_event)
    if at is None:
        return End(EndKind.NOT_CONVERGED)
    exact = at.cycle.found.place._replace(p=p)
    cycle = at.cycle._replace(found=at.cycle.found._replace(place=exact))
    return End(EndKind.BOUNDS, BranchPoint.of(at.sequence, cycle, new.arc))


def _at_bound(point: BranchPoint, guess: ExtendedCycle, *, is_event: bool) -> Requests[BranchPoint | None]:
    """The cycle at a bound, from the motion of the machine where events vanish there; None if there is none."""
    p = float(guess.p)
    if not is_event:
        cycle = yield from at_parameter(point.sequence, guess, p)
        if cycle.found.is_converged:
            return BranchPoint.of(point.sequence, cycle, point.arc)
    return (yield from cycle_of_simulation(point, guess))
