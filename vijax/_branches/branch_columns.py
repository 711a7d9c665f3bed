"""Columns of the dataset of a branch, from its points."""

import json
from dataclasses import replace

import jax
import numpy as np
import xarray as xr

from .._dataset_attributes import variable_attributes, versions
from .._hybrid.limits import IMPACT
from .._orbits.floquet import with_phase
from .._orbits.rigid_modes import num_of
from .._orbits.sequence import NOTHING, SECOND
from .._sweep.short_names import with_labels
from .._system.family_description import attributes_of_system
from .kernels import CorrectedCycle
from .kinds import EndKind, public_kind
from .parameter_family import ParameterFamily
from .point import BranchPoint, DirectedBranch, PeakMark, PlainPoint, stacked_cycles


def dataset_of(
    family: ParameterFamily, start: BranchPoint, back: DirectedBranch, forth: DirectedBranch
) -> xr.Dataset:
    """Dataset of the points of a branch."""
    if forth.end == EndKind.CLOSED and back.end in (EndKind.CLOSED, EndKind.MAX_POINTS, EndKind.INTERRUPTED):
        back = replace(back, points=[], end=EndKind.CLOSED)
    points = [*back.points[::-1], start, *forth.points]
    cycles = stacked_cycles(points)
    arcs = [-point.arc for point in back.points[::-1]] + [point.arc for point in [start, *forth.points]]
    columns = {
        family.path: (("point",), cycles.found.place.p * family.span),
        "arclength": (("point",), np.array(arcs)),
        **_columns_of_orbits(points, cycles, family),
        **_columns_of_events(points, cycles, family.system.num_stops),
        "start": (("point", "state"), cycles.found.place.z * family.scale),
    }
    attrs = {
        **attributes_of_system(family.system),
        "dtype": str(columns["x0"][1].dtype),
        "path": family.path,
        "num_periods": 0 if family.is_autonomous else int(family.num_periods),
        "phase": float(family.phase),
        "ends": json.dumps([back.end, forth.end]),
        **versions(),
    }
    if family.is_autonomous:
        unit = 2 * np.pi / float(family.system.forcing.frequency)
        columns["period"] = (("point",), unit * columns["flight"][1].sum(axis=1))
        columns["multipliers"] = ("point", "multiplier"), _with_phase(columns["multipliers"][1])
    ds = xr.Dataset(columns, attrs=attrs).set_coords(family.path)
    for name, variable in ds.variables.items():
        variable.attrs = variable_attributes(str(name))
    return with_labels(ds, family.system)


_with_phase = jax.jit(jax.vmap(with_phase))


def _columns_of_orbits(
    points: list[BranchPoint | PlainPoint], cycles: CorrectedCycle, family: ParameterFamily
) -> dict[str, tuple]:
    """Columns with one entry for each point."""
    x0, v0 = np.split(cycles.start, 2, axis=1)
    multipliers = cycles.found.multipliers
    return {
        "x0": (("point", "mass"), x0),
        "v0": (("point", "mass"), v0),
        "multipliers": (("point", "multiplier"), multipliers),
        "is_stable": (
            ("point",),
            np.count_nonzero(~(np.abs(multipliers) < 1), axis=1) == num_of(family.drift),
        ),
        "is_admissible": (("point",), np.array([point.is_admissible for point in points])),
        "closest_gap": (("point", "stop"), cycles.watched.gap[:, : family.system.num_stops]),
        "residual": (("point",), cycles.found.residual),
        "bifurcation": (
            ("point",),
            np.array([public_kind(point.kind) for point in points]),
        ),
        **_columns_of_peaks(points),
    }


def _columns_of_peaks(points: list[BranchPoint | PlainPoint]) -> dict[str, tuple]:
    """Columns of peaks, if there are any."""
    marks = [point.peak for point in points]
    if not any(marks):
        return {}
    none = PeakMark("", "", np.nan)
    names = ("peak", "peak_quantity", "peak_height", "peak_event")
    columns = zip(*(mark or none for mark in marks), strict=True)
    return {name: (("point",), np.array(column)) for name, column in zip(names, columns, strict=True)}


def _columns_of_events(
    points: list[BranchPoint | PlainPoint], cycles: CorrectedCycle, num_stops: int
) -> dict[str, tuple]:
    """Columns with one entry for each event of each point, padded."""
    # Most points share the sequence of the one before, as the same object.
    sequences = {id(point.sequence): point.sequence for point in points}
    numbers = {one: number for number, one in enumerate(sequences)}
    which = np.array([numbers[id(point.sequence)] for point in points])
    own = list(sequences.values())
    # A log has at least one entry, be it padding.
    room = max(1, *(len(one.kind) for one in own))
    kind = _rows([one.kind for one in own], room, NOTHING)[which]
    stop = _rows([one.stop for one in own], room, -1)[which]
    held = _rows([one.held for one in own], room + 1, False)[which]
    is_impact = kind == IMPACT
    events, found = ("point", "event"), cycles.found
    impacts = is_impact[..., None] & (stop[..., None] == np.arange(num_stops))
    switching = {}
    if own[0].num_groups > 1:
        modes = _rows([one.mode for one in own], room + 1, 0)[which]
        guard, kind = (
            np.where(kind == NOTHING, 0, kind // SECOND),
            np.where(kind == NOTHING, kind, kind % SECOND),
        )
        switching = {
            "event_guard": (events, guard),
            "mode": (("point", "flight_number", "element"), modes),
        }
    return switching | {
        "num_impacts": (("point", "stop"), np.count_nonzero(impacts, axis=1)),
        "impact_speed": (events, np.where(is_impact, found.speeds[:, :room], np.nan)),
        "event_kind": (events, kind),
        "event_stop": (events, stop),
        "flight": (events, np.where(kind != NOTHING, found.place.flights[:, :room], 0.0)),
        "held": (("point", "flight_number", "stop"), held[..., :num_stops]),
    }


def _rows(values: list, room: int, fill: float | int) -> np.ndarray:
    """Stack arrays of different lengths as rows, padded with `fill`."""
    values = [np.asarray(a) for a in values]
    whole = np.full((len(values), room, *values[0].shape[1:]), fill, np.result_type(values[0], type(fill)))
    for row, a in zip(whole, values, strict=True):
        row[: len(a)] = a[:room]
    return whole
