"""Event log: written instant by instant, read event by event."""

from itertools import accumulate
from operator import attrgetter
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._descriptions import described_by
from .._hybrid.limits import EVENT_NAMES, EVENTS, IMPACT, STICK, SWITCHING_EVENTS, EventKind
from .._hybrid.transition import Instant, no_switches
from .._jax.arrays import UNROLLED, Flag, Reals, Scalar, add_up, append_axes
from .._jax.concrete import concrete
from .._jax.xla import is_any
from .._machine.machine import Machine
from .._machine.state import Mode, State
from .._machine.tables import Knots
from .._printing import describe_events
from .batched import Writing, put

if TYPE_CHECKING:
    import pandas as pd


class EventLog(eqx.Module):
    """All events in time order, padded with NaN and -1.

    Attributes:
        t: time, (events,). A stick has the time at which the chatter it completes ends.
        stop: index of the stop, (events,); for friction element k the number of stops plus k.
        kind: `vx.IMPACT`, `vx.STICK` or `vx.RELEASE`, (events,); of compliant stops `vx.CLOSE` or `vx.OPEN`, of friction
            `vx.STICK`, `vx.SLIP` or `vx.TURN`.
        velocity_minus: signed velocity of the mass just before an impact, (events,); for other events that of the stop,
            0 where it stands still. For a `vx.Contact` the speed of approach, `row . v` less its own velocity; 0 for
            other events. A compliant stop that closes or opens has the velocity at which it does.
        velocity_plus: velocity just after, likewise.
        impulse: m (velocity_plus - velocity_minus) for a stop; for a contact the impulse along its row that opens its
            gap, not negative, (events,).
        friction_impulse: of an impact on a contact with friction: the impulse P of the friction, which acts on the masses with
            -row P; summed up if the contact has several friction elements, (events,). None without friction of contacts.
    """

    t: Float[Array, " events"]
    stop: Int[Array, " events"]
    kind: Int[Array, " events"]
    velocity_minus: Float[Array, " events"]
    velocity_plus: Float[Array, " events"]
    impulse: Float[Array, " events"]
    friction_impulse: Float[Array, " events"] | None = None

    def to_dataframe(self) -> "pd.DataFrame":
        """Convert to a table with one row per event, in time order, without padding.

        Returns:
            `pandas.DataFrame` with the columns `t`, `stop`, `kind`, `velocity_minus`, `velocity_plus` and `impulse`, as
            the attributes have them, in the units of the machine. Kinds are words: "impact", "stick", "release",
            "close", "open", "slip" or "turn". A log without events has no rows.

        Raises:
            ValueError: for traced values, or for the logs of a batch.

        Example:
            ```python
            import vijax as vx
            events = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0).events.to_dataframe()
            hardest = events[events.kind == "impact"].nlargest(5, "impulse")
            ```
        """
        import pandas as pd  # slow to import, and a simulation does not need it

        if concrete(self.stop) is None:
            raise ValueError("`to_dataframe` needs numbers: call it outside of `jax.jit` and `jax.vmap`.")
        if self.t.ndim > 1:
            raise ValueError(
                f"`to_dataframe` lists the events of one trajectory, but this is a batch of shape {self.t.shape[:-1]}: "
                "take its trajectories one by one, as in `jax.tree.map(lambda a: a[0], sol.events)`."
            )
        is_event = np.asarray(self.kind) >= 0
        names = ["t", "stop", "kind", "velocity_minus", "velocity_plus", "impulse"]
        names += [] if self.friction_impulse is None else ["friction_impulse"]
        columns = {name: np.asarray(getattr(self, name))[is_event] for name in names}
        return pd.DataFrame(columns | {"kind": [EVENT_NAMES[kind] for kind in columns["kind"]]})

    __repr__, _repr_html_ = described_by(describe_events, EVENT_NAMES)


class Restarts(eqx.Module):
    """State after every instant with an event, the start first, (rows, ...); the rest is padding.

    `t` is the time; `periods` and `time` give it as whole forcing periods since the start and remainder. `kept` flags what
    others keep closed or at rest, where forces switch. A row to be written has lanes last, if there are any.
    """

    t: Float[Array, "..."]
    periods: Int[Array, "..."]
    time: Float[Array, "..."]
    phase: Float[Array, "..."]
    x: Float[Array, "..."]
    v: Float[Array, "..."]
    held: Bool[Array, "..."]
    mode: Mode | None = None
    kept: Bool[Array, "..."] | None = None
    knots: Knots | None = None


