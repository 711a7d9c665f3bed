"""Scheduler of many branches: the kernel for which most of them wait runs next, batched over these in one call."""

from collections.abc import Callable, Generator, Hashable, Sequence as Many
from functools import cache
from typing import Any

import jax
import numpy as np

from .._jax.packing import Packed, pack
from .._jax.xla import jit_lightly
from .._orbits.sequence import NOTHING, Sequence
from .batched_steps import (
    SHORTEST,
    PlainSteps,
    batch_row_of,
    follows_cycle,
    inner_products,
    is_accepted,
    is_plain,
    is_resolved,
    next_length,
    predictions,
    step_state_of,
)
from .kernels import (
    MOST_EVENTS,
    ROOM_OF_SIMULATION,
    CorrectedCycle,
    KernelCall,
    SimulatedMotion,
    corrected_cycle,
    padded,
    room_for,
    simulate_motion,
)
from .parameter_family import ExtendedCycle, Family
from .point import BranchPoint, PlainPoint, TooManyEvents

# _SIZES: batch sizes for which kernels are compiled, each with the least number of branches that is worth it.
# _MOST_EVENTS: most padded events in a batch of more than 64, as derivatives take memory.
_SIZES, _MOST_EVENTS = ((2, 1), (64, 17), (1024, 513)), 16_384


def drive(families: Many[Family], tasks: Many[Generator], tell_progress: Callable[[], Any]) -> list[Any]:
    """Run tasks, each with its family, side by side: they yield requests and are sent the answers.

    Returns what the tasks return; `tell_progress` is called once a round.
    """
    results: list[Any] = [None] * len(tasks)
    makes, stocks = _stocked(families)
    groups: dict[tuple, _Calls | _PlainStepBatch] = {}
    replies: dict[int, Any] = dict.fromkeys(range(len(tasks)))
    while True:
        for k, reply in replies.items():
            try:
                requests = _next_request(tasks[k], reply)
            except StopIteration as end:
                results[k] = end.value
                continue
            program = getattr(requests, "program", None)
            room = _room_for(program, requests.sequence)
            key = program, room, makes[k]
            if key not in groups:
                stock = stocks[makes[k]]
                groups[key] = _Calls(stock, room, program) if program else _PlainStepBatch(stock, room)
            groups[key].add(k, requests)
        largest = max(groups.values(), key=len, default=())
        if not largest:
            return results
        replies = largest.answer()
        tell_progress()


def _next_request(task: Generator, reply: Any) -> Any:
    """Next request of a task after a reply; one with too many events throws `TooManyEvents` into this task alone."""
    requests = task.send(reply)
    while len(requests.sequence.kind) > MOST_EVENTS:
        requests = task.throw(TooManyEvents("max_events"))
    return requests


def answer(family: Family, request: KernelCall) -> Any:
    """Answer a single request."""
    room = _room_for(request.program, request.sequence)
    calls = _Calls(_Stock({0: family}), room, request.program)
    calls.add(0, request)
    return calls.answer()[0]


def _room_for(program: Callable | None, sequence: Sequence) -> int:
    """Padded number of events for a request."""
    room = room_for(len(sequence.kind))
    return max(room, ROOM_OF_SIMULATION) if program is simulate_motion else room


class _Stock:
    """Stacked families of one tree structure and shapes."""

    def __init__(self, families: dict[int, Family]):
        self.rows = pack(_stack(list(families.values())), has_rows=True)
        self.place = {k: row for row, k in enumerate(families)}

    def of(self, tasks: Many[int], size: int) -> Packed:
        """Families of some tasks, padded to a batch size with the first."""
        rows = [self.place[k] for k in tasks]
        return self.rows.at(np.array(rows + rows[:1] * (size - len(rows))))


