"""Trajectories in one call, with room for the whole request: differentiable, alone or batched."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._flow.interface import AbstractFlow
from .._jax.arrays import UNROLLED, UNROLLED_ALONE
from .._jax.xla import AbstractTask, differentiable, in_lanes_of, not_constant, while_any
from .._machine.laws import kinds_of_elements
from .._machine.numbers import MachineNumbers, numbers_of
from .._system.system import ImpactSystem
from .batched import in_groups, lanes_of_machine, one_by_one, to_all
from .derivative_growth import warn_if_large, watch_closely
from .event_log import Log
from .loop import (
    Carry,
    Choices,
    LoopArguments,
    LoopTask,
    finish,
    prepare_loop,
    result_of,
    run_prepared,
    steps_fit_one_kernel,
)
from .replay import repeat_flights
from .results import RESULTS
from .solution import Solution

_Whole = tuple[ImpactSystem | MachineNumbers, AbstractFlow, LoopArguments, Choices]


def run_single_call(
    machine: ImpactSystem | MachineNumbers, flow: AbstractFlow, request: LoopArguments, choices: Choices
) -> Solution:
    """Follow a trajectory in one call, differentiably."""
    # A program with `throw` calls back into Python anyway.
    watched = watch_closely if choices.raises else warn_if_large
    whole = machine, flow, request, choices
    # Without a flow map, derivatives go along with the steps.
    again = {"smooth": _repeat_whole, "smooth_many": _repeat_many} if flow.has_flow_map else {}
    return differentiable(
        _run_whole,
        whole,
        has_parts=machine.is_switching,
        is_large=machine.is_switching and _has_several_kinds(machine),
        many=_run_many,
        watch=watched,
        always=_end_of,
        **again,
    )


def _has_several_kinds(machine: ImpactSystem | MachineNumbers) -> bool:
    """Whether elements of more than one kind, of which one switches forces, stand in a machine."""
    if isinstance(machine, ImpactSystem):
        return len(set(kinds_of_elements(machine))) > 1
    return machine.laws is not None and len(set(machine.laws.kinds)) > 1


def _end_of(solution: Solution) -> tuple:
    return solution.x1, solution.v1


def _run_whole(whole: _Whole) -> Solution:
    machine, flow, request, choices = whole
    numbers = _in_numbers(machine)
    task, carry = prepare_loop(numbers, flow, request, choices)
    has_parts = numbers.is_switching
    # Steps between the knots of a record are many and small; parts of a step that switches forces save its compilation.
    in_kernel = (has_parts or numbers.tables is not None) and steps_fit_one_kernel(
        numbers, flow, UNROLLED_ALONE
    )
    task, last = run_prepared(task, carry, in_kernel=in_kernel, has_parts=has_parts)
    return finish(task, last, request, choices)


def _repeat_whole(whole: _Whole, wanted: Solution) -> Solution:
    machine, flow, request, choices = whole
    numbers = _in_numbers(machine)
    task, carry = prepare_loop(numbers, flow, request, choices)
    in_kernel = steps_fit_one_kernel(numbers, flow, UNROLLED_ALONE)
    last = repeat_flights(task, carry, **_needs(wanted), in_kernel=in_kernel)
    return finish(task, last, request, choices)


def _needs(wanted: Solution) -> dict[str, bool]:
    """Derivatives to compute: those of the log, and those of the saved states."""
    is_any_wanted = lambda part: any(jax.tree.leaves(part))  # noqa: E731
    return {
        "has_log": is_any_wanted((wanted.events, wanted.restarts, wanted.known_until)),
        "has_saved": is_any_wanted((wanted.xs, wanted.vs)),
    }


def _run_many(whole: _Whole, num_lanes: int) -> Solution:
    """Follow trajectories with lanes last; the results have lanes first."""
    return _follow_many(run_prepared, whole, num_lanes)


def _repeat_many(whole: _Whole, wanted: Solution, num_lanes: int) -> Solution:
    """Follow trajectories as `_run_many` does, differentiably in forward mode."""

    def repeat(task: LoopTask, carry: Carry, *, in_kernel: bool) -> tuple[LoopTask, Carry]:
        return task, repeat_flights(task, carry, **_needs(wanted), in_kernel=in_kernel)

    return _follow_many(repeat, whole, num_lanes)


def _follow_many(run: Callable, whole: _Whole, num_lanes: int) -> Solution:
    machine, flow, request, choices = whole
    arguments = not_constant((_in_numbers(machine), flow, request))
    num_contacts, n = arguments[0].rows.shape[:2]
    with jax.numpy_rank_promotion("allow"):  # shared values are broadcast to the lanes
        follow = partial(_follow_group, run, choices)
        return in_groups(follow, arguments, num_lanes, lanes_of_machine(n, num_contacts))


def _follow_group(
    run: Callable,
    choices: Choices,
    arguments: tuple[MachineNumbers, AbstractFlow, LoopArguments],
    num_lanes: int,
) -> Solution:
    numbers, flow, request = arguments
    request = to_all(request, num_lanes)
    task, carry = prepare_loop(numbers, flow, request, choices)
    task, last = run(task, carry, in_kernel=steps_fit_one_kernel(numbers, flow, UNROLLED))
    written = lambda carry: (carry.seen["log"], carry.seen["saved"])  # noqa: E731

    def finish_one(lane: tuple[LoopTask, Carry, LoopArguments], rows: tuple[Log, tuple]) -> Solution:
        task, last, request = lane
        last = eqx.tree_at(written, last, rows, is_leaf=lambda leaf: leaf is None)
        return finish(task, last, request, choices)

    rest = eqx.tree_at(written, last, (None, None))
    return one_by_one(finish_one, num_lanes, (task, rest, request), written(last))


def _in_numbers(machine: ImpactSystem | MachineNumbers) -> MachineNumbers:
    return machine if isinstance(machine, MachineNumbers) else numbers_of(machine)


def run_for_log(
    numbers: MachineNumbers, flow: AbstractFlow, request: LoopArguments, choices: Choices
) -> tuple[Log, RESULTS, Float[Array, " state"]]:
    """Follow a trajectory without derivatives; its log, result code and end (x, v)."""
    request = jax.tree.map(jnp.asarray, request)
    task, carry = prepare_loop(numbers, flow, request, choices)
    last = while_any(_without_grazing(task), in_lanes_of(request.x0, carry))
    return (
        last.seen["log"],
        result_of(task, last, request),
        jnp.concatenate(task.machine.in_space(last.state)),
    )


def run_with_jacobian(
    numbers: MachineNumbers, flow: AbstractFlow, request: LoopArguments, choices: Choices
) -> tuple[Solution, Log, Float[Array, "state state"]]:
    """Follow a trajectory once for its solution, its log and the derivative of its end (x, v) by its start."""
    request = jax.tree.map(jnp.asarray, request)

    def end_of(z: Float[Array, " state"]) -> tuple[Float[Array, " state"], tuple[Solution, Log]]:
        x0, v0 = jnp.split(z, 2)
        own = request._replace(x0=x0, v0=v0)
        task, carry = prepare_loop(numbers, flow, own, choices)
        task = _without_grazing(task)
        last = while_any(_WithoutRecords(task), in_lanes_of(z, carry))
        solution = finish(task, last, own, choices)
        return jnp.concatenate([solution.x1, solution.v1]), (solution, last.seen["log"])

    jacobian, (solution, log) = jax.jacfwd(end_of, has_aux=True)(jnp.concatenate([request.x0, request.v0]))
    return solution, log, jacobian


class _WithoutRecords(AbstractTask):
    """A loop of which the motion alone has derivatives, not what is recorded of it."""

    task: LoopTask

    def is_live(self, carry: Carry) -> Bool[Array, "..."]:
        return self.task.is_live(carry)

    def step(self, carry: Carry) -> Carry:
        after = self.task.step(carry)
        return replace(after, seen=jax.lax.stop_gradient(after.seen))


def _without_grazing(task: LoopTask) -> LoopTask:
    """The loop of motions whose closest approach to grazing is not asked for."""
    return replace(task, observers={name: one for name, one in task.observers.items() if name != "grazing"})
