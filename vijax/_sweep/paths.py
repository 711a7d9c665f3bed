"""Swept quantities by name: "forcing.frequency", "stops[*].restitution", "damping", "x0[1]"."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._contact.start import is_touching
from .._system.system import ImpactSystem

_PART = re.compile(r"([A-Za-z_]\w*)((?:\[(?:\d+|\*)\])*)$")
_INDEX = re.compile(r"\[(\d+|\*)\]")


class Point(eqx.Module):
    """What a lane is made of: a machine and a start."""

    system: ImpactSystem
    x0: np.ndarray
    v0: np.ndarray


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
    leaves = jax.tree.map(lambda a: np.asarray(a)[..., None], base)
    for path, values in swept.items():
        for leaf, index in _find(base, path):
            leaves = eqx.tree_at(leaf, leaves, _set(leaf(leaves), index, values, path))
    _check(leaves)
    return leaves


def _find(base: Point, path: str):
    """List the leaves that a path names, each as a getter and the index inside."""
    parts = [_PART.match(part) for part in path.split(".")]
    if any(part is None for part in parts):
        raise ValueError(_names_nothing(base, path))
    found = [((), ())]
    for part in parts:
        name, indices = part[1], _INDEX.findall(part[2])
        found = [step for old in found for step in _enter(base, *old, name, indices, path)]
    for trail, _ in found:
        if not eqx.is_array_like(_follow(base, trail)):
            raise ValueError(_names_nothing(base, path))
    return [(lambda point, trail=trail: _follow(point, trail), index) for trail, index in found]


def _enter(base: Point, trail: tuple, index: tuple, name: str, indices: list[str], path: str):
    """Go one name and its indices deeper."""
    node = _follow(base, trail)
    if index:
        raise ValueError(_names_nothing(base, path))
    if trail == () and name not in ("x0", "v0"):
        node, trail = base.system, ("system",)
    if not isinstance(node, eqx.Module) or name not in {f for f in vars(node)}:
        raise ValueError(_names_nothing(base, path))
    node, trail = getattr(node, name), (*trail, name)
    if not isinstance(node, tuple):
        if isinstance(node, (int, str)):
            raise ValueError(_names_nothing(base, path))
        shape = np.shape(node)
        if len(indices) > len(shape) or any(i == "*" or int(i) >= n for i, n in zip(indices, shape, strict=False)):
            raise ValueError(_names_nothing(base, path))
        return [(trail, tuple(int(i) for i in indices))]
    if len(indices) != 1 or (indices[0] != "*" and int(indices[0]) >= len(node)):
        raise ValueError(_names_nothing(base, path))
    chosen = range(len(node)) if indices[0] == "*" else [int(indices[0])]
    return [((*trail, j), ()) for j in chosen]


def _follow(point, trail: tuple):
    for name in trail:
        point = point[name] if isinstance(name, int) else getattr(point, name)
    return point


def _set(leaf: np.ndarray, index: tuple[int, ...], values: np.ndarray, path: str) -> np.ndarray:
    shape = leaf[index].shape[:-1]
    if values.shape[1:] != shape:
        raise ValueError(
            f"The values of `{path}` must have shape (points, {', '.join(map(str, shape))}), "
            f"one value per point, but have shape {values.shape}."
        )
    lanes = np.moveaxis(values, 0, -1)
    new = np.array(np.broadcast_to(leaf, np.broadcast_shapes(leaf.shape, (*leaf.shape[:-1], values.shape[0]))))
    new[index] = lanes
    return new


def _names_nothing(base: Point, path: str) -> str:
    fields = [f for f in vars(base.system) if f not in ("forcing", "stops")]
    names = [*fields, *(f"forcing.{f}" for f in vars(base.system.forcing)), "x0", "v0"]
    names += ["stops[j].position", "stops[j].restitution"] if base.system.stops else []
    return (
        f"The path `{path}` names nothing that can be swept. There are {', '.join(names)}; entries as in "
        "`x0[1]` or `damping[0][1]`, all stops as in `stops[*].restitution`."
    )


def _check(lanes: Point) -> None:
    """Refuse values that make no machine, all lanes at once."""
    system = lanes.system
    for leaf in jax.tree.leaves(lanes):
        if not np.isfinite(leaf).all():
            raise ValueError("All swept values must be finite.")
    if not (system.mass > 0).all():
        raise ValueError("Every swept `mass` must be positive.")
    if not (system.forcing.frequency > 0).all():
        raise ValueError("Every swept `forcing.frequency` must be positive: a sweep counts forcing periods.")
    for name in ("damping", "stiffness"):
        _check_matrices(name, np.moveaxis(np.asarray(getattr(system, name)), -1, 0))
    for j, stop in enumerate(system.stops):
        if not ((stop.restitution >= 0) & (stop.restitution <= 1)).all():
            raise ValueError(f"Every `stops[{j}].restitution` must lie between 0 and 1.")
        gap = stop.sign * (stop.position - lanes.x0[stop.mass])
        if ((gap < 0) & ~np.asarray(is_touching(jnp.asarray(gap), jnp.asarray(stop.position)))).any():
            raise ValueError(
                f"Some lanes start beyond a stop: `x0[{stop.mass}]` is past `stops[{j}]`. Start mass "
                f"{stop.mass} on its free side ({stop.side} stop), or on the stop."
            )
        for other in system.stops[j + 1 :]:
            if other.mass == stop.mass and not (stop.sign * (stop.position - other.position) > 0).all():
                raise ValueError(f"The lower stop of mass {stop.mass} must lie below its upper stop everywhere.")


def _check_matrices(name: str, matrices: np.ndarray) -> None:
    slack = 4 * matrices.shape[-1] ** 2 * np.finfo(matrices.dtype).eps * np.abs(matrices).max(initial=0.0)
    if np.abs(matrices - np.swapaxes(matrices, 1, 2)).max() > slack:
        raise ValueError(f"Every swept `{name}` must be symmetric.")
    if np.linalg.eigvalsh(matrices).min() < -slack:
        raise ValueError(f"Every swept `{name}` must be positive semi-definite.")
