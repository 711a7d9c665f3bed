"""Runner on other processes and machines: chunks of points are tasks of an executor.

A task holds the numbers of its own points, and the size of the whole sweep, which determines what is compiled. It
takes seconds on one core, the one that each worker is assumed to have. A worker compiles for its first chunk only.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from .._flow.interface import AbstractFlow
from .._system.shared_records import SharedRecords
from .points import LaneInput
from .runner import AbstractRunner, Counts, PointResults, join_results
from .settings import ExecutionSettings
from .tasks import as_executor, run_tasks
from .threads import Threads, count_cores, split_evenly


class Cluster(AbstractRunner):
    """Runner that gives chunks of points to an executor.

    Attributes:
        flow: the flow between events.
        counts: arguments of `sweep` for every point.
        settings: sizes of chunks, lanes and queues.
        executor: runs tasks.
    """

    flow: AbstractFlow
    counts: Counts
    settings: ExecutionSettings
    executor: Executor

    def run(self, points: LaneInput, which: np.ndarray, tell: Callable[[int], object]) -> PointResults:
        """Run points in chunks, which keep chains whole."""
        settings, (num_points, num_chains) = self.settings, (which.size, which.shape[-1])
        cores = settings.cores or count_cores()
        size = settings.chunk_of(self.counts.work)
        num_chunks = max(
            min(-(-num_points // size), num_chains), min(cores, -(-num_chains // settings.lanes))
        )
        shares = split_evenly(points, which, num_chunks)
        return join_results(self.run_each(points, enumerate(shares), tell), shares)

    def run_each(
        self, points: LaneInput, parts: Iterable[tuple[int, np.ndarray]], tell: Callable[[int], object]
    ) -> Iterator[tuple[int, PointResults]]:
        """Run each part as a task of the executor."""
        in_all, settings = points.x0.shape[-1], replace(self.settings, cores=1)
        numbers = jax.tree.map(np.asarray, (points, self.flow))

        def tasks() -> Iterator[tuple[tuple[int, np.ndarray], tuple]]:
            for number, which in parts:
                own, flow = part_of(numbers, which)
                yield (number, which), (own, which.shape, Threads(flow, self.counts, settings, in_all))

        for (number, which), found in run_tasks(self.executor, _run_part, tasks(), settings.in_flight):
            tell(which.size)
            yield number, found.numbered(which)


def choose_runner(
    flow: AbstractFlow, counts: Counts, settings: ExecutionSettings, executor: object
) -> AbstractRunner:
    """Runner on an executor, or without one on the cores of this process."""
    if executor is None:
        return Threads(flow, counts, settings)
    return Cluster(flow, counts, settings, as_executor(executor))


def part_of(numbers: Any, which: np.ndarray) -> Any:
    """Numbers of some points, lanes last. A single point is doubled: an axis of length one means shared by all."""
    index = which.ravel() if which.size > 1 else np.repeat(which, 2)
    is_shared = lambda a: isinstance(a, SharedRecords)  # noqa: E731

    def own(a: Any) -> Any:
        if is_shared(a):
            return a.at(index)
        return a if a.shape[-1] == 1 else a[..., index]

    return jax.tree.map(own, numbers, is_leaf=is_shared)


def _run_part(points: LaneInput, shape: tuple[int, ...], runner: Threads) -> PointResults:
    """Run all points, or chains of points, of a task; called by a worker."""
    return runner.run(points, np.arange(np.prod(shape)).reshape(shape), lambda _: None)
