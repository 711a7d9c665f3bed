"""Steps of many branches in one batch, and the points of the steps that were taken.

The state of a batch is arrays with a branch axis, see `request_rows.py`, and so are the results of a call. Python looks
only at branches that are answered, those that meet something or need no more: their rows are cut at once.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from .._jax.packing import Packed
from .batches import SINGLES, FamilyStack, Form, compiled_steps, in_batches
from .followed_steps import followed
from .kernels import SimulatedMotion, corrected_cycle, simulate_motion
from .motions import simulated
from .padding import padded_for_run
from .point import BranchPoint, PlainPoint
from .request_rows import Rows, joined_rows, rows_of_parts, rows_of_steps
from .requests import KernelCall
from .step_kernel import Stepped
from .steps import PlainSteps, Tried
from .tolerances import SHORTEST_STEP

# Kernels of which `take_steps` consists.
PARTS = corrected_cycle, simulate_motion


class _Part(NamedTuple):
    """A request for one part of a step, and its task."""

    task: int
    request: KernelCall


class _Stepper:
    """A branch that steps.

    Attributes:
        task: number of its task.
        request: the request.
        point: the point from which it steps.
    """

    def __init__(self, task: int, request: PlainSteps):
        self.task, self.request = task, request
        self.point: BranchPoint | PlainPoint = request.point

    def most_steps(self, form: Form, num: int) -> int:
        """Most plain steps that it may take now, beside a number of others."""
        if self.request.is_trial:
            return 0
        walk = self.request.walk
        left, budget = min(form.tries, walk.max_points - len(walk.points)), walk.budget.points
        return left if budget >= num * left else int(min(left, max(1, np.ceil(budget / num))))

    def add_point(self, rows: Packed, row: int, length: float) -> None:
        """Add the point of a step."""
        self.point = PlainPoint(self.point.sequence, rows, row, self.point.arc + length)
        self.request.walk.points.append(self.point)


class StepBatch:
    """Waiting requests for steps along branches, and for the two parts of a step.

    Args:
        stack: families of the branches.
        room: padded number of events of their cycles.
    """

    def __init__(self, stack: FamilyStack, room: int):
        self.stack, self.room = stack, room
        self.steppers: list[_Stepper] = []
        self.state: Rows | None = None
        self.new: list[_Stepper] = []
        self.parts: list[_Part] = []

    def __len__(self) -> int:
        return len(self.steppers) + len(self.new) + len(self.parts)

    def add(self, task: int, request: PlainSteps | KernelCall) -> None:
        """Add a request."""
        if isinstance(request, KernelCall):
            self.parts.append(_Part(task, request))
        else:
            self.new.append(_Stepper(task, request))

    def answer(self) -> dict[int, Any]:
        """Answer all requests: plain steps are taken up to the first one that is not plain, or a few of them."""
        num = len(self)
        form = self.stack.form(num)
        replies = {} if form is SINGLES else self._simulated(form)
        parts, state = self._joined()
        if state is None:
            return replies
        steppers, first = self.steppers, len(parts)
        most = np.array([0] * first + [one.most_steps(form, num) for one in steppers])
        tasks = [one.task for one in (*parts, *steppers)]
        points, found = in_batches(compiled_steps(form), form.size, self.stack.of(tasks), *state, most)
        stepped: Stepped = found.unpacked()
        if form.room is None:
            given = state.requests, state.points, stepped, points
            stepped, points = followed(self.stack, tasks, *given, self.room)
        for k, rows, row, length in _taken(stepped):
            steppers[k - first].add_point(rows, row, length)
        replies |= _replies_of_parts(parts, stepped)
        is_left = self._are_answered(stepped, first)
        left, kept = first + np.flatnonzero(is_left), first + np.flatnonzero(~is_left)
        replies |= _replies_of_steppers([steppers[k - first] for k in left], left, stepped, points)
        self.steppers = [steppers[k - first] for k in kept]
        self.state = Rows(state.requests, points, stepped.next_ds).at(kept)
        return replies

    def _simulated(self, form: Form) -> dict[int, Any]:
        """Answers to requests for simulations alone."""
        runs = [part for part in self.parts if part.request.program is simulate_motion]
        self.parts = [part for part in self.parts if part.request.program is not simulate_motion]
        own = [padded_for_run(one.request.sequence, one.request.arguments, self.room) for one in runs]
        return simulated(self.stack, [one.task for one in runs], own, form) if runs else {}

    def _joined(self) -> tuple[list[_Part], Rows | None]:
        """The requests for parts, and the rows of these and of all branches that step; None if there are none."""
        parts, new, rows = self.parts, self.new, []
        if parts:
            asked = [part.request for part in parts]
            rows.append(rows_of_parts(asked, self.room, has_grip=self.stack.has_grip))
        if self.steppers and self.state is not None:
            rows.append(self.state)
        if new:
            rows.append(rows_of_steps([one.request for one in new], self.room))
        self.steppers, self.new, self.parts = self.steppers + new, [], []
        return parts, joined_rows(rows) if rows else None

    def _are_answered(self, stepped: Stepped, first: int) -> np.ndarray:
        """Flags of the branches, in the rows from `first` on, that may take no more plain steps."""
        is_done = [one.request.is_trial or one.request.walk.is_full for one in self.steppers]
        is_over = _are_only_tried(stepped) | (stepped.next_ds < SHORTEST_STEP)
        return is_over[first:] | np.array(is_done, bool)


def _taken(stepped: Stepped) -> Iterator[tuple[int, Packed, int, float]]:
    """Steps that were taken: row of the branch, corrected cycles and the row among them, length of the step."""
    lanes, tries = np.nonzero(stepped.is_taken)
    rows = stepped.tries.at((lanes, tries))
    for row, (k, length) in enumerate(zip(lanes.tolist(), stepped.ds[lanes, tries].tolist(), strict=True)):
        yield k, rows, row, length


def _are_only_tried(stepped: Stepped) -> np.ndarray:
    """Flags of branches whose last step is accepted and short enough, but not taken."""
    is_taken = np.asarray(stepped.is_taken)[np.arange(len(stepped.last)), stepped.last]
    return np.asarray(stepped.is_sound) & ~is_taken


def _replies_of_parts(parts: list[_Part], stepped: Stepped) -> dict[int, Any]:
    """Answers to requests for parts of a step, from the first rows of the results."""
    if not parts:
        return {}
    cycle = stepped.tries.at((np.arange(len(parts)), 0)).each_unpacked()
    return {
        part.task: _motion_in(stepped, k) if part.request.program is simulate_motion else cycle[k]
        for k, part in enumerate(parts)
    }


def _replies_of_steppers(
    steppers: list[_Stepper], rows: np.ndarray, stepped: Stepped, points: Packed
) -> dict[int, tuple[BranchPoint, float, Tried | None]]:
    """Answers to some branches that step, in some rows of the results."""
    last, replies = stepped.last[rows], {}
    whole = zip(
        steppers,
        rows.tolist(),
        points.at(rows).each_unpacked(),
        stepped.tries.at((rows, last)).each_unpacked(),
        _are_only_tried(stepped)[rows].tolist(),
        stepped.ds[rows, last].tolist(),
        strict=True,
    )
    for one, k, cycle, end, is_tried, length in whole:
        point, step = one.point, None
        if isinstance(point, PlainPoint):
            point = BranchPoint.of(point.sequence, cycle, point.arc)
        if is_tried:
            new = BranchPoint.of(point.sequence, end, point.arc + length)
            motion = _motion_in(stepped, k)
            is_known = motion is not None and motion.is_alike
            step = Tried(new, motion if is_known else None, float(stepped.next_length[k]))
        replies[one.task] = point, float(stepped.next_ds[k]), step
    return replies


def _motion_in(stepped: Stepped, k: int) -> SimulatedMotion | None:
    """The motion from the end of the last try in row `k`, if that was simulated."""
    if not stepped.has_motion[k] or stepped.motion is None:
        return None
    return stepped.motion.at(k).unpacked() if isinstance(stepped.motion, Packed) else stepped.motion[k]
