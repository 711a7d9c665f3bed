"""Trajectories in one call, with room for the whole request: differentiable, alone or batched."""

from collections.abc import Callable
from functools import partial

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
from .batched import in_groups, lanes_of_machine, one_by_one, to_all
from .derivative_growth import warn_if_large, watch_closely
from .event_log import Log
from .loop import Carry, Choices, LoopArguments, LoopTask, finish, prepare_loop, run_prepared
from .solution import RESULTS, Solution, result_sentences


def run_single_call(
    machine: ImpactSystem | MachineNumbers, flow: AbstractFlow, request: LoopArguments, choices: Choices
) -> Solution:
    """Follow a trajectory in one call, differentiably."""
    # A program with `throw` calls back into Python anyway.
    watched = watch_closely if choices.raises else warn_if_large
    return differentiable(_forwards, _backwards, (machine, flow, request, choices), _side_by_side, watched)


def _forwards(
    whole: tuple[ImpactSystem | MachineNumbers, AbstractFlow, LoopArguments, Choices],
) -> Solution:
    return _run_whole(*whole, while_any)


def _backwards(
    whole: tuple[ImpactSystem | MachineNumbers, AbstractFlow, LoopArguments, Choices],
) -> Solution:
    choices = whole[3]
    refuse = partial(factor_in_reverse, raises=choices.raises)
    return _run_whole(*whole, partial(bounded_while_any, max_steps=choices.max_reverse_steps, refuse=refuse))


def _side_by_side(
    whole: tuple[ImpactSystem | MachineNumbers, AbstractFlow, LoopArguments, Choices], num_lanes: int
) -> Solution:
    """Follow trajectories with lanes last; the results have lanes first."""
    machine, flow, request, choices = whole
    arguments = not_constant((_in_numbers(machine), flow, request))
    num_contacts, n = arguments[0].rows.shape[:2]
    with jax.numpy_rank_promotion("allow"):  # shared values are broadcast to the lanes
        follow = partial(_follow_group, choices)
        return in_groups(follow, arguments, num_lanes, lanes_of_machine(n, num_contacts))


def _follow_group(
    choices: Choices, arguments: tuple[MachineNumbers, AbstractFlow, LoopArguments], num_lanes: int
) -> Solution:
    numbers, flow, request = arguments
    request = to_all(request, num_lanes)
    task, carry = not_constant(prepare_loop(numbers, flow, request, choices))
    task, last = run_prepared(task, carry, most=UNROLLED)
    written = lambda carry: (carry.log, carry.xs, carry.vs)  # noqa: E731

    def finish_one(lane: tuple[LoopTask, Carry, LoopArguments], rows: tuple[Log, Array, Array]) -> Solution:
        task, last, request = lane
        last = eqx.tree_at(written, last, rows, is_leaf=lambda leaf: leaf is None)
        return finish(task, last, request, choices)

    rest = eqx.tree_at(written, last, (None, None, None))
    return one_by_one(finish_one, num_lanes, (task, rest, request), written(last))


def _run_whole(
    machine: ImpactSystem | MachineNumbers,
    flow: AbstractFlow,
    request: LoopArguments,
    choices: Choices,
    loop: Callable,
) -> Solution:
    task, carry = prepare_loop(_in_numbers(machine), flow, request, choices)
    return finish(task, loop(task, carry), request, choices)


def _in_numbers(machine: ImpactSystem | MachineNumbers) -> MachineNumbers:
    return machine if isinstance(machine, MachineNumbers) else numbers_of(machine)


def run_for_log(
    numbers: MachineNumbers, flow: AbstractFlow, request: LoopArguments, choices: Choices
) -> tuple[Log, RESULTS, Float[Array, " state"]]:
    """Follow a trajectory without derivatives; its log, result code and end (x, v)."""
    request = jax.tree.map(jnp.asarray, request)
    task, carry = prepare_loop(numbers, flow, request, choices)
    last = while_any(task, carry)
    solution = finish(task, last, request, choices)
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
