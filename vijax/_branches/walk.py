"""Walk along a curve of solutions in one direction: a step is halved until it can be taken, up to the end of the curve.

Branches of orbits, curves of bifurcations and families of invariant circles are such curves: each tries its steps, keeps
its points, and tells why it ends.
"""

import abc
from typing import Any, Generic, TypeVar

from .point import End
from .requests import Requests, T
from .tolerances import SHORTEST_STEP

P = TypeVar("P")
S = TypeVar("S")


class AbstractCurve(abc.ABC, Generic[P, S]):
    """Curve that a walk follows, of points P by steps S.

    Attributes:
        shortest: length below which no step is tried.
    """

    shortest = SHORTEST_STEP

    @property
    @abc.abstractmethod
    def is_full(self) -> bool:
        """True if the curve takes no more points."""

    def plain_steps(self, here: P, ds: float) -> Requests[tuple[P, float, Any]]:
        """Take steps on which nothing happens: the last point, the length of the next step, and that step if it was tried."""
        return at_once((here, ds, None))

    @abc.abstractmethod
    def step(self, here: P, ds: float, tried: Any) -> Requests[S | End | None]:
        """Make a step of a length, from what was `tried` if that is known; None if it is too long."""

    @abc.abstractmethod
    def take(self, here: P, step: S) -> Requests[tuple[P, float] | End]:
        """Add the points of a step: the point from which to go on, and the length of the next step."""

    @abc.abstractmethod
    def beyond(self, here: P) -> Requests[tuple[P, float] | End]:
        """Go on where no step is short enough, as `take` does."""


def walk(curve: AbstractCurve[P, S], here: P, ds: float) -> Requests[End | None]:
    """Follow a curve from a point, with a first step of length `ds`, to its end; None once it is full."""
    while not curve.is_full:
        here, ds, tried = yield from curve.plain_steps(here, ds)
        if curve.is_full:
            break
        step = None
        while step is None and ds >= curve.shortest:
            step = yield from curve.step(here, ds, tried)
            ds, tried = ds / 2, None
        if step is None:
            behind = yield from curve.beyond(here)
        else:
            behind = step if isinstance(step, End) else (yield from curve.take(here, step))
        if isinstance(behind, End):
            return behind
        here, ds = behind
    return None


def at_once(value: T) -> Requests[T]:
    """An answer for which nothing is requested."""
    yield from ()
    return value


def walk_alone(curve: AbstractCurve[P, S], here: P, ds: float) -> End | None:
    """`walk` along a curve that requests nothing."""
    try:
        next(walk(curve, here, ds))
    except StopIteration as end:
        return end.value
    raise RuntimeError("A curve that is followed alone has requested something.")
