"""Scheduler of many branches: the kernel for which most of them wait runs next, batched over these in one call."""

from collections.abc import Callable, Generator, Hashable, Sequence as Many
from functools import cache
from typing import Any

import jax
import numpy as np

from .._jax.packing import Layout, Packed, pack
from .._jax.xla import jit_for_lanes, jit_lightly
from .._orbits.sequence import NOTHING, Sequence
from .batched_steps import (
    SHORTEST,
    BranchProgress,
    PlainSteps,
    StepState,
    Tried,
    batch_rows_of,
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
    corrected_cycles,
    padded,
    room_for,
    simulate_motion,
)
from .parameter_family import ExtendedCycle, Family
from .point import BranchPoint, PlainPoint, TooManyEvents

# `_FEW`, `_MANY`: batch sizes for which kernels are compiled; the larger one runs as often as there are branches for it.
# `_WORTH_IT`: fewest branches for which the larger one is compiled.
# `_CHEAPER`: fewest branches for which it is taken once it is compiled.
_FEW, _MANY, _WORTH_IT, _CHEAPER = 2, 64, 17, 5


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
    """Stacked families of one tree structure and shapes; several tasks may share one."""

    def __init__(self, families: dict[int, Family]):
        own = {id(family): family for family in families.values()}
        self.rows = pack(_stack(list(own.values())), has_rows=True)
        rows = {one: row for row, one in enumerate(own)}
        self.place = {k: rows[id(family)] for k, family in families.items()}

    def of(self, tasks: Many[int]) -> Packed:
        """Families of some tasks."""
        return self.rows.at(np.array([self.place[k] for k in tasks]))


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
        """Answer all requests."""
        now, self.waiting = self.waiting, []
        tasks = [task for task, _ in now]
        rows = _stack([padded(request.sequence, request.arguments, self.room) for _, request in now])
        found = _call(self.program, self.stock.of(tasks), rows).unpacked()
        leaves, structure = jax.tree.flatten(found)
        return {
            task: jax.tree.unflatten(structure, [leaf[k] for leaf in leaves]) for k, task in enumerate(tasks)
        }


class _PlainStepBatch:
    """Branches that take plain steps."""

    def __init__(self, stock: _Stock, room: int):
        self.stock, self.room = stock, room
        self.members: list[tuple[int, PlainSteps]] = []
        self.new: list[tuple[int, PlainSteps]] = []
        self.points: list[BranchPoint | PlainPoint] = []
        self.state: Any = None
        self.families: Packed | None = None

    def __len__(self) -> int:
        return len(self.members) + len(self.new)

    def add(self, task: int, requests: PlainSteps) -> None:
        """Add a branch."""
        self.new.append((task, requests))

    def answer(self) -> dict[int, Any]:
        """Step all branches; return those whose next step is not plain, or that are full."""
        self._join()
        known, ways = self.state
        families = self._families()
        guess, weights, targets = predictions(known, ways.ds)
        rows = _call(corrected_cycle, families, (known.sequence, guess, weights, targets), is_long=True)
        seen: CorrectedCycle = rows.unpacked()
        new = step_state_of(known.sequence, seen.found.place, seen)
        sound = is_accepted(seen.found, inner_products(new.tangent, known.tangent), ways.ds)
        sound &= is_resolved(known, new, ways.ds)
        plain = sound & is_plain(known, new, ways)
        taken, motions = self._confirmed(families, known, new, seen, plain)
        length = next_length(seen.found, known, new, ways.ds, ways.longest)
        known = new if taken.all() else jax.tree.map(lambda a, b: _where(taken, a, b), new, known)
        arc = np.where(taken, ways.arc + ways.ds, ways.arc)
        ds = np.where(taken, length, np.where(sound, ways.ds, ways.ds / 2))
        self._add_points(taken, rows, arc)
        is_full = np.array([requests.walk.is_full for _, requests in self.members])
        is_left = (sound & ~taken) | (ds < SHORTEST) | is_full
        tried = {
            k: Tried(PlainPoint(self.points[k].sequence, rows, k, arc[k] + ds[k]).alone(), motions.get(k))
            for k in map(int, np.flatnonzero(is_left & sound & ~taken))
        }
        return self._moved_on(known, ways._replace(ds=ds, arc=arc), is_left, tried)

    def _confirmed(
        self, families: Packed, known: StepState, new: StepState, seen: CorrectedCycle, plain: np.ndarray
    ) -> tuple[np.ndarray, dict[int, SimulatedMotion]]:
        """Flags of the plain steps at whose ends the machine follows the cycle with as many events.

        Also its motions where it only has other bounces of a chatter. (Where it seems to leave the cycle there may
        have been no room for its events.)
        """
        which = np.flatnonzero(plain)
        if not which.size:
            return plain, {}
        sequences, places = _taken((known.sequence, new.place), which)
        families = families.at(which)
        if _size_for(simulate_motion, families) == _FEW:
            sequences, places = _widened(sequences, places, max(self.room, ROOM_OF_SIMULATION))
        own_start = np.full_like(places.z, np.nan)
        motions: SimulatedMotion = _call(simulate_motion, families, (sequences, places, own_start)).unpacked()
        known, seen = _taken((known, seen), which)
        follows = follows_cycle(known, seen, motions)
        taken = plain.copy()
        taken[which] = follows
        return taken, {int(which[k]): _taken(motions, k) for k in np.flatnonzero(motions.is_alike & ~follows)}

    def _join(self) -> None:
        """Append the new branches to the batch."""
        if not self.new:
            return
        rows = batch_rows_of([requests for _, requests in self.new])
        self.state = jax.tree.map(lambda *a: np.concatenate(a), self.state, rows) if self.members else rows
        self.members += self.new
        self.points += [requests.point for _, requests in self.new]
        self.new, self.families = [], None

    def _families(self) -> Packed:
        """Families of the batch, cached because they rarely change from step to step."""
        if self.families is None:
            self.families = self.stock.of([task for task, _ in self.members])
        return self.families

    def _add_points(self, taken: np.ndarray, rows: Packed, arc: np.ndarray) -> None:
        """Add the points of the branches that have taken a step."""
        for k in np.flatnonzero(taken):
            self.points[k] = PlainPoint(self.points[k].sequence, rows, int(k), float(arc[k]))
            self.members[k][1].walk.points.append(self.points[k])

    def _moved_on(
        self, known: StepState, ways: BranchProgress, is_left: np.ndarray, tried: dict[int, Tried]
    ) -> dict[int, Any]:
        """Store the new state of the batch, remove the branches that leave it, and return their answers."""
        gone = np.flatnonzero(is_left)
        alone = lambda point: point.alone() if isinstance(point, PlainPoint) else point  # noqa: E731
        left = {
            self.members[k][0]: (alone(self.points[k]), float(ways.ds[k]), tried.get(int(k))) for k in gone
        }
        self.state = known, ways
        if left:
            order = np.delete(np.arange(len(self.members)), gone)
            self.state = _taken(self.state, order)
            self.members, self.points = [self.members[k] for k in order], [self.points[k] for k in order]
            self.families = None
        return left


