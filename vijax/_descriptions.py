"""Description of a value, as text and as HTML."""

import html
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx


class Description(NamedTuple):
    """A title, and rows whose first cell labels the others."""

    title: str
    rows: list[tuple[str, ...]]


def described_by(tell: Callable[..., Description], *words: Any) -> tuple[Any, Any]:
    """The methods `__repr__` and `_repr_html_` of a class whose objects a function describes."""
    return (lambda self: as_text(tell, self, *words)), (lambda self: as_html(tell, self, *words))


def as_text(tell: Callable[..., Description], thing: Any, *words: Any) -> str:
    """Format a description in aligned columns."""
    described = _safe_description(tell, thing, *words)
    if described is None:
        return eqx.tree_pformat(thing)
    columns = max((len(row) for row in described.rows), default=0)
    widths = [max(len(row[k]) for row in described.rows if k < len(row)) for k in range(columns)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in described.rows]
    return "\n".join([described.title, *(f"  {line}" for line in lines)])


def as_html(tell: Callable[..., Description], thing: Any, *words: Any) -> str:
    """Format a description as an HTML table."""
    described = _safe_description(tell, thing, *words)
    if described is None:
        return f"<pre>{html.escape(eqx.tree_pformat(thing))}</pre>"
    left = 'style="text-align: left"'
    rows = [
        f"<tr><th {left}>{html.escape(row[0])}</th>"
        + "".join(f"<td {left}>{html.escape(cell)}</td>" for cell in row[1:])
        + "</tr>"
        for row in described.rows
    ]
    return f"<div>{html.escape(described.title)}</div><table>{''.join(rows)}</table>"


def _safe_description(tell: Callable[..., Description], thing: Any, *words: Any) -> Description | None:
    """Description of an object; None if its fields are odd or missing."""
    try:
        return tell(thing, *words)
    except Exception:
        return None
