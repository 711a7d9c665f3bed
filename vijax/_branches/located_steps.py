"""A step along a branch, with the events and bifurcations on it."""

from typing import NamedTuple

import numpy as np

from .kernels import SimulatedMotion
from .kinds import Kind
from .locate import first_event, is_passed, special_points
from .margin_sizes import Sizes
from .point import (
    BranchPoint,
    DirectedBranch,
    End,
    predicted_point,
)
from .requests import HostCall, Requests, ask, simulation_of
from .section import in_section
from .steps import PlainSteps, Tried
from .test_functions import (
    TestFunction,
    begins_with_contact,
    crossings,
    grips,
    is_plastic,
    stops_in_impacts,
    tests_of,
    without_echoes,
)
from .tolerances import NEGLIGIBLE, PROBE_STEP, SEPARATE_EVENTS, TRIALS_AHEAD, TRUSTED


def _hides_stop(event: tuple[TestFunction, BranchPoint] | None) -> bool:
    """True if a slip from an impact has no duration as friction sticks within that, over a whole interval of the step."""
    if event is None:
        return False
    test, at = event
    sequence, grip, k = at.sequence, at.cycle.watched.grip, test.index
    if grip is None or not (test.of_flight and begins_with_contact(sequence, k)):
        return False
    return bool(grip[k - 1, sequence.stop[k]] > NEGLIGIBLE)


def is_at_corner(point: BranchPoint) -> bool:
    """True if friction just stops within an impact: the branch turns back so sharply that no step leads there."""
    left = np.abs(grips(point.sequence, point.cycle))
    return bool(np.nanmin(left, initial=np.inf) < NEGLIGIBLE)


class Confirmed(NamedTuple):
    """End of a step with all its events between the start and the end of the cycle, and the motion of the machine from it."""

    point: BranchPoint
    followed: SimulatedMotion


class Step(NamedTuple):
    """A step along a branch.

    Attributes:
        last: point at its end, or just before the first event.
        confirmed: its end as the machine follows it; None behind an event.
        event: first change of the sequence, and the point where it happens; or None.
        special: bifurcations on the step, in order.
        next_length: length of the next step.
    """

    last: BranchPoint
    confirmed: Confirmed | None
    event: tuple[TestFunction, BranchPoint] | None
    special: list[BranchPoint]
    next_length: float


def located_step(
    walk: DirectedBranch, point: BranchPoint, ds: float, tried: Tried | None
) -> Requests[Step | End | None]:
    """A step from a point; None if it is too long to resolve all that happens on it, an `End` if an event is not located."""
    if tried is None:
        _, _, tried = yield from ask(PlainSteps(walk, point, point, ds, is_trial=True))
    if tried is None:
        return None
    new = tried.point
    crossed = crossings(tests_of(point.sequence), point.cycle, new.cycle)
    met = without_echoes(point.sequence, crossed)
    met += stops_in_impacts(point.sequence, point.cycle, new.cycle)
    if any(
        test.kind == Kind.CHATTER_COMPLETION and not is_plastic(point.sequence, point.cycle, test)
        for test in met
    ):
        return None  # ever more bounces accumulate on the step
    confirmed = None
    if not met:
        confirmed = yield from _confirmed(walk, new, tried.motion)
        if isinstance(confirmed, End) or not confirmed.point.is_admissible:
            return None
    sizes = yield from ask(HostCall(Sizes.of, point.sequence))
    first = yield from first_event(point, new, met, sizes)
    if isinstance(first, End):
        return first
    event, last = first
    if _hides_stop(event) or any(is_passed(test, last, sizes) for test in crossed if test not in met):
        return None  # a guard that vanishes before the event with which it seemed to vanish
    specials = yield from special_points(walk, point, last)
    if isinstance(specials, End):
        return specials
    special, is_whole = specials
    if not is_whole and ds > SEPARATE_EVENTS:
        return None
    return Step(last, confirmed, event, special, tried.next_length if event is None else min(ds, PROBE_STEP))


def step_to_corner(walk: DirectedBranch, point: BranchPoint) -> Requests[Step | End | None]:
    """A step to where friction stops within an impact, where the branch bends so that no step passes; None if there is none."""
    for ds in TRIALS_AHEAD if is_at_corner(point) else ():
        new = yield from predicted_point(point, ds)
        stops = (
            stops_in_impacts(point.sequence, point.cycle, new.cycle) if new.cycle.found.is_converged else []
        )
        if not stops or crossings(tests_of(point.sequence), point.cycle, new.cycle):
            continue
        sizes = yield from ask(HostCall(Sizes.of, point.sequence))
        first = yield from first_event(point, new, stops, sizes)
        if isinstance(first, End):
            continue
        specials = yield from special_points(walk, point, first[1])
        return (
            specials if isinstance(specials, End) else Step(first[1], None, first[0], specials[0], PROBE_STEP)
        )
    return None


def _confirmed(
    walk: DirectedBranch, point: BranchPoint, known: SimulatedMotion | None
) -> Requests[Confirmed | End]:
    """The point with its events inside the cycle and its admissibility set, and the motion of the machine from it.

    `known` is the motion from the given point, if it was simulated.
    """
    within = yield from in_section(point, walk.num_periods)
    if isinstance(within, End):
        return within
    followed = known if within is point else None
    point = within
    if followed is None:
        followed = yield from ask(simulation_of(point.sequence, point.place))
    is_trusted = np.abs(point.cycle.found.multipliers[0]) < TRUSTED
    return Confirmed(point._replace(is_admissible=bool(followed.is_alike or not is_trusted)), followed)
