"""Corrector of many cycles at once: every number an array over lanes, one pass over the events for a Newton step.

It solves the equations of `corrector.py`. A pass carries the solutions of the equations of the flights so far, see
`condensation.py`, and a particular one of their right-hand sides; what an event needs on the way back is 2 (2 n + 2) + 1
numbers. The flights themselves are those of `cycle.py`, for one cycle, made into many by `lanes_last`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._flow.modal import ModalFlow
from .._jax.arrays import shapes_of_lane
from .._lanes.kernels import kernel_of, pruned
from .._machine.table_numbers import is_by_tables
from .._orbits.condensation import Pencil
from .._orbits.floquet import floquet_multipliers
from .._orbits.rigid_modes import closing_pin
from .._orbits.sequence import NOTHING, Sequence
from .._system.family import structure_of
from .batch_pass import (
    Kept,
    Pass,
    before_event,
    begun_pass,
    closed_pass,
    flights_of,
    past_event,
    prepared_problem,
)
from .corrector import Corrected, NewtonState, before_the_first_step, corrected_of, is_going_on
from .parameter_family import ExtendedCycle, ParameterFamily

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
    cycles = _Cycles(family, sequence, weights, target, count, *_pruned(family, sequence, guess))

    def turn(state: tuple[ExtendedCycle, NewtonState]) -> tuple[ExtendedCycle, NewtonState]:
        here, now = state
        is_on = is_going_on(now, family.tolerance)
        new = _newton_step(cycles, now, here)
        return jax.tree.map(lambda a, b: jnp.where(is_on, a, b), new, state)

    first = guess, before_the_first_step(guess)
    now = jax.lax.while_loop(lambda state: jnp.any(is_going_on(state[1], family.tolerance)), turn, first)[1]
    length = jnp.sqrt(_along(now.tangent, now.tangent))
    erased = 2 * jnp.max(jnp.sum(sequence.mode, axis=1), axis=0, initial=0)
    return corrected_of(now, length, multipliers_of(now.pencil, erased, family.shifts))


class _Cycles(NamedTuple):
    """Arguments of `correct_many`, the numbers of events of the cycles, and the kernels of a pass, see `_pruned`."""

    family: ParameterFamily
    sequence: Sequence
    weights: ExtendedCycle
    target: Array
    count: Array
    begin: Callable
    past_event: Callable


def _newton_step(cycles: _Cycles, now: NewtonState, here: ExtendedCycle) -> tuple[ExtendedCycle, NewtonState]:
    """Cycles a step on, and the state of Newton's method there."""
    passed, kept = _forwards(cycles, here)
    of_weights = _along(here, cycles.weights)
    shares, pencil = kernel_of(closed_pass)(passed, _pins_of(cycles.family), cycles.target, of_weights)
    shares, durations = _backwards(cycles.count, kept, shares)
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


def _forwards(cycles: _Cycles, here: ExtendedCycle) -> tuple[Pass, Kept]:
    """Past all events, each of whose durations is solved for."""
    family, sequence, weights = cycles.family, cycles.sequence, cycles.weights
    prepared, begun = kernel_of(cycles.begin)(family, sequence, here, weights)
    flights = flights_of(sequence, here.flights, weights.flights)

    def there(k: Array, state: tuple[Pass, Kept]) -> tuple[Pass, Kept]:
        past_event = kernel_of(cycles.past_event)
        passed, kept = past_event(prepared, family.scale, here.z, _at(flights, k), state[0])
        return passed, jax.tree.map(lambda a, new: a.at[k].set(new), state[1], kept)

    room, lanes, free = len(here.flights), here.p.shape, here.z.shape[0] + 1
    nothing = lambda *shape: jnp.zeros((room + 1, *shape, *lanes), here.z.dtype)  # noqa: E731
    kept = Kept(nothing(free + 1), nothing(), nothing(free + 1), nothing())
    return jax.lax.fori_loop(0, jnp.max(cycles.count) + 1, there, (begun, kept))


def _backwards(count: Array, kept: Kept, shares: Array) -> tuple[Array, Array]:
    """Changes of start and parameter, and those of the durations, event by event from the last."""
    last = jnp.max(count)

    def back(k: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        at = last - 1 - k
        free, durations = kernel_of(before_event)(_at(kept, at), at < count, state[0])
        return free, state[1].at[at].set(durations)

    durations = jnp.zeros((len(kept.speed) - 1, 2, *count.shape), shares.dtype)
    return jax.lax.fori_loop(0, last, back, (shares, durations))


def _pins_of(family: ParameterFamily) -> Array:
    """`closing_pin` of many families, (2 n, 2 n, lanes)."""
    return jax.vmap(closing_pin, in_axes=-1, out_axes=-1)(family.shifts)


def _pruned(family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle) -> tuple[Callable, Callable]:
    """Functions that prepare the equations of a cycle and begin a pass, and that go past an event.

    The first returns only those numbers of the machine that the second reads.
    """
    family, sequence, place = shapes_of_lane((family, sequence, guess))
    prepared = eqx.filter_eval_shape(prepared_problem, family, sequence, place.p)
    begun = eqx.filter_eval_shape(begun_pass, prepared, family.scale, place, place)
    flights = eqx.filter_eval_shape(
        lambda *a: _at(flights_of(*jax.tree.map(lambda a: a[..., None], a)), 0),
        sequence,
        place.flights,
        place.flights,
    )
    flight = shapes_of_lane(flights)
    picked, of_picked = pruned(past_event, prepared, family.scale, place.z, flight, begun)

    def begin(
        family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, weights: ExtendedCycle
    ) -> tuple:
        prepared = prepared_problem(family, sequence, place.p)
        return picked(prepared), begun_pass(prepared, family.scale, place, weights)

    return begin, of_picked


def multipliers_of(pencils: Pencil, num_erased: Array, shifts: Array) -> Array:
    """`floquet_multipliers` of many cycles, (2 n, lanes)."""
    return jax.vmap(floquet_multipliers, in_axes=-1, out_axes=-1)(pencils, num_erased, shifts)


def _along(one: ExtendedCycle, other: ExtendedCycle) -> Array:
    """Inner products of many cycles."""
    return jnp.sum(one.z * other.z, axis=0) + jnp.sum(one.flights * other.flights, axis=0) + one.p * other.p


def _at(tree: Any, k: Array | int) -> Any:
    return jax.tree.map(lambda a: a[k], tree)
