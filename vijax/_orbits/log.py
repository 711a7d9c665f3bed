"""The events of an orbit as a log, from its equations: exact where a run of an unstable orbit goes astray."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._trajectory.event_log import IMPACT, RELEASE, STICK, EventLog
from .cycle import Happening, Problem, Unknowns, happenings


def log_of_cycle(problem: Problem, unknowns: Unknowns) -> EventLog:
    """All events of a cycle in the order of time, with room for as many as the sequence has; differentiable.

    Args:
        problem: the machine and the sequence.
        unknowns: the orbit.
    """
    sequence, told = problem.sequence, happenings(problem, unknowns)
    machine = problem.machine
    contacts, held = machine.contacts, sequence.held
    stops = jnp.arange(contacts.num)[None]
    is_own = (stops == sequence.stop[:, None]) & sequence.is_event[:, None]
    is_impact = (sequence.kind == IMPACT)[:, None]
    sticks, leaves = held[1:] & ~held[:-1], held[:-1] & ~held[1:]
    # Within an instant impacts come first; a stick carries the end of its chatter.
    happened = jnp.stack([is_own & is_impact, sticks, leaves & sequence.is_event[:, None]], axis=1)
    kinds = jnp.asarray([IMPACT, STICK, RELEASE])[:, None]
    time = (told.time - problem.phase) * machine.period + problem.phase * machine.period
    zeros = jnp.zeros_like(told.before)
    times = time[:, None, None] + jnp.stack([zeros, told.chatter, zeros], axis=1)
    of_stops = _velocities_of_stops(problem, told)
    minus, plus = (
        jnp.stack([jax.vmap(contacts.told)(a), zeros, zeros], axis=1) + of_stops
        for a in (told.before, told.after)
    )
    room = len(sequence.kind)
    order = jnp.argsort(jnp.where(happened, times, jnp.inf).ravel(), stable=True)[:room]
    is_event = happened.ravel()[order]
    read = lambda a: jnp.broadcast_to(a, happened.shape).ravel()[order]  # noqa: E731
    mass = jnp.broadcast_to(contacts.effective_mass[None, None], happened.shape)
    floats = times, minus, plus, mass * (plus - minus)
    t, minus, plus, impulse = (jnp.where(is_event, read(a), jnp.nan) for a in floats)
    stop, kind = (jnp.where(is_event, read(a), -1) for a in (stops[None], kinds[None]))
    return EventLog(t, stop, kind, minus, plus, impulse)


def _velocities_of_stops(problem: Problem, told: Happening) -> Float[Array, "events kinds stops"]:
    """Velocities of the stops themselves at each event, and at the end of its chatter."""
    machine = problem.machine
    if machine.frame is None:
        return jnp.zeros((len(told.time), 1, machine.contacts.num))
    frame, contacts = machine.frame, machine.contacts
    now = jax.vmap(lambda phase: contacts.size(frame.at(phase)[1]))(told.phase)
    start = told.time[:, None] * machine.period

    def later(t: Array) -> Array:
        return contacts.size(frame.at_time(t)[1])

    ends = jax.vmap(jax.vmap(later))(jnp.where(jnp.isfinite(told.chatter), start + told.chatter, 0))
    at_stick = jnp.diagonal(ends, axis1=1, axis2=2)
    return jnp.stack([now, at_stick, now], axis=1)
