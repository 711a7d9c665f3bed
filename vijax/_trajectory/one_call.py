"""One call of the program for all machines of a size, which continues the call before.

Arguments and results are packed into few arrays: the machine, once for all calls, the request, and the progress.
"""

import sys
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array

from .._flow.interface import AbstractFlow
from .._jax.arrays import UNROLLED, UNROLLED_ALONE, Reals
from .._jax.packing import Layout, Packed, layout_of, pack
from .._jax.xla import are_sums_in_kernels, jit_lightly
from .._machine.numbers import MachineNumbers
from .._machine.state import ModeLayout, State, with_memory
from .._machine.tables import KnotsLayout
from .grazing import Grazing
from .instant_codes import codes_of
from .loop import (
    Carry,
    Choices,
    LoopArguments,
    LoopTask,
    finish,
    fits_one_kernel,
    is_over,
    prepare_loop,
    run_loop,
    run_prepared,
    steps_fit_one_kernel,
)
from .solution import Solution

# Bounds of one call: logged events, saved states, and steps, which take less than a second.
EVENTS, GOALS, STEPS = 1024, 256, 1 << 18


class CallProgress(eqx.Module):
    """Progress of a trajectory, from which the next call continues.

    Attributes:
        is_paused: whether another call is needed.
        state: the motion.
        goals: number of goals reached by this call, including the end.
        steps: number of steps so far.
        rows: number of instants logged by this call, in the first call including the start.
        num_events: number of events so far.
        known_until: time of the last logged instant.
        is_finite: whether the motion stayed finite.
        grazing: closest approach to grazing.
    """

    is_paused: Reals
    state: State
    goals: Reals
    steps: Reals
    rows: Reals
    num_events: Reals
    known_until: Reals
    is_finite: Reals
    grazing: Grazing


class Found(NamedTuple):
    """Results of one call; each array takes three microseconds.

    Attributes:
        solution: the trajectory, with the events of this call and the first saved state: most requests have no more.
        saved: saved positions and velocities, (2, goals, n), padded.
        codes: events of the instants of `solution.restarts`, see `instant_codes.py`, (rows, contacts).
        left: progress, packed; its first whole number, in the order of `CallProgress`, tells whether another call is needed.
    """

    solution: Solution
    saved: Array
    codes: Array
    left: Packed

    @property
    def is_paused(self) -> bool:
        """True if the motion goes on in another call."""
        return bool(np.asarray(self.left.wholes)[0])


class KnownMachine:
    """A machine of concrete numbers as calls take it, packed once: it is immutable.

    Attributes:
        packed: its numbers and its flow, packed.

    Args:
        numbers: its numbers.
        flow: its flow.
        can_stick: whether a stop may hold its mass.
    """

    def __init__(self, numbers: MachineNumbers, flow: AbstractFlow, *, can_stick: bool):
        self._prepare(jax.device_put(pack((numbers, flow))), _packed_nothing(numbers, flow), can_stick)

    @classmethod
    def of(cls, packed: Packed) -> "KnownMachine":
        """Machine whose numbers and flow, which has a flow map, are packed already; its stops may hold."""
        machine = cls.__new__(cls)
        numbers, flow = packed.layout.shapes()
        machine._prepare(packed, _packed_nothing(numbers, flow), True)
        return machine

    def _prepare(self, machine: Packed, nothing: Packed, can_stick: bool) -> None:
        self.packed: Packed = machine
        self._nothing, numbers = nothing, machine.layout.shapes()[0]
        n, dtype = numbers.rows.shape[1], np.dtype(numbers.mass.dtype)
        self._num_reals, self._dtype = 2 + 2 * n + GOALS, dtype
        blank = Packed(np.empty(self._num_reals, dtype), np.empty(6, int), _layout_of_request(n, dtype))
        choices = Choices(can_stick, EVENTS, is_whole=False)
        self._call = call.prepared(machine, self._nothing, blank, choices)

    def follow(self, request: LoopArguments, left: Packed | None, machine: Packed | None = None) -> Found:
        """Follow a trajectory by a request of NumPy numbers, from its start or from the progress of the call before.

        Of another `machine` with as many numbers, if that is given.
        """
        left, machine = left or self._nothing, machine or self.packed
        n = len(request.x0)
        reals = np.empty(self._num_reals, self._dtype)
        reals[0], reals[1], reals[2 : 2 + n], reals[2 + n : 2 + 2 * n] = (
            request.t0,
            request.t1,
            request.x0,
            request.v0,
        )
        reals[2 + 2 * n :] = request.goals
        wholes = np.array([int(a) for a in request[5:]])
        return self._call([machine.reals, machine.wholes, left.reals, left.wholes, reals, wholes])


def _packed_nothing(numbers: MachineNumbers, flow: AbstractFlow) -> Packed:
    if _has_memory(flow):
        return jax.device_put(pack(empty_progress(numbers, flow)))
    return _packed_of_shape(*_sizes(numbers))


class _Sizes(NamedTuple):
    """Sizes of the state of a machine."""

    num_contacts: int
    n: int
    num_columns: int
    dtype: np.dtype
    mode: ModeLayout | None
    knots: KnotsLayout | None


def _sizes(numbers: MachineNumbers) -> _Sizes:
    num_contacts, n = numbers.rows.shape
    modes, knots = numbers.mode_layout, numbers.knots_layout
    return _Sizes(num_contacts, n, numbers.num_columns, numbers.mass.dtype, modes, knots)


