"""Trajectories of concrete numbers: one program for all machines of a size, called until the end.

It has room for a fixed number of events and saved states; longer requests go in, and their results come out, piece by
piece. So only another size of machine compiles anew, and the user can interrupt between calls.
"""

from dataclasses import dataclass
from typing import TypeVar

import equinox as eqx
import jax
import numpy as np

from .event_log import EventLog, Restarts
from .loop import LoopArguments
from .one_call import EVENTS, GOALS, STEPS, CallProgress, Found, KnownMachine
from .solution import Solution

# Events of a log whose length is left to the motion.
MOST_EVENTS = 1 << 20

Rows = TypeVar("Rows", EventLog, Restarts)


def follow_known(known: KnownMachine, request: LoopArguments) -> Solution:
    """Follow a trajectory of NumPy numbers, with any number of `request.goals`."""
    ts, left = request.goals, None
    calls: list[_Taken] = []
    num_reached = 0
    while True:
        window = _window(request, num_reached)
        found = known.follow(window, left)
        left, is_done = found.left, not found.is_paused
        if is_done and not calls and len(ts) == 1 and request.max_events in (EVENTS, MOST_EVENTS):
            return found.solution
        taken = _taken(found, left.in_numpy().unpacked(), int(window.num_goals))
        num_reached += len(taken.xs)
        if not (calls and taken.is_empty):  # ten million periods are thousands of calls
            calls.append(taken)
        if is_done:
            return _joined(found.solution, ts, calls, int(request.max_events))


def _window(request: LoopArguments, num_reached: int) -> LoopArguments:
    """Request of one call: the next goals, padded with the end."""
    waiting = request.goals[num_reached:]
    goals = np.full(GOALS, request.t1)
    goals[: len(waiting)] = waiting[:GOALS]
    return request._replace(
        goals=goals,
        num_goals=np.asarray(min(len(waiting), GOALS)),
        is_last=np.asarray(len(waiting) <= GOALS),
        max_turns=np.asarray(STEPS),
    )


@dataclass(frozen=True)
class _Taken:
    """Results of one call, without padding, in arrays of their own: views would keep the padding."""

    xs: np.ndarray
    vs: np.ndarray
    events: EventLog
    restarts: Restarts

    @property
    def is_empty(self) -> bool:
        """True if the call has neither reached a saved state nor logged anything."""
        return not (len(self.xs) or len(self.events.t) or len(self.restarts.t))


def _taken(found: Found, left: CallProgress, most_goals: int) -> _Taken:
    num_goals = min(int(left.goals), most_goals)  # the end is not a saved state
    xs, vs = np.asarray(found.saved)[:, :num_goals]
    events = found.solution.events
    is_event = np.asarray(events.stop) >= 0
    return _Taken(
        xs=xs.copy(),
        vs=vs.copy(),
        events=jax.tree.map(lambda a: np.asarray(a)[is_event], events),
        restarts=jax.tree.map(lambda a: np.asarray(a)[: int(left.rows)].copy(), found.solution.restarts),
    )


def _joined(solution: Solution, ts: np.ndarray, calls: list[_Taken], max_events: int) -> Solution:
    """Solution of the last call with the results of all calls."""
    events, restarts = (
        _concatenated([getattr(call, name) for call in calls]) for name in ("events", "restarts")
    )
    # A stick has the time at which its chatter ends; events of a later call may come before it.
    if max_events == MOST_EVENTS:
        max_events = min(max(EVENTS, len(events.t)), MOST_EVENTS)
    order = np.argsort(events.t, kind="stable")[:max_events]
    events = jax.tree.map(
        lambda a: _filled(a[order], max_events, -1 if a.dtype.kind == "i" else np.nan), events
    )
    until = _filled(restarts.t, max_events + 1, np.inf)
    restarts = jax.tree.map(lambda a: _filled(a, max_events + 1, 0), restarts)
    restarts = eqx.tree_at(lambda rows: rows.t, restarts, until)
    saved = []
    for name, end in (("xs", solution.x1), ("vs", solution.v1)):
        reached = np.concatenate([getattr(call, name) for call in calls])
        rest = np.broadcast_to(end, (len(ts) - len(reached), *reached.shape[1:]))
        saved.append(np.concatenate([reached, rest]))
    names = lambda s: (s.ts, s.xs, s.vs, s.events, s.restarts)  # noqa: E731
    return eqx.tree_at(names, solution, jax.device_put((ts, *saved, events, restarts)))


def _concatenated(parts: list[Rows]) -> Rows:
    return jax.tree.map(lambda *columns: np.concatenate(columns), *parts)


def _filled(a: np.ndarray, size: int, value: int | float) -> np.ndarray:
    """First `size` rows of a column, padded with `value`."""
    return np.concatenate([a[:size], np.full((max(size - len(a), 0), *a.shape[1:]), value, a.dtype)])
