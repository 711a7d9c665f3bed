"""Swept quantities by name: "forcing.frequency", "stops[*].restitution", "damping", "x0[1]", "force.k3"."""

import dataclasses
import re
from collections import OrderedDict
from collections.abc import Iterable

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, PyTree

from .._system.checks import FINITE, check_every, check_machines
from .._system.force import numbers_of
from .._system.periodicity import refuse_off_period
from .._system.system import ImpactSystem

# Longer arrays of a force, weights of a network, are not written out: attributes of files have little room.
_LONG = 16


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
    points = with_values(base, swept)
    _check(points)
    return points


def with_values(base: Point, swept: dict[str, np.ndarray]) -> Point:
    """What `points_of_lanes` returns, not checked for being machines."""
    points = jax.tree.map(lambda a: np.asarray(a)[..., None], base)
    for path, values in swept.items():
        leaves, index = _find(base, path)
        if not leaves:
            raise ValueError(_names_nothing(base, path))
        for i in leaves:
            old = jax.tree.leaves(_named(points))[i]
            new = _set(old, index, values, path)
            # Not `eqx.tree_at`, to which the empty tuple of a machine without stops is a leaf as well.
            points = jax.tree.map(lambda a, old=old, new=new: new if a is old else a, points)
    return points


def only_paths(base: Point, names: Iterable[str]) -> list[str]:
    """Those of some names that are paths."""
    return [name for name in names if _find(base, name)[0]]


def force_parameters(base: Point) -> dict[str, float | list | str]:
    """The numbers of a force and its args by their paths; of arrays that are long the shape alone."""
    leaves = dict(zip(_names(base), map(np.asarray, jax.tree.leaves(_named(base))), strict=True))
    return {
        name: leaf.tolist() if leaf.size <= _LONG else f"shape {leaf.shape}"
        for name, leaf in leaves.items()
        if is_of_force(name)
    }


def is_of_force(path: str) -> bool:
    """Whether this would be the path of a number of a force or its args."""
    return re.match(r"(force|args)\b", path) is not None


def _find(base: Point, path: str) -> tuple[list[int], tuple[int, ...]]:
    """The numbers of the leaves that a path names, none if it names nothing, and the index inside them."""
    names, shapes = _names(base), [np.shape(leaf) for leaf in jax.tree.leaves(_named(base))]
    name, index = _plain(path), ()
    while True:
        pattern = re.escape(name).replace(r"\[\*\]", r"\[\d+\]")
        leaves = [i for i, known in enumerate(names) if re.fullmatch(pattern, known)]
        match = re.fullmatch(r"(.+)\[(\d+)\]", name)
        if leaves or match is None:
            return leaves if all(_is_inside(index, shapes[i]) for i in leaves) else [], index
        name, index = match[1], (int(match[2]), *index)


def _is_inside(index: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    return len(index) <= len(shape) and all(i < n for i, n in zip(index, shape, strict=False))


def _named(point: Point) -> PyTree:
    """The numbers of a point, in a tree whose keys are the names that the user knows."""
    system = point.system
    own = {field.name: getattr(system, field.name) for field in dataclasses.fields(system)}
    force, args = numbers_of(system.force)
    return OrderedDict(own | {"force": force, "args": args, "x0": point.x0, "v0": point.v0})


def _names(base: Point) -> list[str]:
    """The paths of whole leaves, in their order."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(_named(base))
    return [_plain(jax.tree_util.keystr(keys)).lstrip(".") for keys, _ in leaves]


def _plain(path: str) -> str:
    """Entries of a `dict` are named as fields are: `args.k3` is `args['k3']`."""
    return re.sub(r"\[(['\"])(\w+)\1\]", r".\2", path)


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
    names = _names(base)
    of_stops = dict.fromkeys(re.sub(r"stops\[\d+\]", "", name) for name in names if name.startswith("stops["))
    names = [name for name in names if not name.startswith("stops[")]
    names += [f"stops[{j}]{name}" for j in ("j", "*") for name in of_stops]
    sentence = (
        f"The path `{path}` names nothing that can be swept. There are {', '.join(names)}, and entries of "
        f"them as in `x0[1]` or `damping[0][1]`; the machine has {base.system.num_masses} masses and "
        f"{base.system.num_stops} stops."
    )
    if base.system.force is None:
        return sentence
    return f"{sentence} Of its force, floating-point numbers have paths: write 1.0 in it, not 1."


def _check(points: Point) -> None:
    """Refuse values that make no machine, all lanes at once."""
    for leaf in jax.tree.leaves(points):
        check_every("", leaf, FINITE)
    check_machines(points.system, points.x0)
    refuse_off_period(points.system, points.x0, points.v0, who="a sweep", where=", at every point")
