"""Batches of trajectories under `jax.vmap`, in one kernel as in sweeps.

`jax.vmap` alone puts lanes first, and a step of all lanes is some hundred kernels. Here lanes stand last, as the engine
takes them, in groups that fit the cache. Unlike sweeps there is no queue: a finished lane waits for the others of its
group, which are mostly alike.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PyTree

from .._jax.arrays import vmap_axes
from .._jax.each_lane import for_each

# Range of lanes per group, the best number first. As in sweeps, see `lane_loop.py`, fewer lanes leave the vector units
# idle, and more leave the cache.
_LANES = 128, 63, -1
# Most masses or contacts times lanes, for more than four: XLA divides larger operations among threads, which no kernel
# can do, and the program would not be compiled. (For up to four the rows of products are operations of their own.)
_MOST_ROWS, _MOST_NUMBERS = 4, 128


def lanes_of_machine(num_masses: int, num_contacts: int) -> int:
    """Most lanes of a group whose loop is one kernel."""
    rows = max(num_masses, num_contacts)
    return _LANES[0] if rows <= _MOST_ROWS else max(_MOST_NUMBERS // rows, 1)


def in_groups(follow: Callable[[PyTree, int], PyTree], arguments: PyTree, size: int, most: int) -> PyTree:
    """Call `follow` for one group of lanes after another.

    Args:
        follow: function of such arguments and a number of lanes; its results have lanes first.
        arguments: arrays with lanes last, or with a last axis of length one if all lanes share them.
        size: number of lanes.
        most: most lanes of a group.
    """
    lanes = min(_lanes(size), most)
    num_groups = -(-size // lanes)
    if num_groups == 1:
        return follow(arguments, size)
    own, shared = eqx.partition(arguments, lambda a: jnp.shape(a)[-1:] == (size,))

    def grouped(a: Array) -> Array:
        filled = jnp.concatenate([a, jnp.repeat(a[..., -1:], num_groups * lanes - size, axis=-1)], axis=-1)
        return jnp.moveaxis(filled.reshape(*a.shape[:-1], num_groups, lanes), -2, 0)

    of_group = lambda own: follow(eqx.combine(own, shared), lanes)  # noqa: E731
    found = jax.lax.map(of_group, jax.tree.map(grouped, own))
    return jax.tree.map(lambda a: a.reshape(num_groups * lanes, *a.shape[2:])[:size], found)


def _lanes(size: int) -> int:
    """Lanes per group: a divisor of `size` if one lies in the range, because padding costs a copy at the end."""
    divisors = (lanes for lanes in range(*_LANES) if size % lanes == 0)
    return min(next(divisors, _LANES[0]), size)


def to_all(tree: PyTree, lanes: int) -> PyTree:
    """Broadcast the last axis of arrays to all lanes."""
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (*a.shape[:-1], lanes)), tree)


def one_by_one(function: Callable, lanes: int, last: PyTree, first: PyTree) -> Any:
    """Call a function written for one trajectory for each lane; its results have lanes first.

    Args:
        function: function of two trees without lanes.
        lanes: number of lanes.
        last: tree with lanes last, or a single lane for all.
        first: tree with lanes first.
    """
    leaves, axes, structure = vmap_axes(last, lanes)
    call = lambda leaves, first: function(jax.tree.unflatten(structure, leaves), first)  # noqa: E731
    return jax.vmap(call, (axes, 0))(leaves, first)


def row_of_lane(rows: Array, which: Int[Array, "..."]) -> Array:
    """Select one row for each lane; lanes are the last axis, if there are any."""
    if which.ndim == 0:
        return rows[which]
    return jnp.take_along_axis(rows, which.reshape(*[1] * (rows.ndim - 1), -1), axis=0)[0]


class Writing(NamedTuple):
    """Rows to be written.

    Attributes:
        room: tree of arrays to write into, (rows, ...), with lanes first if there are any.
        rows: the same tree of new rows, (new rows, ...), with lanes last.
        place: index of the first new row, ().
    """

    room: PyTree
    rows: PyTree
    place: Int[Array, "..."]


def put(is_kept: Bool[Array, "..."], *writings: Writing) -> list[PyTree]:
    """Write rows where they are kept, one lane after another: few lanes write at once.

    For a single trajectory, rows that are not kept are written to the end of the room: a selection takes longer.
    """
    rooms = [writing.room for writing in writings]
    if is_kept.ndim == 0:
        return [_written(*writing, is_kept) for writing in writings]

    def write(lane: Int[Array, ""], rooms: list[PyTree]) -> list[PyTree]:
        def of_lane(place: Array, room: Array, rows: Array) -> Array:
            rows = jnp.broadcast_to(rows, (*rows.shape[:-1], is_kept.size))[..., lane].astype(room.dtype)
            start = lane, place[lane].astype(lane.dtype), *[jnp.zeros_like(lane)] * (rows.ndim - 1)
            return jax.lax.dynamic_update_slice(room, rows[None], start)

        pairs = zip(rooms, writings, strict=True)
        return [jax.tree.map(partial(of_lane, w.place), room, w.rows) for room, w in pairs]

    return for_each(is_kept, write, rooms)


def _written(room: PyTree, rows: PyTree, place: Int[Array, ""], is_kept: Bool[Array, ""]) -> PyTree:
    def of_one(room: Array, rows: Array) -> Array:
        start = jnp.where(is_kept, place, len(room) - len(rows))
        return jax.lax.dynamic_update_slice_in_dim(room, rows.astype(room.dtype), start, axis=0)

    return jax.tree.map(of_one, room, rows)
