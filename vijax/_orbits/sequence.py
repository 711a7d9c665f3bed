"""The events of a cycle, in order, as data, so that one program serves every sequence."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.limits import IMPACT, RELEASE
from .._jax.arrays import Reals, Scalar
from .._trajectory.event_log import Log

NOTHING = -1

# `_SAME`: events of two runs within this time, in forcing periods, are the same.
# `_TAIL`: impacts this close before a stick are last bounces of a chatter; one run may have one more than another.
_SAME, _TAIL = 1e-6, 1e-4


class Sequence(eqx.Module):
    """The events that end the flights of a cycle.

    Impacts and releases are events. A stick is none: it is the outcome of an impact. Likewise a release by the jump of
    a force at the impact of another mass is the outcome of that impact.

    Attributes:
        kind: `vx.IMPACT`, `vx.RELEASE`, or `NOTHING` for padding, (events,).
        stop: the stop, (events,).
        held: the stops that hold their masses on each flight, the first and the last included, (events + 1, stops).
    """

    kind: Reals
    stop: Reals
    held: Reals

    @property
    def is_event(self) -> Bool[Array, " events"]:
        """Flags of the events that are not padding."""
        return self.kind != NOTHING

    @property
    def most_held(self) -> Int[Array, ""]:
        """The most stops that hold at once."""
        return jnp.max(jnp.sum(self.held, axis=1), initial=0)


def empty_sequence(num_events: int, num_stops: int) -> Sequence:
    """A sequence without events, with room for `num_events`."""
    whole = jnp.zeros(num_events, int)
    return Sequence(whole + NOTHING, whole, jnp.zeros((num_events + 1, num_stops), bool))


def sequence_of(log: Log, t0: Scalar, period: Scalar) -> tuple[Sequence, Float[Array, " events"]]:
    """The sequence of a trajectory from its log, and the durations of its flights in forcing periods."""
    instants, held = log.instants, log.restarts.held
    size, num_stops = instants.hit.shape
    is_row = (jnp.arange(size) < log.rows)[:, None]
    is_impact = instants.hit & is_row
    # The release of a mass thrown off by an impact at the same instant is no event of its own.
    is_release = instants.released & is_row & ~jnp.any(is_impact, axis=1, keepdims=True)
    is_event, room = (is_impact | is_release).ravel(), size - 2
    place = jnp.where(is_event, jnp.cumsum(is_event) - 1, room)

    def gathered(a: Array, fill: int) -> Int[Array, " events"]:
        return jnp.full(room, fill).at[place].set(jnp.broadcast_to(a, is_impact.shape).ravel(), mode="drop")

    kind = gathered(jnp.where(is_impact, IMPACT, RELEASE), NOTHING)
    stop = gathered(jnp.arange(num_stops)[None], 0)
    row = gathered(jnp.arange(size)[:, None], 0)
    is_real = kind != NOTHING
    row = jnp.where(is_real, row, log.rows - 1)
    # The outcome of several events at one instant applies after the last.
    is_followed = jnp.append(row[1:] == row[:-1], False) & jnp.append(is_real[1:], False)
    after = held[jnp.where(is_followed, row - 1, row)]
    times = jnp.where(is_real, instants.time[row] - t0, 0) / period
    flights = jnp.where(is_real, jnp.diff(times, prepend=0), 0)
    return Sequence(kind, stop, jnp.concatenate([held[:1], after])), flights


def is_same_sequence(
    one: Sequence, flights: Float[Array, " events"], other: Sequence, other_flights: Float[Array, " events"]
) -> Bool[Array, ""]:
    """True where the same events happen at the same times; the last bounces of a chatter do not count."""
    first, second = _times_by_stop(one, flights), _times_by_stop(other, other_flights)
    return jnp.all(jnp.abs(first - second) < _SAME)


def _times_by_stop(
    sequence: Sequence, flights: Float[Array, " events"]
) -> Float[Array, "stops_kinds events"]:
    """Times of the impacts and releases of each stop in order, padded with -1."""
    times, held = jnp.cumsum(flights), sequence.held
    num_stops = held.shape[1]
    is_stick = held[1:] & ~held[:-1]
    next_stick = jax.lax.cummin(jnp.where(is_stick, times[:, None], jnp.inf), reverse=True)
    is_own = sequence.stop[:, None] == jnp.arange(num_stops)[None]
    is_tail = is_own & (next_stick - times[:, None] < _TAIL)
    kinds = [(IMPACT, is_own & ~is_tail), (RELEASE, is_own)]
    groups = jnp.concatenate([own & (sequence.kind == kind)[:, None] for kind, own in kinds], axis=1)
    rank = jnp.where(groups, jnp.cumsum(groups, axis=0) - 1, len(times))
    rows = jnp.arange(2 * num_stops)
    empty = jnp.full((2 * num_stops, len(times)), -1.0, times.dtype)
    return empty.at[rows, rank].set(jnp.broadcast_to(times[:, None], rank.shape), mode="drop")
