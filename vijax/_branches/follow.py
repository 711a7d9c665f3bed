"""One branch, followed in one direction: steps, what is met on a step, and how the branch goes on from there.

`follow` is a generator: it asks for corrected cycles, see `programs.py`, and is sent the answers, so that many
branches are followed side by side although each is told as if it were alone.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .._orbits.sequence import NOTHING, Sequence
from .._trajectory.event_log import IMPACT, RELEASE
from .._types import Reals
from .changes import passed_section, shifted, with_event, with_order_exchanged, without_event
from .family import Place
from .programs import Followed, Rates, Request, Seen, confirm, locate_start, look, rates_along, tell, trimmed
from .zero import Bracket, next_trial

# Lengths of steps: the first, the longest, the shortest, and what leads off a point where the sequence changes.
_FIRST, _LONGEST, _SHORTEST, _OFF = 2e-3, 5e-2, 1e-9, 1e-7
# Where no step leads off, the machine itself is tried at these distances.
_TRIALS = 1e-6, 1e-5, 1e-4, 1e-3
# Several events on a step longer than this are separated by shorter steps.
_SEPARATE = 1e-4
# A stick as short as this, in forcing periods, vanishes right there.
_MOMENT = 1e-5
# The most by which a step may turn, as a cosine; iterations of Newton's method after which steps grow, or shrink.
_TURN, _FEW, _MANY = 0.98, 4, 7
# A multiplier this close to where it should be is there; halves of a cycle this close are one.
CLOSE = 1e-4
# Cycles by which a branch is first interpolated, how far from a point the others are at least, and how well it is known.
_NODES, _REACH, _CERTAIN = 9, 1e-3, 1e-10
# Runs of orbits whose neighbours leave faster than this say nothing.
TRUSTED = 1e4

Asked = Generator[Request, Any, Any]


class Point(NamedTuple):
    """A cycle on a branch.

    Attributes:
        sequence: what happens.
        place: the cycle.
        seen: what is known of it.
        kind: of the bifurcation, or "".
        arc: length of the branch from where it was begun.
        is_admissible: whether the machine follows it.
    """

    sequence: Sequence
    place: Place
    seen: Seen
    kind: str
    arc: float
    is_admissible: bool

    @classmethod
    def of(cls, sequence: Sequence, seen: Seen, arc: float, *, kind: str = "") -> "Point":
        """A point as it is seen."""
        return cls(
            sequence, trimmed(seen.found.place, len(sequence.kind)), seen, kind, arc, is_admissible=True
        )

    @property
    def tangent(self) -> Place:
        """Of the branch."""
        return trimmed(self.seen.found.tangent, len(self.sequence.kind))

    def turned(self) -> "Point":
        """The point, to be left in the other direction."""
        found = self.seen.found
        return self._replace(seen=self.seen._replace(found=found._replace(tangent=found.tangent.turned())))


@dataclass
class Walk:
    """A branch in one direction, as far as it was followed.

    Attributes:
        num_periods: n.
        bounds: of the scaled parameter.
        max_points: the most points.
        points: so far.
        end: why it ended.
    """

    num_periods: float
    bounds: tuple[float, float]
    max_points: int
    points: list[Point] = field(default_factory=list)
    end: str = "interrupted"

    @property
    def is_full(self) -> bool:
        """Whether there are as many points as were asked for."""
        return len(self.points) >= self.max_points


class Ended(Exception):
    """A branch is not followed any further; says why."""


# --- corrected cycles -------------------------------------------------------------------------------------------------


def at_parameter(sequence: Sequence, guess: Place, p: float) -> Asked:
    """The cycle at a value of the parameter."""
    only_p = Place(0 * guess.z, 0 * guess.flights, np.asarray(1.0))
    return (yield from corrected(sequence, guess, only_p, p))


def on_plane(point: Point, guess: Place, s: float) -> Asked:
    """The cycle where the branch meets the plane across its tangent, some way from a point."""
    tangent = point.tangent
    return (yield from corrected(point.sequence, guess, tangent, point.place.along(tangent) + s))


def corrected(sequence: Sequence, guess: Place, weights: Place, target: float) -> Asked:
    """The cycle with `weights . place = target`."""
    seen: Seen = yield Request(look, sequence, (guess, weights, np.asarray(target)))
    return seen


# --- test functions ---------------------------------------------------------------------------------------------------


class Test(NamedTuple):
    """A function that changes its sign where something happens, and what that is."""

    kind: str
    of: Callable[[Seen], float]
    index: int = 0


def _ratio(values: Any, of: Any) -> float:
    """The product of values over 1 + |of|: finite where a multiplier is not."""
    with np.errstate(invalid="ignore"):
        parts = values / (1 + np.abs(of))
    return float(np.prod(np.where(np.isfinite(parts), parts, np.sign(of.real))).real)


def _plus(seen: Seen) -> float:
    mu = seen.found.multipliers
    return _ratio(1 + mu, mu)


def _minus(seen: Seen) -> float:
    mu = seen.found.multipliers
    return _ratio(mu - 1, mu)


def _pairs(seen: Seen) -> float:
    mu = seen.found.multipliers
    first, second = np.triu_indices(len(mu), 1)
    with np.errstate(invalid="ignore"):
        products = mu[first] * mu[second]
    return _ratio(products - 1, np.where(np.isnan(products), 0, products))


TESTS_OF_NEIGHBOURS = (
    Test("fold", lambda seen: float(seen.found.tangent.p)),
    Test("pd", _plus),
    Test("bp", _minus),
    Test("ns", _pairs),
)


def tests_of(sequence: Sequence) -> list[Test]:
    """Test functions of the sequence: positive as long as a machine can follow it."""
    found = []
    for k, (kind, stop) in enumerate(zip(sequence.kind, sequence.stop, strict=True)):
        if kind == IMPACT:
            found.append(Test("gr", lambda seen, k=k: float(seen.found.speeds[k]), k))
        # Two impacts of one stop meet where one of them has no speed.
        if k > 0 and not (kind == sequence.kind[k - 1] and stop == sequence.stop[k - 1]):
            ends_stick = kind == RELEASE and sequence.held[k][stop] and not sequence.held[k - 1][stop]
            name = "chatter_completion" if ends_stick else "double_impact"
            found.append(Test(name, lambda seen, k=k: float(seen.found.place.flights[k]), k))
    for j in range(sequence.held.shape[1]):
        found.append(Test("touch", lambda seen, j=j: float(seen.watched.gap[j]), j))
        found.append(Test("force_zero", lambda seen, j=j: float(seen.watched.force[j]), j))
    return found


def _crossings(tests: list[Test], before: Seen, after: Seen) -> list[Test]:
    """Those that change from positive to not positive."""
    return [test for test in tests if test.of(before) > 0 >= test.of(after)]


def num_unstable(seen: Seen) -> int:
    """How many neighbours leave."""
    return int(np.count_nonzero(np.abs(seen.found.multipliers) > 1))


# What is seen from two sides has one name.
KINDS = {"touch": "gr", "period_doubling": "pd"}


# --- a branch ---------------------------------------------------------------------------------------------------------


def begin(sequence: Sequence, start: np.ndarray, p: float) -> Asked:
    """The point of a branch at an orbit, given by its start in space; None if there is none.

    Args:
        sequence: with room for its events.
        start: positions and velocities, (2 n,).
        p: the scaled parameter.
    """
    place, followed = yield Request(tell, sequence, (start, np.asarray(p)))
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    sequence, place = trimmed(followed.sequence, num_events), trimmed(place, num_events)
    seen = yield from at_parameter(sequence, place, p)
    away = np.abs(seen.found.place.z - place.z).max()
    if not seen.found.is_converged or not away < 1e-3:
        return None
    return Point.of(sequence, seen, 0.0)


def follow(walk: Walk, start: Point) -> Asked:
    """Follow a branch from a point in the direction of its tangent; points are added to the walk."""
    try:
        yield from _follow(walk, start)
    except Ended as why:
        walk.end = str(why)


def _follow(walk: Walk, start: Point) -> Asked:
    point, ds = start, _FIRST
    while not walk.is_full:
        try:
            step = yield from _step(walk, point, ds)
        except Ended:  # what happens on it could not be located
            step = None
        if step is None:
            ds /= 2
            if ds < _SHORTEST:
                yield from _end(walk, point)
            continue
        yield from _add_special(walk, point, step)
        if step.event is not None:
            point, ds = (yield from _beyond(walk, *step.event)), min(ds, _FIRST)
            continue
        if (yield from _is_closed(walk, start, point, step.last)):
            raise Ended("closed")
        walk.points.append(step.told)
        point, ds = (yield from _with_its_bounces(step.told, step.followed)), min(ds * step.longer, _LONGEST)
    walk.end = "max_points"


def _add_special(walk: Walk, point: Point, step: "Step") -> Asked:
    """Add the bifurcations of a step, and end where the branch does."""
    for found in [*step.special, step.last]:
        if not walk.bounds[0] <= found.place.p <= walk.bounds[1]:
            yield from _to_bound(walk, point, found)
        if found is not step.last:
            yield from _add(walk, found)
        if found.kind == "period_doubling":
            raise Ended("period_doubling")


def _end(walk: Walk, point: Point) -> Asked:
    """End where no step is short enough."""
    if 0 < _shortest_stick(point) < _MOMENT:
        # Sticks vanish faster than they shorten: what is left of the way is rounding.
        if walk.points and walk.points[-1].arc == point.arc:
            walk.points.pop()
        yield from _add(walk, point._replace(kind="chatter_completion"))
        raise Ended("chatter_completion")
    raise Ended("left_the_stops")


def _shortest_stick(point: Point) -> float:
    """How long the shortest hold of a stop lasts, in forcing periods; 0 if there is none."""
    sequence, times = point.sequence, np.append(0.0, np.cumsum(point.place.flights))
    found = [
        times[k + 1] - times[np.flatnonzero(~sequence.held[: k + 1, stop])[-1] + 1]
        for k, stop in enumerate(sequence.stop)
        if sequence.kind[k] == RELEASE and not sequence.held[: k + 1, stop].all()
    ]
    return float(min(found, default=0.0))


class Step(NamedTuple):
    """A step along a branch.

    Attributes:
        last: the point at its end, or just before the first event.
        told: the point at its end with its events in the cycle.
        followed: what the machine does that is started there.
        event: the first change of the sequence, and the point where it is; or None.
        special: bifurcations on the way, in their order.
        longer: by how much the next step may be longer.
    """

    last: Point
    told: Point
    followed: Followed
    event: tuple[Test, Point] | None
    special: list[Point]
    longer: float


def _step(walk: Walk, point: Point, ds: float) -> Asked:
    """A step from a point, or None if it is too long to know all that happens on it."""
    new = yield from _ahead(point, ds)
    if new is None:
        return None
    met = _crossings(tests_of(point.sequence), point.seen, new.seen)
    told, followed = yield from _told_by_machine(walk, new)
    if not (met or told.is_admissible) or (len(met) > 1 and ds > _SEPARATE):
        return None
    event, last = yield from _first_event(point, new, met)
    special = yield from _special(walk, point, last)
    if special is None and ds > _SEPARATE:
        return None
    steps = new.seen.found.num_steps
    longer = 1.5 if steps <= _FEW else 1.2 if steps < _MANY else 0.7
    return Step(last, told, followed, event, special or [], longer)


def _ahead(point: Point, ds: float) -> Asked:
    """The next point, or None if the branch is too curved for such a step."""
    seen = yield from on_plane(point, point.place.moved(point.tangent, ds), ds)
    found = seen.found
    new = Point.of(point.sequence, seen, point.arc + ds)
    is_sound = found.is_converged and new.tangent.along(point.tangent) > _TURN and found.first < 10 * ds
    return new if is_sound and found.num_steps <= _MANY else None


def _told_by_machine(walk: Walk, point: Point) -> Asked:
    """The point with its events in the cycle, whether the machine follows it, and what it does."""
    point = yield from _in_section(walk, point)
    followed: Followed = yield Request(confirm, point.sequence, (point.place,))
    is_trusted = np.abs(point.seen.found.multipliers[0]) < TRUSTED
    return point._replace(is_admissible=bool(followed.is_alike or not is_trusted)), followed


def is_followed(point: Point) -> Asked:
    """Whether the machine follows the cycle."""
    followed: Followed = yield Request(confirm, point.sequence, (point.place,))
    return bool(followed.is_alike)


def _add(walk: Walk, point: Point) -> Asked:
    """Add a point to the walk."""
    walk.points.append((yield from _in_section(walk, point)))


def _first_event(point: Point, new: Point, met: list[Test]) -> Asked:
    """The first of the events of a step, or None; and the point just before it, or the end of the step."""
    first, before = None, new
    for test in met:
        if test.of(before.seen) <= 0:  # else it comes after one that is known, or with it
            event = yield from _locate(point, before, test)
            first, before = (test, event), (yield from _just_before(point, event))
    return first, before


def _with_its_bounces(point: Point, followed: Followed) -> Asked:
    """The point with as many bounces in its chatters as they have there."""
    num_events = int(np.count_nonzero(followed.sequence.kind >= 0))
    if not followed.is_alike or num_events == len(point.sequence.kind):
        return point
    sequence = trimmed(followed.sequence, num_events)
    place = point.place._replace(flights=followed.flights[:num_events])
    # The direction is that of the start and the parameter, whatever the number of bounces.
    weights = Place(point.tangent.z, 0 * place.flights, point.tangent.p)
    seen = yield from corrected(sequence, place, weights, place.along(weights))
    return Point.of(sequence, seen, point.arc) if seen.found.is_converged else point


def _locate(point: Point, new: Point, test: Test) -> Asked:
    """Where a test function vanishes between two points."""
    bracket = Bracket.between(test.of(point.seen), test.of(new.seen), new.arc - point.arc)
    best = new
    while (s := next_trial(bracket)) is not None:
        seen = yield from on_plane(point, _between(point, new, s / (new.arc - point.arc)), s)
        if not seen.found.is_converged:
            raise Ended("not_converged")
        best = Point.of(point.sequence, seen, point.arc + s, kind=test.kind)
        bracket = bracket.narrowed(s, test.of(seen))
    return best._replace(kind=test.kind)


def _locate_branch_point(point: Point, new: Point, test: Test) -> Asked:
    """Where a test function vanishes of which every cycle near by is ill-conditioned: another branch crosses this one.

    The branch is smooth there, but no Newton's method converges. So it is interpolated from both sides.
    """
    length = new.arc - point.arc
    seen_at = partial(_seen_at, point, new)
    first = yield from seen_at((1 - np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)) * length / 2)
    rough = _root_of(test, first, (0.0, length))
    # Far enough from it for Newton's method, and on both sides.
    reach = max(length / 2, _REACH)
    known = yield from seen_at(rough + reach * np.array([-1, 1, -0.8, 0.8, -0.6, 0.6, -0.4, 0.4]))
    inside = rough - reach / 2, rough + reach / 2
    roots = [_root_of(test, known[skipped:], inside) for skipped in (0, 2)]
    if len(known) < 8 or not abs(roots[0] - roots[1]) < _CERTAIN:
        raise Ended("not_converged")
    ways = np.array([s for s, _ in known])
    found = [seen.found for _, seen in known]
    at = lambda rows: _interpolated(ways, np.array(rows), roots[0])  # noqa: E731
    nearest = known[int(np.argmin(np.abs(ways - roots[0])))][1]
    multipliers = np.roots(at([np.poly(one.multipliers) for one in found]))
    told = nearest.found._replace(
        place=Place(*(at(rows) for rows in zip(*(one.place for one in found), strict=True))),
        speeds=at([one.speeds for one in found]),
        # Which is which is not known from one cycle to the next, but the polynomial whose roots they are is smooth.
        multipliers=multipliers[np.argsort(-np.abs(multipliers), kind="stable")],
    )
    return Point.of(point.sequence, nearest._replace(found=told), point.arc + roots[0], kind=test.kind)


def _seen_at(point: Point, new: Point, ways: np.ndarray) -> Asked:
    """The cycles that are found some ways from a point, with these."""
    found = []
    for s in ways:
        if np.isfinite(s):
            seen = yield from on_plane(point, _between(point, new, s / (new.arc - point.arc)), s)
            found += [(s, seen)] if seen.found.is_converged else []
    return found


def _between(point: Point, new: Point, share: float) -> Place:
    return Place(*(a + share * (b - a) for a, b in zip(point.place, new.place, strict=True)))


def _root_of(test: Test, known: list[tuple[float, Seen]], inside: tuple[float, float]) -> float:
    """The zero in an interval of the polynomial through a test function; not a number unless there is one."""
    if len(known) < 4:
        return np.nan
    ways, values = np.array([s for s, _ in known]), [test.of(seen) for _, seen in known]
    roots = np.polynomial.Polynomial.fit(ways, values, len(ways) - 1).roots()
    is_real = np.abs(roots.imag) < 1e-9 * (inside[1] - inside[0])
    roots = roots[is_real & (roots.real > inside[0]) & (roots.real < inside[1])].real
    return float(roots[0]) if len(roots) == 1 else np.nan


def _interpolated(ways: np.ndarray, rows: np.ndarray, way: float) -> np.ndarray:
    """The polynomials through rows at one place."""
    weights = [np.prod((way - np.delete(ways, k)) / (ways[k] - np.delete(ways, k))) for k in range(len(ways))]
    return np.tensordot(np.array(weights), rows, axes=1)


def _just_before(point: Point, event: Point) -> Asked:
    """A point right before one where the sequence changes: there multipliers may be infinite."""
    s = event.arc - point.arc - _OFF
    if s <= _OFF:
        return point
    seen = yield from on_plane(point, event.place, s)
    return Point.of(point.sequence, seen, point.arc + s)


def _special(walk: Walk, point: Point, new: Point) -> Asked:
    """Bifurcations on a step, in their order; None if multipliers tell of more than are found."""
    found, change = [], 0
    for test in TESTS_OF_NEIGHBOURS:
        if not test.of(point.seen) * test.of(new.seen) < 0:
            continue
        if test.kind == "bp" and any(at.kind in ("fold", "period_doubling") for at in found):
            continue
        at = yield from (_locate_branch_point if test.kind == "bp" else _locate)(point, new, test)
        if not _is_there(test, at.seen):
            continue
        if test.kind == "fold" and (yield from _repeats_sooner(walk, at)):
            at = at._replace(kind="period_doubling")
        change += {"ns": 2, "period_doubling": 0}.get(at.kind, 1)
        found.append(at)
    if (num_unstable(new.seen) - num_unstable(point.seen) - change) % 2:
        return None
    return sorted(found, key=lambda at: at.arc)


def _is_there(test: Test, seen: Seen) -> bool:
    """Whether the multipliers say so too: a test function changes its sign as well where one is infinite."""
    mu = seen.found.multipliers
    if test.kind == "ns":
        return bool(np.any((np.abs(np.abs(mu) - 1) < CLOSE) & (np.abs(mu.imag) > CLOSE)))
    wanted = {"pd": -1, "bp": 1}
    return test.kind not in wanted or bool(np.any(np.abs(mu - wanted[test.kind]) < CLOSE))


def _repeats_sooner(walk: Walk, point: Point) -> Asked:
    """Whether a cycle is another one twice: where a doubled branch turns, it comes from a period doubling."""
    if walk.num_periods % 2:
        return False
    half = np.asarray(walk.num_periods / 2)
    z = yield Request(locate_start, point.sequence, (point.place, half))
    return bool(np.abs(z - point.place.z).max() < CLOSE)


def _to_bound(walk: Walk, point: Point, new: Point) -> Asked:
    """Add the point at the bound of the parameter that lies between two, and end."""
    p = walk.bounds[int(new.place.p > walk.bounds[1])]
    share = (p - point.place.p) / (new.place.p - point.place.p)
    guess = Place(*(a + share * (b - a) for a, b in zip(point.place, new.place, strict=True)))
    seen = yield from at_parameter(point.sequence, guess, p)
    if seen.found.is_converged and share > 0:
        yield from _add(walk, Point.of(point.sequence, seen, point.arc + share * (new.arc - point.arc)))
    raise Ended("bounds")


def _is_closed(walk: Walk, start: Point, point: Point, new: Point) -> Asked:
    """Whether the step comes back to the start."""
    same = np.array_equal(start.sequence.kind, point.sequence.kind) and np.array_equal(
        start.sequence.stop, point.sequence.stop
    )
    if not same or len(walk.points) < 4:
        return False
    tangent, ds = point.tangent, new.arc - point.arc
    s = start.place.along(tangent) - point.place.along(tangent)
    if not 0 < s <= ds or start.tangent.along(tangent) < _TURN:
        return False
    seen = yield from on_plane(point, start.place, s)
    found = trimmed(seen.found.place, len(point.sequence.kind))
    away = found.moved(start.place, -1.0)
    return bool(seen.found.is_converged and np.sqrt(away.along(away)) < 1e-8)


def _in_section(walk: Walk, point: Point) -> Asked:
    """The point with all its events between the start of the cycle and its end."""
    by = passed_section(point.place, walk.num_periods)
    if by == 0:
        return point
    time = 0.0 if by > 0 else walk.num_periods
    z = yield Request(locate_start, point.sequence, (point.place, np.asarray(time)))
    sequence, place = shifted(point.sequence, point.place, by, walk.num_periods, z)
    at = yield from _retold(sequence, place, point)
    # The times of the events go on as they did.
    before, after = np.cumsum(point.tangent.flights), np.cumsum(at.tangent.flights)
    is_ahead = np.roll(before, -by) @ after + point.tangent.p * at.tangent.p > 0
    return at if is_ahead else at.turned()


# --- where the sequence changes ---------------------------------------------------------------------------------------


def _beyond(walk: Walk, test: Test, event: Point) -> Asked:
    """The point from which the branch goes on behind an event."""
    yield from _add(walk, event)
    try:
        return (yield from _by_sequence(test, event))
    except Ended:
        return (yield from _by_machine(event, test.kind))


def _by_sequence(test: Test, event: Point) -> Asked:
    """The same on the sequence that it must be, in the direction that its derivative tells."""
    sequence, place, k = event.sequence, event.place, test.index
    if test.kind == "touch":
        watched = event.seen.watched
        flight, time = int(watched.gap_flight[k]), float(watched.gap_time[k])
        sequence, place = with_event(sequence, place, IMPACT, k, flight, time)
        return (yield from _going_on(sequence, place, event, lambda rates: rates.speeds[flight]))
    if test.kind == "gr":
        stop, time = int(sequence.stop[k]), float(place.flights[: k + 1].sum())
        sequence, place = without_event(sequence, place, k)
        return (yield from _going_on(sequence, place, event, lambda rates: rates.gaps[stop], time))
    if test.kind == "double_impact" and _are_impacts(sequence, k):
        sequence, place = with_order_exchanged(sequence, place, k)
        return (yield from _oriented(sequence, place, event, lambda at: float(at.tangent.flights[k])))
    raise Ended(test.kind)


def _by_machine(event: Point, kind: str) -> Asked:
    """The point some way ahead with the events that the machine has there."""
    # Room for what may be new: a stick that is interrupted ends in another chatter.
    more = 64
    held = np.concatenate([event.sequence.held, np.repeat(event.sequence.held[-1:], more, axis=0)])
    kinds, stops = (
        np.append(event.sequence.kind, [NOTHING] * more),
        np.append(event.sequence.stop, [0] * more),
    )
    longer = Sequence(kinds, stops, held)
    for ds in _TRIALS:
        guess = event.place.moved(event.tangent, ds)
        wide = guess._replace(flights=np.append(guess.flights, np.zeros(more)))
        followed: Followed = yield Request(confirm, longer, (wide,))
        new = yield from _with_its_bounces(event._replace(place=guess), followed._replace(is_alike=True))
        told: Followed = yield Request(confirm, new.sequence, (new.place,))
        if told.is_alike and np.abs(new.place.z - guess.z).max() < 10 * ds:
            return new._replace(kind="", arc=event.arc + ds)
    raise Ended(KINDS.get(kind, kind))


def _are_impacts(sequence: Sequence, k: int) -> bool:
    is_free = np.array_equal(sequence.held[k - 1], sequence.held[k + 1])
    return bool(is_free and sequence.kind[k] == IMPACT and sequence.kind[k - 1] == IMPACT)


def _going_on(
    sequence: Sequence, place: Place, event: Point, rate: Callable[[Rates], Reals], time: float = 0.0
) -> Asked:
    """The point on the new sequence, in the direction in which a speed or a gap grows."""
    at = yield from _retold(sequence, place, event)
    rates: Rates = yield Request(rates_along, sequence, (at.place, at.tangent, np.asarray(time)))
    return (yield from _off(at, float(rate(rates)) > 0))


def _oriented(sequence: Sequence, place: Place, event: Point, ahead: Callable[[Point], float]) -> Asked:
    """The same in a direction that is read off the tangent."""
    at = yield from _retold(sequence, place, event)
    return (yield from _off(at, ahead(at) > 0))


def _retold(sequence: Sequence, place: Place, event: Point) -> Asked:
    """The point of an event on another sequence."""
    # No direction is special to these weights, and so none is the branch's plane.
    rng = np.random.default_rng(0)
    weights = Place(*(np.asarray(rng.normal(size=np.shape(a))) for a in place))
    weights = Place(*(a / np.sqrt(weights.along(weights)) for a in weights))
    seen = yield from corrected(sequence, place, weights, place.along(weights))
    if not seen.found.is_converged:
        raise Ended("not_converged")
    return event._replace(sequence=sequence, place=trimmed(seen.found.place, len(sequence.kind)), seen=seen)


def _off(at: Point, is_ahead: bool) -> Asked:
    """A point close behind, in the given direction or in the other."""
    tangent = at.tangent if is_ahead else at.tangent.turned()
    target = at.place.along(tangent) + _OFF
    seen = yield from corrected(at.sequence, at.place.moved(tangent, _OFF), tangent, target)
    new = Point.of(at.sequence, seen, at.arc + _OFF)
    if not seen.found.is_converged or min((test.of(seen) for test in tests_of(at.sequence)), default=1) <= 0:
        raise Ended("several_events")
    return new
