"""Machines and starts as lanes; computations are written once, for one lane.

A point has values at paths: of a machine, of a family of machines, or of the start. The machines of a family are made here,
all points at once; what runs them sees machines alone. Records, which are long, are held once for all points that have them.
"""

from collections.abc import Collection, Mapping
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from .._system.checks import FINITE, check_every, check_machines
from .._system.family import Family
from .._system.parameters import find_parameter
from .._system.periodicity import refuse_off_period
from .._system.shared_records import places_of_records, with_shared_records
from .._system.system import AnySystem, ImpactSystem, machine_of

System = TypeVar("System", bound=AnySystem)

# Fewest lanes to a record, in the mean, from which on they share it: otherwise each queue of lanes holds its own alone.
_LANES_TO_A_RECORD = 2


class LaneInput(eqx.Module, Generic[System]):
    """A machine and a start, the input of one lane. Where nothing is swept, a family may stand for the machine."""

    system: System
    x0: Array | np.ndarray
    v0: Array | np.ndarray


def points_of_lanes(
    base: LaneInput[Any],
    values: Mapping[str, np.ndarray],
    places: Mapping[str, np.ndarray] | None = None,
    *,
    counts_periods: bool = True,
) -> LaneInput[ImpactSystem]:
    """Give every leaf of `base` lanes as its last axis, with the swept values at their paths.

    Args:
        base: machine and start where nothing is swept.
        values: for each path its values, (rows, ...).
        places: for each path which of them each lane has, (lanes,); if left out, as many lanes as rows.
        counts_periods: whether the load must have a period, and a force the same.

    Returns:
        The lanes; leaves that are not swept have a single one. Records that some have in common are `SharedRecords`.

    Raises:
        ValueError: for a path that names nothing, or values that do not fit or make no valid machine.
    """
    places = {path: np.arange(len(a)) for path, a in values.items()} if places is None else places
    for path, a in values.items():  # the function of a family may hide them, as an index does
        check_every(path, a, FINITE)
    points = _sharing_records(base, values, places)
    _check(points, counts_periods=counts_periods)
    return points


def _sharing_records(
    base: LaneInput[Any], values: Mapping[str, np.ndarray], places: Mapping[str, np.ndarray]
) -> LaneInput[ImpactSystem]:
    """`with_values`, where lanes with the same values at all paths that move a record share it."""
    records, swept = places_of_records(machine_of(base.system)), list(values)
    moving = [path for path in swept if records & _reached(base, path)] if records else []
    if moving:
        of_lanes, number = np.unique(np.stack([places[path] for path in moving]), axis=1, return_inverse=True)
        if _LANES_TO_A_RECORD * of_lanes.shape[1] <= number.size:
            own = {path: values[path][i] for path, i in zip(moving, of_lanes, strict=True)}
            tables = with_values(base, own).system
            rest = [path for path in swept if not _reached(base, path) or _reached(base, path) - records]
            points = with_values(base, {path: values[path][places[path]] for path in rest}, without=records)
            return eqx.tree_at(
                lambda p: p.system, points, with_shared_records(points.system, tables, number.ravel())
            )
    return with_values(base, {path: values[path][places[path]] for path in swept})


def _reached(base: LaneInput[Any], path: str) -> set[int]:
    """Places of the leaves of the machine that a path moves; none of the start."""
    leaves, own = find_parameter(base, path).leaves, base.system
    if not isinstance(own, Family):
        return set(leaves)
    moved = {i for i in leaves if i < len(own.numbers)}
    return {k for k, flag in enumerate(own.program.reached_by(moved)) if flag} if moved else set()


def with_values(
    base: LaneInput[Any], swept: Mapping[str, np.ndarray], *, without: Collection[int] = ()
) -> LaneInput[ImpactSystem]:
    """The lanes of swept values, (lanes, ...), each with numbers of its own, unchecked.

    Leaves at the places `without` of a family's machine may keep the values where nothing is swept.
    """
    points, own = lanes_with_values(base, swept), base.system
    if not isinstance(own, Family):
        return LaneInput(points.system, *points.system.start_of(points.x0, points.v0))
    numbers: tuple = points.system.numbers
    moved = {i for path in swept for i in find_parameter(base, path).leaves if i < len(own.numbers)}
    lanes = {i: numbers[i] for i in moved}
    machines = own.program.machines(own.bound_system, own.numbers, lanes, without=without)
    return LaneInput(machines, *machines.start_of(points.x0, points.v0))


def lanes_with_values(base: LaneInput[System], swept: Mapping[str, np.ndarray]) -> LaneInput[System]:
    """The swept values at their paths, of a family its values instead of its machines; lanes last."""
    leaves, structure = jax.tree.flatten(base)
    leaves = [np.asarray(a)[..., None] for a in leaves]
    for path, values in swept.items():
        place = find_parameter(base, path)
        for i in place.leaves:
            leaves[i] = _with_lanes(leaves[i], place.index, values, path)
    return jax.tree.unflatten(structure, leaves)


def _with_lanes(leaf: np.ndarray, index: tuple[int, ...], values: np.ndarray, path: str) -> np.ndarray:
    """The array with its entry at `index` set in every lane."""
    shape = leaf[index].shape[:-1]
    if values.shape[1:] != shape:
        wanted = ", ".join(("points", *map(str, shape)))
        raise ValueError(
            f"The values of `{path}` must have shape ({wanted}), one value per point, "
            f"but have shape {values.shape}."
        )
    lanes = max(leaf.shape[-1], len(values))
    new = np.array(np.broadcast_to(leaf, (*leaf.shape[:-1], lanes)))
    new[index] = np.moveaxis(values, 0, -1)
    return new


def _check(points: LaneInput[ImpactSystem], *, counts_periods: bool) -> None:
    """Refuse values that make no valid machine, all lanes at once."""
    for leaf in jax.tree.leaves(points):
        check_every("", leaf, FINITE)
    check_machines(points.system, points.x0, counts_periods=counts_periods)
    if counts_periods:
        refuse_off_period(points.system, points.x0, points.v0, who="a sweep", where=", at every point")
