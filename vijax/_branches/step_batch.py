"""Steps of many branches in one batch: their requests as rows of arrays, and the points of the steps that were taken."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .._jax.packing import Packed, pack
from .._orbits.sequence import Sequence
from .batches import SINGLES, Stock, compiled_steps, in_parts, joined, stacked
from .followed_steps import followed
from .kernels import (
    CorrectedCycle,
    SimulatedMotion,
    corrected_cycle,
    padded,
    padded_for_run,
    simulate_motion,
)
from .motions import simulated
from .parameter_family import ExtendedCycle
from .point import BranchPoint, PlainPoint
from .requests import KernelCall
from .step_kernel import Stepped, StepRequest, blank_cycle
from .steps import PlainSteps, StepLimits, Tried
from .tolerances import SHORTEST_STEP

# Kernels of which `take_steps` consists.
PARTS = corrected_cycle, simulate_motion


class StepBatch:
    """Waiting requests for steps along branches, and for the two parts of a step.

    Args:
        stock: families of the branches.
        room: padded number of events of their cycles.
    """

    def __init__(self, stock: Stock, room: int):
        self.stock, self.room = stock, room
        self.members: list[_Part | _Stepper] = []
        self.new: list[_Part | _Stepper] = []
        self.state: _Rows | None = None

    def __len__(self) -> int:
        return len(self.members) + len(self.new)

    def add(self, task: int, request: PlainSteps | KernelCall) -> None:
        """Add a request."""
        is_part = isinstance(request, KernelCall)
        self.new.append(_Part(task, request) if is_part else _Stepper(task, request))

    def answer(self) -> dict[int, Any]:
        """Answer all requests: plain steps are taken up to the first one that is not plain, or a few of them."""
        num = len(self)
        form = self.stock.form(num)
        replies = {} if form is SINGLES else self._simulated()
        state = self._joined()
        if state is None:
            return replies
        most = np.array([member.most_steps(form.tries, num) for member in self.members])
        # Branches that take many steps share calls: the others of a call would wait for them.
        order = np.argsort(most > 0, kind="stable")
        members, state = [self.members[k] for k in order], state.at(order)
        families = self.stock.of([member.task for member in members])
        points, found = in_parts(compiled_steps(form), form.size, families, *state, most[order])
        stepped: Stepped = found.unpacked()
        if form.room is None:
            tasks = [member.task for member in members]
            stepped, points = followed(
                self.stock, tasks, state.requests, state.points, stepped, points, self.room
            )
        _add_points(members, stepped)
        is_left = np.array([member.is_answered(stepped, k) for k, member in enumerate(members)])
        replies |= {members[k].task: members[k].reply(stepped, int(k)) for k in np.flatnonzero(is_left)}
        self.members = [members[k] for k in np.flatnonzero(~is_left)]
        self.state = _Rows(state.requests, points, stepped.next_ds).at(~is_left)
        return replies

    def _simulated(self) -> dict[int, Any]:
        """Answers to requests for simulations alone."""
        own = [(part.task, part.request) for part in self.new if isinstance(part, _Part) and part.simulates]
        self.new = [member for member in self.new if not member.simulates]
        rows = [padded_for_run(request.sequence, request.arguments, self.room) for _, request in own]
        return simulated(self.stock, [task for task, _ in own], rows) if own else {}

    def _joined(self) -> "_Rows | None":
        """Requests of all branches, those of the new ones last; None if there are none."""
        parts = [self.state] if self.members and self.state is not None else []
        if self.new:
            requests, points, ds = zip(
                *(member.row(self.room, self.stock) for member in self.new), strict=True
            )
            rows = (stacked(list(own)) for own in (requests, points))
            requests, points = (pack(own, has_rows=True) for own in rows)
            parts.append(_Rows(requests, points, np.array(ds)))
        self.members, self.new = self.members + self.new, []
        if len(parts) < 2:
            return parts[0] if parts else None
        requests, points, ds = zip(*parts, strict=True)
        return _Rows(joined(list(requests)), joined(list(points)), np.concatenate(ds))


class _Rows(NamedTuple):
    """Requests of some branches, points from which they step, and lengths of their steps, see `take_steps`."""

    requests: Packed
    points: Packed
    ds: Any

    def at(self, rows: np.ndarray) -> "_Rows":
        """Some of them."""
        return _Rows(self.requests.at(rows), self.points.at(rows), self.ds[rows])


class _Part(NamedTuple):
    """A request for one part of a step.

    Attributes:
        task: number of its task.
        request: the request.
    """

    task: int
    request: KernelCall

    @property
    def simulates(self) -> bool:
        """True for a simulation."""
        return self.request.program is simulate_motion

    def row(self, room: int, stock: Stock) -> tuple[StepRequest, CorrectedCycle, float]:
        """The request, its cycle and the length of a step."""
        blank = partial(blank_cycle, has_grip=stock.has_grip)
        sequence, place, *rest = padded(self.request.sequence, self.request.arguments, room)
        if self.simulates:
            own = _request(sequence, place)._replace(start=rest[0], simulates=np.asarray(True))
            return own, blank(sequence, place, place), np.nan
        weights, target = rest
        return _request(sequence, place)._replace(target=target), blank(sequence, place, weights), 0.0

    def most_steps(self, tries: int, num: int) -> int:
        """Most plain steps that it may take: none."""
        del tries, num
        return 0

    def is_answered(self, stepped: Stepped, k: int) -> bool:
        """True after any call."""
        del stepped, k
        return True

    def reply(self, stepped: Stepped, k: int) -> Any:
        """The answer, from row `k` of the results."""
        return _motion_in(stepped, k) if self.simulates else stepped.tries.at((k, 0)).unpacked()


class _Stepper:
    """A branch that steps.

    Attributes:
        task: number of its task.
        request: the request.
        point: the point from which it steps.
    """

    simulates = False

    def __init__(self, task: int, request: PlainSteps):
        self.task, self.request = task, request
        self.point: BranchPoint | PlainPoint = request.point

    def row(self, room: int, stock: Stock) -> tuple[StepRequest, CorrectedCycle, float]:
        """The request, the point and the length of its first step."""
        del stock
        walk, start, point = self.request.walk, self.request.start, self.request.point
        sequence, place = padded(point.sequence, (point.place,), room)
        one, other = start.sequence, point.sequence
        is_same = one is other or (
            np.array_equal(one.kind, other.kind) and np.array_equal(one.stop, other.stop)
        )
        origin, tangent = place, place.moved(place, -1.0)
        if is_same:
            _, origin, tangent = padded(one, (start.place, start.tangent), room)
        num_periods, bounds, longest = map(np.asarray, (walk.num_periods, walk.bounds, walk.longest))
        limits = StepLimits(num_periods, bounds, longest, origin, tangent)
        return _request(sequence, place, limits), point.seen, self.request.ds

    def most_steps(self, tries: int, num: int) -> int:
        """Most plain steps that it may take now, beside a number of others."""
        walk = self.request.walk
        if self.request.is_trial:
            return 0
        return int(min(tries, walk.max_points - len(walk.points), max(1, np.ceil(walk.budget.points / num))))

    def add_point(self, rows: Packed, row: int, length: float) -> None:
        """Add the point of a step."""
        self.point = PlainPoint(self.point.sequence, rows, row, self.point.arc + length)
        self.request.walk.points.append(self.point)

    def is_answered(self, stepped: Stepped, k: int) -> bool:
        """True unless it may take more plain steps."""
        is_over = _is_only_tried(stepped, k) or stepped.next_ds[k] < SHORTEST_STEP
        return bool(self.request.is_trial or self.request.walk.is_full or is_over)

    def reply(self, stepped: Stepped, k: int) -> tuple[BranchPoint, float, Tried | None]:
        """The answer, from row `k` of the results."""
        last = int(stepped.last[k])
        point = self.point.alone() if isinstance(self.point, PlainPoint) else self.point
        tried = None
        if _is_only_tried(stepped, k):
            row = stepped.tries.at((k, last))
            new = BranchPoint.of(point.sequence, row.unpacked(), point.arc + float(stepped.ds[k, last]))
            motion = _motion_in(stepped, k)
            is_known = motion is not None and motion.is_alike
            tried = Tried(new, motion if is_known else None, float(stepped.next_length[k]))
        return point, float(stepped.next_ds[k]), tried


def _motion_in(stepped: Stepped, k: int) -> SimulatedMotion | None:
    """The motion from the end of the last try in row `k`, if that was simulated."""
    if not stepped.has_motion[k] or stepped.motion is None:
        return None
    return stepped.motion.at(k).unpacked() if isinstance(stepped.motion, Packed) else stepped.motion[k]


def _is_only_tried(stepped: Stepped, k: int) -> bool:
    """True if the last step is accepted and short enough, but not taken."""
    return bool(stepped.is_sound[k] and not stepped.is_taken[k, stepped.last[k]])


def _add_points(members: list[_Part | _Stepper], stepped: Stepped) -> None:
    """Add the points of all steps that were taken."""
    lanes, tries = np.nonzero(stepped.is_taken)
    rows = stepped.tries.at((lanes, tries))
    for row, (k, length) in enumerate(zip(lanes.tolist(), stepped.ds[lanes, tries].tolist(), strict=True)):
        member = members[k]
        assert isinstance(member, _Stepper)
        member.add_point(rows, row, length)


def _request(sequence: Sequence, place: ExtendedCycle, limits: StepLimits | None = None) -> StepRequest:
    """A request for steps; without limits none is plain."""
    if limits is None:
        nowhere: Any = np.array([np.inf, -np.inf])
        limits = StepLimits(nowhere[0], nowhere, nowhere[0], place, place)
    start = np.full(np.shape(place.z), np.nan)
    return StepRequest(sequence, np.asarray(np.nan), start, np.asarray(False), limits)
