"""Linear equations of a cycle, solved flight by flight.

The unknowns of a cycle are its start z0 and the durations of its flights. Each event gives one equation; the closing
of the cycle gives the others. The solutions of the equations of the flights so far are kept as

    dz0 = N c,  dz = Z c,

with 2 n free numbers c. A flight adds one unknown, its duration. Its event removes one, by the reflection that turns
the row of the equation into the last axis. So nothing is divided by the speed of an impact: at grazing, where the
row loses its entry of the duration, another entry takes its place. The work grows linearly with the number of events,
not with its cube. The pencil (Z, N) that remains gives the Floquet multipliers.

Along a branch a parameter p is one more unknown, which no flight changes. Then dz0 stands for (dz0, dp), and there are
2 n + 1 free numbers. The equation that is added is linear in all unknowns, see `Weights`, and has the form of dz0.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from equinox.internal import unvmap_max
from jaxtyping import Array, Float, Int

from .._jax.xla import in_lanes_of


def over_flights(
    one: Callable[[Any, Any], tuple[Any, Any]],
    carry: Any,
    rows: Any,
    count: Int[Array, ""] | None,
    *,
    reverse: bool = False,
) -> tuple[Any, Any]:
    """`jax.lax.scan` over all flights, or over the first `count` of them; the latter has no reverse derivatives.

    A cycle has room for far more events than most cycles have. Results of the other flights are zero. In a batch all
    lanes run as far as the longest: the padding of the others changes nothing.
    """
    if count is None:
        return jax.lax.scan(one, carry, rows, reverse=reverse)
    count = unvmap_max(count)
    at = lambda k: jax.tree.map(lambda a: a[k], rows)  # noqa: E731
    size = len(jax.tree.leaves(rows)[0])
    one = jax.jit(one, inline=True)  # traced once
    results = jax.eval_shape(one, carry, at(0))[1]
    room = jax.tree.map(lambda a: jnp.zeros((size, *a.shape), a.dtype), results)
    carry, room = in_lanes_of(jax.tree.leaves(carry)[0], (carry, room))

    def step(state: tuple[Array, Any, Any]) -> tuple[Array, Any, Any]:
        done, carry, room = state
        k = count - 1 - done if reverse else done
        carry, result = one(carry, at(k))
        return done + 1, carry, jax.tree.map(lambda a, new: a.at[k].set(new), room, result)

    _, carry, room = jax.lax.while_loop(lambda state: state[0] < count, step, (jnp.array(0), carry, room))
    return carry, room


class Flights(NamedTuple):
    """Derivatives of the flights of a cycle, in order.

    A state holds z and the time, and the parameter if there is one: (next,).

    Attributes:
        begin: of the first state by z0, (next, free); zero for masses that are held.
        forward: of the state after each event by the state before the flight and the duration,
            (events, next, next + 1).
        normal: of the value that vanishes at the event, likewise, (events, next + 1).
        close: of z at the end of the cycle by the state after the last event, (state, next).
        pin: of the closing by the start, added where shifts are left free, see `rigid_modes.py`, (state, state).
        drift: the projection onto shifts along which the cycle may come back displaced, (state, state); None without.
    """

    begin: Float[Array, "next free"]
    forward: Float[Array, "events next given"]
    normal: Float[Array, "events given"]
    close: Float[Array, "state next"]
    pin: Float[Array, "state state"]
    drift: Any = None


class Weights(NamedTuple):
    """Coefficients of a linear function of the start and the parameter, (free,), and of the durations, (events,)."""

    start: Float[Array, " free"]
    flights: Float[Array, " events"]


class Pencil(NamedTuple):
    """First and last states of an orbit's neighbours: dz0 = `start` c, dz1 = `end` c."""

    end: Float[Array, "state state"]
    start: Float[Array, "state state"]


class Condensed(NamedTuple):
    """The condensed equations.

    Attributes:
        flights: the derivatives from which they are made.
        row: the row of every equation, (events, free + 1).
        basis: a basis of the kernel of each row, (events, free + 1, free).
        start: N before each flight and, as its last row, the weights, by c and the duration, (events, rows, free + 1).
        reach: the derivative of the state after each flight, likewise, (events, next, free + 1).
        pencil: the pencil that remains; its start has the weights as its last row, if there are any.
    """

    flights: Flights
    row: Float[Array, "events more"]
    basis: Float[Array, "events more free"]
    start: Float[Array, "events rows more"]
    reach: Float[Array, "events next more"]
    pencil: Pencil


