"""Many searches at once, in a program for a fixed number of lanes: those that are done make room for others."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from .._execution.threads import count_cores
from .._trajectory.event_log import IMPACT
from .._xla import jit_lightly
from .search import Search, Strobe, begin_search, learn

# Searches side by side, the only number compiled for: a lane costs the same among 32 as among 128, and fewer wait for
# the longest. Most cycles have fewer events than `_FEW`: the others are searched for again with room for all.
_LANES, _FEW = 32, 32


class Orbits(NamedTuple):
    """What came of many searches, lanes first.

    Attributes:
        start: states in space, (lanes, 2 n).
        multipliers: (lanes, 2 n).
        residual: of the closing, (lanes,).
        num_impacts: in a cycle, (lanes, stops).
        is_orbit: whether the machine follows it, (lanes,).
    """

    start: np.ndarray
    multipliers: np.ndarray
    residual: np.ndarray
    num_impacts: np.ndarray
    is_orbit: np.ndarray


def search_many(
    strobe: Strobe,
    axes: Sequence[int | None],
    guesses: np.ndarray,
    tell: Callable[[int], Any],
) -> Orbits:
    """Search from many guesses, until each has an orbit or nothing left to try.

    Args:
        strobe: the machines, with room for the most events that a cycle may have; what differs from lane to lane has
            the lanes as its first axis.
        axes: for each of its leaves 0 if that is so, None if all share it.
        guesses: states in space, (lanes, 2 n). Neighbours should take about as long.
        tell: is called with how many searches ended since the last call.
    """
    few = dataclasses.replace(strobe, room=min(_FEW, strobe.room))
    search = _search(few, axes, guesses, np.arange(len(guesses)), tell)
    found = _told(search)
    longer = np.flatnonzero(search.is_full & ~search.is_orbit)
    if strobe.room > _FEW and longer.size:
        tell(-longer.size)
        for a, more in zip(found, _told(_search(strobe, axes, guesses, longer, tell)), strict=True):
            a[longer] = more
    return found


def _search(
    strobe: Strobe,
    axes: Sequence[int | None],
    guesses: np.ndarray,
    which: np.ndarray,
    tell: Callable[[int], Any],
) -> Search:
    """The searches of some lanes, at their ends."""
    leaves, structure = jax.tree.flatten(strobe)
    leaves = [
        np.asarray(a) if axis is None else np.asarray(a)[which] for a, axis in zip(leaves, axes, strict=True)
    ]
    learn_all = _learn(structure, tuple(axes))
    whole = jax.tree.map(np.array, _begin(strobe.numbers.rows.shape[-2], strobe.room)(guesses[which]))
    is_on = np.ones(len(which), bool)

    def learn_chunk(chunk: tuple[np.ndarray, np.ndarray]) -> None:
        lanes, index = chunk
        own = [a if axis is None else a[index] for a, axis in zip(leaves, axes, strict=True)]
        found = learn_all(own, jax.tree.map(lambda a: a[index], whole))
        is_on[lanes] = np.asarray(found.is_on)[: len(lanes)]
        for a, new in zip(jax.tree.leaves(whole), jax.tree.leaves(found), strict=True):
            a[lanes] = np.asarray(new)[: len(lanes)]

    waiting, alone = np.arange(len(which)), 1  # the first is alone: each would compile
    with ThreadPoolExecutor(count_cores()) as cores:  # XLA lets go of Python while it works
        while waiting.size:
            chunks = list(_chunks(waiting))
            for part in (chunks[:alone], chunks[alone:]):
                list(cores.map(learn_chunk, part))
            alone = 0
            tell(int(np.count_nonzero(~is_on[waiting])))
            waiting = waiting[is_on[waiting]]
    return whole


def _told(search: Search) -> Orbits:
    cycle, sequence = search.cycle, search.cycle.sequence
    is_hit = (sequence.kind == IMPACT)[..., None] & (
        sequence.stop[..., None] == np.arange(sequence.held.shape[-1])
    )
    columns = cycle.start, cycle.multipliers, cycle.residual, is_hit.sum(axis=1), search.is_orbit
    return Orbits(*map(np.asarray, columns))


def lanes_first(tree: Any) -> tuple[Any, list[int | None]]:
    """Leaves that have lanes last, or a single one, as `search_many` wants them, and their axes."""
    leaves, structure = jax.tree.flatten(tree)
    leaves = [np.asarray(a) for a in leaves]
    axes = [None if a.shape[-1] == 1 else 0 for a in leaves]
    leaves = [
        a[..., 0] if axis is None else np.moveaxis(a, -1, 0) for a, axis in zip(leaves, axes, strict=True)
    ]
    return jax.tree.unflatten(structure, leaves), axes


def _chunks(lanes: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Lanes that go together, and the same filled up to `_LANES` with the first of them."""
    for k in range(0, len(lanes), _LANES):
        own = lanes[k : k + _LANES]
        yield own, np.concatenate([own, np.full(_LANES - len(own), own[0])])


@cache
def _begin(num_stops: int, room: int) -> Callable:
    return jax.jit(jax.vmap(lambda guess: begin_search(guess, num_stops, room)))


@cache
def _learn(structure: Any, axes: tuple[int | None, ...]) -> Callable:
    def one(leaves: list, search: Search) -> Search:
        return learn(jax.tree.unflatten(structure, leaves), search)

    return jit_lightly(jax.vmap(one, in_axes=([*axes], 0)))
