"""The same motion computed in two ways: its states, and its events by kind."""

from typing import NamedTuple

import numpy as np

import vijax as vx

from .laws import ROUNDING
from .runs import ROOM, Failure, Run, code_of
from .shapes import Shape

# Relative error of Taylor series over a motion.
OF_SERIES = 1e-9
# Motions in which a disturbance grows more are compared no further.
MOST_GROWTH = 1e5
# Where an outcome depends on rounding, motions part at once, from less than `TOGETHER` of their size to more than `APART_AT_ONCE` from one
# saved state to the next.
TOGETHER, APART_AT_ONCE = 1e-11, 1e-4
# Shares of the largest velocity below which an impact is one of rounding, and one of the end of a chatter, which has more bounces in some units.
OF_ROUNDING, LIGHT = 1e-9, 1e-5


class Compared(NamedTuple):
    """Motions of a batch of machines, and what the same motions computed in another way may differ by.

    Attributes:
        shape, a: the machines.
        begin, end: of the motions, (lanes,).
        whole: the motions.
        is_sound: whether a motion came to its end, (lanes,).
        growth: largest growth of disturbances, (lanes,).
    """

    shape: Shape
    a: dict
    begin: np.ndarray
    end: np.ndarray
    whole: Run
    is_sound: np.ndarray
    growth: np.ndarray

    @property
    def is_fair(self) -> np.ndarray:
        """Whether a motion is compared: one that ends and does not magnify errors too much."""
        return self.is_sound & (self.growth < MOST_GROWTH) & ~self.is_narrow

    @property
    def is_narrow(self) -> np.ndarray:
        """Whether a motion misses a stop by less than it may differ, so that a hit is as right, (lanes,).

        The hit has a speed of the root of its depth: behind it the difference is the root of what it was. So an oscillator that
        a plastic impact leaves with the amplitude of its gap touches its stop once a cycle, for all its numbers.
        """
        return self.whole.clearance < self.bound * _size(self.whole.xs)

    @property
    def bound(self) -> np.ndarray:
        """Largest difference of states, relative to the size of the motion, (lanes,)."""
        return (ROUNDING if self.shape.is_linear else OF_SERIES) * np.maximum(self.growth, 1)

    def faults(self, name: str, xs: np.ndarray, vs: np.ndarray, part: slice = slice(None)) -> list[Failure]:
        """Motions that differ from states computed in another way, at a part of the saved times."""
        error = self._away(xs, vs, part).max(axis=1)
        wrong = np.flatnonzero(self.is_fair & ~(error <= self.bound))
        return [Failure(name, int(k), float(error[k] / self.bound[k])) for k in wrong]

    def faults_of(
        self, name: str, other: Run, xs: np.ndarray, vs: np.ndarray, *, events: str = "all"
    ) -> list[Failure]:
        """The same of a whole run, in any machine: where the outcome of an event depends on rounding it parts at once, or has other events.

        Args:
            name: of the other way.
            other: run in that way, with the elements numbered as here.
            xs: its positions, as those of these machines.
            vs: its velocities, likewise.
            events: whether its events are those of here: "all", "heavy" of motions without a chatter, or "none".
        """
        away = self._away(xs, vs)
        before = np.maximum.accumulate(
            np.concatenate([np.zeros((len(away), 1)), away[:, :-1]], axis=1), axis=1
        )
        parts = ((away > APART_AT_ONCE) & (before < TOGETHER)).any(axis=1)
        # In units in which velocities are large more bounces of a chatter are logged: their log may be full.
        ends_alike = (other.result == self.whole.result) | (other.result == code_of("max_events_reached"))
        decided = self.is_sound & (parts | ~ends_alike)
        failures = self.faults(name, xs, vs)
        failures += [
            Failure(f"rounding decides, {name}", int(k), float(np.nanmax(away[k]) / APART_AT_ONCE))
            for k in np.flatnonzero(decided)
        ]
        if events == "none":
            return failures
        is_one = self.is_sound & ends_alike & (away.max(axis=1) < TOGETHER)
        is_one &= np.maximum(self.whole.num_events, other.num_events) <= ROOM
        if events == "heavy":
            is_one &= ~_has_light(self.whole) & ~_has_light(other)
        return failures + [
            Failure(f"events, {name}", k, 1.0)
            for k in map(int, np.flatnonzero(is_one))
            if _kinds(self.whole, k) != _kinds(other, k)
        ]

    def _away(self, xs: np.ndarray, vs: np.ndarray, part: slice = slice(None)) -> np.ndarray:
        """Distance of states from these at saved times, relative to the size of the motions, (lanes, times)."""
        whole = self.whole
        places = np.abs(xs - whole.xs[:, part]).max(axis=2)
        speeds = np.abs(vs - whole.vs[:, part]).max(axis=2)
        sizes = (_size(states) for states in (whole.xs, whole.vs))
        return np.maximum(*(far / size[:, None] for far, size in zip((places, speeds), sizes, strict=True)))


def _size(states: np.ndarray) -> np.ndarray:
    """Size of states of motions, (lanes,)."""
    return np.abs(states).max(axis=(1, 2)) + 1e-3


def _speeds(run: Run) -> np.ndarray:
    """Speeds of impacts relative to the motion, infinite of other events, (lanes, events)."""
    fastest = np.abs(run.vs).max(axis=(1, 2))[:, None]
    return np.where(run.kind == vx.IMPACT, np.abs(run.before) / (fastest + 1e-300), np.inf)


def _has_light(run: Run) -> np.ndarray:
    """Whether a motion has the light impacts of a chatter, (lanes,)."""
    speeds = _speeds(run)
    return np.any((speeds < LIGHT) & (speeds > OF_ROUNDING), axis=1)


def _kinds(run: Run, lane: int) -> dict[int, list[int]]:
    """Kinds of the events of each element in order, without impacts of rounding.

    A contact force that touches zero may be negative by its rounding: the contact opens, and such an impact closes it at once.
    """
    kinds: dict[int, list[int]] = {}
    opened: set[int] = set()
    columns = (a[lane, : int(run.num_events[lane])] for a in (run.stop, run.kind, _speeds(run)))
    for stop, kind, speed in zip(*columns, strict=True):
        own = kinds.setdefault(int(stop), [])
        if speed <= OF_ROUNDING:
            if own and own[-1] == vx.RELEASE:
                own.pop()
                opened.add(int(stop))
        elif kind == vx.STICK and stop in opened:
            opened.discard(int(stop))
        else:
            own.append(int(kind))
    return {stop: own for stop, own in kinds.items() if own}
