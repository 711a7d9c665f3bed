"""Machines as files that people read and write: TOML or JSON."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .._writing import naming_argument
from .description import build, describe
from .family import Family
from .family_description import build_family, describe_family
from .force_description import NAMED_FORCE, check_force_is_described
from .forces_by_path import Allowed
from .system import AnySystem, ImpactSystem, machine_of, with_args
from .tables import table_of

# Suffixes of machine files.
SUFFIXES = (".toml", ".json")
# Tables that files of the command line hold besides the machine.
_BESIDE = ("sweep",)
# Limit on the bytes read from a file; the matrices of a thousand masses take less than half of it.
_LARGEST = 1 << 28


def save(system: AnySystem, file: str | os.PathLike[str], *, args: object = None) -> None:
    """Write a machine to a file, from which `load` rebuilds it bit for bit.

    The names in the file are those of Python: `mass`, `damping`, `stiffness`, a table `forcing`, one table for each
    of `stops`. A `force` is written as its import path, `"package.module:function"`, an `eqx.Module` with its fields;
    no code. Of a `vx.Family` the file has a table `family`: the import path of its `function`, `values` and `labels`.

    Args:
        system: the machine, or the family.
        file: the file to write, `.toml` or `.json`. An existing file of that name is replaced.
        args: the `args` of the machine's `force`; the file then holds them too.

    Raises:
        ValueError: for another suffix, a batch of machines, a force that cannot be imported, or a path that cannot be
            written to.

    Example:
        ```python
        import vijax as vx
        vx.save(vx.models.wagg_bishop_b(0.8), "machine.toml")
        system = vx.load("machine.toml")
        ```
    """
    path = _checked(file)
    if isinstance(system, Family):
        _write_family(system, path, args)
        return
    if args is not None:
        system = with_args(system, args)
    description = describe(machine_of(system))
    check_force_is_described(description)
    build(description, system.mass.dtype)  # rejects what could not be rebuilt, a batch for instance
    text = _text(path, _without_none(description))
    with naming_argument("file", path):
        path.write_text(text, encoding="utf-8")


def _write_family(family: Family, path: Path, args: object) -> None:
    if args is not None:
        raise ValueError(
            "Argument `args` is for machines: let the function of the family give its `force` these numbers."
        )
    table = describe_family(family)
    # A file is written by hand too: what the function computes may be mended later.
    del table["program"]
    if ":" not in table["function"]:
        raise ValueError(
            f"The function {table['function']} of the family cannot be imported: define it at the top of a module, not in the main "
            "program, a notebook or another function."
        )
    with naming_argument("file", path):
        path.write_text(_text(path, {"family": table}), encoding="utf-8")


def load(file: str | os.PathLike[str], *, allow_forces: Allowed = False) -> ImpactSystem | Family:
    """Build the machine of a file that was written by `save` or by hand.

    A load may lack `phase` and `mean`, a stop its `motion`, and the file may lack `stops`. A stop has a `mass` and a
    `side`, a contact has a `row`, a table of coefficients by the numbers of masses. A table `sweep` (see
    `python -m vijax sweep --help`) is ignored.

    Importing a `force` runs its module. So a file may name only forces of `vijax.models`, forces that this process
    itself has saved or swept, or was allowed to import before, and forces that `allow_forces` allows. A force is made
    of functions and classes of `eqx.Module`, and nothing else is called. If the file holds `args` too, the machine
    has them, and `simulate`, `sweep` and all others use them unless you pass others. The function of a family counts as a
    force.

    Args:
        file: the file, TOML or JSON by its suffix.
        allow_forces: names of modules from which a force may be imported, `["springs"]`, each with its submodules;
            True for any that the file names, which may run any installed code. The force must be defined there.

    Returns:
        The machine, or the family, in the precision that JAX is set to.

    Raises:
        ValueError: for another suffix, a file that makes no machine, with the place and the remedy, or a force that
            is not allowed or cannot be imported.
        OSError: if the file cannot be read.

    Example:
        ```python
        import vijax as vx
        vx.save(vx.models.wagg_bishop_b(0.8), "machine.json")
        sol = vx.simulate(vx.load("machine.json"), 0.0, 80.0)
        ```
    """
    return machine_of_table(read_table(file), file, allow_forces)


def look_at(table: dict[str, Any], file: str | os.PathLike[str]) -> ImpactSystem:
    """Machine of a table, to be printed or drawn: its force is only a name, and nothing is imported."""
    if "family" in table:
        raise ValueError(
            f"{file} holds a family, {table['family']}: nothing is known of its machine unless its function is called, "
            "which `allow_forces=`, or `--allow-forces` of `vijax plot`, allows."
        )
    found = machine_of_table(table, file, force=NAMED_FORCE)
    assert isinstance(found, ImpactSystem)
    return found


def machine_of_table(
    table: dict[str, Any],
    file: str | os.PathLike[str],
    allow_forces: Allowed = False,
    force: Callable | None = None,
) -> ImpactSystem | Family:
    """Machine or family of a table that was read from a file, see `build` and `build_family`."""
    own = {name: a for name, a in table.items() if name not in _BESIDE}
    try:
        if "family" in own:
            return _family_of(own, allow_forces)
        return build(own, "float64", allow_forces=allow_forces, force=force)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def _family_of(own: dict[str, Any], allow_forces: Allowed) -> Family:
    if len(own) > 1 or not isinstance(own["family"], dict):
        raise ValueError(
            "A file has a machine, or a table `family` with `function` and `values`, and nothing beside it."
        )
    return build_family(own["family"], "float64", allow_forces=allow_forces, where="The table `family`")


def read_table(file: str | os.PathLike[str]) -> dict[str, Any]:
    """Table in a file of TOML or JSON."""
    path = _checked(file)
    kind = path.suffix[1:].upper()
    with path.open("rb") as opened:
        found = opened.read(_LARGEST + 1)
    if len(found) > _LARGEST:
        raise ValueError(
            f"{file} has more than {_LARGEST >> 20} MiB, which no machine needs: it is not read."
        )
    try:
        text = found.decode("utf-8")
    except ValueError as error:
        raise ValueError(f"{file} cannot be read as {kind}: {error}") from error
    return table_of(text, kind, str(file))


def _text(path: Path, table: dict[str, Any]) -> str:
    if path.suffix.lower() == ".json":
        return json.dumps(table, indent=1) + "\n"
    import tomlkit  # only needed here

    return tomlkit.dumps(table)


def _checked(file: str | os.PathLike[str]) -> Path:
    path = Path(file)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"Files of machines end in .toml or .json, but this is {str(path)!r}.")
    return path


def _without_none(value: Any) -> Any:
    """Tables without entries that are None, which TOML cannot express."""
    if isinstance(value, dict):
        return {name: _without_none(a) for name, a in value.items() if a is not None}
    return [_without_none(a) for a in value] if isinstance(value, list) else value
