"""A force as text: where it is imported from, and its numbers; and back.

What a file can hold of a function is the name by which Python imports it, "package.module:function". A force that is
an `eqx.Module` is the name of its class and its fields. What is written is built again and compared before it counts;
a force that does not come back the same, a `lambda` or a function of the main program for instance, is told by its
name, and its args. (To pickle forces was rejected: such a file is read by the same version of everything, or not at all,
and runs what it likes.)

Numbers are numbers and lists, arrays; a sequence that is no array is {"tuple": [...]} or {"list": [...]}.
"""

import dataclasses
import reprlib
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._jax.arrays import as_float
from .force import BoundForce, NamedForce, as_force, name_of_force, whole_force
from .forces_by_path import Allowed, found_by, found_here, path_of, paths_in, remember
from .spelling import did_you_mean

_SEQUENCES = {"tuple": tuple, "list": list}
_ADVICE = (
    "Define it at the top of a module that can be imported, not in the main program, a notebook or another function; "
    "or give it back, vx.system_of(ds, force=...)."
)
# In place of a force where a machine is looked at and never run: it keeps the name of the force alone, and imports nothing.
NAMED_FORCE = NamedForce("")


def describe_force(force: Callable | None) -> dict[str, Any]:
    """What a description has of a force: `force`, and `args` if it has some."""
    if force is None:
        return {"force": None}
    own, args = (force.force, force.args) if isinstance(force, BoundForce) else (force, None)
    of_args = {} if args is None else _told("args", args, args, _numbers)
    of_force = _told("force", whole_force(own), own, as_force)
    if of_args is None:
        return {"force": {"name": name_of_force(force)}}
    return (of_force or {"force": {"name": name_of_force(own)}}) | of_args


def build_force(
    description: dict[str, Any], allow_forces: Allowed = False, force: Callable | None = None
) -> Callable | None:
    """The force of a description, bound to its `args` if it has some.

    Args:
        description: of a machine.
        allow_forces: the modules that may be imported, see `vx.load`.
        force: what is taken in place of the force that the description tells of.

    Raises:
        ValueError: for one that may not be imported, or cannot.
    """
    told, args = description.get("force"), description.get("args")
    if told is None:
        _refuse_without_force(args, force)
        return None
    if isinstance(force, NamedForce):
        return NamedForce(_name_in(told, args))
    told = {"path": told} if isinstance(told, str) else told
    if force is None:
        _check_path(told)
    paths = [*(paths_in(told) if force is None else ()), *paths_in(args)]
    found = found_by(paths, allow_forces)
    own = as_force(_made_of(told, found) if force is None else force)
    bound = own if own is None or args is None else BoundForce(own, _numbers(_from_text(args, found)))
    remember(found)
    return bound


def check_force_is_described(description: dict[str, Any]) -> None:
    """Refuse a description that has no more of a force than its name."""
    if description["force"] is not None:
        _check_path(description["force"])


def _refuse_without_force(args: Any, force: Callable | None) -> None:
    """Refuse what makes no sense for a machine that has no force."""
    if args is not None:
        raise ValueError("`args` are passed to `force`, but there is no `force`.")
    if force is not None and not isinstance(force, NamedForce):
        raise ValueError(
            "Argument `force` stands in for the force of a machine, but this one has none: leave it out."
        )


def _check_path(told: Any) -> None:
    """Refuse what tells of no force that could be imported."""
    if isinstance(told, dict) and "path" not in told and "name" in told:
        raise ValueError(f"The machine has the force {told['name']}, which no text can hold. {_ADVICE}")
    if not isinstance(told, dict) or not isinstance(told.get("path"), str):
        raise ValueError(
            '`force` must be "package.module:function", or a table with that as its `path` and the fields of a class, '
            f"but is {told!r}."
        )