def condense(
    flights: Flights, count: Int[Array, ""] | None = None, weights: Weights | None = None
) -> Condensed:
    """Eliminate the duration of every flight, or of the first `count` of them, see `over_flights`."""
    events, num_free = len(flights.forward), flights.begin.shape[1]
    first = jnp.eye(num_free, dtype=flights.begin.dtype)
    of_flights = jnp.zeros((events, num_free), first.dtype)
    if weights is not None:
        first = jnp.vstack([first, weights.start])
        of_flights = jnp.column_stack([of_flights, weights.flights])

    def one(carry, flight):
        start, here = carry
        forward, normal, of_flight = flight
        row = jnp.append(normal[:-1] @ here, normal[-1])
        start = jnp.column_stack([start, of_flight])
        reach = jnp.column_stack([forward[:, :-1] @ here, forward[:, -1]])
        basis = basis_of_kernel(row)
        return (start @ basis, reach @ basis), (row, basis, start, reach)

    rows = flights.forward, flights.normal, of_flights
    (start, here), (row, basis, starts, reach) = over_flights(one, (first, flights.begin), rows, count)
    return Condensed(flights, row, basis, starts, reach, Pencil(flights.close @ here, start))


def basis_of_kernel(row: Float[Array, " free"]) -> Float[Array, "free state"]:
    """Orthonormal basis of the kernel of a row, by a reflection; unit vectors for a row of zeros."""
    length = jnp.sqrt(jnp.sum(row * row))
    last = row[-1] + jnp.where(row[-1] < 0, -length, length)
    axis = row.at[-1].set(last)
    square = jnp.sum(axis * axis)
    scale = 2 / jnp.where(square > 0, square, 1)
    return jnp.eye(len(row), len(row) - 1, dtype=row.dtype) - scale * jnp.outer(axis, axis[:-1])


def solve_condensed(
    equations: Condensed,
    of_events: Float[Array, " events"],
    of_closing: Float[Array, " state"],
    count: Int[Array, ""] | None = None,
    of_weights: Float[Array, ""] | None = None,
) -> tuple[Float[Array, " free"], Float[Array, " events"]]:
    """Solve for the changes of the start and of the durations; linear in the right-hand sides, so differentiable.

    The right-hand sides are those of the events, of the closing and, if there are weights, of their equation.
    """
    flights = equations.flights

    def there(carry, flight):
        of_start, change = carry  # a particular solution of the equations so far
        forward, normal, row, start, reach, value = flight
        square = jnp.sum(row * row)
        own = row * ((value - normal[:-1] @ change) / jnp.where(square > 0, square, 1))
        return (of_start + start @ own, reach @ own + forward[:, :-1] @ change), own

    def back(free, flight):
        basis, own = flight
        whole = basis @ free + own
        return whole[:-1], whole[-1]

    size, (end, start) = len(of_closing), equations.pencil
    first = jnp.zeros(len(start), end.dtype), jnp.zeros(len(flights.begin), end.dtype)
    rows = flights.forward, flights.normal, equations.row, equations.start, equations.reach, of_events
    (of_start, change), own = over_flights(there, first, rows, count)
    closed = jnp.eye(size, dtype=end.dtype) - flights.pin
    matrix, value = (
        end - closed @ start[:size],
        of_closing - flights.close @ change + closed @ of_start[:size],
    )
    if flights.drift is not None:
        beside = jnp.eye(size, dtype=end.dtype) - flights.drift
        matrix = beside @ matrix + flights.drift @ start[:size]
        value = beside @ value - flights.drift @ of_start[:size]
    if of_weights is not None:
        matrix, value = jnp.vstack([matrix, start[-1]]), jnp.append(value, of_weights - of_start[-1])
    free = jnp.linalg.solve(matrix, value)
    return over_flights(back, free, (equations.basis, own), count, reverse=True)
