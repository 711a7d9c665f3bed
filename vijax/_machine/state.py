"""Hybrid state of a motion."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .._jax.arrays import Reals, Scalar
from .tables import in_new_period

# Value of `State.contact` for a contact that others keep closed.
KEPT_CLOSED = 4
# Value of `State.contact` for an open element whose gap, or sliding velocity, is constant, as others hold its row.
FROZEN = 5
# Value of `State.contact` for friction of an open contact, which has no force and no event.
UNLOADED = 6
# Size of `Mode.direction` for friction that others keep at rest while its force is at the bound of its grip.
SATURATED = 2


class Mode(eqx.Module):
    """Laws that the elements of a machine with friction or compliant contacts follow now, (contacts,) each.

    Elements that hold are flagged in `State.held`: rigid contacts, friction that sticks, and preloaded compliant contacts
    on which a mass rests.

    Attributes:
        closed: compliant contacts that push.
        inside: compliant contacts past their position that do not push, as their damper lags behind.
        direction: sign of the sliding velocity of friction that slips; that of its force, times `SATURATED`, where others
            keep it at rest with its grip; 0 for all else.
        begins: as `State.contact`, for the second guard of an element.
        paradox: whether no choice of what the elements do agreed with all laws at some instant; None without friction of
            contacts.
    """

    closed: Bool[Array, "contacts ..."]
    inside: Bool[Array, "contacts ..."]
    direction: Int[Array, "contacts ..."]
    begins: Int[Array, "contacts ..."]
    paradox: Any = None


class State(eqx.Module):
    """Hybrid state of one trajectory: everything that determines its continuation.

    Time is local to the forcing period, in two parts whose sum has twice the digits, so that no step is lost in
    rounding. `gap` is carried beside x and summed up from the last contact, not computed as position - x: light
    bounces keep all their digits.

    `contact` gives how a stop was last left: the number of leading derivatives of the gap that vanish exactly (0
    none, 1 just hit, 2 released by a jump of the force, 3 released as the force crossed zero). It holds for the next
    step only. All of them vanish, `KEPT_CLOSED`, where the row of a contact depends on those of others that hold: it stays
    closed without a force, until one of them releases.

    `memory` is the memory of the flow from step to step; exact flows have none. `mode` is None if all contacts are rigid.
    `knots` is the place in the tables of the load, None if there are none.
    """

    periods: Int[Array, "..."]
    time: Scalar
    time_low: Scalar
    phase: Float[Array, "2 harmonics ..."]
    x: Float[Array, "n ..."]
    v: Float[Array, "n ..."]
    gap: Float[Array, "stops ..."]
    held: Bool[Array, "stops ..."]
    contact: Int[Array, "stops ..."]
    memory: PyTree = None
    mode: Any = None  # `Mode` or None; type checkers would ask for a test of None at every use
    knots: Any = None  # `Knots` or None, likewise

    @property
    def is_kept_closed(self) -> Bool[Array, "stops ..."]:
        """Flags of the contacts that others keep closed."""
        return self.contact == KEPT_CLOSED

    @property
    def is_frozen(self) -> Bool[Array, "contacts ..."]:
        """Flags of elements without events: kept closed, or open with a constant gap."""
        return self.contact >= KEPT_CLOSED

    @property
    def no_events(self) -> Bool[Array, "guards ..."]:
        """No flags, one for each guard: one guard a contact, two where forces switch."""
        none = jnp.zeros_like(self.held)
        return none if self.mode is None else jnp.concatenate([none, none])


class ModeLayout(NamedTuple):
    """Layout of the `Mode` of a machine; `is_tied` with friction of contacts."""

    is_tied: bool

    def idle(self, like: Float[Array, "contacts ..."]) -> Mode:
        """Mode in which no element acts on the masses."""
        none, zero = jnp.zeros(like.shape, bool), jnp.zeros(like.shape, jnp.int8)
        return Mode(none, none, zero, zero, jnp.zeros(like.shape[1:], bool) if self.is_tied else None)


# What an element does, as one number. Rigid contacts are free, held or kept closed by others. Sequences of cycles tell
# friction that sticks from contacts that hold, and Jenkins elements whose sliders stick, the springs, from contacts that are
# free; `laws_as_numbers` does not.
FREE, HELD, CLOSED, INSIDE, AHEAD, BEHIND, KEPT, KEPT_AHEAD, KEPT_BEHIND, STICKING = range(10)
SPRING = -1


def rests_in(number: Reals) -> Any:
    """True for numbers of elements at rest, by themselves or kept so by others."""
    return (number == HELD) | (number >= KEPT)


def laws_as_numbers(state: State) -> Int[Array, "contacts ..."]:
    """Laws that the elements of a machine with friction or compliant contacts follow, one number each."""
    mode, kept = state.mode, state.is_kept_closed
    number = jnp.where(mode.closed, CLOSED, jnp.where(mode.inside, INSIDE, FREE))
    number = jnp.where(mode.direction > 0, AHEAD, jnp.where(mode.direction < 0, BEHIND, number))
    at_rest = jnp.where(mode.direction > 0, KEPT_AHEAD, jnp.where(mode.direction < 0, KEPT_BEHIND, KEPT))
    return jnp.where(state.held, HELD, jnp.where(kept, at_rest, number)).astype(jnp.int8)


def with_laws(state: State, numbers: Int[Array, "contacts ..."]) -> State:
    """State in which the elements do what `laws_as_numbers` tells."""
    ahead, behind = (
        (numbers == AHEAD) | (numbers == KEPT_AHEAD),
        (numbers == BEHIND) | (numbers == KEPT_BEHIND),
    )
    direction = ahead.astype(jnp.int8) - behind.astype(jnp.int8)
    direction = jnp.where(numbers >= KEPT, SATURATED * direction, direction).astype(jnp.int8)
    is_tied = state.mode is not None and state.mode.paradox is not None
    paradox = jnp.zeros(numbers.shape[1:], bool) if is_tied else None
    mode = Mode(numbers == CLOSED, numbers == INSIDE, direction, jnp.zeros_like(direction), paradox)
    contact = jnp.where((numbers >= KEPT) & (numbers < STICKING), jnp.int8(KEPT_CLOSED), jnp.int8(0))
    held = (numbers == HELD) | (numbers == STICKING)
    return eqx.tree_at(lambda s: (s.held, s.contact, s.mode), state, (held, contact, mode))


def with_memory(state: State, memory: PyTree) -> State:
    """State with another memory of the flow."""
    return eqx.tree_at(lambda s: s.memory, state, memory, is_leaf=lambda leaf: leaf is None)


def start_period(state: State, phase0: Float[Array, "2 harmonics ..."], is_over: Bool[Array, "..."]) -> State:
    """Count a forcing period that is over and reset time and phase, so that neither drifts."""
    if state.knots is not None:
        knots, phase0 = in_new_period(state.knots, state.phase, phase0, is_over)
        state = eqx.tree_at(lambda s: s.knots, state, knots)
    return eqx.tree_at(
        lambda s: (s.periods, s.time, s.time_low, s.phase),
        state,
        (
            state.periods + is_over,
            jnp.where(is_over, 0, state.time),
            jnp.where(is_over, 0, state.time_low),
            jnp.where(is_over, phase0, state.phase),
        ),
    )
