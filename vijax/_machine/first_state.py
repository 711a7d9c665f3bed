"""First state of a trajectory, and its derivatives by the start."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.arrays import (
    Scalar,
    with_derivative_of,
)
from .machine import Machine
from .state import State
from .tables import Knots, Tables


def state_before_contact(
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    held: Bool[Array, "stops ..."],
    time: Scalar | None = None,
) -> State:
    """State at a local time, 0 if left out, with no contact just left, and all friction and compliant contacts idle."""
    gap = machine.contacts.gaps(x, phase)
    zero = jnp.zeros(x.shape[1:], x.dtype)
    return State(
        periods=jnp.zeros(zero.shape, int),
        time=zero if time is None else time,
        time_low=zero,
        phase=phase,
        x=x,
        v=v,
        gap=gap,
        held=held,
        contact=jnp.zeros(gap.shape, jnp.int8),
        mode=None if machine.mode_layout is None else machine.mode_layout.idle(gap),
        knots=None if machine.tables is None else _first_knots(machine.tables, zero),
    )


def _first_knots(tables: Tables, like: Scalar) -> Knots:
    """Places in all tables at the beginning of a trajectory, in all lanes."""
    return jax.tree.map(lambda a: jnp.broadcast_to(a, (len(a), *like.shape)), tables.first)


def moving_with(machine: Machine, state: State, x: Float[Array, "n ..."], v: Float[Array, "n ..."]) -> State:
    """First state that moves with the given start, except where contacts hold."""
    contacts, phase, held = machine.contacts, state.phase, state.held | state.is_kept_closed
    x = contacts.with_closed_gaps(x, held, phase)
    v = contacts.with_zero_approach(v, held, machine.phase_rate(phase))
    gap = jnp.where(held, 0, contacts.gaps(x, phase))
    same = (with_derivative_of(*pair) for pair in ((state.x, x), (state.v, v), (state.gap, gap)))
    return eqx.tree_at(lambda s: (s.x, s.v, s.gap), state, tuple(same))


def moving_on_contacts(machine: Machine, state: State) -> State:
    """First state that stays on the contacts where it starts, whatever start the derivatives vary."""
    contacts, phase = machine.contacts, state.phase
    closed = (state.gap == 0) & contacts.is_rigid
    x = with_derivative_of(state.x, contacts.with_closed_gaps(state.x, closed, phase))
    gap = with_derivative_of(state.gap, jnp.where(closed, 0, contacts.gaps(x, phase)))
    return eqx.tree_at(lambda s: (s.x, s.gap), state, (x, gap))
