"""Taylor coefficients of a force along a motion in a loop over the orders: the program of one order serves all.

Written out, a program of order P has some P^2 / 2 products for each product of two series. A loop has the products of all
orders as two arrays, one of them with the orders in reverse, which one order shifts by one place: then products of the same
sum stand beside each other. Compiling it takes a tenth of the time. Its steps are faster for one trajectory and slower for
lanes: most products are of zeros.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Scalar
from .algebra import Coefficient, Factor, Operand, Order, Read, is_known, minus, number, pair, plus, times
from .plan import Plan
from .powers import weighted_pairs
from .series import AbstractSeries, Row, Series


class Convolution(eqx.Module):
    """Sums over 0 < j < k of a_j b_{k-j} for some pairs of series, order by order.

    Attributes:
        left: a_j in row j - 1, (rows, pairs); zero where they are not known yet.
        right: b_{k-j} in row j - 1, likewise.
    """

    left: Float[Array, "rows pairs"]
    right: Float[Array, "rows pairs"]

    def sums(self) -> Float[Array, " pairs"]:
        """Sums of this order, added by halves: no program of a library, which a kernel could not call."""
        return added_by_halves(self.left * self.right)

    def extended(self, k: Scalar, a: Sequence[Array], b: Sequence[Array]) -> "Convolution":
        """With the coefficients of order k > 0, for the sums of order k + 1."""
        is_here = jnp.arange(1, len(self.left) + 1, dtype=k.dtype) == k
        left = jnp.where(is_here[:, None], jnp.stack(a), self.left)
        return Convolution(left, jnp.concatenate([jnp.stack(b)[None], self.right[:-1]]))


def no_sums(order: int, num_pairs: int, like: Array) -> Convolution:
    """Convolution before the first order, for orders below `order`."""
    rows = 1 << max(order - 2, 0).bit_length()
    return Convolution(*[jnp.zeros((rows, num_pairs), like.dtype)] * 2)


def added_by_halves(a: Float[Array, "rows ..."]) -> Float[Array, "..."]:
    """Sum over the leading axis, whose length is a power of two."""
    while len(a) > 1:
        a = a[: len(a) // 2] + a[len(a) // 2 :]
    return a[0]


class _AfterStart(AbstractSeries):
    """Series that go on from those of order 0, `start`."""

    start: eqx.AbstractVar[Series]

    @property
    def plan(self) -> Plan:
        return self.start.plan

    @property
    def like(self) -> Array:
        return self.start.like


class OneOrder(_AfterStart):
    """Coefficients of one order k > 0.

    Attributes:
        start: series of order 0.
        row: coefficients of order k.
        sums: products of the orders between 0 and k + 1.
    """

    start: Series
    row: Row
    sums: Convolution

    def __init__(self, start: Series, row: Row, sums: Convolution):
        self.start, self.row, self.sums = start, row, sums

    def coefficient(self, operand: Operand, k: Order) -> Coefficient:
        """Coefficient of a series; of order k whatever `k` is."""
        return None if is_known(operand) else self.row[operand]


def first_sums(plan: Plan, order: int, like: Array) -> Convolution:
    """Sums for order 1 of the series of a force, for orders below `order`."""
    return no_sums(order, len(_pairs(plan)), like)


def one_order(start: Series, k: Scalar, sums: Convolution, x: Any, v: Any) -> OneOrder:
    """Coefficients of order k > 0.

    Args:
        start: series of order 0.
        k: the order.
        sums: products of the orders between 0 and k.
        x: coefficients of this order of the positions, (n,).
        v: of the velocities, (n,).
    """
    plan, n = start.plan, start.plan.num_masses
    pairs = _pairs(plan)
    row: list[Coefficient] = [None] * plan.size
    row[0] = jnp.where(k == 1, jnp.ones_like(k), 0)
    first = 1 + plan.num_numbers
    row[first : first + 2 * n] = [*(x[i] for i in range(n)), *(v[i] for i in range(n))]
    totals = sums.sums() if pairs else ()
    read = _OneOrder(start.rows[0], row, {pair: totals[j] for j, pair in enumerate(pairs)})
    for operation in plan.operations:
        if operation.out in plan.moving:
            row[operation.out] = operation.later(read, k)
    if pairs:
        sides = [[_of_factor(row, factor, k) for factor in side] for side in zip(*pairs, strict=True)]
        sums = sums.extended(k, *sides)
    return OneOrder(start, tuple(row), sums)


def _of_factor(row: Sequence[Coefficient], factor: Factor, k: Scalar) -> Array:
    series, is_slope = factor
    found = row[series]
    if found is None:
        return jnp.zeros_like(k)
    return k * found if is_slope else found


@lru_cache
def _pairs(plan: Plan) -> list[tuple[Factor, Factor]]:
    """Pairs of series that both move, each once."""
    own = (p for operation in plan.operations if operation.out in plan.moving for p in operation.pairs)
    return list(dict.fromkeys(p for p in own if all(series in plan.moving for series, _ in p)))


class _OneOrder(Read):
    """Coefficients of order 0, those of order k so far, and sums over the orders between."""

    fresh = None
    at_knot: ClassVar[dict] = {}  # powers begin at order 0

    def __init__(
        self,
        start: Sequence[Coefficient],
        now: Sequence[Coefficient],
        sums: dict[tuple[Factor, Factor], Array],
    ):
        self._start, self._now, self._sums = start, now, sums

    def __call__(self, operand: Operand, k: Order) -> Coefficient:
        is_first = isinstance(k, int)
        if is_known(operand):
            return number(operand) if is_first else None
        return (self._start if is_first else self._now)[operand]

    def products(
        self, a: Operand, b: Operand, k: Order, *, first: bool = True, last: bool = True
    ) -> Coefficient:
        total = self._sums.get(pair(a, b))
        if first:
            total = plus(total, times(self(a, 0), self(b, k)))
        return plus(total, times(self(a, k), self(b, 0))) if last else total

    def weighted(self, a: Operand, b: Operand, p: Coefficient, k: Order) -> Coefficient:
        of_a, of_b = (self._sums.get(own) for own in weighted_pairs(a, b))
        total = minus(times(p, of_a), of_b)
        return plus(times(1 / k, total), times(p, times(self(a, k), self(b, 0))))


class LoopSeries(_AfterStart):
    """Series of which a loop has kept some.

    Attributes:
        start: series of order 0.
        later: coefficients from order 1 on of the series that are kept, (orders - 1,) each.
        num_orders: number of orders.
    """

    start: Series
    later: dict[int, Array]
    num_orders: int = eqx.field(static=True)

    def __init__(self, start: Series, later: dict[int, Array], num_orders: int):
        self.start, self.later, self.num_orders = start, later, num_orders

    @property
    def given(self) -> tuple[Any, list[Any], list[Any]]:
        return self.start.given

    def __len__(self) -> int:
        return self.num_orders

    def coefficient(self, operand: Operand, k: Order) -> Coefficient:
        if k == 0:
            return self.start.coefficient(operand, 0)
        return self.later[operand][k - 1] if operand in self.plan.moving else None
