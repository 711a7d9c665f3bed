"""Many trajectories side by side: what `jax.vmap` makes of one, in the kernel that sweeps have.

`jax.vmap` alone puts lanes first, and a step of all of them is some hundred kernels. Here lanes stand last, as the engine
takes them, so many at a time as fit the cache. There is no queue as for sweeps: a lane that is done waits for the others
of its group, which are mostly alike.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PyTree

from .._jax.arrays import lanes_apart
from .._jax.xla import for_each

# Lanes of a group, from the best number down to the least. As for sweeps, see `lane_loop.py`, fewer leave the vector
# units idle, and more leave the cache.
_LANES = 128, 63, -1


def in_groups(follow: Callable[[PyTree, int], PyTree], arguments: PyTree, size: int) -> PyTree:
    """Call `follow` for one group of lanes after another.

    Args:
        follow: of arguments as these, for so many lanes; what it returns has lanes in front.
        arguments: arrays with lanes last, or an axis of length one in their place where all share them.
        size: how many lanes there are.
    """
    lanes = _lanes(size)
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
    """How many lanes make a group: a divisor if there is one that serves, for what is filled up is copied at the end."""
    divisors = (lanes for lanes in range(*_LANES) if size % lanes == 0)
    return min(next(divisors, _LANES[0]), size)


def to_all(tree: PyTree, lanes: int) -> PyTree:
    """The arrays with every lane's own numbers, last."""
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (*a.shape[:-1], lanes)), tree)


def one_by_one(function: Callable, lanes: int, last: PyTree, first: PyTree) -> Any:
    """Call a function written for one trajectory for each lane; what it returns has lanes in front.

    Args:
        function: of two trees without lanes.
        lanes: how many there are.
        last: a tree with lanes last, or a single one for all.
        first: a tree with lanes in front.
    """
    leaves, axes, structure = lanes_apart(last, lanes)
    call = lambda leaves, first: function(jax.tree.unflatten(structure, leaves), first)  # noqa: E731
    return jax.vmap(call, (axes, 0))(leaves, first)


def row_of_lane(rows: Array, which: Int[Array, "..."]) -> Array:
    """One of the rows, of each lane its own."""
    return rows[which] if which.ndim == 0 else jnp.take_along_axis(rows, which[None], axis=0)[0]


class Writing(NamedTuple):
    """Rows to be written.

    Attributes:
        room: a tree of arrays, (rows, ...), with lanes in front if there are any.
        rows: the same tree, (so many, ...), with lanes last.
        place: where the first is written, ().
    """

    room: PyTree
    rows: PyTree
    place: Int[Array, "..."]


def put(is_kept: Bool[Array, "..."], *writings: Writing) -> list[PyTree]:
    """Write rows if they are kept, those of several lanes one lane after another: few write at once.

    Of one trajectory alone, what is not kept is written to the end of the room: to choose takes longer.
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
