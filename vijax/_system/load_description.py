"""Loads as tables, lists, numbers and strings, as in JSON and TOML, and back."""

from typing import Any

from jax.typing import DTypeLike

from .forcing import Harmonic
from .load import AbstractLoad, LoadSum, with_own_frequencies
from .tables import arrays_of, check_names, lists_of
from .tabulated import Tabulated, Waveform

_HARMONIC, _WAVEFORM = ("amplitude", "frequency", "phase", "mean"), ("phases", "values", "frequency")

# Entries that are no numbers.
_WORDS = ("kind", "from_base")


def describe_load(load: AbstractLoad) -> dict[str, Any] | list[dict[str, Any]]:
    """Table of a load; a list of tables of a sum, each with its frequency."""
    if isinstance(load, LoadSum):
        return [_table(part) for part in with_own_frequencies(load)]
    return _table(load)


def build_load(given: Any, dtype: DTypeLike) -> AbstractLoad:
    """Load of a table, or sum of a list of tables; the names in a table tell its kind."""
    if not isinstance(given, list):
        return _built("forcing", given, dtype)
    if not given:
        raise ValueError("`forcing` must be a table, or a list of tables, but is an empty list.")
    loads = [_built(f"forcing[{k}]", lists, dtype) for k, lists in enumerate(given)]
    return LoadSum(loads) if len(loads) > 1 else loads[0]


def _table(load: Any) -> dict[str, Any]:
    from_base = {"from_base": True} if load.from_base else {}
    if isinstance(load, Harmonic):
        return lists_of(load, _HARMONIC) | from_base
    names = _WAVEFORM if isinstance(load, Waveform) else ("times", "values")
    return lists_of(load, names) | {"kind": load.kind} | from_base


def _built(name: str, lists: Any, dtype: DTypeLike) -> AbstractLoad:
    kind = Harmonic
    if isinstance(lists, dict) and ("times" in lists or "phases" in lists):
        kind = Tabulated if "times" in lists else Waveform
    needed, others = {
        Harmonic: (_HARMONIC[:2], (*_HARMONIC, "from_base")),
        Tabulated: (("times", "values"), _WORDS),
        Waveform: (_WAVEFORM, _WORDS),
    }[kind]
    check_names(f"`{name}`", lists, needed, others)
    if not isinstance(lists.get("from_base", False), bool):
        raise ValueError(f"`{name}.from_base` must be true or false, but is {lists['from_base']!r}.")
    numbers = arrays_of(name, {key: a for key, a in lists.items() if key not in _WORDS}, dtype)
    words = {key: lists[key] for key in _WORDS if key in lists}
    return kind(**numbers, **words)
