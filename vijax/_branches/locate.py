"""Where test functions vanish on a step along a branch."""

from functools import partial

import numpy as np

from .branch_tests import CLOSE, TESTS_OF_NEIGHBOURS, Test, num_on_circle, num_unstable
from .family import Place
from .point import Asked, Ended, Point, on_plane
from .programs import Request, Seen, locate_start
from .zero import Bracket, next_trial

# Just before a point where the sequence changes.
_OFF = 1e-7
# Cycles by which a branch is first interpolated, how far from a point the others are at least, and how well it is known.
_NODES, _REACH, _CERTAIN = 9, 1e-3, 1e-10


def first_event(point: Point, new: Point, met: list[Test]) -> Asked:
    """The first of the events of a step, or None; and the point just before it, or the end of the step."""
    first, before = None, new
    for test in met:
        if test.of(before.seen) <= 0:  # else it comes after one that is known, or with it
            event = yield from locate(point, before, test)
            first, before = (test, event), (yield from _just_before(point, event))
    return first, before


def locate(point: Point, new: Point, test: Test) -> Asked:
    """Where a test function vanishes between two points."""
    bracket = Bracket.between(test.of(point.seen), test.of(new.seen), new.arc - point.arc)
    best = new
    while (s := next_trial(bracket)) is not None:
        seen = yield from on_plane(point, between(point, new, s / (new.arc - point.arc)), s)
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
            seen = yield from on_plane(point, between(point, new, s / (new.arc - point.arc)), s)
            found += [(s, seen)] if seen.found.is_converged else []
    return found


def between(point: Point, new: Point, share: float) -> Place:
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


def special_points(num_periods: float, point: Point, new: Point) -> Asked:
    """Bifurcations on a step, in their order; None if multipliers tell of more than are found."""
    found, change = [], 0
    for test in TESTS_OF_NEIGHBOURS:
        if not test.of(point.seen) * test.of(new.seen) < 0:
            continue
        if test.kind == "bp" and any(at.kind in ("fold", "period_doubling") for at in found):
            continue
        at = yield from (_locate_branch_point if test.kind == "bp" else locate)(point, new, test)
        if not _is_there(test, at.seen):
            continue
        if test.kind == "fold" and (yield from _repeats_sooner(num_periods, at)):
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
        return num_on_circle(mu) > 0
    wanted = {"pd": -1, "bp": 1}
    return test.kind not in wanted or bool(np.any(np.abs(mu - wanted[test.kind]) < CLOSE))


def _repeats_sooner(num_periods: float, point: Point) -> Asked:
    """Whether a cycle is another one twice: where a doubled branch turns, it comes from a period doubling."""
    if num_periods % 2:
        return False
    half = np.asarray(num_periods / 2)
    z = yield Request(locate_start, point.sequence, (point.place, half))
    return bool(np.abs(z - point.place.z).max() < CLOSE)