class Log(eqx.Module):
    """Log with one row per instant with an event, the start first.

    Attributes:
        restarts: state after each instant, (rows + 1, ...); the last row takes those without room.
        instants: transition at each instant, likewise.
        places: row of every event and its number in that row, `_joined`, (events,).
        rows: rows written by this call.
        num_events: number of events in all, including those past the end of the log.
        events_before: number of events of earlier calls.
        known_until: time of the last logged instant.
        is_whole: whether this log is the only one, even if it overflows.
    """

    restarts: Restarts
    instants: Instant
    places: Int[Array, "*lanes events"]
    rows: Int[Array, "..."]
    num_events: Int[Array, "..."]
    events_before: Int[Array, "..."]
    known_until: Scalar
    is_whole: bool = eqx.field(static=True)

    def has_room(self, max_events: Int[Array, "..."]) -> Bool[Array, "..."]:
        """True if there is room for another instant, or `max_events` are logged and none is needed."""
        if self.is_whole:
            return jnp.array(True)
        size, num_stops = self.instants.hit.shape
        most = _most_events(self.instants, num_stops)
        return (self.num_events - self.events_before + most <= size - 2) | (self.num_events >= max_events)

    def kept(self) -> Restarts:
        """Rows without the last, which takes those without room."""
        return jax.tree.map(lambda a: a[:-1], self.restarts)

    def kept_instants(self) -> Instant:
        """Transitions at the rows of `kept`."""
        return jax.tree.map(lambda a: a[:-1], self.instants)


def _kinds_of(instants: Instant) -> tuple[EventKind, ...]:
    """Kinds of events that may happen."""
    return EVENTS if instants.switched is None else EVENTS + SWITCHING_EVENTS


def _most_events(instants: Instant, num_stops: int) -> int:
    """The most events of one instant."""
    return len(_kinds_of(instants)) * num_stops


def _joined(row: Reals, number: Reals, most: int) -> Reals:
    """Row and number of an event in that row, packed into one integer by shifts, because divisions are slow."""
    return (row << most.bit_length()) + number


def _split(both: Reals, most: int) -> tuple[Reals, Reals]:
    """Inverse of `_joined`."""
    bits = most.bit_length()
    return both >> bits, both & ((1 << bits) - 1)


def empty_log(first: State, t0: Scalar, room: int, *, is_whole: bool, has_impulses: bool) -> Log:
    """Log of the start, with room for `room` events after it; `has_impulses` if instants carry impulses."""

    def rows(a: Array, fill: bool | int | float) -> Array:
        return jnp.full((room + 2, *a.shape), fill, a.dtype).at[0].set(a)

    gap, held = first.gap, first.held
    none, zeros = jnp.zeros_like(held), jnp.zeros_like(gap)
    impulse = zeros if has_impulses else None
    rubbed = zeros if first.mode is not None and first.mode.paradox is not None else None
    nothing = Instant(
        none, none, none, zeros, zeros, zeros, jnp.array(False), t0, impulse, no_switches(first), rubbed
    )
    return Log(
        restarts=Restarts(
            t=rows(t0, jnp.inf),
            periods=rows(first.periods, 0),
            time=rows(first.time, 0.0),
            phase=rows(first.phase, 0.0),
            x=rows(first.x, 0.0),
            v=rows(first.v, 0.0),
            held=rows(held, False),
            mode=jax.tree.map(lambda a: rows(a, 0), first.mode),
            kept=None if first.mode is None else rows(first.is_kept_closed, False),
            knots=jax.tree.map(lambda a: rows(a, 0), first.knots),
        ),
        instants=jax.tree.map(lambda a: rows(a, 0), nothing),
        places=jnp.zeros(room + 2 * _most_events(nothing, held.size), int),
        rows=jnp.array(1),
        num_events=jnp.array(0),
        events_before=jnp.array(0),
        known_until=t0,
        is_whole=is_whole,
    )


