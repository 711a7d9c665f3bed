"""Polynomials through a table of values: steps, lines, and cubic splines.

Every function returns the derivatives at the knots where its intervals begin, (intervals, orders, columns). Lanes may be
last. Concrete values are computed by NumPy, which compiles nothing.
"""

from functools import partial
from typing import Any

import jax
import numpy as np

from .._jax.arrays import Reals, array_namespace

KINDS = ("linear", "previous", "cubic")


def derivatives_at_knots(knots: Reals, values: Reals, kind: str, turn: float | None = None) -> Reals:
    """Value and slope, and for "cubic" two more derivatives, where each interval begins.

    Args:
        knots: rising, (knots, ...).
        values: (knots, columns, ...).
        kind: one of `KINDS`.
        turn: period in units of the knots, after which the first value follows the last; None if it does not repeat.
    """
    library = array_namespace(knots, values)
    values = values + 0 * knots[:, None]  # in all lanes of both
    if turn is not None:
        knots = library.concatenate([knots, knots[:1] + turn])
        values = library.concatenate([values, values[:1]])
    width = (knots[1:] - knots[:-1])[:, None]
    slope = (values[1:] - values[:-1]) / width
    begin = values[:-1]
    if kind == "previous":
        return library.stack([begin, 0 * slope], axis=1)
    if kind == "linear":
        return library.stack([begin, slope], axis=1)
    curvature = (_repeating if turn is not None else _not_a_knot)(width, slope)
    now, then = curvature[:-1], curvature[1:]
    first = slope - width * (2 * now + then) / 6
    return library.stack([begin, first, now, (then - now) / width], axis=1)


def _not_a_knot(width: Reals, slope: Reals) -> Reals:
    """Second derivatives at all knots, whose third derivative is continuous at the last but one on both sides."""
    library, count = array_namespace(width, slope), len(width)
    change = 6 * (slope[1:] - slope[:-1])
    if count == 1:
        return library.concatenate([0 * slope, 0 * slope])
    if count == 2:
        curvature = change / (3 * (width[:1] + width[1:]))
        return library.concatenate([curvature] * 3)
    before, after = width[:-1], width[1:]
    diagonal = 2 * (before + after)
    share, last = width[0] / width[1], width[-1] / width[-2]
    # Of the first and the last unknown, M0 = M1 + share (M1 - M2).
    diagonal = _added(_added(diagonal, 0, width[0] * (1 + share)), -1, width[-1] * (1 + last))
    lower, upper = _added(before, -1, -width[-1] * last), _added(after, 0, -width[0] * share)
    inner = solve_tridiagonal(lower, diagonal, upper, change)
    first = inner[0] + share * (inner[0] - inner[1])
    end = inner[-1] + last * (inner[-1] - inner[-2])
    return library.concatenate([first[None], inner, end[None]])


def _repeating(width: Reals, slope: Reals) -> Reals:
    """Second derivatives at all knots and the first again, where the spline repeats."""
    library = array_namespace(width, slope)
    before = library.concatenate([width[-1:], width[:-1]])
    change = 6 * (slope - library.concatenate([slope[-1:], slope[:-1]]))
    diagonal = 2 * (before + width)
    # The last unknown is set free, and its equation solved at the end.
    beside = _added(_added(0 * change[:-1], 0, -before[0]), -1, -before[-1])
    both = library.concatenate([change[:-1], beside], axis=1)
    columns = change.shape[1]
    found = solve_tridiagonal(before[:-1], diagonal[:-1], width[:-1], both)
    own, by_last = found[:, :columns], found[:, columns:]
    rest = change[-1] - before[-1] * own[-1] - width[-1] * own[0]
    last = rest / (diagonal[-1] + before[-1] * by_last[-1] + width[-1] * by_last[0])
    inner = own + by_last * last[None]
    return library.concatenate([inner, last[None], inner[:1]])


def _added(rows: Reals, place: int, value: Reals) -> Reals:
    """Rows with a value added to one of them."""
    library = array_namespace(rows, value)
    is_it = np.arange(len(rows)) == place % len(rows)
    return rows + library.where(is_it.reshape(-1, *[1] * (rows.ndim - 1)), value[None], 0)


def solve_tridiagonal(lower: Reals, diagonal: Reals, upper: Reals, right: Reals) -> Reals:
    """Solve equations whose matrix has three diagonals and needs no pivots.

    Args:
        lower: coefficient of the unknown before, in every row; that of the first is not read.
        diagonal: coefficient of the own unknown.
        upper: coefficient of the unknown after; that of the last is not read.
        right: right-hand sides, (rows, columns, ...).
    """
    library = array_namespace(lower, diagonal, upper, right)
    ratio, reduced = 0 * upper[0] / diagonal[0], 0 * right[0] / diagonal[0]
    rows = (lower, diagonal, upper, right)
    _, (ratios, found) = _scan(library, _eliminated, (ratio, reduced), rows)
    _, solution = _scan(library, _substituted, 0 * found[0], (ratios, found), reverse=True)
    return solution


def _eliminated(last: tuple[Reals, Reals], row: tuple[Reals, ...]) -> tuple[Any, Any]:
    (ratio, reduced), (lower, diagonal, upper, right) = last, row
    pivot = diagonal - lower * ratio
    new = upper / pivot, (right - lower * reduced) / pivot
    return new, new


def _substituted(last: Reals, row: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
    ratio, reduced = row
    new = reduced - ratio * last
    return new, new


def _scan(library: Any, step: Any, start: Any, rows: tuple[Reals, ...], *, reverse: bool = False) -> Any:
    """`jax.lax.scan`, by a loop of Python for NumPy arrays."""
    if library is not np:
        return partial(jax.lax.scan, reverse=reverse)(step, start, rows)
    found, carry = [], start
    order = range(len(rows[0]))
    for k in reversed(order) if reverse else order:
        carry, one = step(carry, tuple(a[k] for a in rows))
        found.append(one)
    found = found[::-1] if reverse else found
    is_tuple = isinstance(found[0], tuple)
    return carry, tuple(map(np.stack, zip(*found, strict=True))) if is_tuple else np.stack(found)
