"""Parameters of a machine by path: "forcing.frequency", "stops[*].restitution", "friction[0].force".

Paths are written as in Python: fields after a dot, entries in brackets, `*` for every entry. A path names a whole
array or one of its entries. Sweeps, continuation and fits all find parameters here.

Paths refer to a machine, or to a module that holds one as its `system` beside a start; "x0[1]" is then also a path.
The `args` of a force have paths once they are bound to it, see `with_args`. A family of machines has its names as paths;
a machine is the family of which every leaf is a value. `machine_at` gives the machine of either.

Leaves are identified by number. (Rejected: identity of arrays, as in `equinox.tree_at`; two stops may share a
motion.)
"""

import dataclasses
import re
from collections import OrderedDict
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .._jax.arrays import Numbers, Reals, as_float
from .._jax.concrete import has_tracer
from .family import Family
from .force import force_numbers
from .spelling import did_you_mean
from .system import AbstractFamily, ImpactSystem, check_again, machine_of

Whole = TypeVar("Whole", bound=eqx.Module)

# Longer arrays of a force (weights of a network) are not written out: attributes of files have little room.
_LONG = 16


class Location(NamedTuple):
    """Location of a parameter among the leaves.

    Attributes:
        leaves: numbers of the arrays in the order of `jax.tree.leaves`; several for a path with a star.
        index: of the entry in each of them, () for the whole array.
    """

    leaves: tuple[int, ...]
    index: tuple[int, ...]


def parameter_names(whole: eqx.Module) -> list[str]:
    """Paths of all parameters, whole arrays, in the order of the fields."""
    return list(_numbers_of_leaves(whole))


def is_parameter(whole: eqx.Module, path: str) -> bool:
    """Test whether a path names a parameter."""
    return bool(_search(whole, path).leaves)


def find_parameter(whole: eqx.Module, path: str) -> Location:
    """Location of the parameter at a path.

    Raises:
        ValueError: for a path that names nothing; the message lists the valid paths.
    """
    place = _search(whole, path)
    if not place.leaves:
        raise ValueError(_names_nothing(whole, path))
    return place


def get_parameter(whole: eqx.Module, path: str) -> Array:
    """Value of a parameter; for a path with a star all values, stacked, (places, ...).

    Args:
        whole: the machine, or a module that holds it and a start.
        path: the path of the parameter.

    Raises:
        ValueError: for a path that names nothing, or arrays of different shapes at once.
    """
    place, leaves = find_parameter(whole, path), jax.tree.leaves(whole)
    values = [jnp.asarray(leaves[i])[place.index] for i in place.leaves]
    _check_alike(path, values)
    return jnp.stack(values) if "*" in path else values[0]


def set_parameter(whole: Whole, path: str, value: Numbers) -> Whole:
    """Machine with one parameter changed, differentiable by its value.

    Args:
        whole: the machine, or a module that holds it and a start.
        path: the path of the parameter.
        value: of the shape of the parameter; for a path with a star one value for all places, or (places, ...).

    Raises:
        ValueError: for a path that names nothing, a value of another shape, or one that makes no valid machine.
            Traced values are not checked.
    """
    place, (leaves, structure) = find_parameter(whole, path), jax.tree.flatten(whole)
    new, old = as_float(value, path), [leaves[i] for i in place.leaves]
    # One operation of JAX on a known array takes as long as all that is done here.
    library = jnp if has_tracer((new, old)) else np
    old = [library.asarray(a) for a in old]
    entries = [a[place.index] for a in old]
    _check_alike(path, entries)
    one, all_places = entries[0].shape, (len(old), *entries[0].shape)
    if new.shape != one and not ("*" in path and new.shape == all_places):
        wanted = f"{one} or {all_places}" if "*" in path else f"{one}"
        raise ValueError(f"The value of `{path}` must have shape {wanted}, but has shape {new.shape}.")
    for k, (i, a) in enumerate(zip(place.leaves, old, strict=True)):
        leaves[i] = _with_entry(a, place.index, new if new.shape == one else new[k])
    changed = jax.tree.unflatten(structure, leaves)
    if isinstance(own := _system_of(changed), ImpactSystem):  # that of a family is checked where it is made
        check_again(own)
    return changed


def _with_entry(a: Array | np.ndarray, index: tuple[int, ...], value: Array) -> Array:
    if not isinstance(a, np.ndarray):
        return a.at[index].set(value.astype(a.dtype))
    changed = np.array(a)
    changed[index] = value
    return jax.device_put(changed)


def machine_at(whole: eqx.Module, path: str, value: Numbers) -> ImpactSystem:
    """The machine with one parameter changed, of a machine or a family; otherwise as `set_parameter`."""
    return machine_of(_system_of(set_parameter(whole, path, value)))


def known_machine_at(whole: eqx.Module, path: str, value: float | np.floating) -> ImpactSystem:
    """`machine_at` for known numbers and a value that is valid: nothing is checked, and a machine has arrays of NumPy.

    That takes a tenth of the time.
    """
    place, (leaves, structure) = find_parameter(whole, path), jax.tree.flatten(whole)
    for i in place.leaves:
        leaves[i] = np.array(leaves[i])
        leaves[i][place.index] = value
    if isinstance(_system_of(whole), Family):
        leaves = [jnp.asarray(leaf) for leaf in leaves]
    return machine_of(_system_of(jax.tree.unflatten(structure, leaves)))


def moved_arrays(whole: eqx.Module, path: str) -> list[str]:
    """Paths of the arrays of the machine that a parameter moves: of a machine the path itself."""
    place, system = find_parameter(whole, path), _system_of(whole)
    if not isinstance(system, Family):
        return [path]
    flags = system.program.reached_by(place.leaves)
    return [name for name, i in _numbers_of_leaves(system.program.shapes()).items() if flags[i]]


