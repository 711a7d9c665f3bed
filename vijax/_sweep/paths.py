"""Swept quantities by name: "forcing.frequency", "stops[*].restitution", "damping", "x0[1]"."""

import re
from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from .._contact.start import is_touching
from .._system.system import ImpactSystem, check_semidefinite

_PATH = re.compile(
    r"(?:stops\[(?P<stop>\d+|\*)\]\.|(?P<forcing>forcing)\.)?(?P<field>\w+)(?P<index>(\[\d+\])*)"
)
_FIELDS = {
    "stops": ("position", "restitution"),
    "forcing": ("amplitude", "frequency", "phase", "mean"),
    "system": ("mass", "damping", "stiffness"),
    "start": ("x0", "v0"),
}


class Point(eqx.Module):
    """What a lane is made of: a machine and a start."""

    system: ImpactSystem
    x0: Array | np.ndarray
    v0: Array | np.ndarray


def points_of_lanes(base: Point, swept: dict[str, np.ndarray]) -> Point:
    """Give every leaf of `base` lanes as its last axis, the swept values where they are named.

    Args:
        base: the machine and start that hold where nothing is swept.
        swept: for each path one value a lane, (lanes, ...).

    Returns:
        The lanes; leaves that are not swept have a single one.

    Raises:
        ValueError: for a path that names nothing or values that do not fit or make no machine.
    """
    points = jax.tree.map(lambda a: np.asarray(a)[..., None], base)
    for path, values in swept.items():
        leaves, index = _find(base, path)
        for leaf in leaves:
            points = eqx.tree_at(leaf, points, _set(leaf(points), index, values, path))
    _check(points)
    return points


def is_of_machine(path: str) -> bool:
    """Whether this is the path of a quantity of the machine, such as one may sweep."""
    match = _PATH.fullmatch(path)
    kind = "system" if match is None else "stops" if match["stop"] else match["forcing"] or "system"
    return match is not None and match["field"] in _FIELDS[kind]


def _find(base: Point, path: str) -> tuple[list[Callable], tuple[int, ...]]:
    """The leaves that a path names, as getters, and the index inside them."""
    match = _PATH.fullmatch(path)
    if match is None:
        raise ValueError(_names_nothing(base, path))
    stop, field = match["stop"], match["field"]
    index = tuple(int(i) for i in re.findall(r"\[(\d+)\]", match["index"]))
    owners: list[Callable]
    if stop is not None:
        numbers = range(len(base.system.stops)) if stop == "*" else [int(stop)]
        kind, owners = "stops", [lambda p, j=j: p.system.stops[j] for j in numbers]
        is_there = len(numbers) > 0 and max(numbers) < len(base.system.stops)
    elif match["forcing"]:
        kind, owners, is_there = "forcing", [lambda p: p.system.forcing], True
    elif field in _FIELDS["start"]:
        kind, owners, is_there = "start", [lambda p: p], True
    else:
        kind, owners, is_there = "system", [lambda p: p.system], True
    if not is_there or field not in _FIELDS[kind]:
        raise ValueError(_names_nothing(base, path))
    leaves = [lambda p, owner=owner: getattr(owner(p), field) for owner in owners]
    shape = np.shape(leaves[0](base))
    if len(index) > len(shape) or any(i >= n for i, n in zip(index, shape, strict=False)):
        raise ValueError(_names_nothing(base, path))
    return leaves, index


def _set(leaf: np.ndarray, index: tuple[int, ...], values: np.ndarray, path: str) -> np.ndarray:
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


def _names_nothing(base: Point, path: str) -> str:
    names = [*_FIELDS["system"], *(f"forcing.{name}" for name in _FIELDS["forcing"]), *_FIELDS["start"]]
    if base.system.stops:
        names += [f"stops[{j}].{name}" for j in ("j", "*") for name in _FIELDS["stops"]]
    return (
        f"The path `{path}` names nothing that can be swept. There are {', '.join(names)}, and entries of "
        f"them as in `x0[1]` or `damping[0][1]`; the machine has {base.system.num_masses} masses and "
        f"{base.system.num_stops} stops."
    )


def _check(points: Point) -> None:
    """Refuse values that make no machine, all lanes at once."""
    system = points.system
    for leaf in jax.tree.leaves(points):
        if not np.isfinite(leaf).all():
            raise ValueError("All swept values must be finite.")
    if not (system.mass > 0).all():
        raise ValueError("Every swept `mass` must be positive.")
    if not (system.forcing.frequency > 0).all():
        raise ValueError("Every `forcing.frequency` must be positive: a sweep counts forcing periods.")
    for name in ("damping", "stiffness"):
        check_semidefinite(name, np.moveaxis(np.asarray(getattr(system, name)), -1, 0))
    _check_stops(points)


def _check_stops(points: Point) -> None:
    stops = points.system.stops
    for j, stop in enumerate(stops):
        if not ((stop.restitution >= 0) & (stop.restitution <= 1)).all():
            raise ValueError(f"Every `stops[{j}].restitution` must lie between 0 and 1.")
        gap = stop.sign * (stop.position - points.x0[stop.mass])
        if ((gap < 0) & ~np.asarray(is_touching(gap, stop.position))).any():
            raise ValueError(
                f"Some points start beyond a stop: `x0[{stop.mass}]` is past `stops[{j}]`. Start mass "
                f"{stop.mass} on its free side ({stop.side} stop), or on the stop."
            )
        for other in stops[j + 1 :]:
            if other.mass == stop.mass and not (stop.sign * (stop.position - other.position) > 0).all():
                raise ValueError(
                    f"The lower stop of mass {stop.mass} must lie below its upper stop at every point."
                )
