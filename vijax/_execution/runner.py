"""The interface of what runs many points, on any machine, and their results."""

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import equinox as eqx
import numpy as np

from .points import Point
from .records import Impact, joined


@dataclass(frozen=True)
class Counts:
    """Arguments of `sweep` for every point; `max_steps` is None where every point has its own bound."""

    transient: int
    record: int
    max_impacts: int
    max_steps: int | None
    can_stick: bool
    lyapunov: bool = False


@dataclass(frozen=True)
class Found:
    """Results of some points.

    Attributes:
        ends: `x`, `v`, `held`, `periods`, `num_impacts`, `num_sticks`, `steps`, `is_finite`, and of the end
            of each recorded period `section_x`, `section_v`, `section_held_time`, `section_growth` (see `Mark`), (...,
            periods, points); the points are the last axis of all.
        impacts: the recorded impacts, in any order.
        lane_steps: steps of all lanes, idle ones included.
    """

    ends: dict[str, np.ndarray]
    impacts: Impact
    lane_steps: int


class AbstractRunner(eqx.Module):
    """A way to run points: on the cores of this machine, from a store, on other machines.

    Sweeps, carried chains and stores know nothing else of it. To add one: write `run`, and

    - hold what is asked of every point and the motion between events as fields, given once;
    - let nothing that comes of a point depend on those run beside it, not by a bit: what is compiled follows
      from the size of all `points`, never from how many of them `which` names;
    - leave the process that calls open to an interrupt, and raise here what goes wrong elsewhere.

    One that changes how points are run by another, as a store does, holds that other as a field; what
    shares points out, as a cluster does, may put the pieces together by `together`.
    """

    @abc.abstractmethod
    def run(self, points: Point, which: np.ndarray, tell: Callable[[int], object]) -> Found:
        """Run some points.

        Args:
            points: the machines and starts of a whole sweep, whose size decides what is compiled; `x0` and
                `v0` have all points as their last axis.
            which: the points to run, in increasing order.
            tell: called with the number of points done since the last call.

        Returns:
            What came of them, in their order; the impacts with their numbers in the whole sweep.
        """


def together(parts: Sequence[Found]) -> Found:
    """Results of all parts joined, in their order."""
    ends = {name: np.concatenate([part.ends[name] for part in parts], axis=-1) for name in parts[0].ends}
    return Found(ends, joined([part.impacts for part in parts]), sum(part.lane_steps for part in parts))
