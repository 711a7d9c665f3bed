"""Trajectories in one call, with room for the whole request: differentiable, alone or batched."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._flow.interface import AbstractFlow
from .._jax.arrays import UNROLLED, Scalar
from .._jax.errors import checked_one
from .._jax.xla import bounded_while_any, differentiable, not_constant, while_any
from .._machine.numbers import MachineNumbers, numbers_of
from .._system.system import ImpactSystem
from .batched import in_groups, one_by_one, to_all
from .derivative_growth import warn_if_large, watch_closely
from .event_log import Log
from .loop import Carry, LoopArguments, LoopTask, finish, prepare_loop, run_without_derivatives
from .solution import RESULTS, Solution, result_sentences


class CallSettings(NamedTuple):
    """Static settings of a trajectory followed in one call.

    Attributes:
        room: bound on the logged events.
        can_stick: whether any stop may hold its mass.
        max_reverse_steps: see `simulate`.
        raises: whether derivatives over too many steps raise; else they are NaN.
    """

    room: int
    can_stick: bool
    max_reverse_steps: int
    raises: bool


def run_single_call(
    machine: ImpactSystem | MachineNumbers, flow: AbstractFlow, request: LoopArguments, asked: CallSettings
) -> Solution:
    """Follow a trajectory in one call, differentiably."""
    # A program with `throw` calls back into Python anyway.
    watched = watch_closely if asked.raises else warn_if_large
    return differentiable(_forwards, _backwards, (machine, flow, request, asked), _side_by_side, watched)


def _forwards(
    whole: tuple[ImpactSystem | MachineNumbers, AbstractFlow, LoopArguments, CallSettings],
) -> Solution:
    return _run_whole(*whole, while_any)


def _backwards(
    whole: tuple[ImpactSystem | MachineNumbers, AbstractFlow, LoopArguments, CallSettings],
) -> Solution:
    asked = whole[3]
    refuse = partial(factor_in_reverse, raises=asked.raises)
    return _run_whole(*whole, partial(bounded_while_any, max_steps=asked.max_reverse_steps, refuse=refuse))


def _side_by_side(
    whole: tuple[ImpactSystem | MachineNumbers, AbstractFlow, LoopArguments, CallSettings], num_lanes: int
) -> Solution:
    """Follow trajectories with lanes last; the results have lanes first."""
    machine, flow, request, asked = whole
    arguments = not_constant((_in_numbers(machine), flow, request))
    with jax.numpy_rank_promotion("allow"):  # shared values are broadcast to the lanes
        return in_groups(partial(_follow_group, asked), arguments, num_lanes)


def _follow_group(
    asked: CallSettings, arguments: tuple[MachineNumbers, AbstractFlow, LoopArguments], num_lanes: int
) -> Solution:
    numbers, flow, request = arguments
    request = to_all(request, num_lanes)
    prepare = partial(prepare_loop, room=asked.room, can_stick=asked.can_stick)
    task, last = run_without_derivatives(prepare, (numbers, flow, request), most=UNROLLED)
    written = lambda carry: (carry.log, carry.xs, carry.vs)  # noqa: E731

    def finish_one(lane: tuple[LoopTask, Carry, LoopArguments], rows: tuple[Log, Array, Array]) -> Solution:
        task, last, request = lane
        last = eqx.tree_at(written, last, rows, is_leaf=lambda leaf: leaf is None)
        return finish(task, last, request, asked.room)

    rest = eqx.tree_at(written, last, (None, None, None))
    return one_by_one(finish_one, num_lanes, (task, rest, request), written(last))


def _run_whole(
    machine: ImpactSystem | MachineNumbers,
    flow: AbstractFlow,
    request: LoopArguments,
    asked: CallSettings,
    loop: Callable,
) -> Solution:
    task, carry = prepare_loop(
        _in_numbers(machine), flow, request, room=asked.room, can_stick=asked.can_stick
    )
    return finish(task, loop(task, carry), request, asked.room)


def _in_numbers(machine: ImpactSystem | MachineNumbers) -> MachineNumbers:
    return machine if isinstance(machine, MachineNumbers) else numbers_of(machine)


def run_for_log(
    numbers: MachineNumbers, flow: AbstractFlow, request: LoopArguments, *, room: int, can_stick: bool
) -> tuple[Log, RESULTS, Float[Array, " state"]]:
    """Follow a trajectory without derivatives; its log, result code and end (x, v)."""
    request = jax.tree.map(jnp.asarray, request)
    task, carry = prepare_loop(numbers, flow, request, room=room, can_stick=can_stick)
    last = while_any(task, carry)
    solution = finish(task, last, request, room)
    return last.log, solution.result, jnp.concatenate([solution.x1, solution.v1])


def factor_in_reverse(is_cut: Bool[Array, ""], *, raises: bool) -> Scalar:
    """Factor of reverse-mode derivatives: 1, or NaN or an error if the loop back was too short."""
    factor = jnp.where(is_cut, jnp.nan, 1.0)
    if raises:
        number, sentences = result_sentences(
            RESULTS.where(is_cut, RESULTS.max_reverse_steps_reached, RESULTS.successful)
        )
        factor = factor * checked_one(number, sentences)
    return factor
