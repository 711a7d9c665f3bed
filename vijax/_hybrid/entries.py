"""Entries of the log: the events of an instant, from what the elements of a machine do before and after it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._machine.derivatives import rates
from .._machine.kinds import COMPLIANT, FRICTION, JENKINS, RIGID
from .._machine.machine import Machine
from .._machine.state import UNLOADED, State, laws_as_numbers
from .friction_chatter import complete_chatter
from .sticking import chatter_time
from .transition import Instant, Switches


def time_of_bounces(machine: Machine, state: State, instant: Instant) -> Float[Array, "contacts ..."]:
    """Time to the end of the bounces that the impacts of this instant leave to be completed, at the state behind them."""
    if state.mode is not None:
        return complete_chatter(machine, state, instant).duration
    contacts, hold = machine.contacts, machine.hold(state.held)
    pull = contacts.pull(rates(machine, state, hold).force, hold, state.phase)
    return chatter_time(jnp.abs(instant.velocity_plus), pull, contacts.light_restitution)


def logged(
    machine: Machine,
    before: State,
    after: State,
    instant: Instant,
    ended: Int[Array, "contacts ..."],
    duration: Float[Array, "contacts ..."],
) -> Instant:
    """Events of this instant, from the modes before and after it.

    Args:
        machine: the machine.
        before: state before this instant.
        after: state after it.
        instant: its impacts.
        ended: number of the guard of each element that is zero, 1 or 2, or 0 for none.
        duration: time to the end of the bounces of what sticks.
    """
    if before.mode is None:
        stuck, released = after.held & ~before.held, before.held & ~after.held
        names = lambda i: (i.stuck, i.released, i.chatter)  # noqa: E731
        return eqx.tree_at(names, instant, (stuck, released, jnp.where(stuck, duration, 0)))
    contacts = machine.contacts
    rests = lambda s: s.held | s.is_kept_closed  # noqa: E731
    comes, goes = ~rests(before) & rests(after), rests(before) & ~rests(after)
    rigid, compliant, friction = (contacts.are(kind) for kind in (RIGID, COMPLIANT, FRICTION))
    pushes = lambda s: compliant & (s.mode.closed | s.held)  # noqa: E731
    is_tied = machine.has_tied_friction
    old, new = before.mode.direction, after.mode.direction
    # The direction after an impact is no event of its own: only that at a zero of the sliding velocity is.
    turned = friction & (ended == 1) & (old * new == -1)
    unlogged = (before.held != after.held) | (before.mode.inside != after.mode.inside)
    switched = Switches(
        closed=pushes(after) & ~pushes(before),
        opened=pushes(before) & ~pushes(after),
        slipped=friction & goes & (after.contact != UNLOADED) if is_tied else friction & goes,
        turned=turned,
        unlogged=unlogged,
        ended=ended.astype(jnp.int8),
        before=laws_as_numbers(before),
        after=laws_as_numbers(after),
    )
    stuck = comes & ~compliant
    if JENKINS in contacts.laws.kinds:
        # One without a limit stops and slips the other way at once.
        changes = contacts.are(JENKINS) & (old != new)
        stuck = stuck | changes & (old != 0)
        switched = eqx.tree_at(lambda s: s.slipped, switched, switched.slipped | changes & (new != 0))
    return eqx.tree_at(
        lambda i: (i.stuck, i.released, i.chatter, i.switched),
        instant,
        (stuck, rigid & goes, jnp.where(stuck, duration, 0), switched),
    )
