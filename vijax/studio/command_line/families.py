"""Families of machines on the command line: a function in a file of Python, FILE.py:FUNCTION."""

import importlib.util
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..._jax.arrays import Numbers
from ..._system.family import Family
from ..._system.parameters import set_parameter


def is_function(file: Path) -> bool:
    """True for FILE.py:FUNCTION."""
    return _parts(file) is not None


def family_of_file(file: Path, values: Mapping[str, Numbers]) -> Family:
    """Family of a function in a file, which is run: naming it is permission.

    Args:
        file: FILE.py:FUNCTION.
        values: by names of the function, or paths into those that are arrays; others take its defaults.
    """
    parts = _parts(file)
    assert parts is not None
    function = _function(Path(parts[0]), parts[1])
    whole: dict[str, Any] = {name: a for name, a in values.items() if "[" not in name}
    try:
        family = Family(function, **whole)
    except ValueError as error:
        raise ValueError(f"{file}: {error} Values are given by --set NAME=VALUE.") from error
    for path in values.keys() - whole.keys():
        family = set_parameter(family, path, values[path])
    return family


def _parts(file: Path) -> tuple[str, str] | None:
    match = re.fullmatch(r"(.+\.py):([^\W\d]\w*)", str(file))
    return None if match is None else (match[1], match[2])


def _function(file: Path, name: str) -> Callable:
    """Function of a file, whose module can then be imported by its name."""
    if not file.exists():
        raise ValueError(f"There is no {file}.")
    found = getattr(_module(file), name, None)
    if not callable(found):
        raise ValueError(f"{file} has no function `{name}`.")
    return found


def _module(file: Path) -> Any:
    module, whole = file.stem, file.resolve()
    known = sys.modules.get(module)
    if known is not None:
        if Path(getattr(known, "__file__", None) or "").resolve() == whole:
            return known
        raise ValueError(f"{file} has the name of a module that Python has loaded already: rename the file.")
    made = importlib.util.spec_from_file_location(module, whole)
    assert made is not None
    assert made.loader is not None
    found = sys.modules[module] = importlib.util.module_from_spec(made)
    sys.path.append(str(whole.parent))  # for what the file imports from beside it
    try:
        made.loader.exec_module(found)
    except BaseException:
        del sys.modules[module]
        raise
    return found
