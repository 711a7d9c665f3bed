"""Interface of runners, which run many points on any machine, and their results."""

import abc
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np

from .points import LaneInput
from .records import Impact, joined


@dataclass(frozen=True)
class Counts:
    """Arguments of `sweep` for every point.

    A motion passes marks, at which its state is recorded: the ends of forcing periods, or given times, of which the last is
    the end of the motion.

    Attributes:
        transient: forcing periods before the first mark; 0 where times are given.
        record: number of marks.
        max_impacts: room for the recorded impacts of a point.
        max_steps: most steps; None where every point has its own bound.
        can_stick: whether any stop of any point may hold its mass.
        lyapunov: whether exponents are computed.
        observed: names of what is observed besides, see `observer.py`.
        times: times of the marks; None for the ends of forcing periods.
        own_work: rough number of oscillations of a motion to given times.
    """

    transient: int
    record: int
    max_impacts: int
    max_steps: int | None
    can_stick: bool
    lyapunov: bool = False
    observed: tuple[str, ...] = ()
    times: tuple[float, ...] | None = None
    own_work: int = 0

    @property
    def work(self) -> int:
        """Forcing periods of a point, or a rough number of oscillations: the sizes of chunks follow from it."""
        return self.transient + self.record if self.times is None else self.own_work


@dataclass(frozen=True)
class PointResults:
    """Results of some points.

    Attributes:
        ends: `x`, `v`, `held`, `periods` (marks, the transient included), `num_impacts`, `num_sticks`, `steps`, `is_finite`, and for each
            mark `section_x`, `section_v`, `section_held_time`, `section_growth` (see `Mark`), (...,
            marks, points), and what is observed, by its names. Points are the last axis of all.
        impacts: recorded impacts, in any order.
        lane_steps: steps of all lanes, idle ones included.
    """

    ends: dict[str, np.ndarray]
    impacts: Impact
    lane_steps: int

    def numbered(self, which: np.ndarray) -> "PointResults":
        """Results of points counted from 0, renumbered by `which` in the whole sweep and put in increasing order."""
        numbers = which.ravel()
        numbers = numbers.astype(np.int32) if numbers.max(initial=0) < 2**31 else numbers
        order = np.argsort(numbers)
        ends = {name: a.take(order, axis=-1) for name, a in self.ends.items()}
        return replace(self, ends=ends, impacts=replace(self.impacts, point=numbers[self.impacts.point]))


class AbstractRunner(eqx.Module):
    """A way to run points: on the cores of this machine, from a store, on other machines.

    Sweeps, carried chains and stores use this interface only. To add a runner, write `run`, and

    - hold the request common to all points and the flow between events as fields, given once;
    - let no result of a point depend on the points run beside it, not by a bit: what is compiled follows from the
      size of all `points`, never from how many of them `which` names;
    - leave the calling process open to an interrupt, and raise here what goes wrong elsewhere.

    A runner that wraps another, as a store does, holds that other as a field. A runner that distributes points, as a
    cluster does, may join the parts by `join_results`.
    """

    @abc.abstractmethod
    def run(self, points: LaneInput, which: np.ndarray, tell: Callable[[int], object]) -> PointResults:
        """Run some points.

        Args:
            points: machines and starts of a whole sweep, whose size determines what is compiled; `x0` and `v0` have
                all points as their last axis.
            which: points to run. In increasing order, (points,), each runs from its own start. In chains, one a
                column, (visits, chains), all but the first start where the one before them ended.
            tell: called with the number of points done since the last call.

        Returns:
            Results in increasing order of the points; the impacts with their numbers in the whole sweep.
        """

    def run_each(
        self, points: LaneInput, parts: Iterable[tuple[int, np.ndarray]], tell: Callable[[int], object]
    ) -> Iterator[tuple[int, PointResults]]:
        """Run several parts one after another, otherwise as `run`; overridden where they run at the same time.

        Parts are pairs of a number and the points; the next is taken when it can be run. Yields the number of a part
        and its results, when it is done.
        """
        for number, which in parts:
            yield number, self.run(points, which, tell)


def join_results(parts: Iterable[tuple[int, PointResults]], shares: Sequence[np.ndarray]) -> PointResults:
    """Join the results of parts as they come, so that memory never holds all of them twice.

    Args:
        parts: numbers of parts, in any order, and their results, the points of each in increasing order.
        shares: the points of each part.

    Returns:
        Results of all points in increasing order.
    """
    points = np.concatenate([np.sort(share, axis=None) for share in shares])
    places = np.empty_like(points)
    places[np.argsort(points)] = np.arange(len(points))
    place_of = np.split(places, np.cumsum([share.size for share in shares[:-1]]))
    ends: dict[str, np.ndarray] = {}
    impacts, lane_steps = {}, 0
    for number, found in parts:
        for name, a in found.ends.items():
            if name not in ends:
                ends[name] = np.empty((*a.shape[:-1], len(points)), a.dtype)
            ends[name][..., place_of[number]] = a
        impacts[number] = found.impacts
        lane_steps += found.lane_steps
    return PointResults(ends, joined([impacts[number] for number in range(len(shares))]), lane_steps)
