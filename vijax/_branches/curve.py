"""From a point of a branch to the curve of such points in the plane of two parameters."""

import json
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from .._dataset_attributes import label, versions
from .._orbits.sequence import Sequence
from .._progress import tqdm
from .._system.parameters import get_parameter
from .._types import Count, as_known, whole_number
from .._xla import padding_allowed
from .branch import Bifurcation, cycle_of
from .family import Family, Line, Place
from .follow import KINDS, TESTS_OF_NEIGHBOURS, Asked, Point, Test, corrected, is_followed, on_plane, tests_of
from .programs import Seen, drive
from .starts import family_of, starts_of

# Steps in the plane, relative to the bounds: the first, the longest, the shortest.
_FIRST, _LONGEST, _SHORTEST = 2e-3, 2e-2, 1e-7
# The secant method: its first step, when it is done, and the most trials.
_APART, _DONE, _MOST = 1e-4, 1e-13, 20
# What vanishes with the function of the curve is zero but for rounding.
_ROUNDING = 1e-9
# The most by which the curve may turn on a step, as a cosine.
_TURN = 0.97


class _On(NamedTuple):
    """A point of the curve: both parameters in their scale, the direction of the curve, and the cycle on its line."""

    at: np.ndarray
    direction: np.ndarray
    point: Point


@padding_allowed
def bifurcation_curve(
    point: Bifurcation,
    path: str,
    bounds: dict[str, tuple[float, float]],
    *,
    max_points: Count = 1000,
    progress: bool = True,
) -> xr.Dataset:
    """Follow a bifurcation while a second parameter varies too, both ways.

    Args:
        point: one of `branch.bifurcations`.
        path: the second parameter.
        bounds: lowest and highest values of both parameters, by their paths.
        max_points: the most points each way.
        progress: show a bar.

    Returns:
        A dataset along `point`, in the order of the curve: both parameters by their paths, `x0`, `v0` (mass,),
        `multipliers`, `impact_speed` (event,), and as attributes the `kind` and why the curve ends on either side:
        at the bounds, or where the machine follows the orbit no further, with the kind of what happens there.

    Raises:
        ValueError: for paths or bounds that do not fit, or a kind that has no curve.

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
        branch = vx.continuation(orbit, "forcing.frequency", (0.8, 1.0))
        fold = branch.bifurcations[1]
        bounds = {"forcing.frequency": (0.8, 1.1), "stops[0].position": (0.2, 0.4)}
        curve = vx.bifurcation_curve(fold, "stops[0].position", bounds)
        ```

    References:
        Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sec. 10.3.
    """
    first = point.branch.path
    if set(bounds) != {first, path} or first == path:
        raise ValueError(
            f"Argument `bounds` must be of `{first}` and another path, as in {{`{first}`: (0, 1), `{path}`: (0, 1)}}."
        )
    most = whole_number("max_points", max_points, 1)
    box = np.array([[float(as_known(a)) for a in bounds[name]] for name in (first, path)])
    size = box[:, 1] - box[:, 0]
    (start,) = starts_of(point.orbit)
    start = start._replace(is_admissible=True)
    at = np.array([float(np.asarray(get_parameter(start.system, name))) for name in (first, path)]) / size
    family_of(start, path, *box[1])  # refuses a second path that names no number
    family = replace(family_of(start, first, *box[0]), span=np.ones(()))
    sequence, place = cycle_of(point, family.scale, 0.0)
    curve = _Curve(family, path, TESTS_OF_NEIGHBOURS[0], box / size[:, None], size, most)
    seen = curve.on_line(as_it_is(sequence, place), at, np.array([1.0, 0.0]))
    curve.test = test_of(point.kind, sequence, seen)
    begun = curve.begin(Point.of(sequence, seen, 0.0), at)
    with tqdm(unit="point", disable=not progress) as bar:
        back, first_end = curve.follow(begun._replace(direction=-begun.direction), bar)
        forth, last_end = curve.follow(begun, bar)
    return _dataset(point, path, curve, [*back[::-1], begun, *forth], (first_end, last_end))