class _Calls:
    """Waiting requests for one kernel."""

    def __init__(self, stock: _Stock, room: int, program: Callable):
        self.stock, self.room, self.program = stock, room, program
        self.waiting: list[tuple[int, KernelCall]] = []

    def __len__(self) -> int:
        return len(self.waiting)

    def add(self, task: int, request: KernelCall) -> None:
        """Add a request."""
        self.waiting.append((task, request))

    def answer(self) -> dict[int, Any]:
        """Answer as many requests as fit into one call."""
        size = _size_for(len(self), self.room)
        now, self.waiting = self.waiting[:size], self.waiting[size:]
        tasks = [task for task, _ in now]
        rows = _stack([padded(request.sequence, request.arguments, self.room) for _, request in now])
        found = _call(self.program, self.stock.of(tasks, size), *_filled(rows, size))
        return {task: found.at(k).unpacked() for k, task in enumerate(tasks)}


class _PlainStepBatch:
    """Branches that take plain steps."""

    def __init__(self, stock: _Stock, room: int):
        self.stock, self.room = stock, room
        self.members: list[tuple[int, PlainSteps]] = []
        self.new: list[tuple[int, PlainSteps]] = []
        self.points: list[BranchPoint | PlainPoint] = []
        self.state: Any = None
        self.fixed: tuple | None = None

    def __len__(self) -> int:
        return len(self.members) + len(self.new)

    def add(self, task: int, requests: PlainSteps) -> None:
        """Add a branch."""
        self.new.append((task, requests))

    def answer(self) -> dict[int, Any]:
        """Step as many branches as fit into one call; return those whose next step is not plain, or that are full."""
        self._join()
        size = _size_for(len(self), self.room)
        num = min(size, len(self))
        known, ways = _taken(self.state, slice(num))
        families, sequences = self._fixed(num, size)
        guess, weights, targets = predictions(known, ways.ds)
        rows = _call(corrected_cycle, families, sequences, *_filled((guess, weights, targets), size)).at(
            slice(num)
        )
        seen: CorrectedCycle = rows.unpacked()
        new = step_state_of(known.sequence, seen.found.place, seen)
        sound = is_accepted(seen.found, inner_products(new.tangent, known.tangent), ways.ds)
        sound &= is_resolved(known, new, ways.ds)
        taken = sound & is_plain(known, new, ways)
        if taken.any():
            places = _filled(new.place, size)
            if size == _SIZES[0][0]:
                sequences, places = _widened(sequences, places, max(self.room, ROOM_OF_SIMULATION))
            own_start = np.full_like(places.z, np.nan)
            rows_of_motions = _call(simulate_motion, families, sequences, places, own_start)
            followed: SimulatedMotion = rows_of_motions.at(slice(num)).unpacked()
            taken &= follows_cycle(known, seen, followed)
        length = next_length(seen.found, known, new, ways.ds)
        known = new if taken.all() else jax.tree.map(lambda a, b: _where(taken, a, b), new, known)
        arc = np.where(taken, ways.arc + ways.ds, ways.arc)
        ds = np.where(taken, length, np.where(sound, ways.ds, ways.ds / 2))
        self._add_points(taken, rows, arc)
        is_full = np.array([requests.walk.is_full for _, requests in self.members[:num]])
        return self._moved_on(
            known, ways._replace(ds=ds, arc=arc), (sound & ~taken) | (ds < SHORTEST) | is_full
        )

    def _join(self) -> None:
        """Append the new branches to the batch."""
        if not self.new:
            return
        rows = _stack([batch_row_of(requests) for _, requests in self.new])
        self.state = jax.tree.map(lambda *a: np.concatenate(a), self.state, rows) if self.members else rows
        self.members += self.new
        self.points += [requests.point for _, requests in self.new]
        self.new, self.fixed = [], None

    def _fixed(self, num: int, size: int) -> tuple:
        """Padded families and sequences of the batch, cached because they rarely change from step to step."""
        if self.fixed is None or self.fixed[0] != (num, size):
            families = self.stock.of([task for task, _ in self.members[:num]], size)
            sequences = _filled(_taken(self.state[0].sequence, slice(num)), size)
            self.fixed = (num, size), (families, sequences)
        return self.fixed[1]

    def _add_points(self, taken: np.ndarray, rows: Packed, arc: np.ndarray) -> None:
        """Add the points of the branches that have taken a step."""
        for k in np.flatnonzero(taken):
            self.points[k] = PlainPoint(self.points[k].sequence, rows, int(k), float(arc[k]))
            self.members[k][1].walk.points.append(self.points[k])

    def _moved_on(self, known: Any, ways: Any, is_left: np.ndarray) -> dict[int, Any]:
        """Store the new state of the batch, remove the branches that leave it, and return their answers."""
        num, gone = len(is_left), np.flatnonzero(is_left)
        alone = lambda point: point.alone() if isinstance(point, PlainPoint) else point  # noqa: E731
        left = {self.members[k][0]: (alone(self.points[k]), float(ways.ds[k])) for k in gone}
        for old, new in zip(jax.tree.leaves(self.state), jax.tree.leaves((known, ways)), strict=True):
            old[:num] = new
        if left:
            order = np.delete(np.arange(len(self.members)), gone)
            self.state = _taken(self.state, order)
            self.members, self.points = [self.members[k] for k in order], [self.points[k] for k in order]
            self.fixed = None
        return left


