"""Families as text: the import path of the function and the values; and back.

A function is found by its path where that is allowed, as a force is; and without any import where this process has itself
described the family, be its function of a notebook or defined in another function.
"""

import json
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jax.typing import DTypeLike

from .._jax.arrays import as_float
from .description import build_from, describe
from .family import Family
from .family_program import FamilyProgram, kinds_of
from .forces_by_path import Allowed, found_by, path_of, remember
from .spelling import did_you_mean
from .system import AnySystem, machine_of
from .tables import array_of, table_of

_ENTRIES = ("function", "values", "labels", "program")
# Programs that this process has described, by their digests.
_MOST = 256
_described: OrderedDict[str, FamilyProgram] = OrderedDict()


def describe_family(family: Family) -> dict[str, Any]:
    """Table of a family: `function`, `values`, `labels`, and the digest of its `program`."""
    try:
        function = path_of(family.function)
        remember([function])
    except (ValueError, AttributeError):
        function = family.program.name
    digest = family.program.digest
    _described[digest] = family.program
    _described.move_to_end(digest)
    while len(_described) > _MOST:
        _described.popitem(last=False)
    labels = {"labels": family.labels} if family.labels else {}
    values = {name: np.asarray(a).tolist() for name, a in family.values.items()}
    return {"function": function, "values": values, "program": digest} | labels


def build_family(
    table: Mapping[str, Any],
    dtype: DTypeLike,
    *,
    allow_forces: Allowed = False,
    function: Callable | Family | None = None,
    where: str = "The family",
) -> Family:
    """Family of a table.

    Args:
        table: made by `describe_family`, or written by hand with `function` and `values`.
        dtype: type of the numbers.
        allow_forces: modules from which the function may be imported, see `vx.load`.
        function: the function, or a family of it, where it cannot be imported.
        where: what the table belongs to, for messages.

    Raises:
        ValueError: for a table that makes no family, or a function that is not allowed, cannot be imported, or has changed.
    """
    unknown = [name for name in table if name not in _ENTRIES]
    if unknown:
        raise ValueError(
            f"{where} has `{unknown[0]}`, which is not known: there are {', '.join(_ENTRIES)}.{did_you_mean(unknown[0], _ENTRIES)}"
        )
    path, values, labels = table.get("function"), table.get("values", {}), table.get("labels", {})
    if not isinstance(path, str) or not isinstance(values, dict) or not isinstance(labels, dict):
        raise ValueError(
            f'{where} must have a `function`, "package.module:function", tables `values` and `labels`, but has {dict(table)!r}.'
        )
    if not all(isinstance(words, str) for words in labels.values()) or "labels" in values:
        raise ValueError(
            f"{where} must have texts as `labels`, and numbers as `values`, none of the name `labels`."
        )
    if isinstance(function, Family):
        function = function.function
    digest = str(table.get("program", ""))
    numbers = {name: array_of(a, f"`values.{name}`", dtype) for name, a in values.items()}
    known = _described.get(digest)
    if function is None and known is not None and numbers.keys() == {*known.names}:
        return _of_program(known, numbers)
    family = Family(function or _imported(path, allow_forces), labels=labels, **numbers)
    releases, _, program = family.program.digest.partition("-")
    # Other releases make other programs of one function.
    if function is None and digest.startswith(f"{releases}-") and not digest.endswith(program):
        raise ValueError(
            f"The function {path} of the family is no longer the one that was used: give that, vx.system_of(ds, family=...), or "
            "compute again."
        )
    return family


def attributes_of_system(system: AnySystem) -> dict[str, str]:
    """Attributes of a dataset that describe a machine, or a family and its machine at the values."""
    own = {"family": json.dumps(describe_family(system))} if isinstance(system, Family) else {}
    return own | {"system": json.dumps(describe(machine_of(system)))}


def system_from(
    attributes: Mapping[Any, Any],
    *,
    allow_forces: Allowed = False,
    force: Callable | None = None,
    family: Callable | Family | None = None,
) -> AnySystem:
    """Machine or family of the attributes of a dataset, see `build` and `build_family`."""
    text = attributes.get("family")
    if text is None:
        if family is not None:
            raise ValueError(
                "Argument `family` is the function of a family, but the dataset is that of a machine: leave it out."
            )
        return build_from(attributes, allow_forces=allow_forces, force=force)
    if force is not None:
        raise ValueError(
            "Argument `force` is for machines, but the dataset is that of a family: give its function, `family`."
        )
    name = "The attribute `family` of the dataset"
    dtype = "float32" if attributes.get("dtype") == "float32" else "float64"
    return build_family(
        table_of(str(text), "JSON", name), dtype, allow_forces=allow_forces, function=family, where=name
    )


def _of_program(program: FamilyProgram, numbers: Mapping[str, Any]) -> Family:
    """Family of a program that is traced already."""
    values = tuple(as_float(numbers[name], name) for name in program.names)
    return Family.of_program(program.of_kinds(kinds_of(values)), values)


def _imported(path: str, allow_forces: Allowed) -> Callable:
    if ":" not in path:
        raise ValueError(
            f"The function {path} of the family has no import path, as it was defined in the main program, a notebook or another "
            "function: give it back, vx.system_of(ds, family=...)."
        )
    found = found_by([path], allow_forces, "function of the family")[path]
    remember([path])
    return found
