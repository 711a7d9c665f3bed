"""The search for an orbit of a machine of concrete numbers: its runs are calls of the program of `simulate`.

A program of the whole search would hold the loop of a run once more, which takes half of its time to compile.
"""

from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._jax.arrays import Reals
from .._jax.packing import Packed, pack
from .._jax.xla import jit_quickly
from .._trajectory.instant_codes import instants_of
from .._trajectory.one_call import EVENTS, CallProgress, Found, KnownMachine
from .._trajectory.results import RESULTS
from .search import FollowedMap, Search, StroboscopicMap, begin_search, run_request, search_step
from .sequence import Instants


class _Seen(NamedTuple):
    """Part of a call that a step of a search reads: its start, codes and times of its instants, what holds, its end."""

    start: Reals
    codes: Array
    times: Array
    held: Array
    left: Packed
    result: RESULTS
    x1: Array
    v1: Array

    @classmethod
    def of(cls, start: np.ndarray, found: Found) -> "_Seen":
        """The same of a call that is done."""
        solution, rows = found.solution, found.solution.restarts
        return cls(
            start, found.codes, rows.t, rows.held, found.left, solution.result, solution.x1, solution.v1
        )


def search_by_calls(machine: KnownMachine, strobe: StroboscopicMap, guess: np.ndarray) -> Search | None:
    """A search to its end, in NumPy arrays; None if a run has more events than one call has room for."""
    if strobe.room > EVENTS:
        return None
    period = 2 * np.pi / np.asarray(strobe.numbers.frequency)
    map_ = num_periods, phase = np.asarray(strobe.num_periods), np.asarray(strobe.phase)
    t0 = phase * period
    numbers, trial = strobe.numbers, np.asarray(guess)
    search = _nothing(len(trial), numbers.kinds, strobe.room, trial.dtype)
    is_on = True
    while is_on:
        found = machine.follow(run_request(t0, t0 + num_periods * period, trial, strobe.room), None)
        # Nothing waits for the run but the program of the step.
        search, trial, flags = step_of_search(machine.packed, map_, search, _Seen.of(trial, found))
        is_on, is_paused = np.asarray(flags).tolist()
        if is_paused:
            return None
        trial = np.asarray(trial)
    return search.in_numpy().unpacked()


@jit_quickly
def step_of_search(
    machine: Packed, map_: tuple[Array, Array], search: Packed, seen: _Seen
) -> tuple[Packed, Array, Bool[Array, "2"]]:
    """The search after a run, from which it begins if that is the first.

    Then the start of the next run, and flags: whether there is one, and whether the run is unfinished.
    """
    numbers, flow = machine.unpacked()
    before: Search = search.unpacked()
    progress: CallProgress = seen.left.unpacked()
    room = len(before.cycle.unknowns.flights)
    kinds = numbers.kinds
    first = begin_search(seen.start, kinds, room)
    now = jax.tree.map(lambda a, b: jnp.where(before.num_runs == 0, a, b), first, before)
    transitions = instants_of(seen.codes, seen.times, kinds)
    transitions, held = jax.tree.map(lambda a: a[: room + 2], (transitions, seen.held))
    instants, end = Instants(transitions, held, progress.rows), jnp.concatenate([seen.x1, seen.v1])
    strobe = StroboscopicMap(numbers, flow.compact(), map_[0], map_[1], room)
    after = search_step(strobe, now, lambda _: FollowedMap(instants, seen.result, end))
    return pack(after, search.layout), after.trial, jnp.stack([after.is_on, progress.is_paused])


@lru_cache
def _nothing(size: int, kinds: tuple[int, ...], room: int, dtype: np.dtype) -> Packed:
    """A packed search of no runs."""
    begin = lambda guess: begin_search(guess, kinds, room)  # noqa: E731
    shapes = jax.eval_shape(begin, jax.ShapeDtypeStruct((size,), dtype))
    return pack(jax.tree.map(lambda a: np.zeros(a.shape, a.dtype), shapes))
