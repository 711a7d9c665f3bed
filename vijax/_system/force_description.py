"""Forces as text: import paths and numbers; and back.

A file can hold a function only by its import path, "package.module:function". A force that is an `eqx.Module` is the
path of its class and its fields. The text is used only if the force rebuilt from it is equal. A force that cannot be
rebuilt, a `lambda` or a function of the main program for instance, is described by its name and its args. (Rejected
alternative: pickling. Such a file can only be read by the same version of everything, and may run any code.)

Numbers stay numbers, arrays are lists; a sequence that is not an array is {"tuple": [...]} or {"list": [...]}.
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
from .tables import array_of

_SEQUENCES = {"tuple": tuple, "list": list}
_ADVICE = (
    "Define it at the top of a module that can be imported, not in the main program, a notebook or another function; "
    "or give it back, vx.system_of(ds, force=...)."
)
# Placeholder of a force in machines that are inspected and never run: keeps only the name, and imports nothing.
NAMED_FORCE = NamedForce("")


def describe_force(force: Callable | None) -> dict[str, Any]:
    """Entries of a description about a force: `force`, and `args` if it has any."""
    if force is None:
        return {"force": None}
    own, args = (force.force, force.args) if isinstance(force, BoundForce) else (force, None)
    of_args = {} if args is None else _described("args", args, args, _numbers)
    of_force = _described("force", whole_force(own), own, as_force)
    if of_args is None:
        return {"force": {"name": name_of_force(force)}}
    return (of_force or {"force": {"name": name_of_force(own)}}) | of_args


def build_force(
    description: dict[str, Any], allow_forces: Allowed = False, force: Callable | None = None
) -> Callable | None:
    """Force of a description, bound to its `args` if it has any.

    Args:
        description: of a machine.
        allow_forces: the modules from which forces may be imported, see `vx.load`.
        force: replacement for the force of the description.

    Raises:
        ValueError: for a force that is not allowed or cannot be imported.
    """
    given, args = description.get("force"), description.get("args")
    if given is None:
        _refuse_without_force(args, force)
        return None
    if isinstance(force, NamedForce):
        return NamedForce(_name_in(given, args))
    given = {"path": given} if isinstance(given, str) else given
    if force is None:
        _check_path(given)
    paths = [*(paths_in(given) if force is None else ()), *paths_in(args)]
    found = found_by(paths, allow_forces)
    own = as_force(_made_of(given, found) if force is None else force)
    bound = own if own is None or args is None else BoundForce(own, _numbers(_from_text(args, found)))
    remember(found)
    return bound


def check_force_is_described(description: dict[str, Any]) -> None:
    """Reject a description that holds only the name of its force."""
    if description["force"] is not None:
        _check_path(description["force"])


def _refuse_without_force(args: Any, force: Callable | None) -> None:
    """Reject `args` or a replacement for the force of a machine without one."""
    if args is not None:
        raise ValueError("`args` are passed to `force`, but there is no `force`.")
    if force is not None and not isinstance(force, NamedForce):
        raise ValueError(
            "Argument `force` replaces the force of a machine, but this machine has none: leave it out."
        )


def _check_path(given: Any) -> None:
    """Reject text without an import path of a force."""
    if isinstance(given, dict) and "path" not in given and "name" in given:
        raise ValueError(f"The machine has the force {given['name']}, which no text can hold. {_ADVICE}")
    if not isinstance(given, dict) or not isinstance(given.get("path"), str):
        raise ValueError(
            '`force` must be "package.module:function", or a table with that as its `path` and the fields of a class, '
            f"but is {given!r}."
        )


def _made_of(given: dict[str, Any], found: Mapping[str, Any]) -> Callable:
    """Force of a text, before its args are bound."""
    force = _from_text(given, found)
    if not callable(force):
        raise ValueError(
            f"`force` must be a function, but {given['path']} is none: give its class a `__call__`."
        )
    return force


def _described(name: str, value: Any, wanted: Any, build: Callable[[Any], Any]) -> dict[str, Any] | None:
    """Text of a force, or of its args; None unless `build` makes an equal value from the text."""
    try:
        text = _text_of(value)
        found = found_here(paths_in(text))
        again = build(_from_text(text, found))
        is_same = bool(eqx.tree_equal(_alike(again, wanted), wanted))
    except Exception:  # a user's class may raise anything
        return None
    if is_same:
        remember(found)
    return {name: text} if is_same else None


def _numbers(args: Any) -> Any:
    """Args in the precision that JAX is set to."""
    return jax.tree.map(as_float, args)


def _alike(found: Any, wanted: Any) -> Any:
    """Force with its numbers in the types of another's; JAX's precision may have changed since that was made."""
    return jax.tree.map(lambda a, b: np.asarray(a, b.dtype), found, wanted)


def _name_in(given: Any, args: Any) -> str:
    """Name of a force from its text, with its numbers, on one line."""
    if isinstance(given, dict) and "path" in given:
        fields = ", ".join(f"{name}={reprlib.repr(a)}" for name, a in given.items() if name != "path")
        name = f"{given['path']}({fields})" if fields else str(given["path"])
    else:
        name = str(given["name"] if isinstance(given, dict) and "name" in given else given)
    whole = name if args is None else f"{name} with args {reprlib.repr(args)}"
    return whole if whole.isprintable() else ascii(whole)  # it may be printed in a terminal


def _text_of(value: Any) -> Any:
    """A force, its args or a part of them as numbers, strings, lists and tables."""
    if isinstance(value, bool | int | str):
        return value
    if isinstance(value, dict):
        return {name: _text_of(a) for name, a in value.items()}
    for name, kind in _SEQUENCES.items():
        if isinstance(value, kind):
            return {name: [_text_of(a) for a in value]}
    if isinstance(value, eqx.Module):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        given = {name: _text_of(a) for name, a in fields.items() if a is not None}
        return {"path": path_of(type(value)), **given}
    if callable(value):
        return {"path": path_of(value)}
    return np.asarray(value).tolist()


def _from_text(given: Any, found: Mapping[str, Any]) -> Any:
    """Inverse of `_text_of`; `found` holds the functions and classes by path."""
    if isinstance(given, list):
        return array_of(given, "A list in `force` or `args` must be an array of numbers", float, "biuf")
    if not isinstance(given, dict):
        return given
    if "path" in given:
        fields = {name: _from_text(a, found) for name, a in given.items() if name != "path"}
        return _made(given["path"], found[given["path"]], fields)
    for name, kind in _SEQUENCES.items():
        if given.keys() == {name} and isinstance(given[name], list):
            return kind(_from_text(a, found) for a in given[name])
    return {name: _from_text(a, found) for name, a in given.items()}


def _made(path: str, found: Any, fields: dict[str, Any]) -> Any:
    """A function unchanged, or an instance of a class from its fields."""
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
    except Exception as error:  # its own checks may raise anything
        raise ValueError(
            f"{path} cannot be made of the fields {', '.join(fields) or 'none'}: {error}"
        ) from error
