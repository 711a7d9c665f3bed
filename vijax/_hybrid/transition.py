"""Record of the events at the end of a step."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Flag, Scalar
from .._machine.state import State, laws_as_numbers


class Switches(eqx.Module):
    """Events of friction and compliant contacts, (contacts,) each.

    Attributes:
        closed: flags of compliant contacts that begin to push.
        opened: flags of compliant contacts that push no more.
        slipped: flags of friction elements that begin to slip.
        turned: flags of friction elements that go on to slip in the other direction.
        ended: number of the guard of each element that is zero, 1 or 2, or 0 for none.
        before: what the elements did before this instant, see `laws_as_numbers`.
        after: what they do after it.
        unlogged: flags of other changes: of the elements that carry a load at rest, or a mass that leaves a compliant contact
            which pushed it no more.
    """

    closed: Bool[Array, "stops ..."]
    opened: Bool[Array, "stops ..."]
    slipped: Bool[Array, "stops ..."]
    turned: Bool[Array, "stops ..."]
    unlogged: Bool[Array, "stops ..."]
    ended: Int[Array, "stops ..."]
    before: Int[Array, "stops ..."]
    after: Int[Array, "stops ..."]

    @property
    def any(self) -> Bool[Array, "stops ..."]:
        """Flags of elements with an event, logged or not."""
        return self.closed | self.opened | self.slipped | self.turned | self.unlogged


def no_switches(state: State) -> Switches | None:
    """No events of friction and compliant contacts, in the mode of a state; None if all contacts are rigid."""
    if state.mode is None:
        return None
    none, laws = jnp.zeros_like(state.held), laws_as_numbers(state)
    return Switches(none, none, none, none, none, jnp.zeros_like(laws), laws, laws)


class Zeros(NamedTuple):
    """Zeros of the first and of the second guards, (contacts,) each."""

    first: Bool[Array, "contacts ..."]
    second: Bool[Array, "contacts ..."]


class Instant(eqx.Module):
    """Events at the end of a step.

    Attributes:
        hit: flags of impacts, (stops,).
        stuck: flags of stops on which a mass comes to rest, (stops,).
        released: flags of stops that release their mass, (stops,).
        velocity_minus: velocity of each stop's mass before the impacts, (stops,).
        velocity_plus: velocity after them, before sticking, (stops,).
        chatter: time from this instant to the end of the skipped bounces of the stuck, (stops,).
        arrived: True where the step ends at the target time.
        time: local time of the instant.
        impulse: of each impact, along its row, (stops,); None where it follows from the velocities alone.
        switched: events of friction and compliant contacts; None if all contacts are rigid.
        friction_impulse: of each friction element at the contacts that are hit, along its row, (stops,); None without friction of
            contacts.
        delay: time from this instant to the event of each stop, (stops,), zeros with the derivatives of times of their own; None in runs.
    """

    hit: Bool[Array, "stops ..."]
    stuck: Bool[Array, "stops ..."]
    released: Bool[Array, "stops ..."]
    velocity_minus: Float[Array, "stops ..."]
    velocity_plus: Float[Array, "stops ..."]
    chatter: Float[Array, "stops ..."]
    arrived: Flag
    time: Scalar
    impulse: Float[Array, "stops ..."] | None = None
    switched: Switches | None = None
    friction_impulse: Float[Array, "stops ..."] | None = None
    delay: Float[Array, "stops ..."] | None = None

    @property
    def happened(self) -> Bool[Array, "..."]:
        """True where any event happened."""
        flags = self.hit | self.stuck | self.released
        return jnp.any(flags if self.switched is None else flags | self.switched.any, axis=0)
