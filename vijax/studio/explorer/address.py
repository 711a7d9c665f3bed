"""The state of the page in its address, so that a link or a reload shows the same motion."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

_CHANGE = "change:"
_WIDGETS = ("stop", "mass", "ordinate")


class Shown(NamedTuple):
    """State in an address: values of dimensions, changed numbers, and choices of widgets."""

    place: dict[str, Any]
    changes: dict[str, float]
    chosen: dict[str, Any]


def query_of(
    place: Mapping[str, Any], changes: Mapping[str, float], chosen: Mapping[str, Any]
) -> dict[str, Any]:
    """Parameters of the address."""
    values = {name: value if isinstance(value, str) else float(value) for name, value in place.items()}
    return values | {_CHANGE + path: float(value) for path, value in changes.items()} | dict(chosen)


def shown_by(query: Mapping[str, Any], dims: Sequence[str], paths: Sequence[str]) -> Shown:
    """State in the parameters of an address; unknown ones and those that are no numbers are left out."""
    place: dict[str, Any] = {dim: value for dim in dims if (value := _number(query.get(dim))) is not None}
    if query.get("direction") in ("up", "down"):
        place["direction"] = query["direction"]
    changes = {path: value for path in paths if (value := _number(query.get(_CHANGE + path))) is not None}
    return Shown(place, changes, {name: query[name] for name in _WIDGETS if name in query})


def _number(value: Any) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None
