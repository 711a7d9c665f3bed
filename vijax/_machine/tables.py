"""Loads by tables, as polynomials in time that change at knots.

Between two knots a load is a polynomial of degree 3 at most. Its derivatives p0, p1, ... at the present instant, over the
masses, are states that evolve linearly, p0' = p1, p1' = p2, ..., just as the cosines and sines of the harmonics do. They
are columns of the phase of the load, behind those of the harmonics:

    phase[r, H + column] = p_(2 pair + r) of a mass,   columns in the order (stream, pair, mass), r = 0, 1.

So every flow, guard and derivative that is linear in the phase serves them without knowing of them. At a knot a step ends
and they are read anew from the table, by a gather: nothing is accumulated, and each lane may have its own table.

A load is one stream. A wave form of the frequency by which the machine counts periods begins each period anew, with its
time local to the period; any other counts its own periods.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Flag, Reals, Scalar, add_up, stack
from .table_numbers import TableNumbers
from .turns import Turns


class Knots(eqx.Module):
    """Place of a trajectory in all tables.

    Attributes:
        passed: row of each table, and above its bits the number of turns of a wave form, (streams, ...).
        first: the same at the beginning of a forcing period.
        anew: for each column of the phase of the load, whether it begins anew with each forcing period.
        in_step: the same for each stream.
    """

    passed: Int[Array, "streams ..."]
    first: Int[Array, "streams ..."]
    anew: tuple[bool, ...] = eqx.field(static=True)
    in_step: tuple[bool, ...] = eqx.field(static=True)


def in_new_period(
    knots: Knots,
    phase: Float[Array, "2 columns ..."],
    phase0: Float[Array, "2 columns ..."],
    is_over: Flag,
) -> tuple[Knots, Float[Array, "2 columns ..."]]:
    """Places and phase where a forcing period may be over; loads that are out of step go on."""
    of_rows = lambda flags: np.array(flags).reshape(-1, *[1] * is_over.ndim)  # noqa: E731
    passed = jnp.where(is_over[None] & of_rows(knots.in_step), knots.first, knots.passed)
    anew = (is_over[None] & of_rows(knots.anew))[None]
    return eqx.tree_at(lambda k: k.passed, knots, passed), jnp.where(anew, phase0, phase)


class Stream(eqx.Module):
    """A table with its times counted from the beginning of a trajectory, lanes last.

    Attributes:
        starts: times at which the rows begin in turn 0, (rows, ...).
        rows: derivatives of the load by time there, (rows, orders, n, ...).
        count: number of rows of a turn, (...).
        turn: duration of a turn, (...); 0 of a table in time, which has one.
        knots: times at which rows begin, or phases of a wave form, (rows, ...).
        frequency: angular frequency of a wave form; None of a table in time.
        is_in_step: whether it begins anew with each forcing period.
        size: number of rows of a table, see `TableNumbers`.
        turns: its turns in a forcing period; None of a table in time, and of one that is in step.
        number: number of the table of each lane, (...); None where there is one for all, or one for each.
    """

    starts: Float[Array, "rows ..."]
    rows: Float[Array, "rows orders n ..."]
    count: Int[Array, "..."]
    turn: Scalar
    knots: Float[Array, "rows ..."]
    frequency: Scalar | None
    is_in_step: bool = eqx.field(static=True)
    size: int = eqx.field(static=True)
    turns: Turns | None = None
    number: Int[Array, "..."] | None = None

    @property
    def _bits(self) -> int:
        return self.size.bit_length() - 1

    def row(self, passed: Int[Array, "..."]) -> Int[Array, "..."]:
        """Row of a place."""
        return passed & (self.size - 1)

    def derivatives(self, passed: Int[Array, "..."]) -> Float[Array, "orders n ..."]:
        """Derivatives of the load by time where the row of a place begins."""
        return self._at(self.rows, self.row(passed))

    def bounds(self) -> Float[Array, "orders n ..."]:
        """Largest derivatives of the load where rows begin."""
        sizes = jnp.abs(self.rows)
        if self.number is None:
            return jnp.max(sizes, axis=0)
        largest = jnp.max(sizes.reshape(-1, self.size, *sizes.shape[1:]), axis=1)
        return row_at(largest, self.number)

    def following(self, passed: Int[Array, "..."]) -> Int[Array, "..."]:
        """The place after the next knot."""
        is_turn = self.row(passed) + 1 >= self.count
        return jnp.where(is_turn, ((passed >> self._bits) + 1) << self._bits, passed + 1)

    def preceding(self, passed: Int[Array, "..."]) -> Int[Array, "..."]:
        """The place before the last knot."""
        is_turn = self.row(passed) == 0
        before = (((passed >> self._bits) - 1) << self._bits) + self.count - 1
        return jnp.where(is_turn, before, passed - 1)

    def start(self, passed: Int[Array, "..."]) -> Scalar:
        """Time at which the row of a place begins."""
        return self._at(self.starts, self.row(passed)) + (passed >> self._bits) * self.turn

    def start_in_period(
        self, passed: Int[Array, "..."], periods: Int[Array, "..."], elapsed: Scalar
    ) -> Scalar:
        """Time at which the row of a place begins, since the beginning of a forcing period; `elapsed` is the time of all before."""
        if self.is_in_step:
            return self.start(passed)
        if self.turns is None:
            return self.start(passed) - elapsed
        whole, rest = self.turns.in_periods(periods)
        ahead = ((passed >> self._bits) - whole) - rest
        return self._at(self.starts, self.row(passed)) + ahead * self.turn

    def place_at(self, t: Scalar, origin: Scalar) -> tuple[Int[Array, "..."], Float[Array, "orders n ..."]]:
        """Place at a time, and derivatives of the load there; `origin` is the beginning of the trajectory."""
        if self.frequency is None:
            row = jnp.maximum(self._rows_until(t) - 1, 0)
            return row, shifted(self._at(self.rows, row), t - self._at(self.knots, row))
        angle = self.frequency * t
        turns = jnp.floor(angle / (2 * jnp.pi))
        rest = angle - turns * 2 * jnp.pi
        row = self._rows_until(rest) - 1
        is_before = row < 0
        row = jnp.where(is_before, self.count - 1, row)
        since = rest - self._at(self.knots, row) + 2 * jnp.pi * is_before
        own = turns - jnp.floor(self.frequency * origin / (2 * jnp.pi)) - is_before
        passed = (own.astype(row.dtype) << self._bits) + row
        return passed, shifted(self._at(self.rows, row), since / self.frequency)

    def _at(self, rows: Float[Array, "rows ..."], row: Int[Array, "..."]) -> Array:
        """Numbers of a row of the table."""
        return row_at(rows, row if self.number is None else self.number * self.size + row)

    def _rows_until(self, t: Scalar) -> Int[Array, "..."]:
        """Number of knots that are not after a time."""
        if self.number is None:
            return jnp.sum(self.knots <= t[None], axis=0)
        row = jnp.zeros_like(self.number)
        for k in range(self._bits - 1, -1, -1):  # the last knot is infinite
            ahead = row + (1 << k)
            row = jnp.where(self._at(self.knots, ahead - 1) <= t, ahead, row)
        return row


def row_at(rows: Array, which: Int[Array, "..."]) -> Array:
    """Select a row for each lane; lanes are the last axis, if there are any, or one for all."""
    if which.ndim == 0:
        return jax.lax.dynamic_index_in_dim(rows, which, 0, keepdims=False)
    if rows.shape[-1] == 1:
        return jnp.moveaxis(jnp.take(rows[..., 0], which, axis=0, mode="clip"), 0, -1)
    place = which.reshape(*[1] * (rows.ndim - 1), -1)
    return jnp.take_along_axis(rows, place, axis=0, mode="clip")[0]


def shifted(p: Float[Array, "orders ..."], step: Scalar) -> Float[Array, "orders ..."]:
    """Derivatives of a polynomial after a step."""
    return p + change_of(list(p), step)


def change_of(p: list[Array], step: Scalar) -> Array:
    """Change of the derivatives of a polynomial over a step, accurate relative to itself."""
    changes, step = [], step.reshape((1,) * (p[0].ndim - step.ndim) + step.shape)
    for k in range(len(p)):
        total = jnp.zeros_like(p[k] * step)
        for j in range(len(p) - 1, k, -1):  # Horner's scheme
            total = (total + p[j]) * step * (1 / (j - k))
        changes.append(total)
    return jnp.stack(changes)


class Tables(eqx.Module):
    """All loads by tables of a machine.

    Attributes:
        streams: the tables.
        origin: time of the beginning of the trajectory, from which others are counted.
        first: places there.
        columns: columns of the phase there, (2, columns, ...).
        bounds: bounds of the derivatives of all loads, (orders, n, ...).
    """

    streams: tuple[Stream, ...]
    origin: Scalar
    first: Knots
    columns: Float[Array, "2 columns ..."]
    bounds: Float[Array, "orders n ..."]

    def at(self, t: Scalar) -> Float[Array, "2 columns ..."]:
        """Columns of the phase at a time."""
        return _columns([stream.place_at(t, self.origin)[1] for stream in self.streams])

    def load(self, columns: Float[Array, "2 columns ..."]) -> Float[Array, "n ..."]:
        """Load of columns of a phase; its derivative, of those of the rate of a phase."""
        return add_up(self._derivatives(columns)[0])

    def load_of(
        self, columns: Float[Array, "2 columns ..."], which: tuple[bool, ...]
    ) -> Float[Array, "n ..."]:
        """Sum of the loads of flagged tables, at columns of a phase."""
        loads = self._derivatives(columns)[0]
        return add_up([loads[k] for k, is_own in enumerate(which) if is_own])

    def derivatives_of_load(self, columns: Float[Array, "2 columns ..."]) -> list[Float[Array, "n ..."]]:
        """Load of columns of a phase, and its derivatives by time."""
        return [add_up(p) for p in self._derivatives(columns)]

    def rate(self, columns: Float[Array, "2 columns ..."]) -> Float[Array, "2 columns ..."]:
        """Time derivative of columns of a phase."""
        p = self._derivatives(columns)
        return self._joined([*p[1:], jnp.zeros_like(p[0])])

    def change(self, columns: Float[Array, "2 columns ..."], step: Scalar) -> Float[Array, "2 columns ..."]:
        """Change of columns of a phase over a step, without a knot inside."""
        return self._joined(list(change_of(self._derivatives(columns), step)))

    def bound(self, order: int) -> Reals:
        """Bound of a derivative of the load, (n, ...)."""
        return self.bounds[order] if order < len(self.bounds) else 0 * self.bounds[0]

    def until(
        self, knots: Knots, periods: Int[Array, "..."], elapsed: Scalar, time: Scalar, low: Scalar
    ) -> Float[Array, "streams ..."]:
        """Time to the next knot of each table.

        Args:
            knots: the places.
            periods: whole forcing periods since the beginning of the trajectory.
            elapsed: time of all of them.
            time: time since then.
            low: its low part.
        """
        times = []
        for k, stream in enumerate(self.streams):
            then = stream.start_in_period(stream.following(knots.passed[k]), periods, elapsed)
            times.append((then - time) - low)
        return stack(times)

    def past(
        self, knots: Knots, columns: Float[Array, "2 columns ..."], at: Bool[Array, "streams ..."]
    ) -> tuple[Knots, Float[Array, "2 columns ..."]]:
        """Places and columns of the phase after the next knot of the flagged tables."""
        passed = [s.following(p) for s, p in zip(self.streams, knots.passed, strict=True)]
        rows = [s.derivatives(p) for s, p in zip(self.streams, passed, strict=True)]
        return self._chosen(knots, columns, at, (jnp.stack(passed), _columns(rows)))

    def before(
        self, knots: Knots, columns: Float[Array, "2 columns ..."], at: Bool[Array, "streams ..."]
    ) -> tuple[Knots, Float[Array, "2 columns ..."]]:
        """Places and columns of the phase before the last knot of the flagged tables."""
        passed, rows = [], []
        for stream, p in zip(self.streams, knots.passed, strict=True):
            last = stream.preceding(p)
            passed.append(last)
            width = stream.start(p) - stream.start(last)
            rows.append(shifted(stream.derivatives(last), width))
        return self._chosen(knots, columns, at, (jnp.stack(passed), _columns(rows)))

    def _chosen(
        self, knots: Knots, columns: Float[Array, "2 columns ..."], at: Bool[Array, "streams ..."], new: tuple
    ) -> tuple[Knots, Float[Array, "2 columns ..."]]:
        """New places and columns of the flagged tables."""
        passed, those = new
        flags = jnp.repeat(at, those.shape[1] // len(self.streams), axis=0)
        passed = jnp.where(at, passed, knots.passed)
        return eqx.tree_at(lambda k: k.passed, knots, passed), jnp.where(flags[None], those, columns)

    def _derivatives(self, columns: Float[Array, "2 columns ..."]) -> list[Float[Array, "streams n ..."]]:
        """Derivatives of each load, from columns of a phase."""
        orders, n = self.bounds.shape[:2]
        parts = columns.reshape(2, len(self.streams), orders // 2, n, *columns.shape[2:])
        return [parts[j % 2, :, j // 2] for j in range(orders)]

    def _joined(self, p: list[Float[Array, "streams n ..."]]) -> Float[Array, "2 columns ..."]:
        """Columns of a phase from derivatives of each load."""
        parts = jnp.stack([jnp.stack(p[r::2], axis=1) for r in range(2)])
        return parts.reshape(2, -1, *parts.shape[4:])


def _columns(of_streams: list[Float[Array, "orders n ..."]]) -> Float[Array, "2 columns ..."]:
    """Columns of a phase from derivatives of each load."""
    p = stack(of_streams)
    p = p.reshape(len(p), p.shape[1] // 2, 2, *p.shape[2:])
    p = jnp.moveaxis(p, 2, 0)
    return p.reshape(2, -1, *p.shape[4:])


class KnotsLayout(NamedTuple):
    """Static fields of `Knots`."""

    anew: tuple[bool, ...]
    in_step: tuple[bool, ...]

    @classmethod
    def of(cls, in_step: tuple[bool, ...], num_harmonics: int, width: int) -> "KnotsLayout":
        """Layout of streams of so many columns each, behind those of the harmonics."""
        return cls((True,) * num_harmonics + tuple(own for own in in_step for _ in range(width)), in_step)

    def blank(self, like: Reals) -> Knots:
        """Places of a motion that has not begun, in all lanes."""
        nothing = jnp.zeros((len(self.in_step), *like.shape), int)
        return Knots(nothing, nothing, *self)


def prepare_tables(
    numbers: tuple[TableNumbers, ...], origin: Scalar, clock: Scalar, num_harmonics: int
) -> Tables:
    """Tables in times of a trajectory that begins at `origin`; `clock` is the frequency of the machine."""
    streams = tuple(_stream(one, origin, clock) for one in numbers)
    places, derivatives = zip(*(stream.place_at(origin, origin) for stream in streams), strict=True)
    passed, columns = jnp.stack(jnp.broadcast_arrays(*places)), _columns(list(derivatives))
    in_step = tuple(stream.is_in_step for stream in streams)
    width = columns.shape[1] // len(streams)
    layout = KnotsLayout.of(in_step, num_harmonics, width)
    bounds = add_up([stream.bounds() for stream in streams])
    return Tables(streams, origin, Knots(passed, passed, *layout), columns, bounds)


def _stream(numbers: TableNumbers, origin: Scalar, clock: Scalar) -> Stream:
    knots, rows, count = numbers.knots, numbers.rows, numbers.count.astype(int)
    if not numbers.is_wave:
        own = None if numbers.number is None else numbers.number.astype(int)
        starts, turn = knots - origin[None], jnp.zeros_like(knots[0])
        return Stream(starts, rows, count, turn, knots, None, False, numbers.size, number=own)
    frequency = clock if numbers.frequency is None else numbers.frequency
    angle = frequency * origin
    begin = angle - 2 * jnp.pi * jnp.floor(angle / (2 * jnp.pi))
    scales = jnp.stack([frequency**k for k in range(rows.shape[1])])[None, :, None]
    starts = (knots - begin[None]) / frequency[None]
    turns = None if numbers.is_in_step else Turns.of(frequency, clock)
    return Stream(
        starts,
        rows * scales,
        count,
        2 * jnp.pi / frequency,
        knots,
        frequency,
        numbers.is_in_step,
        numbers.size,
        turns,
    )
