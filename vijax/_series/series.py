"""Taylor coefficients of a force along a motion, order by order."""

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .._jax.xla import compute_once
from .algebra import Coefficient, Operand, Order, Read, is_known, number, plus, times
from .plan import Plan

Row = tuple[Any, ...]


class AbstractSeries(eqx.Module):
    """Coefficients of all series of a plan.

    Attributes:
        plan: operations.
        like: array of the shape of the positions.
    """

    plan: eqx.AbstractVar[Plan]
    like: eqx.AbstractVar[Array]

    @abc.abstractmethod
    def coefficient(self, operand: Operand, k: Order) -> Coefficient:
        """Coefficient of a series, None if it is known to be zero."""

    def force(self, k: Order) -> Array:
        """Coefficient k of the force on every mass, (n, ...)."""
        return jnp.stack([self._scalar(s, k) for s in self.plan.forces])

    def guard(self, switch: int, k: Order) -> Array:
        """Coefficient k of the guard of a switch."""
        return self._scalar(self.plan.switches[switch].guard, k)

    def knot(self, switch: int, number: int) -> Array:
        """Value of a guard where its branch changes."""
        return self._scalar(self.plan.switches[switch].knots[number], 0)

    def by_x(self, k: Order) -> dict[tuple[int, int], Array]:
        """Coefficients k of the derivatives of force i by position j, but for known zeros."""
        return self._entries(self.plan.by_x, k)

    def by_v(self, k: Order) -> dict[tuple[int, int], Array]:
        """The same by velocity j."""
        return self._entries(self.plan.by_v, k)

    def _entries(self, entries: dict[tuple[int, int], Operand], k: Order) -> dict[tuple[int, int], Array]:
        if not self.plan.has_jacobian:
            raise ValueError("The plan was made without `jacobian=True`.")
        found = {at: self.coefficient(entry, k) for at, entry in entries.items()}
        return {at: jnp.asarray(entry, self.like.dtype) for at, entry in found.items() if entry is not None}

    def _scalar(self, operand: Operand, k: Order) -> Array:
        found = self.coefficient(operand, k)
        dtype, shape = self.like.dtype, self.like.shape[1:]
        return jnp.broadcast_to(jnp.asarray(0.0 if found is None else found, dtype), shape)


class Series(AbstractSeries):
    """Coefficients so far; `extend` adds an order.

    Attributes:
        rows: coefficients of every series, order by order; None where they are known to be zero.
        given: time, numbers of the force and modes, of order 0.
        like: array of the shape of the positions.
        fresh: flags of the modes that have just changed, by the series of the mode, for series in the root of time; else None.
        at_knot: flags of the modes whose guards are at a knot, by the series of the mode.
        plan: operations.
        fence: whether XLA computes each order once, not once for each result that needs it.
    """

    rows: tuple[Row, ...]
    given: tuple[Any, list[Any], list[Any]]
    like: Array
    fresh: dict[int, Any] | None
    at_knot: dict[int, Any]
    plan: Plan = eqx.field(static=True)
    fence: bool = eqx.field(static=True, default=False)

    def __len__(self) -> int:
        return len(self.rows)

    def extend(self, x: Any, v: Any) -> "Series":
        """The series with one order more, from the coefficients of this order of positions and velocities, (n, ...)."""
        row = compute_once(next_row, self, x, v) if self.fence else next_row(self, x, v)
        return eqx.tree_at(lambda s: s.rows, self, (*self.rows, row))

    def coefficient(self, operand: Operand, k: int) -> Coefficient:
        """Coefficient of a series, None if it is known to be zero."""
        if is_known(operand):
            return None if k else float(operand)
        return self.rows[k][operand]


def series_of(
    plan: Plan,
    force: Any,
    t: Any,
    *,
    like: Array,
    modes: Any = (),
    fresh: Any = None,
    at_knot: Any = (),
    fence: bool = False,
) -> Series:
    """Series without coefficients yet.

    Args:
        plan: operations.
        force: the force with the numbers of now.
        t: time.
        like: array of the shape of the positions, (n, ...).
        modes: number of knots below the guard of every switch.
        fresh: flags of the modes that have just changed: the series are then in w, with time t + w^2, so that x' = 2 w v and
            v' = 2 w a. A contact that closes by a power has such a series alone, see `Plan.is_singular`.
        at_knot: flags of the modes whose guards are at a knot, so that powers that begin there are zero to the last digit;
            none are if left out.
        fence: whether XLA computes each order once.
    """
    if len(modes) != plan.num_switches:
        raise ValueError(f"The force has {plan.num_switches} switches, but {len(modes)} modes are given.")
    given = t, plan.numbers(force), [modes[j] for j in range(len(modes))]
    flags = None if fresh is None else {w.mode: fresh[j] for j, w in enumerate(plan.switches)}
    at = {w.mode: flag for w, flag in zip(plan.switches, at_knot, strict=False)}
    return Series(rows=(), given=given, like=like, fresh=flags, at_knot=at, plan=plan, fence=fence)


def force_at(plan: Plan, force: Any, t: Any, x: Any, v: Any, modes: Any = ()) -> Array:
    """The force itself, (n, ...), in the branches that the modes say."""
    return series_of(plan, force, t, like=x, modes=modes).extend(x, v).force(0)


def next_row(series: Series, x: Any, v: Any) -> Row:
    """Coefficients of the next order of every series."""
    plan, k = series.plan, len(series.rows)
    row: list[Coefficient] = [None] * plan.size
    n, (t, numbers, modes) = plan.num_masses, series.given
    if k == 0:
        row[0] = t
        row[1 : 1 + len(numbers)] = numbers
        for switch, mode in zip(plan.switches, modes, strict=True):
            row[switch.mode] = mode
    elif k == (1 if series.fresh is None else 2):
        row[0] = 1.0
    first = 1 + plan.num_numbers
    row[first : first + 2 * n] = [*(x[i] for i in range(n)), *(v[i] for i in range(n))]

    read = _Rows((*series.rows, row), series.fresh, series.at_knot)
    for operation in plan.operations:
        row[operation.out] = operation.coefficient(read, k)
    return tuple(row)


class _Rows(Read):
    """Coefficients order by order."""

    def __init__(self, rows: Sequence[Sequence[Coefficient]], fresh: dict | None, at_knot: dict):
        self._rows, self.fresh, self.at_knot = rows, fresh, at_knot

    def __call__(self, operand: Operand, k: int) -> Coefficient:
        if is_known(operand):
            return None if k else number(operand)
        return self._rows[k][operand]

    def products(
        self, a: Operand, b: Operand, k: int, *, first: bool = True, last: bool = True
    ) -> Coefficient:
        if a == b and first == last and not is_known(a):  # half the products
            total = times(2.0, self._sum(a, a, k, 0 if first else 1, (k - 1) // 2))
            return total if k % 2 else plus(total, times(self(a, k // 2), self(a, k // 2)))
        return self._sum(a, b, k, 0 if first else 1, k if last else k - 1)

    def _sum(self, a: Operand, b: Operand, k: int, first: int, last: int) -> Coefficient:
        total = None
        for j in range(first, last + 1):
            total = plus(total, times(self(a, j), self(b, k - j)))
        return total

    def weighted(self, a: Operand, b: Operand, p: Coefficient, k: int) -> Coefficient:
        total = None
        for j in range(1, k + 1):
            factor = p * (j / k) - (k - j) / k
            total = plus(total, times(factor, times(self(a, j), self(b, k - j))))
        return total