def _stocked(families: Many[Family]) -> tuple[list[Hashable], dict[Hashable, _Stock]]:
    """Make (tree structure and shapes) of each family, and the stacked families of each make."""
    members: dict[Hashable, dict[int, Family]] = {}
    makes = []
    for k, family in enumerate(families):
        leaves, structure = jax.tree.flatten(family)
        makes.append((structure, *(np.shape(a) for a in leaves)))
        members.setdefault(makes[-1], {})[k] = family
    return makes, {make: _Stock(own) for make, own in members.items()}


def _size_for(num: int, room: int) -> int:
    """Batch size for a number of requests."""
    sizes = [size for size, least in _SIZES if num >= least and (size <= 64 or size * room <= _MOST_EVENTS)]
    return sizes[-1]


def _call(program: Callable, families: Packed, *rows: Any) -> Packed:
    """Packed results of a kernel for rows of families and of its other arguments."""
    return _compiled(program)(families, pack(rows, has_rows=True)).in_numpy()


@cache
def _compiled(program: Callable) -> Callable:
    """A compiled kernel of packed rows."""

    def of_rows(families: Packed, arguments: Packed) -> Packed:
        def of_row(family: Packed, arguments: Packed) -> Packed:
            return pack(program(family.unpacked(), *arguments.unpacked()))

        return jax.vmap(of_row)(families, arguments)

    of_rows.__name__ = program.__name__  # its name in profiles
    return jit_lightly(of_rows, name=(program.__module__, program.__qualname__))


def _stack(trees: list) -> Any:
    return jax.tree.map(lambda *a: np.stack(a), *trees)


def _taken(tree: Any, rows: Any) -> Any:
    return jax.tree.map(lambda a: a[rows], tree)


def _filled(tree: Any, size: int) -> Any:
    """Pad rows to a batch size with the first row."""
    num = len(jax.tree.leaves(tree)[0])
    rows = np.append(np.arange(num), np.zeros(size - num, int))
    return tree if num == size else _taken(tree, rows)


def _widened(sequences: Sequence, places: ExtendedCycle, room: int) -> tuple[Sequence, ExtendedCycle]:
    """A batch of padded cycles with more padding."""
    more = ((0, 0), (0, room - sequences.kind.shape[1]))
    wide = Sequence(
        kind=np.pad(sequences.kind, more, constant_values=NOTHING),
        stop=np.pad(sequences.stop, more),
        mode=np.pad(sequences.mode, (*more, (0, 0)), mode="edge"),
    )
    return wide, places._replace(flights=np.pad(places.flights, more))


def _where(is_new: np.ndarray, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    return np.where(is_new.reshape(-1, *[1] * (new.ndim - 1)), new, old)
