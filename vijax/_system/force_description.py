"""A force as text: where it is imported from, and its numbers; and back.

What a file can hold of a function is the name by which Python imports it, "package.module:function". A force that is
an `eqx.Module` is the name of its class and its fields. What is written is built again and compared before it counts;
a force that does not come back the same, a `lambda` or a function of the main program for instance, is told by its
name alone. (To pickle forces was rejected: such a file is read by the same version of everything, or not at all.)

Numbers are numbers and lists, arrays; a sequence that is no array is {"tuple": [...]} or {"list": [...]}.
"""

import dataclasses
import importlib
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._types import as_float
from .force import BoundForce, as_force, name_of_force, whole_force

_SEQUENCES = {"tuple": tuple, "list": list}
_ADVICE = "Define it at the top of a module that can be imported, not in the main program, a notebook or another function."


def describe_force(force: Callable | None) -> dict[str, Any]:
    """What a description has of a force: `force`, and `args` if it has some."""
    if force is None:
        return {"force": None}
    own, args = (force.force, force.args) if isinstance(force, BoundForce) else (force, None)
    try:
        told = {"force": _text_of(whole_force(own))} | ({} if args is None else {"args": _text_of(args)})
        found, wanted = build_force(told), own if args is None else force
        is_same = bool(eqx.tree_equal(_alike(found, wanted), wanted))
    except Exception:  # whatever a class of the user's own may raise
        is_same, told = False, {}
    return told if is_same else {"force": {"name": name_of_force(force)}}


def build_force(description: dict[str, Any]) -> Callable | None:
    """The force of a description, bound to its `args` if it has some.

    Raises:
        ValueError: for one that cannot be imported.
    """
    told, args = description.get("force"), description.get("args")
    if told is None:
        if args is not None:
            raise ValueError("`args` are passed to `force`, but there is no `force`.")
        return None
    if isinstance(told, dict) and "path" not in told and "name" in told:
        raise ValueError(f"The machine has the force {told['name']}, which no text can hold. {_ADVICE}")
    if isinstance(told, str):
        told = {"path": told}
    if not isinstance(told, dict) or not isinstance(told.get("path"), str):
        raise ValueError(
            '`force` must be "package.module:function", or a table with that as its `path` and the fields of a class, '
            f"but is {told!r}."
        )
    force = _from_text(told)
    if not callable(force):
        raise ValueError(f"`force` must be a function, but {told['path']} is {force!r}.")
    found = as_force(force)
    if found is None or args is None:
        return found
    return BoundForce(found, jax.tree.map(as_float, _from_text(args)))


def check_force_is_told(description: dict[str, Any]) -> None:
    """Refuse a description that has no more of a force than its name."""
    if isinstance(description["force"], dict) and "path" not in description["force"]:
        build_force(description)


def _alike(found: Any, wanted: Any) -> Any:
    """A force with its numbers in the types of another's; JAX may have changed its precision since that was made."""
    return jax.tree.map(lambda a, b: np.asarray(a, b.dtype), found, wanted)


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
        return {"path": _path_of(type(value)), **told}
    if callable(value):
        return {"path": _path_of(value)}
    return np.asarray(value).tolist()


def _from_text(told: Any) -> Any:
    """What `_text_of` has told of."""
    if isinstance(told, list):
        return _array(told)
    if not isinstance(told, dict):
        return told
    if "path" in told:
        fields = {name: _from_text(a) for name, a in told.items() if name != "path"}
        return _made(told["path"], fields)
    for name, kind in _SEQUENCES.items():
        if told.keys() == {name}:
            return kind(_from_text(a) for a in told[name])
    return {name: _from_text(a) for name, a in told.items()}


def _array(told: list) -> np.ndarray:
    try:
        return np.asarray(told, float)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"A list in `force` or `args` must be an array of numbers, but is {told!r}."
        ) from error


def _made(path: str, fields: dict[str, Any]) -> Any:
    """A function, or an instance of a class with some fields."""
    found = _imported(path)
    if not isinstance(found, type):
        if fields:
            raise ValueError(
                f"{path} is no class, so it has no fields {', '.join(fields)}: pass them as `args`."
            )
        return found
    try:
        return found(**fields)
    except TypeError as error:
        raise ValueError(
            f"{path} cannot be made of the fields {', '.join(fields) or 'none'}: {error}"
        ) from error


def _imported(path: str) -> Any:
    module, _, name = path.partition(":")
    try:
        found = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f'{path!r} cannot be imported: it must be "package.module:function", and the module on the path of '
            f"Python. {type(error).__name__}: {error}"
        ) from error
    return found


def _path_of(value: Any) -> str:
    """The name by which a function or class is imported, which another program finds as well."""
    path = f"{value.__module__}:{value.__qualname__}"
    if value.__module__ == "__main__" or _imported(path) is not value:
        raise ValueError(f"{path} cannot be imported.")
    return path