@lru_cache
def _packed_of_shape(*sizes: Any) -> Packed:
    return jax.device_put(pack(_nothing(_Sizes(*sizes))))


@jit_lightly
def call(machine: Packed, left: Packed, request: Packed, choices: Choices) -> Found:
    """Follow a trajectory of a machine and its flow, from its start or from the progress `left` of the call before."""
    (numbers, flow), asked = machine.layout.shapes(), request.unpacked()
    arguments = machine, request, left
    has_sums = are_sums_in_kernels()
    if fits_one_kernel(numbers, flow, UNROLLED if has_sums else UNROLLED_ALONE):
        begin = partial(_begin, unpack=Packed.unpacked, choices=choices)
        task, last = run_loop(begin, arguments, in_kernel=True)
    else:
        # Otherwise each of fifty arrays would be the result of a kernel.
        begin = partial(_begin, unpack=Packed.unpacked_by_kernel, choices=choices)
        most = sys.maxsize if has_sums else UNROLLED_ALONE
        task, last = run_prepared(*begin(*arguments), in_kernel=steps_fit_one_kernel(numbers, flow, most))
    solution, reached = finish(task, last, asked, choices), _progress(task, last, asked)
    names = lambda s: (s.ts, s.xs, s.vs)  # noqa: E731
    first = eqx.tree_at(names, solution, [a[:1] for a in names(solution)])
    codes = codes_of(last.seen["log"].kept_instants())
    return Found(first, jnp.stack([solution.xs, solution.vs]), codes, pack(reached))


def _begin(
    machine: Packed, request: Packed, left: Packed, unpack: Callable[[Packed], Any], choices: Choices
) -> tuple[LoopTask, Carry]:
    """Loop and carry of a request, from its start or from where the call before stopped."""
    (numbers, flow), asked = unpack(machine), unpack(request)
    task, carry = prepare_loop(numbers, flow, asked, choices)
    carry = _gone_on(carry, unpack(left))
    return eqx.tree_at(lambda t: t.last_step, task, carry.steps + asked.max_turns), carry


def _progress(task: LoopTask, last: Carry, request: LoopArguments) -> CallProgress:
    """Progress of a trajectory at the end of a call."""
    log = last.seen["log"]
    return CallProgress(
        state=last.state,
        goals=last.goal,
        steps=last.steps,
        rows=log.rows,
        num_events=log.num_events,
        known_until=log.known_until,
        is_finite=last.is_finite,
        is_paused=last.is_finite & (last.steps < task.max_steps) & ~is_over(task, last, request),
        grazing=last.seen["grazing"],
    )


def _gone_on(carry: Carry, left: CallProgress) -> Carry:
    """Initial carry of a call: that of the start, or continued from the call before."""
    goes_on = left.steps > 0
    log = eqx.tree_at(
        lambda log: (log.rows, log.num_events, log.events_before, log.known_until),
        carry.seen["log"],
        (jnp.zeros_like(carry.seen["log"].rows), left.num_events, left.num_events, left.known_until),
    )
    before = eqx.tree_at(
        lambda c: (c.state, c.seen["log"], c.steps, c.is_finite, c.seen["grazing"]),
        carry,
        (left.state, log, left.steps, left.is_finite, left.grazing),
    )
    # Empty arrays for events and saved states are the same in both.
    return jax.tree.map(lambda a, b: b if a is b else jnp.where(goes_on, a, b), before, carry)


@lru_cache
def _layout_of_request(n: int, dtype: np.dtype) -> Layout:
    count, real, flag = np.zeros((), int), np.zeros((), dtype), np.zeros((), bool)
    start, goals = np.zeros(n, dtype), np.zeros(GOALS, dtype)
    return layout_of(LoopArguments(real, real, start, start, goals, count, flag, count, count, count, flag))


def empty_progress(numbers: MachineNumbers, flow: AbstractFlow) -> CallProgress:
    """Input of the first call, in the shapes of the progress of a call."""
    left = _nothing(_sizes(numbers))
    if not _has_memory(flow):
        return left
    memory = flow.memory(left.known_until)
    return eqx.tree_at(lambda left: left.state, left, with_memory(left.state, memory))


def _has_memory(flow: AbstractFlow) -> bool:
    return type(flow).memory is not AbstractFlow.memory  # not asked of the flow to save time


@lru_cache
def _nothing(sizes: _Sizes) -> CallProgress:
    num_contacts, n, num_columns, real_type, mode, knots = sizes

    def zeros(dtype: DTypeLike, *shape: int) -> Array:
        return jax.device_put(np.zeros(shape, dtype))

    count, real, flag = zeros(int), zeros(real_type), zeros(bool)
    state = State(
        periods=count,
        time=real,
        time_low=real,
        phase=zeros(real_type, 2, num_columns),
        x=zeros(real_type, n),
        v=zeros(real_type, n),
        gap=zeros(real_type, num_contacts),
        held=zeros(bool, num_contacts),
        contact=zeros(np.int8, num_contacts),
        mode=None if mode is None else mode.idle(zeros(real_type, num_contacts)),
        knots=None if knots is None else knots.blank(real),
    )
    return CallProgress(
        state=state,
        goals=count,
        steps=count,
        rows=count,
        num_events=count,
        known_until=real,
        is_finite=flag,
        is_paused=flag,
        grazing=Grazing(real, real, flag),
    )