def log_row(
    log: Log, after: State, instant: Instant, time: Scalar, live: Flag, max_events: Int[Array, "..."]
) -> Log:
    """Write one row if the instant has an event, unless so many are logged already."""
    count = add_up([jnp.sum(a, axis=0) for a in flags_by_kind(instant)])
    is_row = live & (count > 0) & (log.num_events < max_events)
    restart = Restarts(
        time,
        after.periods,
        after.time,
        after.phase,
        after.x,
        after.v,
        after.held,
        after.mode,
        None if after.mode is None else after.is_kept_closed,
        after.knots,
    )
    instant = eqx.tree_at(lambda i: i.time, instant, time)
    most = _most_events(instant, len(instant.hit))
    numbers = jnp.arange(most)
    restarts, instants, places = put(
        is_row,
        Writing(log.restarts, jax.tree.map(lambda a: a[None], restart), log.rows),
        Writing(log.instants, jax.tree.map(lambda a: a[None], instant), log.rows),
        # The next instant overwrites surplus entries.
        Writing(
            log.places,
            _joined(log.rows, append_axes(numbers, count[None]), most),
            log.num_events - log.events_before,
        ),
    )
    return Log(
        restarts=restarts,
        instants=instants,
        places=places,
        rows=log.rows + is_row,
        num_events=log.num_events + jnp.where(live, count, 0),
        events_before=log.events_before,
        known_until=jnp.where(is_row, time, log.known_until),
        is_whole=log.is_whole,
    )


def event_log(
    machine: Machine,
    instants: Instant,
    phases: Float[Array, "rows 2 harmonics"],
    max_events: int,
    places: Int[Array, " events"] | None = None,
) -> EventLog:
    """Expand instants into single events, in time order.

    Args:
        machine: the machine.
        instants: transitions in time order, (rows, ...).
        phases: phase of the load at each.
        max_events: length of the log.
        places: row and number of every event, see `Log`; counted if left out.
    """
    happened = _flags_of(instants)
    kinds, num_stops = _kinds_of(instants), instants.hit.shape[1]
    most = _most_events(instants, num_stops)
    if num_stops == 0:
        none, nan = jnp.full(max_events, -1), jnp.full(max_events, jnp.nan, instants.time.dtype)
        return EventLog(nan, none, none, nan, nan, nan)
    if places is None:
        places = _count_places(happened, max_events + num_stops)
    row, number = _split(places[: max_events + num_stops], most)
    event = _joined(row, _flag_of_number(happened[row], number), most)

    def read_off(event: Int[Array, " room"]) -> tuple[Array, ...]:
        row, flag = _split(event, most)
        kind = add_up([(flag >= k * num_stops).astype(int) for k in range(1, len(kinds))])
        stop = flag - kind * num_stops
        t = instants.time[row]
        if instants.delay is not None:
            t = t + instants.delay[row, stop]
        if machine.can_stick:
            t = t + jnp.where(kind == STICK, instants.chatter[row, stop], 0)
        return t, row, kind, stop

    is_event = jnp.arange(event.size) < jnp.sum(happened)
    if machine.can_stick:
        event = _in_order(jax.lax.stop_gradient(jnp.where(is_event, read_off(event)[0], jnp.inf)), event)
    t, row, kind, stop = read_off(event[:max_events])
    is_event = is_event[:max_events]
    of_stops = _velocities_of_stops(machine, instants, phases)
    of_stop = 0.0 if of_stops is None else of_stops[row, kind, stop]
    signed = jax.vmap(machine.contacts.signed)
    has_speed = jnp.asarray([event.has_speed for event in kinds])[kind]
    read = lambda a: jnp.where(has_speed, signed(a)[row, stop], 0) + of_stop  # noqa: E731
    minus, plus = read(instants.velocity_minus), read(instants.velocity_plus)
    if instants.impulse is not None:
        along = jax.vmap(machine.contacts.signed_impulse)(instants.impulse)
        impulse = jnp.where(has_speed, along[row, stop], 0)
    else:
        impulse = machine.contacts.effective_mass[stop] * (plus - minus)
    t, minus, plus, impulse = (jnp.where(is_event, a, jnp.nan) for a in (t, minus, plus, impulse))
    stop, kind = (jnp.where(is_event, a, -1) for a in (stop, kind))
    if instants.friction_impulse is None:
        return EventLog(t, stop, kind, minus, plus, impulse)
    rubbed = jax.vmap(machine.contacts.of_friction_at)(instants.friction_impulse)[row, stop]
    rubbed = jnp.where(kind == IMPACT, rubbed, 0)
    return EventLog(t, stop, kind, minus, plus, impulse, jnp.where(is_event, rubbed, jnp.nan))