def _made_of(told: dict[str, Any], found: Mapping[str, Any]) -> Callable:
    """The force of a text, before it is bound."""
    force = _from_text(told, found)
    if not callable(force):
        raise ValueError(
            f"`force` must be a function, but {told['path']} is none: give its class a `__call__`."
        )
    return force


def _told(name: str, value: Any, wanted: Any, build: Callable[[Any], Any]) -> dict[str, Any] | None:
    """The text of a force, or of its args, if `build` makes the same of what comes back."""
    try:
        text = _text_of(value)
        found = found_here(paths_in(text))
        again = build(_from_text(text, found))
        is_same = bool(eqx.tree_equal(_alike(again, wanted), wanted))
    except Exception:  # whatever a class of the user's own may raise
        return None
    if is_same:
        remember(found)
    return {name: text} if is_same else None


def _numbers(args: Any) -> Any:
    """Args in the precision that JAX is set to."""
    return jax.tree.map(as_float, args)


def _alike(found: Any, wanted: Any) -> Any:
    """A force with its numbers in the types of another's; JAX may have changed its precision since that was made."""
    return jax.tree.map(lambda a, b: np.asarray(a, b.dtype), found, wanted)


def _name_in(told: Any, args: Any) -> str:
    """The name of a force by its text, and its numbers, on one line."""
    if isinstance(told, dict) and "path" in told:
        fields = ", ".join(f"{name}={reprlib.repr(a)}" for name, a in told.items() if name != "path")
        name = f"{told['path']}({fields})" if fields else str(told["path"])
    else:
        name = str(told["name"] if isinstance(told, dict) and "name" in told else told)
    whole = name if args is None else f"{name} with args {reprlib.repr(args)}"
    return whole if whole.isprintable() else ascii(whole)  # it may stand in a terminal


def _text_of(value: Any) -> Any:
    """A force, its args or a part of them as numbers, words, lists and tables."""
    if isinstance(value, bool | int | str):
        return value
    if isinstance(value, dict):
        return {name: _text_of(a) for name, a in value.items()}
    for name, kind in _SEQUENCES.items():
        if isinstance(value, kind):
            return {name: [_text_of(a) for a in value]}
    if isinstance(value, eqx.Module):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        told = {name: _text_of(a) for name, a in fields.items() if a is not None}
        return {"path": path_of(type(value)), **told}
    if callable(value):
        return {"path": path_of(value)}
    return np.asarray(value).tolist()


def _from_text(told: Any, found: Mapping[str, Any]) -> Any:
    """What `_text_of` has told of, with what stands at its paths."""
    if isinstance(told, list):
        return _array(told)
    if not isinstance(told, dict):
        return told
    if "path" in told:
        fields = {name: _from_text(a, found) for name, a in told.items() if name != "path"}
        return _made(told["path"], found[told["path"]], fields)
    for name, kind in _SEQUENCES.items():
        if told.keys() == {name} and isinstance(told[name], list):
            return kind(_from_text(a, found) for a in told[name])
    return {name: _from_text(a, found) for name, a in told.items()}


def _array(told: list) -> np.ndarray:
    try:
        array = np.asarray(told)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"A list in `force` or `args` must be an array of numbers, but is {told!r}.")
    return array.astype(float)


def _made(path: str, found: Any, fields: dict[str, Any]) -> Any:
    """A function as it stands, or an instance of a class with some fields."""
    if not isinstance(found, type):
        if fields:
            raise ValueError(
                f"{path} is no class, so it has no fields {', '.join(fields)}: pass them as `args`."
            )
        return found
    own = [field.name for field in dataclasses.fields(found) if field.init]
    unknown = [name for name in fields if name not in own]
    if unknown:
        raise ValueError(
            f"{path} has no field `{unknown[0]}`: it has {', '.join(own) or 'none'}.{did_you_mean(unknown[0], own)}"
        )
    try:
        return found(**fields)
    except Exception as error:  # whatever its own checks may raise
        raise ValueError(
            f"{path} cannot be made of the fields {', '.join(fields) or 'none'}: {error}"
        ) from error