def as_it_is(sequence: Sequence, place: Place) -> Asked:
    """A cycle that is known."""
    rng = np.random.default_rng(0)
    weights = Place(
        rng.normal(size=place.z.shape), rng.normal(size=place.flights.shape), np.asarray(rng.normal())
    )
    return (yield from corrected(sequence, place, weights, place.along(weights)))


def test_of(kind: str, sequence: Sequence, seen: Seen) -> Test:
    """The function that vanishes at a bifurcation."""
    if kind in ("fold", "pd", "ns", "bp"):
        return next(test for test in TESTS_OF_NEIGHBOURS if test.kind == kind)
    wanted = {"gr": ("gr", "touch"), "double_impact": ("double_impact",), "force_zero": ("force_zero",)}
    if kind not in wanted:
        raise ValueError(
            f"There is no curve of {kind}: where a chatter is completed, infinitely many changes meet."
        )
    tests = [test for test in tests_of(sequence) if test.kind in wanted[kind]]
    # An impact without speed is a touch as well, with a gap of exactly zero.
    light = _ROUNDING * np.abs(seen.start[len(seen.start) // 2 :]).max()
    impacts = [test for test in tests if test.kind == "gr" and abs(test.of(seen)) < light]
    return min(impacts or tests, key=lambda test: abs(test.of(seen)))


@dataclass
class _Curve:
    """A curve that is followed.

    Attributes:
        family: of the machines, but for the line in the plane.
        path: the second parameter.
        test: the function that vanishes on it.
        box: bounds of both parameters in their scale, (2, 2).
        size: the scale, (2,).
        most: the most points.
    """

    family: Family
    path: str
    test: Test
    box: np.ndarray
    size: np.ndarray
    most: int

    def on_line(self, task: Asked, at: np.ndarray, direction: np.ndarray) -> Any:
        """The answer to a task on a line in the plane."""
        line = Line(at * self.size, direction * self.size, self.path)
        return drive([replace(self.family, line=line)], [task], lambda: None)[0]

    def begin(self, point: Point, at: np.ndarray) -> _On:
        """The first point and the direction of the curve there."""
        for ds in (_FIRST, _FIRST / 16, _FIRST / 256):
            other = self.ahead(_On(at, np.array([0.0, 1.0]), point), ds, None)
            if other is not None:
                along = other.at - at
                return _On(at, along / np.linalg.norm(along), point)
        raise ValueError("The curve cannot be followed from this point.")

    def ahead(self, here: _On, ds: float, before: _On | None) -> _On | None:
        """The point of the curve some way ahead, or None."""
        base, normal = here.at + ds * here.direction, np.array([-here.direction[1], here.direction[0]])
        place = here.point.place._replace(p=np.zeros(()))
        if before is not None and len(before.point.place.flights) == len(place.flights):
            share = ds / np.linalg.norm(here.at - before.at)
            place = place.moved(place.moved(before.point.place._replace(p=np.zeros(())), -1.0), share)
        return self.at_zero(here, base, normal, place)

    def at_zero(self, here: _On, base: np.ndarray, normal: np.ndarray, place: Place) -> _On | None:
        """Where a line meets the curve."""
        point = self.on_line(_zero(here.point, place, self.test), base, normal)
        if point is None:
            return None
        at = base + float(point.place.p) * normal
        along = at - here.at
        return _On(at, along / max(np.linalg.norm(along), 1e-300), point)

    def follow(self, begun: _On, bar: tqdm) -> tuple[list[_On], str]:
        """All points in the direction of one, and why there are no more."""
        found: list[_On] = []
        here, before, ds = begun, None, _FIRST
        while len(found) < self.most:
            new = self.ahead(here, ds, before)
            end = self._end_of(here, new)
            if new is None or end not in ("", "bounds"):
                ds /= 2
                if ds < _SHORTEST:
                    return found, end
                continue
            if end:
                return [*found, *self._at_bound(here, new)], end
            if (
                len(found) > 2
                and np.linalg.norm(new.at - begun.at) < ds
                and new.direction @ begun.direction > 0
            ):
                return found, "closed"
            found.append(new)
            bar.update()
            here, before, ds = new, here, min(1.3 * ds, _LONGEST)
        return found, "max_points"

    def _end_of(self, here: _On, new: _On | None) -> str:
        """Why the curve ends before a point, or nothing."""
        if new is None or new.direction @ here.direction < _TURN:
            return "not_converged"
        if np.any((new.at < self.box[:, 0]) | (new.at > self.box[:, 1])):
            return "bounds"
        for test in tests_of(new.point.sequence):
            is_own = test.kind == self.test.kind and test.index == self.test.index
            if not is_own and test.of(new.point.seen) < -_ROUNDING:
                return KINDS.get(test.kind, test.kind)
        if self.test not in TESTS_OF_NEIGHBOURS:
            return ""
        direction = new.direction
        normal = np.array([-direction[1], direction[0]])
        place = new.point.place._replace(p=np.zeros(()))
        is_alike = self.on_line(is_followed(new.point._replace(place=place)), new.at, normal)
        return "" if is_alike else "left_the_stops"

    def _at_bound(self, here: _On, new: _On) -> list[_On]:
        """The point of the curve on the bound between two."""
        along = new.at - here.at
        limits = np.where(along > 0, self.box[:, 1], self.box[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(along != 0, (limits - here.at) / along, np.inf)
        k = int(np.argmin(np.where(shares >= 0, shares, np.inf)))
        base = here.at + shares[k] * along
        base[k] = limits[k]
        place = Place(
            *(a + shares[k] * (b - a) for a, b in zip(here.point.place, new.point.place, strict=True))
        )
        last = self.at_zero(here, base, np.eye(2)[1 - k], place._replace(p=np.zeros(())))
        return [] if last is None else [last]


def _zero(point: Point, guess: Place, test: Test) -> Asked:
    """The cycle near a guess where a test function vanishes, by the secant method; None if there is none."""
    tangent = point.tangent
    seen = yield from corrected(point.sequence, guess, tangent, guess.along(tangent))
    if not seen.found.is_converged:
        return None
    base = Point.of(point.sequence, seen, 0.0)
    s, value, other, other_value = _APART, None, 0.0, test.of(seen)
    for _ in range(_MOST):
        seen = yield from on_plane(base, base.place.moved(base.tangent, s), s)
        value = test.of(seen)
        if not seen.found.is_converged or not np.isfinite(value):
            return None
        if value == other_value or abs(s - other) < _DONE:
            break
        step = -value * (s - other) / (value - other_value)
        if abs(step) > 1:
            return None
        s, other, other_value = s + step, s, value
    else:
        return None
    return Point.of(point.sequence, seen, 0.0)


def _dataset(
    point: Bifurcation, path: str, curve: _Curve, found: list[_On], ends: tuple[str, str]
) -> xr.Dataset:
    """The curve, labelled."""
    plane = np.stack([one.at for one in found]) * curve.size
    seen = [one.point.seen for one in found]
    start = np.stack([one.start for one in seen])
    num_events, n = len(found[0].point.sequence.kind), start.shape[1] // 2
    columns = {
        point.branch.path: (("point",), plane[:, 0]),
        path: (("point",), plane[:, 1]),
        "x0": (("point", "mass"), start[:, :n]),
        "v0": (("point", "mass"), start[:, n:]),
        "multipliers": (("point", "multiplier"), np.stack([one.found.multipliers for one in seen])),
        "impact_speed": (("point", "event"), np.stack([one.found.speeds[:num_events] for one in seen])),
        "residual": (("point",), np.array([one.found.residual for one in seen])),
    }
    attrs = {"kind": point.kind, "ends": json.dumps(ends), "num_periods": int(curve.family.num_periods)}
    ds = xr.Dataset(columns, attrs=attrs | versions()).set_coords([point.branch.path, path])
    for name, variable in ds.variables.items():
        variable.attrs = label(str(name))
    return ds
