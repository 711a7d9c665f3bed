"""Numbers, arrays and batches in the words of descriptions."""

from typing import Any

import equinox as eqx
import jax
import numpy as np

from ._jax.concrete import concrete

# MOST_NUMBERS: most numbers of a vector that are shown.
# _ROWS: most rows of a matrix.
# _WIDTH: most characters of a line.
MOST_NUMBERS, _ROWS, _WIDTH = 6, 3, 90


def written_numbers(value: Any, own: int) -> str:
    """Numbers of an array with `own` axes of its own, as text; their range if it is a batch."""
    known = concrete(value) if isinstance(value, jax.Array | np.ndarray) else None
    if known is None:
        return written_shape(value)
    if known.ndim > own:
        low, high = (f"{a:.6g}" for a in (known.min(), known.max())) if known.size else ("none", "none")
        return low if low == high else f"{low} to {high}"
    if own < 2:
        return written_row(known.ravel(), known.size > MOST_NUMBERS)
    rows, columns = known.shape
    if rows <= _ROWS and columns <= _ROWS:
        return " ".join(f"[{written_row(row)}]" for row in known)
    if rows == columns:
        return f"{rows} x {rows}, diagonal {written_row(np.diag(known), rows > MOST_NUMBERS)}"
    return f"{rows} x {columns}, the largest {np.abs(known).max():.6g}"


def written_row(values: np.ndarray, is_cut: bool = False) -> str:
    if is_cut:
        return f"{written_row(values[:3])} ... {written_row(values[-1:])} ({values.size} numbers)"
    return " ".join(f"{a:.6g}" for a in values.tolist())


def written_shape(value: Any) -> str:
    """Dtype and shape of a traced array."""
    if isinstance(value, jax.Array | np.ndarray | jax.ShapeDtypeStruct):
        return f"{value.dtype}{list(value.shape)}"
    return written_short(eqx.tree_pformat(value, width=10**6))


def written_beside(value: Any, batch: tuple[int, ...]) -> str:
    """Remarks for a title: shape of a batch, reduced precision."""
    lanes = f", a batch of shape {batch}" if batch else ""
    return lanes if value.dtype == np.float64 else f"{lanes}, {value.dtype}"


def written_batch(*fields: tuple[Any, int]) -> tuple[int, ...]:
    """Batch axes: the leading axes of fields in front of their own."""
    return max((a.shape[: a.ndim - own] for a, own in fields if a is not None), key=len)


def is_zero(value: Any) -> bool:
    known = concrete(value)
    return known is not None and not known.any()


def as_number(leaf: Any) -> Any:
    known = concrete(leaf)
    return leaf if known is None or known.ndim else float(known)


def written_short(text: str) -> str:
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 4]} ..."


def counted(count: int, one: str, several: str | None = None) -> str:
    return f"{count} {one if count == 1 else several or one + 's'}"
