"""Records of a run as named columns, written by the loop over lanes, read by the host.

Integers have columns of their own type: a 32-bit float loses point numbers above 2^24. A column is an array of its
own, not a part of one wide row: one loop then writes all columns, whatever their types.
"""

from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Int

from .._jax.each_lane import for_each

# Array on the device or on the host.
Column = Array | np.ndarray


class Impact(eqx.Module):
    """Impacts, rows first. Their points are numbered within a queue on the device, within the sweep on the host.

    Attributes:
        time: time since the end of the transient.
        velocity: of the mass, in space, before the impact.
        chatter: time to the end of the chatter that the impact completes, or 0.
        stop: index of the stop.
        point: index of the point.
        number: number of earlier recorded impacts of the point.
    """

    time: Column
    velocity: Column
    chatter: Column
    stop: Column
    point: Column
    number: Column


class PeriodEnd(eqx.Module):
    """States of points at the ends of recorded periods, or at given times, rows first.

    Attributes:
        point: index of the point.
        mark: number of the recorded period that ends, or of the time.
        x: positions in space, (rows, n).
        v: velocities in space, (rows, n).
        held_time: time for which each stop held its mass so far, (rows, stops).
        growth: growth of small changes in the period, (rows, 2 n), see `Tangents`; None where not requested.
    """

    point: Column
    mark: Column
    x: Column
    v: Column
    held_time: Column
    growth: Column | None = None


Record = TypeVar("Record", Impact, PeriodEnd)


class RecordBatch(eqx.Module):
    """Rows that the host takes away: memory does not depend on their total number.

    Attributes:
        room: the columns, each (rows, ...).
        size: number of rows written.
    """

    room: Impact | PeriodEnd
    size: Int[Array, ""]

    def has_room(self, num_rows: int) -> Bool[Array, ""]:
        """True where `num_rows` more rows fit."""
        return self.size + num_rows <= len(jax.tree.leaves(self.room)[0])


def impact_rows(size: int, dtype: DTypeLike) -> RecordBatch:
    """Empty room for impacts."""
    real, whole = jnp.zeros(size, dtype), jnp.zeros(size, int)
    room = Impact(time=real, velocity=real, chatter=real, stop=whole, point=whole, number=whole)
    return RecordBatch(room, jnp.zeros((), int))


def mark_rows(
    size: int, num_masses: int, num_stops: int, dtype: DTypeLike, *, has_growth: bool
) -> RecordBatch:
    """Empty room for the ends of recorded periods."""
    whole, of_masses = jnp.zeros(size, int), jnp.zeros((size, num_masses), dtype)
    held_time = jnp.zeros((size, num_stops), dtype)
    growth = jnp.zeros((size, 2 * num_masses), dtype) if has_growth else None
    room = PeriodEnd(whole, whole, of_masses, of_masses, held_time, growth)
    return RecordBatch(room, jnp.zeros((), int))


def append(rows: RecordBatch, kept: Bool[Array, "*stops lanes"], record: Impact | PeriodEnd) -> RecordBatch:
    """Append a row for each entry that is kept, those of several stops of one lane in their order.

    On a processor rows are written one after another, because a turn has few. Elsewhere a turn of that loop takes as
    long as a turn of all lanes, so all are scattered at once.

    Args:
        rows: where to write.
        kept: flags of the entries to append.
        record: the columns, each (..., *stops, lanes) or broadcastable to it.
    """
    if kept.size == 0:
        return rows
    return jax.lax.platform_dependent(rows, kept, record, cpu=appended_in_turn, default=appended_at_once)


def appended_in_turn(rows: RecordBatch, kept: Bool[Array, "*stops lanes"], record: Record) -> RecordBatch:
    """Append row by row, which a kernel can contain."""

    def put(place: Int[Array, ""], carry: tuple) -> tuple:
        room, size = carry
        at = jnp.unravel_index(place, kept.shape)

        def write(room: Array, column: Array) -> Array:
            for k in range(max(-column.ndim, -kept.ndim), 0):
                if column.shape[k] > 1 and column.shape[k] == kept.shape[k]:
                    column = jax.lax.dynamic_slice_in_dim(column, at[k], 1, axis=k)
            row = jnp.broadcast_to(column, (*room.shape[1:], *[1] * kept.ndim)).reshape(1, *room.shape[1:])
            return jax.lax.dynamic_update_slice_in_dim(room, row.astype(room.dtype), size, 0)

        return jax.tree.map(write, room, record), size + 1

    return RecordBatch(*for_each(kept.ravel(), put, (rows.room, rows.size)))


def appended_at_once(rows: RecordBatch, kept: Bool[Array, "*stops lanes"], record: Record) -> RecordBatch:
    """Append all rows by a scatter."""
    flags = kept.ravel()
    ends = rows.size + jnp.cumsum(flags)

    def write(room: Array, column: Array) -> Array:
        of_entries = jnp.broadcast_to(column, (*room.shape[1:], *kept.shape)).reshape(
            *room.shape[1:], kept.size
        )
        place = jnp.where(flags, ends - 1, len(room))
        return room.at[place].set(jnp.moveaxis(of_entries, -1, 0).astype(room.dtype), mode="drop")

    return RecordBatch(jax.tree.map(write, rows.room, record), ends[-1].astype(rows.size.dtype))


def written_rows(rows: RecordBatch) -> Impact | PeriodEnd:
    """Copy the written rows, because the room is reused; integers, which count what is in memory, in 32 bits."""
    size = int(rows.size)

    def copy(a: Array) -> np.ndarray:
        return np.array(np.asarray(a)[:size], np.int32 if a.dtype.kind == "i" else None)

    return jax.tree.map(copy, rows.room)


def selected_rows(record: Record, which: np.ndarray | slice) -> Record:
    """Some rows of a record."""
    return jax.tree.map(lambda a: a[which], record)


def joined(parts: Sequence[Record]) -> Record:
    """The rows of all parts, one part after another."""
    if len(parts) == 1:
        return parts[0]
    return jax.tree.map(lambda *columns: np.concatenate(columns), *parts)