def _stocked(families: Many[Family]) -> tuple[list[Hashable], dict[Hashable, _Stock]]:
    """Make (tree structure and shapes) of each family, and the stacked families of each make."""
    members: dict[Hashable, dict[int, Family]] = {}
    makes, known = [], {}
    for k, family in enumerate(families):
        if id(family) not in known:
            leaves, structure = jax.tree.flatten(family)
            known[id(family)] = (structure, *(np.shape(a) for a in leaves))
        makes.append(known[id(family)])
        members.setdefault(makes[-1], {})[k] = family
    return makes, {make: _Stock(own) for make, own in members.items()}


# Kernels, with the layout of families, for which the larger batches were compiled in this process.
_made: set[tuple[Callable, Layout]] = set()
# Forms of kernels for very many branches; to compile them takes twice as long.
_OF_MANY: dict[Callable, Callable] = {corrected_cycle: corrected_cycles}
# `_VERY_MANY`: fewest branches for which these are compiled, and then taken for the same layouts.
_VERY_MANY, _written_out = 256, set[tuple[Callable, Layout, Layout]]()


def _size_for(program: Callable, families: Packed) -> int:
    """Batch size in which requests for a kernel are answered, one for each family."""
    least = _CHEAPER if (program, families.layout) in _made else _WORTH_IT
    return _MANY if len(families.reals) >= least else _FEW


def _call(program: Callable, families: Packed, rows: Any, *, is_long: bool = False) -> Packed:
    """Packed results of a kernel for rows of families and of its other arguments, computed batch by batch.

    `is_long` is True where many more calls follow.
    """
    arguments, num, size = pack(rows, has_rows=True), len(families.reals), _size_for(program, families)
    run = _compiled_by_row(program)
    if size == _MANY:
        _made.add((program, families.layout))
        layouts = program, families.layout, arguments.layout
        if program in _OF_MANY and (layouts in _written_out or (is_long and num >= _VERY_MANY)):
            _written_out.add(layouts)
            run = _compiled(_OF_MANY[program])
    # The last batch is filled up with its last row.
    parts = [np.minimum(np.arange(k, k + size), num - 1) for k in range(0, num, size)]
    found = [run(families.at(part), arguments.at(part)).in_numpy() for part in parts]
    reals, wholes = (
        np.concatenate(own)[:num] for own in zip(*((a.reals, a.wholes) for a in found), strict=True)
    )
    return Packed(reals, wholes, found[0].layout)


@cache
def _compiled_by_row(program: Callable) -> Callable:
    """A compiled kernel of packed rows, batched by `vmap`."""

    def of_rows(families: Packed, arguments: Packed) -> Packed:
        def of_row(family: Packed, arguments: Packed) -> Packed:
            return pack(program(family.unpacked(), *arguments.unpacked()))

        return jax.vmap(of_row)(families, arguments)

    of_rows.__name__ = program.__name__  # its name in profiles
    return jit_lightly(of_rows, name=(program.__module__, program.__qualname__))


@cache
def _compiled(program: Callable) -> Callable:
    """A compiled kernel of packed rows that is itself one of many."""

    def of_rows(families: Packed, arguments: Packed) -> Packed:
        return pack(program(families.unpacked(), *arguments.unpacked()), has_rows=True)

    of_rows.__name__ = program.__name__
    return jit_for_lanes(of_rows, name=(program.__module__, program.__qualname__))


def _stack(trees: list) -> Any:
    return jax.tree.map(lambda *a: np.stack(a), *trees)


def _taken(tree: Any, rows: Any) -> Any:
    return jax.tree.map(lambda a: a[rows], tree)


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
