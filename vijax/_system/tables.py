"""TOML or JSON text as tables, from files that may be written by anybody."""

import json
import tomllib
from typing import Any

import numpy as np
from jax.typing import DTypeLike

from .spelling import did_you_mean

# Largest depth: a machine has 5, a force made of others a few more. Recursion over a table must end before Python's
# stack does.
_DEEPEST = 40


def table_of(text: str, kind: str, name: str) -> dict[str, Any]:
    """Table of a text.

    Args:
        text: of a file or an attribute.
        kind: its format, "TOML" or "JSON".
        name: its name, for messages.

    Raises:
        ValueError: for a text of another format, one that is no table, or one nested too deeply.
    """
    too_deep = f"{name} is nested more than {_DEEPEST} deep: a machine has fewer tables within tables."
    try:
        table = json.loads(text) if kind == "JSON" else tomllib.loads(text)
    except RecursionError:
        raise ValueError(too_deep) from None
    except ValueError as error:  # of either format
        raise ValueError(f"{name} cannot be read as {kind}: {error}") from error
    if not isinstance(table, dict):
        raise ValueError(f"{name} must hold a machine, a table, but holds {type(table).__name__}.")
    if _is_deep(table):
        raise ValueError(too_deep)
    return table


def array_of(value: Any, refusal: str, dtype: DTypeLike, kinds: str = "iuf") -> np.ndarray:
    """Array of a number or of nested lists of numbers, of some kinds of NumPy's types; `refusal` says what it must be."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in kinds:
        raise ValueError(f"{refusal}, but is {value!r}.")
    return array.astype(dtype)


def one_array(name: str, value: Any, dtype: DTypeLike) -> np.ndarray:
    """Array of an entry of a table; `name` is that of the entry, for messages."""
    return array_of(value, f"`{name}` must be a number, or lists of numbers of one length", dtype)


def arrays_of(name: str, lists: dict[str, Any], dtype: DTypeLike) -> dict[str, np.ndarray]:
    """Arrays of all entries of a table."""
    return {key: one_array(f"{name}.{key}", a, dtype) for key, a in lists.items()}


def lists_of(part: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Table of those fields of a part of a machine that are not None."""
    values = ((name, getattr(part, name)) for name in names)
    return {name: np.asarray(value).tolist() for name, value in values if value is not None}


def check_names(name: str, lists: Any, needed: tuple[str, ...], others: tuple[str, ...] = ()) -> None:
    """Reject a table that lacks a required name, or has an unknown name: it may be misspelt."""
    if not isinstance(lists, dict):
        raise ValueError(f"{name} must be a table, but is {lists!r}.")
    missing, unknown = (
        [a for a in needed if a not in lists],
        [a for a in lists if a not in (*needed, *others)],
    )
    known = ", ".join(f"`{a}`" for a in dict.fromkeys((*needed, *others)))
    meant = did_you_mean(unknown[0], [*missing, *needed, *others]) if unknown else ""
    if missing:
        raise ValueError(f"{name} has no `{missing[0]}`: it has {known}.{meant}")
    if unknown:
        raise ValueError(f"{name} has `{unknown[0]}`, which is not known: there are {known}.{meant}")


def _is_deep(table: dict[str, Any]) -> bool:
    level: list[Any] = [table]
    for _ in range(_DEEPEST):
        level = [part for one in level for part in _parts(one)]
    return bool(level)


def _parts(value: dict | list) -> list[Any]:
    """Tables and lists that are entries of a table or a list."""
    inner = value.values() if isinstance(value, dict) else value
    return [part for part in inner if isinstance(part, dict | list)]
