"""Corrector of many cycles at once: every number an array over lanes, one pass over the events for a Newton step.

It solves the equations of `corrector.py`. A pass carries the solutions of the equations of the flights so far, see
`condensation.py`, and a particular one of their right-hand sides; what an event needs on the way back is 2 (2 n + 2) + 1
numbers. The flights themselves are those of `cycle.py`, for one cycle, made into many by `lanes_last`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._flow.modal import ModalFlow
from .._lanes.kernels import kernel_of, pruned
from .._machine.tables import is_by_tables
from .._orbits.condensation import Pencil, basis_of_kernel
from .._orbits.cycle import Event, Moment, Problem, fly_to_event, initial_moment, moved_by
from .._orbits.floquet import floquet_multipliers
from .._orbits.rigid_modes import closing_pin
from .._orbits.sequence import NOTHING, Sequence
from .._system.family import structure_of
from .corrector import Corrected, NewtonState, is_converged, is_going_on
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


class _Pass(NamedTuple):
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


class _Kept(NamedTuple):
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


# Most masses of a machine for which all is written out: compilation takes 2 ms an operation.
_MOST_MASSES = 3


def can_correct_many(families: ParameterFamily) -> bool:
    """True if `correct_many` may be taken for families, along the first axis: by their flow and number of masses."""
    is_modal = isinstance(families.flow, ModalFlow) and not is_by_tables(structure_of(families.system))
    return is_modal and families.scale.shape[-1] <= 2 * _MOST_MASSES


def correct_many(
    family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle, weights: ExtendedCycle, target: Array
) -> Corrected:
    """`correct` of many cycles; all arrays have the lanes as their last axis.

    Raises:
        NotImplementedError: if a law of the machine is made of what `lanes_last` does not know.
    """
    count = jnp.sum(sequence.kind != NOTHING, axis=0)
    begin, past_event = _pruned(family, sequence, guess)

    def one(now: NewtonState, here: ExtendedCycle) -> tuple[ExtendedCycle, NewtonState]:
        prepared, begun = kernel_of(begin)(family, sequence, here, weights)
        flights = flights_of(sequence, here.flights, weights.flights)

        def there(k: Array, state: tuple[_Pass, _Kept]) -> tuple[_Pass, _Kept]:
            passed, kept = kernel_of(past_event)(prepared, family.scale, here.z, _at(flights, k), state[0])
            return passed, jax.tree.map(lambda a, new: a.at[k].set(new), state[1], kept)

        room, lanes = len(here.flights), here.p.shape
        free = here.z.shape[0] + 1
        nothing = lambda *shape: jnp.zeros((room + 1, *shape, *lanes), here.z.dtype)  # noqa: E731
        kept = _Kept(nothing(free + 1), nothing(), nothing(free + 1), nothing())
        last = jnp.max(count)
        passed, kept = jax.lax.fori_loop(0, last + 1, there, (begun, kept))
        shares, pencil = kernel_of(_closed)(passed, _pins_of(family), target, _along(here, weights))

        def back(k: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
            at = last - 1 - k
            free, durations = kernel_of(_before_event)(_at(kept, at), at < count, state[0])
            return free, state[1].at[at].set(durations)

        durations = jnp.zeros((room, 2, *lanes), here.z.dtype)
        shares, durations = jax.lax.fori_loop(0, last, back, (shares, durations))
        step, tangent = (ExtendedCycle(shares[k, :-1], durations[:, k], shares[k, -1]) for k in range(2))
        length = jnp.maximum(
            jnp.max(jnp.abs(shares[0]), axis=0), jnp.max(jnp.abs(durations[:, 0]), axis=0, initial=0)
        )
        return here.moved(step, 1.0), NewtonState(
            place=here,
            pencil=pencil,
            tangent=tangent,
            speeds=kept.speed[:-1],
            residual=jnp.max(jnp.abs(passed.closing), axis=0),
            first=jnp.where(now.num_steps == 0, length, now.first),
            step=length,
            last=now.step,
            num_steps=now.num_steps + 1,
        )

    def turn(state: tuple[ExtendedCycle, NewtonState]) -> tuple[ExtendedCycle, NewtonState]:
        here, now = state
        is_on = is_going_on(now, family.tolerance)
        new = one(now, here)
        return jax.tree.map(lambda a, b: jnp.where(is_on, a, b), new, state)

    first = guess, _nothing(guess)
    now = jax.lax.while_loop(lambda state: jnp.any(is_going_on(state[1], family.tolerance)), turn, first)[1]
    length = jnp.sqrt(_along(now.tangent, now.tangent))
    erased = 2 * jnp.max(jnp.sum(sequence.mode, axis=1), axis=0, initial=0)
    return Corrected(
        place=now.place,
        tangent=ExtendedCycle(*(a / length for a in now.tangent)),
        multipliers=multipliers_of(now.pencil, erased, family.shifts),
        speeds=now.speeds,
        residual=now.residual,
        first=now.first,
        num_steps=now.num_steps,
        is_converged=is_converged(now),
    )


def prepared_problem(family: ParameterFamily, sequence: Sequence, p: Array) -> PreparedProblem:
    """Equations of a cycle at a parameter, and the derivative of the machine and its flow by it."""
    return PreparedProblem(*family.linear_problem(sequence, p))


def _pins_of(family: ParameterFamily) -> Array:
    """`closing_pin` of many families, (2 n, 2 n, lanes)."""
    return jax.vmap(closing_pin, in_axes=-1, out_axes=-1)(family.shifts)


def _pruned(family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle) -> tuple[Callable, Callable]:
    """Functions that prepare the equations of a cycle and begin a pass, and that go past an event.

    The first returns only those numbers of the machine that the second reads.
    """
    of_one = lambda tree: jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[:-1], a.dtype), tree)  # noqa: E731
    family, sequence, place = of_one((family, sequence, guess))
    prepared = eqx.filter_eval_shape(prepared_problem, family, sequence, place.p)
    begun = eqx.filter_eval_shape(_begun, prepared, family.scale, place, place)
    flights = eqx.filter_eval_shape(
        lambda *a: _at(flights_of(*jax.tree.map(lambda a: a[..., None], a)), 0),
        sequence,
        place.flights,
        place.flights,
    )
    flight = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[:-1], a.dtype), flights)
    picked, of_picked = pruned(_past_event, prepared, family.scale, place.z, flight, begun)

    def begin(
        family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, weights: ExtendedCycle
    ) -> tuple:
        prepared = prepared_problem(family, sequence, place.p)
        return picked(prepared), _begun(prepared, family.scale, place, weights)

    return begin, of_picked


def multipliers_of(pencils: Pencil, num_erased: Array, shifts: Array) -> Array:
    """`floquet_multipliers` of many cycles, (2 n, lanes)."""
    return jax.vmap(floquet_multipliers, in_axes=-1, out_axes=-1)(pencils, num_erased, shifts)


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


def _begun(prepared: PreparedProblem, scale: Array, place: ExtendedCycle, weights: ExtendedCycle) -> _Pass:
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
    return _Pass(
        moment=moment,
        start=start,
        here=here,
        of_start=jnp.zeros_like(start[:, 0]),
        of_here=jnp.zeros_like(here[:, 0]),
        end=here[:size],
        of_end=jnp.zeros_like(here[:size, 0]),
        closing=jnp.zeros_like(scale),
    )


def _past_event(
    prepared: PreparedProblem, scale: Array, z: Array, flight: WeightedFlight, passed: _Pass
) -> tuple[_Pass, _Kept]:
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
    new = _Pass(
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
    return _Pass(**of_event, **of_end), _Kept(axis, factor, own, speed)


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


def _before_event(kept: _Kept, is_event: Array, shares: Array) -> tuple[Array, Array]:
    """The free numbers before a flight, and its duration, from those behind its event, of one cycle.

    `shares` are those of the Newton step and of the tangent, (2, free).
    """
    along = kept.scale * (shares @ kept.axis[:-1])
    whole = jnp.column_stack([shares, jnp.zeros_like(along)]) - jnp.outer(along, kept.axis)
    whole = jnp.stack([whole[0] + kept.own, whole[1]])
    return jnp.where(is_event, whole[:, :-1], shares), jnp.where(is_event, whole[:, -1], 0)


def _closed(passed: _Pass, pin: Array, target: Array, along: Array) -> tuple[Array, Pencil]:
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


def _along(one: ExtendedCycle, other: ExtendedCycle) -> Array:
    """Inner products of many cycles."""
    return jnp.sum(one.z * other.z, axis=0) + jnp.sum(one.flights * other.flights, axis=0) + one.p * other.p


def _at(tree: Any, k: Array | int) -> Any:
    return jax.tree.map(lambda a: a[k], tree)


def _nothing(guess: ExtendedCycle) -> NewtonState:
    zero, size = jnp.zeros_like(guess.p), len(guess.z)
    big = zero + jnp.finfo(zero.dtype).max
    square = jnp.zeros((size, size, *zero.shape), zero.dtype)
    none = jnp.zeros(zero.shape, int)
    pencil = Pencil(square, square)
    return NewtonState(guess, pencil, guess, jnp.zeros_like(guess.flights), zero, zero, big, big, none)
