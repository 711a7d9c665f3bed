"""One pass over the events of many cycles, see `batch_corrector.py`: forwards past each event, and backwards to its duration."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._orbits.condensation import Pencil, basis_of_kernel
from .._orbits.cycle import Event, Moment, Problem, fly_to_event, initial_moment, moved_by
from .._orbits.sequence import NOTHING, Sequence
from .parameter_family import ExtendedCycle, ParameterFamily


class PreparedProblem(NamedTuple):
    """Equations of a cycle at a parameter, and the derivative of the machine and its flow by it."""

    problem: Problem
    change: Any


class WeightedFlight(NamedTuple):
    """A flight, its weight, and whether it ends with an event of the cycle, or is the one that closes it."""

    event: Event
    duration: Array
    weight: Array
    is_event: Array
    closes: Array


class Pass(NamedTuple):
    """State of the pass over the events, rows of derivatives by the free numbers c.

    Attributes:
        moment: where it is.
        start: (dz0, dp, weights . unknowns) by c, (2 n + 2, free).
        here: (dz, dtime, dp) by c, (2 n + 2, free).
        of_start: particular solution of the equations so far, as the rows of `start`.
        of_here: the same, as the rows of `here`.
        end: dz at the end of the cycle by c, (2 n, free).
        of_end: particular solution there, (2 n,).
        closing: state at the end minus the state at the start, scaled, (2 n,).
    """

    moment: Moment
    start: Array
    here: Array
    of_start: Array
    of_here: Array
    end: Array
    of_end: Array
    closing: Array


class Kept(NamedTuple):
    """Quantities of an event that the way back needs, and the approach speed.

    Attributes:
        axis: of the reflection that removes the duration, (free + 1,).
        scale: its factor.
        own: particular solution of the equation of the event, (free + 1,).
        speed: approach speed.
    """

    axis: Array
    scale: Array
    own: Array
    speed: Array


def prepared_problem(family: ParameterFamily, sequence: Sequence, p: Array) -> PreparedProblem:
    """Equations of a cycle at a parameter, and the derivative of the machine and its flow by it."""
    return PreparedProblem(*family.linear_problem(sequence, p))


def flights_of(sequence: Sequence, durations: Array, weights: Array) -> WeightedFlight:
    """Flights of many cycles, the last one of each closes it and has no duration yet, (events + 1, ..., lanes)."""
    room, count = len(durations), jnp.sum(sequence.kind != NOTHING, axis=0)
    longer = lambda a, last: jnp.concatenate([a, jnp.full((1, *a.shape[1:]), last, a.dtype)])  # noqa: E731
    numbers = jnp.arange(room + 1)[:, None]
    event = Event(
        kind=longer(sequence.kind, NOTHING),
        stop=longer(sequence.stop, 0),
        mode=sequence.mode,
        mode_after=jnp.concatenate([sequence.mode[1:], sequence.mode[-1:]]),
    )
    return WeightedFlight(event, longer(durations, 0), longer(weights, 0), numbers < count, numbers == count)


def begun_pass(prepared: PreparedProblem, scale: Array, place: ExtendedCycle, weights: ExtendedCycle) -> Pass:
    """The pass before the first flight, of one cycle."""
    problem, change = prepared
    size = len(scale)

    def begun(y: Array) -> tuple[Array, Moment]:
        machine, _ = moved_by((problem.machine, problem.flow), change, y[size])
        moment = initial_moment(problem, machine, y[:size] * scale)
        return jnp.concatenate([moment.z / scale, moment.time[None], y[size:]]), moment

    y = jnp.append(place.z, jnp.zeros_like(place.p))
    here, moment = jax.jacfwd(begun, has_aux=True)(y)
    start = jnp.vstack([jnp.eye(size + 1, dtype=here.dtype), jnp.append(weights.z, weights.p)])
    return Pass(
        moment=moment,
        start=start,
        here=here,
        of_start=jnp.zeros_like(start[:, 0]),
        of_here=jnp.zeros_like(here[:, 0]),
        end=here[:size],
        of_end=jnp.zeros_like(here[:size, 0]),
        closing=jnp.zeros_like(scale),
    )


def past_event(
    prepared: PreparedProblem, scale: Array, z: Array, flight: WeightedFlight, passed: Pass
) -> tuple[Pass, Kept]:
    """The pass behind the next flight and its event, of one cycle, that starts in `z`."""
    problem, change = prepared
    size, place, here = len(scale), passed.moment, passed.here
    duration = jnp.where(flight.closes, problem.phase + problem.num_periods - place.time, flight.duration)

    def moved(y: Array) -> tuple[tuple[Array, Array], tuple[Moment, Array, Array]]:
        machine, flow = moved_by((problem.machine, problem.flow), change, y[size + 1])
        before = place._replace(z=y[:size] * scale, time=y[size])
        there, (value, speed), _ = fly_to_event(machine, flow, before, flight.event, y[-1])
        return (jnp.concatenate([there.z / scale, there.time[None], y[size + 1 : -1]]), value), (
            there,
            value,
            speed,
        )

    y = jnp.concatenate([place.z / scale, place.time[None], jnp.zeros(1), duration[None]])
    (forward, normal), (there, value, speed) = jax.jacfwd(moved, has_aux=True)(y)
    row = jnp.append(normal[:-1] @ here, normal[-1])
    square = jnp.sum(row * row)
    own = row * ((-value - normal[:-1] @ passed.of_here) / jnp.where(square > 0, square, 1))
    axis, factor = reflection_of(row, square)
    reach = jnp.column_stack([forward[:, :-1] @ here, forward[:, -1]])
    change_here = forward[:, :-1] @ passed.of_here
    of_duration = jnp.zeros(size + 2).at[-1].set(flight.weight)
    longer = jnp.column_stack([passed.start, of_duration])
    # The flight that closes the cycle lasts as long as the others leave.
    end = reach[:size, :-1] - jnp.outer(forward[:size, -1], here[size])
    new = Pass(
        moment=there,
        start=reflected(longer, axis, factor),
        here=reflected(reach, axis, factor),
        of_start=passed.of_start + longer @ own,
        of_here=reach @ own + change_here,
        end=end,
        of_end=change_here[:size] - forward[:size, -1] * passed.of_here[size],
        closing=(there.z - z * scale) / scale,
    )

    def chosen(when: Array, *names: str) -> dict[str, Any]:
        either = partial(jnp.where, when)
        return {name: jax.tree.map(either, getattr(new, name), getattr(passed, name)) for name in names}

    of_event = chosen(flight.is_event, "moment", "start", "here", "of_start", "of_here")
    of_end = chosen(flight.closes, "end", "of_end", "closing")
    return Pass(**of_event, **of_end), Kept(axis, factor, own, speed)


def reflection_of(row: Array, square: Array) -> tuple[Array, Array]:
    """Axis and factor of the reflection of `basis_of_kernel`, from a row and its square."""
    length = jnp.sqrt(square)
    last = row[-1] + jnp.where(row[-1] < 0, -length, length)
    axis = row.at[-1].set(last)
    of_axis = jnp.sum(axis * axis)
    return axis, 2 / jnp.where(of_axis > 0, of_axis, 1)


def reflected(matrix: Array, axis: Array, factor: Array) -> Array:
    """Matrix times the basis of the kernel of a row, by its reflection."""
    return matrix[:, :-1] - jnp.outer(factor * (matrix @ axis), axis[:-1])


def before_event(kept: Kept, is_event: Array, shares: Array) -> tuple[Array, Array]:
    """The free numbers before a flight, and its duration, from those behind its event, of one cycle.

    `shares` are those of the Newton step and of the tangent, (2, free).
    """
    along = kept.scale * (shares @ kept.axis[:-1])
    whole = jnp.column_stack([shares, jnp.zeros_like(along)]) - jnp.outer(along, kept.axis)
    whole = jnp.stack([whole[0] + kept.own, whole[1]])
    return jnp.where(is_event, whole[:, :-1], shares), jnp.where(is_event, whole[:, -1], 0)


def closed_pass(passed: Pass, pin: Array, target: Array, along: Array) -> tuple[Array, Pencil]:
    """Free numbers of the Newton step and of the tangent, (2, free), and the pencil, of one cycle."""
    size = len(passed.closing)
    closed = jnp.eye(size, dtype=pin.dtype) - pin
    matrix = jnp.vstack([passed.end - closed @ passed.start[:size], passed.start[-1]])
    value = jnp.append(
        -passed.closing - passed.of_end + closed @ passed.of_start[:size],
        target - along - passed.of_start[-1],
    )
    of_tangent = jnp.zeros_like(value).at[-1].set(1)
    shares = solved(matrix, jnp.stack([value, of_tangent], axis=1)).T
    row = passed.start[size]
    basis = basis_of_kernel(row)
    return shares, Pencil(passed.end @ basis, passed.start[:size] @ basis)


def solved(matrix: Array, values: Array) -> Array:
    """Solution of square equations by reflections, written out; they need no pivots. `values` are columns."""
    num, whole = len(matrix), jnp.concatenate([matrix, values], axis=1)
    rows = []
    for _ in range(num):
        column = whole[:, 0]
        square = jnp.sum(column * column)
        length = jnp.where(column[0] < 0, -jnp.sqrt(square), jnp.sqrt(square))
        axis = column.at[0].add(length)
        factor = 1 / jnp.where(square > 0, square + jnp.abs(column[0] * length), 1)
        rest = whole[:, 1:]
        rest = rest - jnp.outer(axis, factor * (axis @ rest))
        rows.append((-length, rest[0]))
        whole = rest[1:]
    found: list[Array] = []
    for k, (diagonal, row) in enumerate(reversed(rows)):
        value = row[k:]
        for j, x in enumerate(found):
            value = value - row[k - 1 - j] * x
        found.append(value / jnp.where(diagonal == 0, jnp.finfo(row.dtype).tiny, diagonal))
    return jnp.stack(found[::-1])
