"""Smooth motion over a whole flight under loads by tables, from knot to knot, forwards or backwards.

The flow map between two knots is that of the flow. A flight of less than a turn of the wave forms has a fixed number of
pieces, most of no length; so it is a loop of fixed length, differentiable in reverse too. Whole turns of a linear machine
are one affine map, raised to a power by repeated squaring.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._jax.arrays import Scalar, smallest
from .._jax.xla import is_any
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .._machine.tables import Knots
from .affine import affine_power
from .interface import AbstractFlow

# Binary digits of the number of turns of a flight.
_DIGITS = 24


class _Piece(NamedTuple):
    """Motion within a flight: time left, state, displacement and gain of velocity so far."""

    left: Scalar
    state: State
    displacement: Array
    gain: Array


def flow_map_across_knots(
    flow: AbstractFlow,
    machine: Machine,
    state: State,
    hold: Held,
    span: Scalar,
    time: Scalar,
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, "2 columns"]]:
    """Follow the smooth motion over a flight of any length, under loads that repeat with the forcing period.

    Args:
        flow: the flow, prepared.
        machine: the machine as arrays, prepared for a trajectory that begins at time 0.
        state: start of the flight.
        hold: contacts that hold.
        span: duration of the flight, negative for one backwards.
        time: time at its start.

    Returns:
        Displacement, gain of velocity, and phase at the end.
    """
    assert machine.tables is not None
    passed = jnp.stack([s.place_at(time, machine.tables.origin)[0] for s in machine.tables.streams])
    knots = eqx.tree_at(lambda k: k.passed, state.knots, passed)
    where = lambda s: (s.knots, s.time, s.time_low, s.periods)  # noqa: E731
    zero = jnp.zeros_like(time)
    state = eqx.tree_at(where, state, (knots, time, zero, jnp.zeros_like(state.periods)))
    turns = jnp.floor(jax.lax.stop_gradient(jnp.abs(span)) / machine.period)
    rest = span - jnp.copysign(turns, span) * machine.period
    begun = jax.lax.cond(
        is_any(turns > 0),
        lambda: _turned(flow, machine, state, hold, jnp.copysign(machine.period, span), turns.astype(int)),
        lambda: state,
    )
    end = _within_turn(flow, machine, begun, hold, rest)
    gone = (state.x, begun.x, end.displacement), (state.v, begun.v, end.gain)
    displacement, gain = ((turned - start) + way for start, turned, way in gone)
    return displacement, gain, end.state.phase


def _within_turn(flow: AbstractFlow, machine: Machine, state: State, hold: Held, span: Scalar) -> _Piece:
    """Motion over less than a turn."""
    assert machine.tables is not None
    count = sum(stream.size for stream in machine.tables.streams) + 1
    nothing = jnp.zeros_like(state.x)
    start = _Piece(span, state, nothing, nothing)
    end, _ = jax.lax.scan(
        lambda piece, _: (_to_next_knot(flow, machine, piece, hold), None), start, None, length=count
    )
    return end


def _to_next_knot(flow: AbstractFlow, machine: Machine, piece: _Piece, hold: Held) -> _Piece:
    """Motion to the next knot in the direction of the flight, at most to its end."""
    tables, (left, state, displacement, gain) = machine.tables, piece
    assert tables is not None
    is_back = left < 0
    begins = _begins(tables.streams, state.knots.passed)
    until = _begins(tables.streams, _followed(tables.streams, state.knots.passed)) - state.time
    ahead, behind = smallest(until), -smallest(state.time - begins)
    step = jnp.where(is_back, jnp.where(behind > left, behind, left), jnp.where(ahead < left, ahead, left))
    change = machine.phase_after(state.phase, step) - state.phase
    moved, gained = flow.flow_map(machine, state, hold, step, change)
    is_there = jnp.where(is_back, step > left, step < left)
    at = is_there & jnp.where(is_back, begins - state.time >= step, until <= step)
    knots, phase = _past(machine, state.knots, state.phase + change, at, is_back)
    there = eqx.tree_at(
        lambda s: (s.time, s.x, s.v, s.phase, s.knots),
        state,
        (state.time + step, machine.moved(state.x, moved), state.v + gained, phase, knots),
    )
    return _Piece(jnp.where(is_there, left - step, 0), there, displacement + moved, gain + gained)


def _begins(streams: tuple[Any, ...], passed: Array) -> Float[Array, "streams"]:
    return jnp.stack([stream.start(p) for stream, p in zip(streams, passed, strict=True)])


def _followed(streams: tuple[Any, ...], passed: Array) -> Int[Array, "streams"]:
    return jnp.stack([stream.following(p) for stream, p in zip(streams, passed, strict=True)])


def _past(
    machine: Machine, knots: Knots, phase: Array, at: Array, is_back: Array
) -> tuple[Knots, Float[Array, "2 columns"]]:
    """Places and phase after knots that are passed forwards or backwards."""
    tables, num_harmonics = machine.tables, machine.waves.num_harmonics
    assert tables is not None
    columns = phase[:, num_harmonics:]
    on, back = tables.past(knots, columns, at), tables.before(knots, columns, at)
    chosen, columns = jax.tree.map(lambda a, b: jnp.where(is_back, a, b), back, on)
    return chosen, jnp.concatenate([phase[:, :num_harmonics], columns], axis=1)


def _turned(
    flow: AbstractFlow, machine: Machine, state: State, hold: Held, turn: Scalar, turns: Int[Array, ""]
) -> State:
    """State after whole turns, at the time of the state before them."""
    n = len(state.x)
    names = lambda s: (s.x, s.v)  # noqa: E731

    def once(z: Float[Array, " state"]) -> Float[Array, " state"]:
        end = _within_turn(flow, machine, eqx.tree_at(names, state, (z[:n], z[n:])), hold, turn)
        return z + jnp.concatenate([end.displacement, end.gain])

    z = jnp.concatenate(names(state))
    if not flow.is_linear:
        on = lambda carry: (once(carry[0]), carry[1] - 1)  # noqa: E731
        z, _ = jax.lax.while_loop(lambda carry: carry[1] > 0, on, (z, turns))
        return eqx.tree_at(names, state, (z[:n], z[n:]))
    z = affine_power(once, z, turns, _DIGITS)
    return eqx.tree_at(names, state, (z[:n], z[n:]))
