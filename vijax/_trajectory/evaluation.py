"""Motion at any time: the smooth flow from the last event before it."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._flow.interface import AbstractFlow
from .._flow.smooth_flow import coast
from .._hybrid.switching_resets import forces_between_events
from .._jax.arrays import Reals, Scalar
from .._jax.packing import Packed
from .._jax.xla import compile_lightly, jit_lightly
from .._machine.first_state import state_before_contact
from .._machine.machine import Machine, in_periods
from .._machine.state import KEPT_CLOSED, with_memory
from .event_log import Restarts


class Evaluated(NamedTuple):
    """A motion at times: positions, velocities, forces of contacts and friction, and accelerations."""

    x: Array
    v: Array
    force: Array
    acceleration: Array


class Times(NamedTuple):
    """Times of an evaluation, with the restart before each.

    Attributes:
        phase0: phase of the load at the start of the trajectory, (2, harmonics).
        starts: the restarts, (times, ...).
        times: the times, (times,).
        t0: start of the trajectory.
        max_steps: bound on its steps.
    """

    phase0: Reals
    starts: Restarts
    times: Reals
    t0: Reals
    max_steps: Reals


@jit_lightly
def coasted(prepared: Packed, request: Times) -> Evaluated:
    """The motion at the times of a request."""
    machine, flow = prepared.unpacked_by_kernel()
    flow = flow.compact()

    def at(start: Restarts, t: Scalar) -> Evaluated:
        return _from_restart(machine, flow, request.phase0, start, t, request.t0, request.max_steps)

    return jax.vmap(at)(request.starts, request.times)


def followed(request: tuple) -> Evaluated:
    """Follow the smooth motion by a loop, which JAX differentiates forwards alone."""
    prepared, *rest = request
    machine, flow = prepared.unpacked()
    return _from_restart(machine, flow.compact(), *rest)


def _from_restart(
    machine: Machine,
    flow: AbstractFlow,
    phase0: Reals,
    start: Restarts,
    t: Scalar,
    t0: Reals,
    max_steps: Reals,
) -> Evaluated:
    """Follow the smooth motion from an event to a time before the next."""
    state = state_before_contact(machine, start.phase, start.x, start.v, start.held)
    state = eqx.tree_at(lambda s: (s.periods, s.time), state, (start.periods, start.time))
    if start.mode is not None:
        assert start.kept is not None
        contact = jnp.where(start.kept, jnp.int8(KEPT_CLOSED), state.contact)
        state = eqx.tree_at(lambda s: (s.mode, s.contact), state, (start.mode, contact))
    if start.knots is not None:
        state = eqx.tree_at(lambda s: s.knots, state, start.knots)
    state = with_memory(state, flow.memory(state.time))
    # At a logged event time the state is the logged one to the last bit.
    then, here = in_periods(machine, t - t0), (start.periods, start.time)
    periods, time = (jnp.where(t == start.t, a, b) for a, b in zip(here, then, strict=True))
    now = machine.in_mode(state)
    state = coast(flow, now, state, phase0, periods, time, max_steps)
    hold = now.hold(state.held)
    force = now.total_force(state)
    acceleration = now.acceleration_in_space(state, force, hold)
    if state.mode is not None:
        return Evaluated(*machine.in_space(state), forces_between_events(machine, state), acceleration)
    pressing = now.contacts.contact_force(force, hold, state.phase)
    return Evaluated(*machine.in_space(state), jnp.where(state.held, pressing, 0), acceleration)


@compile_lightly
def motion_of_stops(machine: Machine, times: Float[Array, "..."]) -> tuple[Array, Array]:
    num = machine.contacts.num_stops
    of_one = lambda t: tuple(a[:num] for a in machine.stops_at(machine.phase_at(t)))  # noqa: E731
    return jnp.vectorize(of_one, signature="()->(stops),(stops)")(times)