def axis_names(path: str, ndim: int) -> list[str]:
    """Names of the axes of a parameter."""
    if re.match(r"(mass|damping|stiffness|forcing|x0|v0)\b", path) is None:
        return [f"{path}.axis{k}" for k in range(ndim)]
    if path.endswith((".times", ".phases")):
        return ["knot"]
    first = ("knot" if path.endswith(".values") else "harmonic") if path.startswith("forcing") else "row"
    return [first, "mass"][-ndim:]


def force_parameters(whole: eqx.Module) -> dict[str, float | list | str]:
    """Numbers of a force and its args by path; for long arrays the shape alone."""
    leaves = jax.tree.leaves(whole)
    known = {
        name: np.asarray(leaves[i]) for name, i in _numbers_of_leaves(whole).items() if is_of_force(name)
    }
    return {name: a.tolist() if a.size <= _LONG else f"shape {a.shape}" for name, a in known.items()}


def is_of_force(path: str) -> bool:
    """True for a path that begins like that of a number of a force or its args."""
    return re.match(r"(force|args)\b", path) is not None


def _search(whole: eqx.Module, path: str) -> Location:
    """Location of a parameter; without leaves if the path names nothing."""
    numbers, shapes = _numbers_of_leaves(whole), [np.shape(leaf) for leaf in jax.tree.leaves(whole)]
    name, index = _plain(path), ()
    while True:
        pattern = re.escape(name).replace(r"\[\*\]", r"\[\d+\]")
        found = tuple(i for known, i in numbers.items() if re.fullmatch(pattern, known))
        match = re.fullmatch(r"(.+)\[(\d+)\]", name)
        if found or match is None:
            return Location(found if all(_is_inside(index, shapes[i]) for i in found) else (), index)
        name, index = match[1], (int(match[2]), *index)


def _is_inside(index: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    return len(index) <= len(shape) and all(i < n for i, n in zip(index, shape, strict=False))


def _numbers_of_leaves(whole: eqx.Module) -> dict[str, int]:
    """Number among the leaves for each path of a whole array."""
    return _numbers_in(jax.tree.structure(whole))


@lru_cache
def _numbers_in(structure: Any) -> dict[str, int]:
    counted = jax.tree.unflatten(structure, range(structure.num_leaves))
    named, _ = jax.tree_util.tree_flatten_with_path(_named(counted))
    return {_of_sum(_plain(jax.tree_util.keystr(keys)).lstrip(".")): i for keys, i in named}


def _named(whole: Any) -> PyTree:
    """All parameters in a tree whose keys are the user's names."""
    if isinstance(whole, AbstractFamily):
        return OrderedDict(whole.values)
    own = [field.name for field in dataclasses.fields(whole) if not field.metadata.get("static", False)]
    fields = OrderedDict((name, getattr(whole, name)) for name in own)
    if not isinstance(whole, ImpactSystem):
        return _named(fields.pop("system")) | fields
    force, args = force_numbers(whole.force)
    return fields | {"force": force, "args": args, "parametric": whole.parametric}


def _system_of(whole: Any) -> Any:
    return whole if isinstance(whole, ImpactSystem | AbstractFamily) else whole.system


def _plain(path: str) -> str:
    """Path with entries of a `dict` written as fields: `args.k3` for `args['k3']`."""
    return re.sub(r"\[(['\"])(\w+)\1\]", r".\2", path)


def _of_sum(path: str) -> str:
    """Path in a sum of loads as users write it: `forcing[1].values`, and `forcing.frequency` of all of them."""
    return re.sub(r"\bforcing\.common\b", "forcing.frequency", path.replace("forcing.parts[", "forcing["))


def _check_alike(path: str, values: Iterable[Reals]) -> None:
    shapes = list(dict.fromkeys(a.shape for a in values))
    if len(shapes) > 1:
        raise ValueError(f"The path `{path}` names arrays of the shapes {shapes}: name them one by one.")


def _names_nothing(whole: eqx.Module, path: str) -> str:
    names, system = parameter_names(whole), _system_of(whole)
    if isinstance(system, AbstractFamily):
        return _no_value(path, names, system.system)
    every = [re.sub(r"^(stops|friction|hysteresis)\[\d+\]", r"\1[*]", name) for name in names]
    meant = did_you_mean(path, dict.fromkeys([*every, *names]))
    for part in ("stops", "friction", "hysteresis"):
        own = dict.fromkeys(
            re.sub(part + r"\[\d+\]", "", name) for name in names if name.startswith(f"{part}[")
        )
        names = [name for name in names if not name.startswith(f"{part}[")]
        names += [f"{part}[{j}]{name}" for j in ("j", "*") for name in own]
    sentence = (
        f"The path `{path}` names nothing that can be swept. There are {', '.join(names)}, and entries of "
        f"them as in `x0[1]` or `damping[0][1]`; the machine has {system.num_masses} masses and "
        f"{system.num_stops} stops."
    )
    if system.force is not None:
        sentence += " Of its force, floating-point numbers have paths: write 1.0 in it, not 1."
    return sentence + meant


def _no_value(path: str, names: list[str], machine: ImpactSystem) -> str:
    sentence = (
        f"The path `{path}` names nothing that can be varied: the values of the family are {', '.join(names)}, and entries of "
        "those that are arrays, as in `x0[1]`."
    )
    if is_parameter(machine, path):
        sentence += " It is a number of the machine, which the function of the family makes: let the function take it by a name."
    return sentence + did_you_mean(path, names)
