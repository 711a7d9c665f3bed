"""Forces by where they stand, "package.module:function": which of them a text may name, and how they are found.

To import a module runs its code, and to call what a text names would run anything. So a text names no module but those
that the caller allows, those of `vijax.models`, and forces that this process has told of itself, whose modules run
already: of a machine that it swept, saved or followed along a branch. What is found must be a class of
`eqx.Module`, or a function, which is left as it stands; all paths are looked at before anything is imported, and all that is
found before anything is made.
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
# Paths that this process has told of itself, or was once allowed.
_known: set[str] = set()


def remember(paths: Iterable[str]) -> None:
    """Allow the forces of some paths for the rest of this process."""
    _known.update(paths)


def paths_in(told: Any) -> Iterator[Any]:
    """All paths in the text of a force, or of its args."""
    if isinstance(told, dict):
        if "path" in told:
            yield told["path"]
        for part in told.values():
            yield from paths_in(part)
    elif isinstance(told, list):
        for part in told:
            yield from paths_in(part)


def found_by(paths: Iterable[Any], allow_forces: Allowed) -> dict[str, Any]:
    """The functions and classes of some paths.

    Raises:
        ValueError: if one of them is not allowed, cannot be imported, or is neither a function nor a class of `eqx.Module`.
    """
    paths, names = list(dict.fromkeys(paths)), _names_of(allow_forces)
    for path in paths:
        if not isinstance(path, str) or re.fullmatch(f"{_NAME}:{_NAME}", path) is None:
            raise ValueError(f'The path of a force must be "package.module:function", but is {path!r}.')
    _refuse([path for path in paths if path not in _known and not _covers(names, module_of(path))])
    found = {path: _fit(path, _stands_at(path, importlib.import_module)) for path in paths}
    for path, value in found.items():
        # What a module has from elsewhere is not what was allowed with it.
        home = module_of(path) if isinstance(value, eqx.Module) else getattr(value, "__module__", None) or ""
        if path not in _known and not _covers(names, home):
            _refuse([f"{home}:{path.partition(':')[2]}"])
    return found


def found_here(paths: Iterable[str]) -> dict[str, Any]:
    """The functions and classes of some paths in modules that this process has imported."""
    return {path: _fit(path, _stands_at(path, sys.modules.__getitem__)) for path in paths}


def path_of(value: Any) -> str:
    """The path by which a function or class is found again in this process.

    Raises:
        ValueError: for one that is not: of the main program, or of within another function.
    """
    path = f"{value.__module__}:{value.__qualname__}"
    if value.__module__ == "__main__" or _stands_at(path, sys.modules.__getitem__) is not value:
        raise ValueError(f"{path} cannot be imported.")
    return path


def module_of(path: str) -> str:
    """The module of a path."""
    return path.partition(":")[0]


def _names_of(allow_forces: Allowed) -> list[str] | None:
    """The modules that are allowed; None for all."""
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
    """Whether a module is allowed: a name stands for a package with all that is in it."""
    return names is None or any(module == name or module.startswith(f"{name}.") for name in names)


def _refuse(paths: list[str]) -> None:
    if not paths:
        return
    modules = list(dict.fromkeys(map(module_of, paths)))
    raise ValueError(
        f"The force {', '.join(paths)} is not imported, for that runs the code of {', '.join(modules)}. If you trust it, say "
        f"`allow_forces={modules!r}` to `vx.load`, `vx.system_of` or `vx.Branch`, or `--allow-forces {modules[0]}` on the "
        "command line; from then on this process knows it, and other functions take datasets with it."
    )


def _stands_at(path: str, module_named: Callable[[str], Any]) -> Any:
    """What stands at a path, as it lies there: to ask for attributes may run what answers."""
    module, _, name = path.partition(":")
    try:
        found = module_named(module)
        for k, part in enumerate(name.split(".")):
            names = vars(found) if k == 0 or isinstance(found, type) else {}
            if part not in names:
                raise AttributeError(f"there is no {part}, or it stands neither in a module nor in a class")
            found = names[part]
    except Exception as error:  # whatever a module raises that is imported
        raise ValueError(
            f'{path!r} cannot be imported: it must be "package.module:function", and the module on the path of '
            f"Python. {type(error).__name__}: {error}"
        ) from error
    return found.__func__ if isinstance(found, staticmethod) else found


def _fit(path: str, found: Any) -> Any:
    """Refuse what is neither a class to make a force of, nor a function."""
    is_fit = eqx.Module in found.__mro__ if isinstance(found, type) else isinstance(found, _FUNCTIONS)
    if not is_fit:
        raise ValueError(
            f"A force is made of functions and classes of `eqx.Module`, but {path} is {_kind_of(found)}."
        )
    return found


def _kind_of(found: Any) -> str:
    """What something is, which is not asked itself."""
    return f"the class {found.__name__}" if isinstance(found, type) else f"of type {type(found).__name__}"
