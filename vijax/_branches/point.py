"""A cycle on a branch, and how it is asked for."""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from .._orbits.sequence import Sequence
from .family import Place
from .programs import Followed, Request, Seen, confirm, look, trimmed

# Runs of orbits whose neighbours leave faster than this say nothing.
TRUSTED = 1e4

Asked = Generator[Any, Any, Any]


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


def as_it_is(sequence: Sequence, place: Place) -> Asked:
    """A cycle that is known. No direction is special to the weights, and so none is the branch's plane."""
    rng = np.random.default_rng(0)
    weights = Place(*(np.asarray(rng.normal(size=np.shape(a))) for a in place))
    weights = Place(*(a / np.sqrt(weights.along(weights)) for a in weights))
    return (yield from corrected(sequence, place, weights, place.along(weights)))


def is_followed(point: Point) -> Asked:
    """Whether the machine follows the cycle."""
    followed: Followed = yield Request(confirm, point.sequence, (point.place,))
    return bool(followed.is_alike)
