"""Core operations: every one makes the coefficients of a series from those of others, order by order.

A series has a number; an operand is such a number, or a known number as a NumPy scalar. A coefficient is an array over
the lanes, a float, or None if it is known to be zero.

The order k is a number where the coefficients are written out, or an array in a loop over the orders, see `order_loop.py`:
then sums over orders are `Read.products` and `Read.weighted`, and an operation tells their pairs in `pairs`.

To add an operation, extend `Operation`, give it a method of `Builder` in `builder.py`, and let a primitive of
`primitives.py` call it.
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from .algebra import Coefficient, Factor, Operand, Order, Read, is_known, minus, pair, plus, times


@dataclass(eq=False, frozen=True)
class Operation(abc.ABC):
    """Series number `out`, made of the series `args`."""

    # The first arguments, whose derivatives make its own; None for all.
    num_sources: ClassVar[int | None] = None

    out: int
    args: tuple[Operand, ...]

    def coefficient(self, read: Read, k: int) -> Coefficient:
        """Coefficient k. Those of the arguments are there up to k, its own and those of later series below k."""
        return self.later(read, k) if k else self.first(read)

    @abc.abstractmethod
    def first(self, read: Read) -> Coefficient:
        """Coefficient 0."""

    @abc.abstractmethod
    def later(self, read: Read, k: Order) -> Coefficient:
        """Coefficient k of those that follow."""

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        """Pairs of series whose products over the orders between 0 and k `later` reads."""
        return ()

    @property
    def sources(self) -> tuple[Operand, ...]:
        """Arguments whose derivatives make its own."""
        return self.args[: self.num_sources]

    @abc.abstractmethod
    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        """Series of the derivative by a leaf, made by a `Builder` from those of the arguments."""

    def num_operations(self, k: int) -> int:
        """Estimate of the arithmetic operations of coefficient k."""
        return 2 * k + 1


@dataclass(eq=False, frozen=True)
class Linear(Operation):
    """Series y = sum of c a, plus a constant."""

    factors: tuple[float, ...]
    constant: float

    def first(self, read: Read) -> Coefficient:
        total = self._sum(read, 0, self.constant or None)
        return 0.0 if total is None else total

    def later(self, read: Read, k: Order) -> Coefficient:
        return self._sum(read, k, None)

    def _sum(self, read: Read, k: Order, total: Coefficient) -> Coefficient:
        for c, a in zip(self.factors, self.args, strict=True):
            term = read(a, k)
            total = minus(total, term) if c == -1 else plus(total, times(c, term))
        return total

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return build.linear([(c, of(a)) for c, a in zip(self.factors, self.args, strict=True)])

    def num_operations(self, k: int) -> int:
        return 2 * len(self.args)


class Product(Operation):
    """Series y = a b."""

    def first(self, read: Read) -> Coefficient:
        a, b = self.args
        return times(read(a, 0), read(b, 0))

    def later(self, read: Read, k: Order) -> Coefficient:
        a, b = self.args
        return read.products(a, b, k)

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        a, b = self.args
        return (pair(a, b),)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        a, b = self.args
        return build.linear([(1, build.multiply(a, of(b))), (1, build.multiply(b, of(a)))])


class Square(Operation):
    """Series y = a^2, with half the products."""

    def first(self, read: Read) -> Coefficient:
        (a,) = self.args
        return times(read(a, 0), read(a, 0))

    def later(self, read: Read, k: Order) -> Coefficient:
        (a,) = self.args
        return read.products(a, a, k)

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        (a,) = self.args
        return (pair(a, a),)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        (a,) = self.args
        return build.linear([(2, build.multiply(a, of(a)))])

    def num_operations(self, k: int) -> int:
        return k + 2


class Quotient(Operation):
    """Series y = a / b, from y b = a. The third argument is `Reciprocal` of b."""

    num_sources = 2

    def first(self, read: Read) -> Coefficient:
        a, _, inverse = self.args
        return times(read(inverse, 0), read(a, 0))

    def later(self, read: Read, k: Order) -> Coefficient:
        a, b, inverse = self.args
        return times(read(inverse, 0), minus(read(a, k), read.products(self.out, b, k, last=False)))

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        return (pair(self.out, self.args[1]),)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        a, b, _ = self.args
        return build.divide(build.linear([(1, of(a)), (-1, build.multiply(self.out, of(b)))]), b)


class SquareRoot(Operation):
    """Series y = sqrt(a), from y^2 = a. The second argument is `Reciprocal` of y."""

    num_sources = 1

    def first(self, read: Read) -> Coefficient:
        return jnp.sqrt(read(self.args[0], 0))

    def later(self, read: Read, k: Order) -> Coefficient:
        a, inverse = self.args
        total = read.products(self.out, self.out, k, first=False, last=False)
        return times(0.5, times(read(inverse, 0), minus(read(a, k), total)))

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        return (pair(self.out, self.out),)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return build.divide(build.linear([(0.5, of(self.args[0]))]), self.out)

    def num_operations(self, k: int) -> int:
        return k + 4


@dataclass(eq=False, frozen=True)
class Integral(Operation):
    """Series y' = sum of c g x'. The arguments are the pairs `Slope` of x and g, then x of every pair.

    Attributes:
        value: function of the values of `of` for order 0.
        of: its operands.
        factors: c of every pair.
    """

    value: Callable
    of: tuple[Operand, ...]
    factors: tuple[float, ...]

    @property
    def sources(self) -> tuple[Operand, ...]:
        return self.args[2::3]

    def first(self, read: Read) -> Coefficient:
        return self.value(*(read(a, 0) for a in self.of))

    def later(self, read: Read, k: Order) -> Coefficient:
        total = None
        for c, slope, g in zip(self.factors, self.args[::3], self.args[1::3], strict=True):
            total = plus(total, times(c / k, read.products(slope, g, k, first=False)))
        return total

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        return tuple(map(pair, self.args[::3], self.args[1::3]))

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        pairs = zip(self.factors, self.args[1::3], self.args[2::3], strict=True)
        return build.linear([(c, build.multiply(g, of(x))) for c, g, x in pairs])

    def num_operations(self, k: int) -> int:
        return 2 * k * len(self.factors) if k else 20


@dataclass(eq=False, frozen=True)
class InverseIntegral(Operation):
    """Series y' g = x'. The arguments are x, g, `Slope` of y and `Reciprocal` of g.

    Attributes:
        value: function of the value of x for order 0.
    """

    value: Callable

    num_sources = 1

    def first(self, read: Read) -> Coefficient:
        return self.value(read(self.args[0], 0))

    def later(self, read: Read, k: Order) -> Coefficient:
        x, g, slope, inverse = self.args
        total = read.products(slope, g, k, first=False, last=False)
        return times(read(inverse, 0), minus(read(x, k), times(1 / k, total)))

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        _, g, slope, _ = self.args
        return (pair(slope, g),)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return build.divide(of(self.args[0]), self.args[1])


class Chosen(Operation):
    """One of several series. The first argument is the constant that says which: a flag, or the number of the case."""

    @property
    def sources(self) -> tuple[Operand, ...]:
        return self.args[1:]

    def first(self, read: Read) -> Coefficient:
        return self.later(read, 0)

    def later(self, read: Read, k: Order) -> Coefficient:
        which, *cases = self.args
        rows = [read(case, k) for case in cases]
        if all(row is None for row in rows):
            return None
        return chosen(read(which, 0), [0.0 if row is None else row for row in rows])

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        which, *cases = self.args
        return build.choose(which, [of(case) for case in cases])

    def num_operations(self, k: int) -> int:
        return len(self.args) - 1


def chosen(which: Coefficient, cases: list[Coefficient]) -> Coefficient:
    """The case that a flag or a number says, by selections."""
    which = jnp.asarray(which)
    total = cases[0]
    for k, case in enumerate(cases[1:], 1):
        total = jnp.where(which if which.dtype == bool else which >= k, case, total)
    return total


class Slope(Operation):
    """Coefficients k a_k: of the derivative by time, times time."""

    num_sources = 0

    def first(self, read: Read) -> Coefficient:
        return None

    def later(self, read: Read, k: Order) -> Coefficient:
        return times(float(k) if isinstance(k, int) else k, read(self.args[0], k))

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        raise NotImplementedError("No function of it reaches a result.")

    def num_operations(self, k: int) -> int:
        return 1


class Fixed(Operation):
    """Number that does not change along the motion: it has order 0 alone, and no derivative."""

    num_sources = 0

    def later(self, read: Read, k: Order) -> Coefficient:
        return None

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return np.float64(0)

    def num_operations(self, k: int) -> int:
        return 0 if k else 1


@dataclass(eq=False, frozen=True)
class Computed(Fixed):
    """A function of numbers that do not change."""

    function: Callable

    def first(self, read: Read) -> Coefficient:
        return self.function(*(a if is_known(a) else read(a, 0) for a in self.args))


class Reciprocal(Fixed):
    """1 / a_0."""

    def first(self, read: Read) -> Coefficient:
        return 1 / read(self.args[0], 0)


@dataclass(eq=False, frozen=True)
class BranchFlag(Fixed):
    """Flag that a guard is above a knot, as its mode says. The argument is the series of the mode."""

    knot: int

    def first(self, read: Read) -> Coefficient:
        return jnp.greater(read(self.args[0], 0), self.knot)


def is_zero(operand: Operand) -> bool:
    """True for the known number zero."""
    return is_known(operand) and bool(operand == 0)
