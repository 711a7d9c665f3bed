"""Scheduler of many branches: the kernel for which most of them wait runs next, batched over these in one call."""

from collections.abc import Callable, Sequence as Many
from dataclasses import replace
from typing import Any

from .._jax.garbage import with_rare_garbage_collection
from .._orbits.sequence import NOTHING
from .batches import FamilyStack, call, makes_of, stacked
from .kernels import simulate_motion
from .motions import simulated
from .padding import MOST_EVENTS, ROOM_OF_SIMULATION, padded, padded_for_run, room_for, trimmed
from .parameter_family import ParameterFamily
from .point import TooManyEvents
from .requests import HostCall, KernelCall, Requests, T
from .step_batch import PARTS, StepBatch
from .steps import PlainSteps


def drive(
    families: Many[ParameterFamily], tasks: Many[Requests[T]], tell_progress: Callable[[], Any]
) -> list[T]:
    """Run tasks, each with its family, side by side: they yield requests and are sent the answers.

    Returns what the tasks return; `tell_progress` is called once a round.
    """
    results: list[Any] = [None] * len(tasks)
    makes, stacks = makes_of(families)
    groups: dict[tuple, _Calls | StepBatch] = {}
    replies: dict[int, Any] = dict.fromkeys(range(len(tasks)))
    with with_rare_garbage_collection():
        while True:
            for k, reply in replies.items():
                stack = stacks[makes[k]]
                try:
                    request = _next_request(families[k], stack, tasks[k], reply)
                except StopIteration as end:
                    results[k] = end.value
                    continue
                program = request.program if isinstance(request, KernelCall) else None
                room = room_for(len(request.sequence.kind))
                if program in PARTS and not stack.has_second:
                    program = None
                key = program, room, makes[k]
                if key not in groups:
                    groups[key] = _Calls(stack, room, program) if program else StepBatch(stack, room)
                groups[key].add(k, request)
            largest = max(groups.values(), key=len, default=())
            if not largest:
                return results
            replies = largest.answer()
            tell_progress()


def _next_request(
    family: ParameterFamily, stack: FamilyStack, task: Requests[Any], reply: Any
) -> KernelCall[Any] | PlainSteps:
    """Next request of a task after a reply; one with too many events throws `TooManyEvents` into this task alone."""
    request = task.send(reply)
    while isinstance(request, HostCall):
        request = task.send(request.answer(family, stack.known))
    while len(request.sequence.kind) > MOST_EVENTS:
        request = task.throw(TooManyEvents("max_events"))
    assert isinstance(request, KernelCall | PlainSteps)
    return _without_padding(request) if isinstance(request, KernelCall) else request


def _without_padding(request: KernelCall[T]) -> KernelCall[T]:
    """A request for a simulation that fits `ROOM_OF_SIMULATION`, without padding: it would ask for a program of its own."""
    kind = request.sequence.kind
    if request.program is not simulate_motion or len(kind) > ROOM_OF_SIMULATION:
        return request
    num = int((kind != NOTHING).sum())
    place, *others = request.arguments
    return replace(request, sequence=trimmed(request.sequence, num), arguments=(trimmed(place, num), *others))


def answer(family: ParameterFamily, request: KernelCall[T]) -> T:
    """Answer a single request."""
    calls = _Calls(FamilyStack({0: family}), room_for(len(request.sequence.kind)), request.program)
    calls.add(0, request)
    return calls.answer()[0]


class _Calls:
    """Waiting requests for one kernel.

    Args:
        stack: families of the branches.
        room: padded number of events of their cycles.
        program: the kernel.
    """

    def __init__(self, stack: FamilyStack, room: int, program: Callable):
        self.stack, self.room, self.program = stack, room, program
        self.waiting: list[tuple[int, KernelCall]] = []

    def __len__(self) -> int:
        return len(self.waiting)

    def add(self, task: int, request: KernelCall | PlainSteps) -> None:
        """Add a request."""
        assert isinstance(request, KernelCall)
        self.waiting.append((task, request))

    def answer(self) -> dict[int, Any]:
        """Answer all requests."""
        now, self.waiting = self.waiting, []
        tasks = [task for task, _ in now]
        if self.program is simulate_motion:
            own = [padded_for_run(request.sequence, request.arguments, self.room) for _, request in now]
            return simulated(self.stack, tasks, own)
        rows = [padded(request.sequence, request.arguments, self.room) for _, request in now]
        return call(self.program, self.stack, tasks, stacked(rows))
