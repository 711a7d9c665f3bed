"""Workers that advance chunks of searches: the cores of this process, or those of an executor.

The last bits of a lane depend on its place in a chunk. So chunks are the same wherever they run, and the host
gathers all results of a round before it makes the next chunks.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import cache
from typing import Any

import jax
import numpy as np

from .._execution.settings import DEFAULT_SETTINGS
from .._execution.tasks import run_tasks
from .._execution.threads import count_cores
from .._jax.xla import jit_lightly, padding_allowed
from .search import Search, StroboscopicMap, search_step

Axes = tuple[int | None, ...]
Chunk = tuple[StroboscopicMap, Search]

# Keys of the compiled programs.
_COMPILED: set[tuple] = set()
# Chunks in a task of an executor: about a second of work.
_IN_TASK = 16


class SearchWorkers:
    """Threads or tasks of an executor that advance chunks of searches, see `search_step`.

    Args:
        axes: for each leaf of the strobes 0 if it has lanes as its first axis, None if all lanes share it.
        executor: runs the chunks; None means the cores of this process.
    """

    def __init__(self, axes: Axes, executor: Executor | None):
        self._axes, self._executor = axes, executor
        self._x64 = bool(jax.config.read("jax_enable_x64"))
        self._cores = ThreadPoolExecutor(count_cores()) if executor is None else None
        self._program: tuple | None = None

    def __enter__(self) -> "SearchWorkers":
        return self

    def __exit__(self, *_: object) -> None:
        if self._cores is not None:
            self._cores.shutdown(cancel_futures=True)

    def learn(self, num_chunks: int, chunk: Callable[[int], Chunk]) -> Iterator[tuple[int, Search]]:
        """Advance chunks of searches by one run each; yield the index of each chunk and its updated searches."""
        if self._cores is None:
            yield from self._by_workers(num_chunks, chunk)
            return
        # Until there is a program the first chunk runs alone, as every thread would compile.
        if self._program is None:  # the same for all chunks
            leaves, structure = jax.tree.flatten(chunk(0))
            self._program = structure, self._axes, self._x64, tuple(np.shape(a) for a in leaves)
        alone = 0 if self._program in _COMPILED else 1
        for numbers in (range(alone), range(alone, num_chunks)):
            yield from zip(numbers, self._cores.map(lambda k: self._here(chunk(k)), numbers), strict=True)
            _COMPILED.add(self._program)

    @padding_allowed
    def _here(self, chunk: Chunk) -> Search:
        with jax.enable_x64(self._x64):  # JAX's settings are thread-local
            return _advance_chunk(self._axes, chunk)

    def _by_workers(self, num_chunks: int, chunk: Callable[[int], Chunk]) -> Iterator[tuple[int, Search]]:
        size = min(_IN_TASK, -(-num_chunks // count_cores()))
        parts = [range(k, min(k + size, num_chunks)) for k in range(0, num_chunks, size)]
        tasks = ((part, (self._axes, [chunk(k) for k in part])) for part in parts)
        for part, found in run_tasks(self._executor, _advance_task, tasks, DEFAULT_SETTINGS.in_flight):
            yield from zip(part, found, strict=True)


@padding_allowed
def _advance_task(axes: Axes, chunks: list[Chunk]) -> list[Search]:
    """Advance some chunks; called by a worker."""
    return [_advance_chunk(axes, chunk) for chunk in chunks]


def _advance_chunk(axes: Axes, chunk: Chunk) -> Search:
    strobe, search = chunk
    leaves, structure = jax.tree.flatten(strobe)
    return jax.tree.map(np.asarray, _advance(structure, axes)(leaves, search))


@cache
def _advance(structure: Any, axes: Axes) -> Callable:
    def one(leaves: list, search: Search) -> Search:
        return search_step(jax.tree.unflatten(structure, leaves), search)

    return jit_lightly(jax.vmap(one, in_axes=([*axes], 0)), name=("search_step", structure, axes))
