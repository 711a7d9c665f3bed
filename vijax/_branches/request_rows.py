"""Requests of many branches as rows of arrays, each array filled for all of them at once."""

from collections.abc import Sequence as Many
from typing import Any, NamedTuple

import numpy as np

from .._jax.packing import Packed, pack
from .._orbits.sequence import NOTHING, Sequence
from .batches import joined, stacked
from .kernels import simulate_motion
from .parameter_family import ExtendedCycle
from .requests import KernelCall
from .step_kernel import StepRequest, blank_cycles
from .steps import PlainSteps, StepLimits


class Rows(NamedTuple):
    """Requests of some branches, points from which they step, and lengths of their steps, see `take_steps`."""

    requests: Packed
    points: Packed
    ds: Any

    def at(self, rows: np.ndarray) -> "Rows":
        """Some of them."""
        return Rows(self.requests.at(rows), self.points.at(rows), self.ds[rows])


def joined_rows(parts: Many[Rows]) -> Rows:
    """All rows of some batches."""
    requests, points, ds = zip(*parts, strict=True)
    return Rows(joined(list(requests)), joined(list(points)), np.concatenate(ds))


def rows_of_parts(requests: Many[KernelCall], room: int, *, has_grip: bool) -> Rows:
    """Rows of requests for corrections and simulations; `has_grip` with friction of contacts."""
    sequences = padded_sequences([request.sequence for request in requests], room)
    places = padded_cycles([request.arguments[0] for request in requests], room)
    # A correction has weights and a target, a simulation a start.
    simulates = np.array([request.program is simulate_motion for request in requests])
    rest = [request.arguments[1:] for request in requests]
    own = [
        request.arguments[0] if is_run else given[0]
        for request, given, is_run in zip(requests, rest, simulates, strict=True)
    ]
    nowhere = np.full_like(places.z[0], np.nan)
    target = np.array([np.nan if is_run else given[1] for given, is_run in zip(rest, simulates, strict=True)])
    start = np.array([given[0] if is_run else nowhere for given, is_run in zip(rest, simulates, strict=True)])
    never = np.tile([np.inf, -np.inf], (len(requests), 1))
    limits = StepLimits(never[:, 0], never, never[:, 0], places, places)
    whole = StepRequest(sequences, target, start, simulates, limits)
    points = blank_cycles(sequences, places, padded_cycles(own, room), has_grip=has_grip)
    return Rows(pack(whole, has_rows=True), pack(points, has_rows=True), np.where(simulates, np.nan, 0.0))


def rows_of_steps(requests: Many[PlainSteps], room: int) -> Rows:
    """Rows of requests for plain steps."""
    num, points = len(requests), [request.point for request in requests]
    places = padded_cycles([point.place for point in points], room)
    origins, tangents = [], []
    for request, point in zip(requests, points, strict=True):
        start = request.start
        is_same = _has_events_of(start.sequence, point.sequence)
        origins.append(start.place if is_same else point.place)
        tangents.append(start.tangent if is_same else point.place.moved(point.place, -1.0))
    walks = [request.walk for request in requests]
    limits = StepLimits(
        np.array([float(walk.num_periods) for walk in walks]),
        np.array([walk.bounds for walk in walks], float),
        np.array([walk.longest for walk in walks], float),
        padded_cycles(origins, room),
        padded_cycles(tangents, room),
    )
    sequences, nan = padded_sequences([point.sequence for point in points], room), np.full(num, np.nan)
    whole = StepRequest(sequences, nan, np.full_like(places.z, np.nan), np.zeros(num, bool), limits)
    cycles = stacked([point.cycle for point in points])
    ds = np.array([request.ds for request in requests], float)
    return Rows(pack(whole, has_rows=True), pack(cycles, has_rows=True), ds)


def _has_events_of(one: Sequence, other: Sequence) -> bool:
    return one is other or (np.array_equal(one.kind, other.kind) and np.array_equal(one.stop, other.stop))


def padded_sequences(sequences: Many[Sequence], room: int) -> Sequence:
    """Sequences with padding, (sequences, ...)."""
    num, first = len(sequences), sequences[0]
    kinds, stops = np.full((num, room), NOTHING), np.zeros((num, room), int)
    modes = np.empty((num, room + 1, *first.mode.shape[1:]), first.mode.dtype)
    for k, (kind, stop, mode) in enumerate(sequences):
        kinds[k, : len(kind)], stops[k, : len(stop)] = kind, stop
        modes[k, : len(mode)], modes[k, len(mode) :] = mode, mode[-1]
    return Sequence(kinds, stops, modes)


def padded_cycles(cycles: Many[ExtendedCycle], room: int) -> ExtendedCycle:
    """Cycles with padding, (cycles, ...)."""
    z = np.array([cycle.z for cycle in cycles])
    flights = np.zeros((len(cycles), room), z.dtype)
    for row, cycle in zip(flights, cycles, strict=True):
        row[: len(cycle.flights)] = cycle.flights
    return ExtendedCycle(z, flights, np.array([cycle.p for cycle in cycles], z.dtype))
