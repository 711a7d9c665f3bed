"""The events of a cycle, in order, as data, so that one program serves every sequence."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.limits import CLOSE, EVENT_NAMES, IMPACT, OPEN, RELEASE, SLIP, STICK, TURN
from .._hybrid.transition import Instant
from .._jax.arrays import Reals, Scalar, array_namespace
from .._machine.contacts import Contacts
from .._machine.kinds import COMPLIANT, FRICTION, JENKINS, RIGID
from .._machine.numbers import MachineNumbers
from .._machine.state import AHEAD, BEHIND, FREE, HELD, INSIDE, KEPT, SPRING, STICKING
from .._machine.switching import SwitchingContacts
from .._trajectory.event_log import Log, flags_by_kind
from .side_by_side import SideBySide, as_their_sum, may_have_pairs, of_first_contacts, side_by_side

NOTHING = -1
# Internal kind of an event that no log has: a mass leaves a compliant contact that pushed it no more.
LEAVE = len(EVENT_NAMES)
# Added to the kind of an event at which the second guard of an element is zero, see `guards_of`.
SECOND = 8

# `_SAME`: events of two runs within this time, in forcing periods, are the same.
# `_TAIL`: impacts this close before a stick are last bounces of a chatter; one run may have one more than another.
_SAME, _TAIL = 1e-6, 1e-4


class Sequence(NamedTuple):
    """The events that end the flights of a cycle.

    Each zero of a guard is an event. A stick on a stop is none: it is the outcome of an impact. Likewise a release by the
    jump of a force at the impact of another mass is the outcome of that impact.

    Attributes:
        kind: `vx.IMPACT`, `vx.RELEASE`, or `NOTHING` for padding, (events,); of machines with friction or compliant contacts
            any kind, with `SECOND` added for a second guard, or `LEAVE`.
        stop: the stop, (events,).
        mode: the stops that hold their masses on each flight, the first and the last included, (events + 1, stops); of
            machines with friction or compliant contacts what each element does, see `laws_as_numbers`.
    """

    kind: Reals
    stop: Reals
    mode: Reals

    @property
    def num_groups(self) -> int:
        """Number of groups of guards, see `guards_of`: one of rigid contacts alone, else two."""
        return 1 if self.mode.dtype == bool else 2

    def for_guards(self, of_elements: Reals) -> Reals:
        """Rows of elements, repeated for the guards of each group."""
        library = array_namespace(of_elements)
        return of_elements if self.num_groups == 1 else library.concatenate([of_elements] * self.num_groups)

    def for_first_guards(self, flags: Array) -> Array:
        """Flags of elements for the guards of the first group; none of the others is set."""
        return flags if self.num_groups == 1 else jnp.concatenate([flags, jnp.zeros_like(flags)])

    @property
    def held(self) -> Reals:
        """Flags of the stops that hold on each flight, (events + 1, stops)."""
        return held_in(self.mode)

    @property
    def is_event(self) -> Bool[Array, " events"]:
        """Flags of the events that are not padding."""
        return self.kind != NOTHING

    @property
    def most_erased(self) -> Int[Array, ""]:
        """The most directions of the state that a flight has lost: a held mass two, friction that sticks one."""
        if self.mode.dtype == bool:
            return 2 * jnp.max(jnp.sum(self.mode, axis=1), initial=0)
        lost = 2 * (self.mode == HELD) + (self.mode == STICKING)
        return jnp.max(jnp.sum(lost, axis=1), initial=0)


def num_erased(sequence: Sequence, num_sliders: int) -> Int[Array, ""]:
    """As `most_erased`, with directions that Jenkins elements lose: the position of each, and the stretch of one that slips."""
    if not num_sliders:
        return sequence.most_erased
    mode, num = jnp.asarray(sequence.mode), num_sliders
    lost = 2 * (mode == HELD) + (mode == STICKING)
    slips = (mode[:, -num:] == AHEAD) | (mode[:, -num:] == BEHIND)
    return jnp.max(jnp.sum(lost, axis=1) + jnp.sum(slips, axis=1), initial=0) + num


def sticks_all_along(sequence: Sequence, num_sliders: int) -> Bool[Array, " sliders"]:
    """Flags of the Jenkins elements that stick all along, the last elements of a machine."""
    mode = jnp.asarray(sequence.mode)[:, jnp.shape(sequence.mode)[1] - num_sliders :]
    return ~jnp.any((mode == AHEAD) | (mode == BEHIND), axis=0)


def num_stops_of(numbers: MachineNumbers) -> int:
    """Number of stops of a machine, without friction and Jenkins elements."""
    return numbers.rows.shape[-2] - (0 if numbers.laws is None else int(numbers.laws.has_no_gap.sum()))


def held_in(mode: Reals) -> Reals:
    """Flags of the stops that hold in a mode of `Sequence`."""
    return mode if mode.dtype == bool else (mode == HELD) | (mode == STICKING)


def kept_in(mode: Reals) -> Reals | None:
    """Flags of the elements that others keep at rest in a mode of `Sequence`; None for rigid contacts, whose load has no mode."""
    return None if mode.dtype == bool else (mode >= KEPT) & (mode < STICKING)


def effective(mode: Reals) -> Reals:
    """Mode in which laws with the same motion are one: at rest by whatever, and without touching on whichever side."""
    if mode.dtype == bool:
        return mode
    return jnp.where(mode >= KEPT, HELD, jnp.where(mode == INSIDE, FREE, mode))


def public_kind_of(kind: Reals) -> Reals:
    """Kinds of events as logs have them; `LEAVE` for those without an entry."""
    return jnp.where(kind == NOTHING, NOTHING, kind % SECOND)


def empty_sequence(num_events: int, kinds: tuple[int, ...]) -> Sequence:
    """A sequence without events of elements of some kinds, with room for `num_events`."""
    whole, type_ = np.zeros(num_events, int), bool if set(kinds) <= {RIGID} else jnp.int8
    return Sequence(whole + NOTHING, whole, np.zeros((num_events + 1, len(kinds)), type_))


class Instants(NamedTuple):
    """Instants of a trajectory with events, the start first.

    Attributes:
        transitions: what happens at each, (rows, ...).
        held: flags of the stops that hold after it, (rows, stops).
        count: number of rows; others are padding.
    """

    transitions: Instant
    held: Bool[Array, "rows stops"]
    count: Int[Array, ""]

    @classmethod
    def of(cls, log: Log) -> "Instants":
        """The instants of a log."""
        return cls(log.instants, log.restarts.held, log.rows)


def sequence_of(
    happened: Instants, t0: Scalar, period: Scalar, numbers: MachineNumbers
) -> tuple[Sequence, Float[Array, " events"]]:
    """The sequence of a trajectory of a machine, and the durations of its flights in forcing periods."""
    kinds = numbers.kinds
    laws, pairs = numbers.laws, side_by_side(numbers) if may_have_pairs(numbers) else None
    if pairs is not None and kinds.count(RIGID) > 1:
        flags = lambda h: (h.held, h.transitions.hit, h.transitions.released)  # noqa: E731
        merged = [of_first_contacts(pairs, kinds, own) for own in flags(happened)]
        happened = eqx.tree_at(flags, happened, merged)
    instants, (ended, before, after) = happened.transitions, _modes_at(happened)
    size, num_stops = instants.hit.shape
    is_row = (jnp.arange(size) < happened.count)[:, None]
    if laws is not None and pairs is not None:
        ended, before, after = as_their_sum(laws, pairs, ended, before, after)
    is_event, event_kinds = _events_at(instants, (ended, before, after), is_row)
    if pairs is not None:
        is_event = is_event & ~_follows_an_event(pairs, is_event, event_kinds)
    of_instants, is_event, room = is_event, is_event.ravel(), size - 2
    place = jnp.where(is_event, jnp.cumsum(is_event) - 1, room)

    def gathered(a: Array, fill: int) -> Int[Array, " events"]:
        return jnp.full(room, fill).at[place].set(jnp.broadcast_to(a, event_kinds.shape).ravel(), mode="drop")

    kind = gathered(event_kinds, NOTHING)
    stop = gathered(jnp.arange(num_stops)[None], 0)
    row = gathered(jnp.arange(size)[:, None], 0)
    is_real = kind != NOTHING
    row = jnp.where(is_real, row, happened.count - 1)
    times = jnp.where(is_real, instants.time[row] - t0, 0) / period
    flights = jnp.where(is_real, jnp.diff(times, prepend=0), 0)
    # The mode at the end of each flight: between events others may take over the load of an element.
    behind, before, after = after, before[row], after[row[-1:]]
    if instants.switched is not None:
        # Of events of one instant each changes its own element, in order, and an impact those that it strikes; the first one the rest.
        own, is_earlier = of_instants[row], jnp.arange(num_stops)[None] < stop[:, None]
        is_second = jnp.any(own & is_earlier, axis=1, keepdims=True)
        hit, strikes = own & instants.hit[row], _share_a_mass(numbers)
        waits = (hit @ strikes) & ~((hit & is_earlier) @ strikes)
        before = jnp.where(is_second & jnp.where(own, is_earlier, ~waits), behind[row], before)
    if COMPLIANT in kinds:
        # Without an event a mass leaves the inside of a contact: the last flight of a cycle ends as the first one does.
        after = jnp.where((after == INSIDE) & (before[:1] != INSIDE), jnp.int8(FREE), after)
    mode = jnp.concatenate([jnp.where(is_real[:, None], before, after), after])
    for own, general, special in ((FRICTION, HELD, STICKING), (JENKINS, FREE, SPRING)):
        if own in kinds:
            mode = jnp.where((np.array(kinds) == own)[None] & (mode == general), jnp.int8(special), mode)
    return Sequence(kind, stop, mode), flights


def _share_a_mass(numbers: MachineNumbers) -> Bool[Array, "elements elements"]:
    """Flags of the pairs of elements of which one feels an impulse on the other; all, with a full mass matrix."""
    acts = jnp.asarray(numbers.rows) != 0
    return (acts @ acts.T) | (jnp.ndim(numbers.mass) > 1)


def _modes_at(happened: Instants) -> tuple[Reals, Reals, Reals]:
    """Numbers of the guards that are zero at each instant, 0 for none, and the modes before and after it, (rows, elements) each."""
    instants, switched, held = happened.transitions, happened.transitions.switched, happened.held
    if switched is not None:
        return switched.ended.astype(int), switched.before, switched.after
    # The release of a mass thrown off by an impact at the same instant is no event of its own.
    is_zero = instants.hit | (instants.released & ~jnp.any(instants.hit, axis=1, keepdims=True))
    return is_zero, jnp.concatenate([held[:1], held[:-1]]), held


def _events_at(
    instants: Instant, changes: tuple[Reals, Reals, Reals], is_row: Bool[Array, "rows 1"]
) -> tuple[Bool[Array, "rows elements"], Int[Array, "rows elements"]]:
    """Flags and kinds of the events: zeros of guards that change what an element does; `changes` as of `_modes_at`."""
    ended, before, after = changes
    if instants.switched is None:
        return ended & is_row, jnp.where(instants.hit, IMPACT, RELEASE)
    kind: Any = LEAVE
    for number, flag in reversed([*enumerate(flags_by_kind(instants))]):
        kind = jnp.where(flag, number, kind)
    is_zero = (ended > 0) & is_row
    is_change = is_zero & (instants.hit | instants.switched.turned | (effective(before) != effective(after)))
    # A zero without effect on its own element passes the load on to others.
    is_event = jnp.where(jnp.any(is_change, axis=1, keepdims=True), is_change, is_zero)
    return is_event, kind + SECOND * (ended == 2)


def _follows_an_event(
    pairs: SideBySide, is_event: Bool[Array, "rows elements"], kinds: Int[Array, "rows elements"]
) -> Bool[Array, "rows elements"]:
    """Flags of events that are one with that of an element before, see `side_by_side`."""
    public = kinds % SECOND
    begin, end = (own != 0 for own in pairs)
    is_of_one = jnp.where(ends_a_mode(kinds)[:, :, None], end, begin) & (
        public[:, :, None] == public[:, None]
    )
    return jnp.any(is_of_one & is_event[:, :, None], axis=1)


def ends_a_mode(kind: Reals) -> Any:
    """True for events at which a force is zero or at its bound; at all others a velocity or a gap is zero."""
    public = kind % SECOND
    return (public == SLIP) | (public == OPEN) | (public == LEAVE) | (kind == CLOSE + SECOND)


def elements_of_events(sequence: Sequence, contacts: Contacts) -> Bool[Array, "events elements"]:
    """Flags of the elements that have an event: its own, and those that close with it."""
    stop = jnp.asarray(sequence.stop)
    own = stop[:, None] == jnp.arange(contacts.num)[None]
    if not isinstance(contacts, SwitchingContacts) or contacts.kinds.count(COMPLIANT) < 2:
        return own
    begin = side_by_side(contacts).begin != 0
    return own | ((begin | begin.T)[stop] & ~ends_a_mode(jnp.asarray(sequence.kind))[:, None])


def is_same_sequence(
    one: Sequence, flights: Float[Array, " events"], other: Sequence, other_flights: Float[Array, " events"]
) -> Bool[Array, ""]:
    """True where the same events happen at the same times; the last bounces of a chatter do not count."""
    first, second = _times_by_stop(one, flights), _times_by_stop(other, other_flights)
    return jnp.all(jnp.abs(first - second) < _SAME)


def _times_by_stop(
    sequence: Sequence, flights: Float[Array, " events"]
) -> Float[Array, "stops_kinds events"]:
    """Times of the events of each stop in order, kind by kind, padded with -1."""
    times, held = jnp.cumsum(flights), held_in(effective(sequence.mode))
    num_stops = held.shape[1]
    is_stick = held[1:] & ~held[:-1]
    next_stick = jax.lax.cummin(jnp.where(is_stick, times[:, None], jnp.inf), reverse=True)
    is_own = sequence.stop[:, None] == jnp.arange(num_stops)[None]
    is_tail = is_own & (next_stick - times[:, None] < _TAIL)
    kinds = [(IMPACT, is_own & ~is_tail), (RELEASE, is_own)]
    of_event = sequence.kind
    if sequence.num_groups > 1:
        of_event = public_kind_of(sequence.kind)
        kinds += [(kind, is_own & ~is_tail) for kind in (TURN, CLOSE, OPEN)]
        kinds += [(kind, is_own) for kind in (STICK, SLIP)]
    groups = jnp.concatenate([own & (of_event == kind)[:, None] for kind, own in kinds], axis=1)
    rank = jnp.where(groups, jnp.cumsum(groups, axis=0) - 1, len(times))
    rows = jnp.arange(len(kinds) * num_stops)
    empty = jnp.full((len(kinds) * num_stops, len(times)), -1.0, times.dtype)
    return empty.at[rows, rank].set(jnp.broadcast_to(times[:, None], rank.shape), mode="drop")
