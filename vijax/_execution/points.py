"""Machines and starts as lanes; computations are written once, for one lane.

A point has values at paths: of a machine, of a family of machines, or of the start. The machines of a family are made here,
all points at once; what runs them sees machines alone.
"""

from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from .._system.checks import FINITE, check_every, check_machines
from .._system.family import Family
from .._system.parameters import find_parameter
from .._system.periodicity import refuse_off_period
from .._system.system import AnySystem, ImpactSystem

System = TypeVar("System", bound=AnySystem)


class LaneInput(eqx.Module, Generic[System]):
    """A machine and a start, the input of one lane. Where nothing is swept, a family may stand for the machine."""

    system: System
    x0: Array | np.ndarray
    v0: Array | np.ndarray


def points_of_lanes(
    base: LaneInput[Any], swept: dict[str, np.ndarray], *, counts_periods: bool = True
) -> LaneInput[ImpactSystem]:
    """Give every leaf of `base` lanes as its last axis, with the swept values at their paths.

    Args:
        base: machine and start where nothing is swept.
        swept: for each path one value a lane, (lanes, ...).
        counts_periods: whether the load must have a period, and a force the same.

    Returns:
        The lanes; leaves that are not swept have a single one.

    Raises:
        ValueError: for a path that names nothing, or values that do not fit or make no valid machine.
    """
    points = with_values(base, swept)
    _check(points, counts_periods=counts_periods)
    return points


def with_values(base: LaneInput[Any], swept: dict[str, np.ndarray]) -> LaneInput[ImpactSystem]:
    """`points_of_lanes` without its checks."""
    points, own = lanes_with_values(base, swept), base.system
    if not isinstance(own, Family):
        return LaneInput(points.system, *points.system.start_of(points.x0, points.v0))
    numbers: tuple = points.system.numbers
    moved = {i for path in swept for i in find_parameter(base, path).leaves if i < len(own.numbers)}
    lanes = {i: numbers[i] for i in moved}
    machines = own.program.machines(own.bound_system, own.numbers, lanes)
    return LaneInput(machines, *machines.start_of(points.x0, points.v0))


def lanes_with_values(base: LaneInput[System], swept: dict[str, np.ndarray]) -> LaneInput[System]:
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
