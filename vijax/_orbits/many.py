"""Many searches at once, in a program for a fixed number of lanes: finished searches make room for others."""

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from .._hybrid.limits import IMPACT
from .._jax.xla import jit_lightly
from .find import search_to_end
from .search import Search, StroboscopicMap, begin_search
from .search_workers import SearchWorkers
from .sequence import num_stops_of

# `_LANES`: lanes of the one compiled program. A lane costs the same among 32 as among 128; fewer wait for the longest.
# `_FEW`: room for events at first. Most cycles have fewer; the others are searched for again with room for all.
# `_ALONE`: most searches that run one by one, by the program of a single search: it compiles in half the time, and a process
# that searches for an orbit has it.
_LANES, _FEW, _ALONE = 32, 32, 8


class Orbits(NamedTuple):
    """Results of many searches, lanes first.

    Attributes:
        start: states in the fixed frame, (lanes, 2 n).
        multipliers: (lanes, 2 n).
        residual: closing error, (lanes,).
        num_impacts: impacts in one cycle, (lanes, stops).
        is_orbit: true where the machine follows the cycle, (lanes,).
    """

    start: np.ndarray
    multipliers: np.ndarray
    residual: np.ndarray
    num_impacts: np.ndarray
    is_orbit: np.ndarray


def search_many(
    strobe: StroboscopicMap,
    axes: Sequence[int | None],
    guesses: np.ndarray,
    tell: Callable[[int], Any],
    executor: Executor | None = None,
) -> Orbits:
    """Search from many guesses, until each has an orbit or nothing left to try.

    Args:
        strobe: the machines, with room for the maximum number of events of a cycle; leaves that differ between lanes
            have the lanes as their first axis.
        axes: for each leaf of `strobe` 0 if it has that axis, None if all lanes share it.
        guesses: states in the fixed frame, (lanes, 2 n). Neighbours should take about equally long.
        tell: called with the number of searches that ended since the last call.
        executor: runs the searches, unless they are few; if left out, the cores of this process do, with the same chunks and
            the same bits.
    """
    (_, first), *others = search_each(strobe, axes, guesses, tell, executor)
    num_stops = num_stops_of(strobe.numbers)
    found = _orbits_of_search(first, num_stops)
    for which, search in others:
        for a, more in zip(found, _orbits_of_search(search, num_stops), strict=True):
            a[which] = more
    return found


def search_each(
    strobe: StroboscopicMap,
    axes: Sequence[int | None],
    guesses: np.ndarray,
    tell: Callable[[int], Any],
    executor: Executor | None = None,
) -> list[tuple[np.ndarray, Search]]:
    """The searches of `search_many`: of all lanes, then of the lanes that needed more room, each with its indices."""
    everyone = np.arange(len(guesses))
    if len(guesses) <= _ALONE:
        return [(everyone, _one_by_one(strobe, axes, guesses, tell))]
    few = dataclasses.replace(strobe, room=min(_FEW, strobe.room))
    search = _search(few, axes, guesses, everyone, tell, executor)
    found, longer = [(everyone, search)], np.flatnonzero(search.is_full & ~search.is_orbit)
    if strobe.room > _FEW and longer.size:
        tell(-longer.size)
        found.append((longer, _search(strobe, axes, guesses, longer, tell, executor)))
    return found


def _one_by_one(
    strobe: StroboscopicMap, axes: Sequence[int | None], guesses: np.ndarray, tell: Callable[[int], Any]
) -> Search:
    """The finished searches of all lanes, each alone."""
    leaves, structure = jax.tree.flatten(strobe)
    found = []
    for lane, guess in enumerate(guesses):
        own = [
            np.asarray(a) if axis is None else np.asarray(a)[lane]
            for a, axis in zip(leaves, axes, strict=True)
        ]
        found.append(jax.tree.map(np.asarray, search_to_end(jax.tree.unflatten(structure, own), guess)))
        tell(1)
    return jax.tree.map(lambda *a: np.stack(a), *found)


def _search(
    strobe: StroboscopicMap,
    axes: Sequence[int | None],
    guesses: np.ndarray,
    which: np.ndarray,
    tell: Callable[[int], Any],
    executor: Executor | None,
) -> Search:
    """The finished searches of the lanes `which`."""
    numbers = strobe.numbers
    begin = _begin(numbers.kinds, strobe.room)
    whole = jax.tree.map(np.array, begin(guesses[which]))
    leaves, structure = jax.tree.flatten(strobe)

    def chunk_of(lanes: np.ndarray) -> tuple[StroboscopicMap, Search]:
        """The lanes of a chunk, padded with the first of them."""
        index = np.concatenate([lanes, np.full(_LANES - len(lanes), lanes[0])])
        of_lanes = [
            np.asarray(a) if axis is None else np.asarray(a)[which[index]]
            for a, axis in zip(leaves, axes, strict=True)
        ]
        return jax.tree.unflatten(structure, of_lanes), jax.tree.map(lambda a: a[index], whole)

    with SearchWorkers(tuple(axes), executor) as learners:
        waiting = np.arange(len(which))
        while waiting.size:
            chunks = [waiting[k : k + _LANES] for k in range(0, len(waiting), _LANES)]
            for k, found in learners.learn(len(chunks), lambda k, chunks=chunks: chunk_of(chunks[k])):
                for a, new in zip(jax.tree.leaves(whole), jax.tree.leaves(found), strict=True):
                    a[chunks[k]] = new[: len(chunks[k])]
            is_on = np.asarray(whole.is_on)[waiting]
            tell(int(np.count_nonzero(~is_on)))
            waiting = waiting[is_on]
    return whole


def _orbits_of_search(search: Search, num_stops: int) -> Orbits:
    cycle, sequence = search.cycle, search.cycle.sequence
    is_hit = (sequence.kind == IMPACT)[..., None] & (sequence.stop[..., None] == np.arange(num_stops))
    columns = cycle.start, cycle.multipliers, cycle.residual, is_hit.sum(axis=1), search.is_orbit
    return Orbits(*map(np.asarray, columns))


def lanes_first(tree: Any) -> tuple[Any, list[int | None]]:
    """Move the lane axis of leaves from last to first, or drop it where its size is one; also returns the `axes`."""
    leaves, structure = jax.tree.flatten(tree)
    leaves = [np.asarray(a) for a in leaves]
    axes = [None if a.shape[-1] == 1 else 0 for a in leaves]
    leaves = [
        a[..., 0] if axis is None else np.moveaxis(a, -1, 0) for a, axis in zip(leaves, axes, strict=True)
    ]
    return jax.tree.unflatten(structure, leaves), axes


@cache
def _begin(kinds: tuple[int, ...], room: int) -> Callable:
    begin = jax.vmap(lambda guess: begin_search(guess, kinds, room))
    return jit_lightly(begin, name=("begin_search", kinds, room))
