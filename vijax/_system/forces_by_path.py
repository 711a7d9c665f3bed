"""Forces by path, "package.module:function": the paths that are allowed, and their lookup.

Importing a module runs its code, and calling whatever a text names could run anything. So a text may name only
modules that the caller allows, those of `vijax.models`, and forces that this process itself has described, whose
modules are already imported: those of machines that it swept, saved or followed along a branch. The object at a path
must be a class of `eqx.Module`, or a function, which is not called. All paths are checked before any import, and all
objects before any class is instantiated.
"""

import importlib
import re
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

Allowed = bool | str | Sequence[str]

_READY_MADE = "vijax.models"
_NAME = r"[^\W\d]\w*(\.[^\W\d]\w*)*"
_FUNCTIONS = (
    types.FunctionType,
    type(jax.jit(lambda: None)),
    jax.custom_jvp,
    jax.custom_vjp,
    jnp.ufunc,
    eqx.Module,
)
# Paths that this process has described itself, or was allowed to import before.
_known: set[str] = set()


def remember(paths: Iterable[str]) -> None:
    """Allow the forces of some paths for the rest of this process."""
    _known.update(paths)


def paths_in(given: Any) -> Iterator[Any]:
    """All paths in the text of a force, or of its args."""
    if isinstance(given, dict):
        if "path" in given:
            yield given["path"]
        for part in given.values():
            yield from paths_in(part)
    elif isinstance(given, list):
        for part in given:
            yield from paths_in(part)


def found_by(paths: Iterable[Any], allow_forces: Allowed, what: str = "force") -> dict[str, Any]:
    """Functions and classes at some paths; `what` they are, for messages.

    Raises:
        ValueError: if one is not allowed, cannot be imported, or is neither a function nor a class of `eqx.Module`.
    """
    paths, names = list(dict.fromkeys(paths)), _names_of(allow_forces)
    for path in paths:
        if not isinstance(path, str) or re.fullmatch(f"{_NAME}:{_NAME}", path) is None:
            raise ValueError(f'The path of a {what} must be "package.module:function", but is {path!r}.')
    _refuse([path for path in paths if path not in _known and not _covers(names, module_of(path))], what)
    found = {path: _fit(path, _stands_at(path, importlib.import_module), what) for path in paths}
    for path, value in found.items():
        # An object that a module has imported from elsewhere is not allowed along with the module.
        home = module_of(path) if isinstance(value, eqx.Module) else getattr(value, "__module__", None) or ""
        if path not in _known and not _covers(names, home):
            _refuse([f"{home}:{path.partition(':')[2]}"], what)
    return found


def found_here(paths: Iterable[str]) -> dict[str, Any]:
    """Functions and classes at some paths, in modules that this process has imported."""
    return {path: _fit(path, _stands_at(path, sys.modules.__getitem__), "force") for path in paths}


def path_of(value: Any) -> str:
    """Path at which a function or class is found again in this process.

    Raises:
        ValueError: for one of the main program, or defined within another function.
    """
    path = f"{value.__module__}:{value.__qualname__}"
    if value.__module__ == "__main__" or _stands_at(path, sys.modules.__getitem__) is not value:
        raise ValueError(f"{path} cannot be imported.")
    return path


def module_of(path: str) -> str:
    """Module of a path."""
    return path.partition(":")[0]


def _names_of(allow_forces: Allowed) -> list[str] | None:
    """Names of the allowed modules; None if all are allowed."""
    if isinstance(allow_forces, bool):
        return None if allow_forces else [_READY_MADE]
    names = [allow_forces] if isinstance(allow_forces, str) else allow_forces
    if not isinstance(names, list | tuple) or not all(
        isinstance(name, str) and re.fullmatch(_NAME, name) for name in names
    ):
        raise ValueError(
            'Argument `allow_forces` must be True, or the names of modules, as ["package.module"], but is '
            f"{allow_forces!r}."
        )
    return [_READY_MADE, *names]


def _covers(names: list[str] | None, module: str) -> bool:
    """True if a module is allowed; a package name covers all its submodules."""
    return names is None or any(module == name or module.startswith(f"{name}.") for name in names)


def _refuse(paths: list[str], what: str) -> None:
    if not paths:
        return
    modules = list(dict.fromkeys(map(module_of, paths)))
    raise ValueError(
        f"The {what} {', '.join(paths)} is not imported, for that runs the code of {', '.join(modules)}. If you trust it, say "
        f"`allow_forces={modules!r}` to `vx.load`, `vx.system_of` or `vx.Branch`, or `--allow-forces {modules[0]}` on the "
        "command line; from then on this process knows it, and other functions take datasets with it."
    )


def _stands_at(path: str, module_named: Callable[[str], Any]) -> Any:
    """Object at a path, from `vars` alone: `getattr` may run code."""
    module, _, name = path.partition(":")
    try:
        found = module_named(module)
        for k, part in enumerate(name.split(".")):
            names = vars(found) if k == 0 or isinstance(found, type) else {}
            if part not in names:
                raise AttributeError(f"there is no {part} in a module or a class")
            found = names[part]
    except Exception as error:  # an imported module may raise anything
        raise ValueError(
            f'{path!r} cannot be imported: it must be "package.module:function", and the module on the path of '
            f"Python. {type(error).__name__}: {error}"
        ) from error
    return found.__func__ if isinstance(found, staticmethod) else found


def _fit(path: str, found: Any, what: str) -> Any:
    """Reject an object that is neither a class of `eqx.Module` nor a function."""
    is_fit = eqx.Module in found.__mro__ if isinstance(found, type) else isinstance(found, _FUNCTIONS)
    if not is_fit:
        raise ValueError(
            f"A {what} is made of functions and classes of `eqx.Module`, but {path} is {_kind_of(found)}."
        )
    return found


def _kind_of(found: Any) -> str:
    """Kind of an object for a message, without calling its methods."""
    return f"the class {found.__name__}" if isinstance(found, type) else f"of type {type(found).__name__}"