def _flags_of(instants: Instant) -> Bool[Array, "rows flags"]:
    """Flags of the events: impacts of an instant come before its sticks, and these before its releases."""
    return jnp.concatenate(flags_by_kind(instants), axis=1)


def flags_by_kind(instants: Instant) -> list[Bool[Array, "..."]]:
    """Flags of the contacts with an event of each kind, in the order of their numbers."""
    return [attrgetter(event.flag)(instants) for event in _kinds_of(instants)]


def _count_places(flags: Bool[Array, "rows flags"], room: int) -> Int[Array, " room"]:
    """Row and number, `_joined`, of the raised flags, row by row; arbitrary past the last of them."""
    num = jnp.sum(flags, axis=1)
    until = jnp.cumsum(num)  # flags up to the end of each row
    event = jnp.arange(room)
    row = jnp.minimum(jnp.sum(until[None] <= event[:, None], axis=1), len(flags) - 1)
    return _joined(row, event - (until - num)[row], flags.shape[1])


def _flag_of_number(flags: Bool[Array, "room flags"], number: Int[Array, " room"]) -> Int[Array, " room"]:
    """Index of the raised flag of every row that has `number` raised flags before it; arbitrary if there is none."""
    columns = flags.T.astype(int)
    up_to = list(accumulate(columns)) if len(columns) <= UNROLLED else jnp.cumsum(columns, axis=0)
    return jnp.minimum(add_up([(a <= number).astype(int) for a in up_to]), len(columns) - 1)


def _in_order(times: Float[Array, " room"], events: Int[Array, " room"]) -> Int[Array, " room"]:
    """Sort events by nearly sorted times, by exchanging neighbours.

    Rows are in order except for the ends of chatters, at most one pending per stop. A sort would take longer than
    following the trajectory.
    """
    place = jnp.arange(times.size)

    def is_wrong(columns: tuple[Array, Array]) -> Bool[Array, ""]:
        return is_any(jnp.any(columns[0][:-1] > columns[0][1:]))

    def exchange(columns: tuple[Array, Array]) -> tuple[Array, Array]:
        for first in (0, 1):
            is_late = columns[0] > jnp.roll(columns[0], -1)
            goes = is_late & (place % 2 == first) & (place < times.size - 1)
            columns = _exchanged(columns[0], goes), _exchanged(columns[1], goes)
        return columns

    return jax.lax.while_loop(is_wrong, exchange, (times, events))[1]


def _exchanged(a: Array, goes: Bool[Array, " room"]) -> Array:
    """Exchange each flagged row with the next."""
    return jnp.where(goes, jnp.roll(a, -1), jnp.where(jnp.roll(goes, 1), jnp.roll(a, 1), a))


def _velocities_of_stops(
    machine: Machine, instants: Instant, phases: Float[Array, "rows 2 harmonics"]
) -> Float[Array, "rows kinds stops"] | None:
    """Velocities of the stops at the events of every instant; None if all stand still."""
    later = jax.vmap(jax.vmap(machine.phase_after, (None, 0)))
    now, of_others = (over(machine.velocity_of_stops) for over in (jax.vmap, lambda f: jax.vmap(jax.vmap(f))))
    chatter, delay = instants.chatter, instants.delay
    if delay is None:
        now, at_sticks = now(phases), of_others(later(phases, chatter))
    else:
        now, at_sticks = of_others(later(phases, delay)), of_others(later(phases, delay + chatter))
    if now is None or at_sticks is None:
        return None
    own = lambda a: a if a.ndim == 2 else jnp.diagonal(a, axis1=1, axis2=2)  # noqa: E731
    return jnp.stack([own(now), own(at_sticks), *[own(now)] * (len(_kinds_of(instants)) - 2)], axis=1)
