"""Core operations: every one makes the coefficients of a series from those of others, order by order.

A series has a number; an operand is such a number, or a known number as a NumPy scalar. A coefficient is an array over
the lanes, a float, or None if it is known to be zero.

To add an operation, extend `Operation`, give it a method of `Builder` in `builder.py`, and let a primitive of
`primitives.py` call it.
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

Operand = Any
Coefficient = Any


class Read(abc.ABC):
    """Coefficients that are there.

    Attributes:
        fresh: for the series of every mode, whether it has just changed, if the series are in the root of time; else None.
        at_knot: for the series of every mode, whether its guard is at a knot.
    """

    fresh: dict[int, Coefficient] | None
    at_knot: dict[int, Coefficient]

    @abc.abstractmethod
    def __call__(self, operand: Operand, k: int) -> Coefficient:
        """Coefficient k of an operand."""


def is_known(operand: Operand) -> bool:
    """True for known numbers, False for series."""
    return isinstance(operand, np.generic)


def plus(a: Coefficient, b: Coefficient) -> Coefficient:
    """Sum of coefficients."""
    return b if a is None else a if b is None else a + b


def minus(a: Coefficient, b: Coefficient) -> Coefficient:
    """Difference of coefficients."""
    return a if b is None else -b if a is None else a - b


def times(factor: Coefficient, a: Coefficient) -> Coefficient:
    """Product of coefficients; factors 1 and -1 cost nothing."""
    if factor is None or a is None:
        return None
    if isinstance(factor, float) and abs(factor) == 1:
        return a if factor == 1 else -a
    return factor * a


def cauchy(
    read: Read, a: Operand, b: Operand, k: int, first: int = 0, last: int | None = None
) -> Coefficient:
    """Sum of a_j b_{k-j} over j from `first` to `last`, k if that is None."""
    total = None
    for j in range(first, (k if last is None else last) + 1):
        total = plus(total, times(read(a, j), read(b, k - j)))
    return total


@dataclass(eq=False, frozen=True)
class Operation(abc.ABC):
    """Series number `out`, made of the series `args`."""

    out: int
    args: tuple[Operand, ...]

    @abc.abstractmethod
    def coefficient(self, read: Read, k: int) -> Coefficient:
        """Coefficient k. Those of the arguments are there up to k, its own and those of later series below k."""

    @property
    def sources(self) -> tuple[Operand, ...]:
        """Arguments whose derivatives make its own."""
        return self.args

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

    def coefficient(self, read: Read, k: int) -> Coefficient:
        total = self.constant if k == 0 and self.constant else None
        for c, a in zip(self.factors, self.args, strict=True):
            term = read(a, k)
            total = minus(total, term) if c == -1 else plus(total, times(c, term))
        return 0.0 if total is None and k == 0 else total

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return build.linear([(c, of(a)) for c, a in zip(self.factors, self.args, strict=True)])

    def num_operations(self, k: int) -> int:
        return 2 * len(self.args)


class Product(Operation):
    """Series y = a b."""

    def coefficient(self, read: Read, k: int) -> Coefficient:
        a, b = self.args
        return cauchy(read, a, b, k)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        a, b = self.args
        return build.linear([(1, build.multiply(a, of(b))), (1, build.multiply(b, of(a)))])


class Square(Operation):
    """Series y = a^2, with half the products."""

    def coefficient(self, read: Read, k: int) -> Coefficient:
        (a,) = self.args
        total = times(2.0, cauchy(read, a, a, k, 0, (k - 1) // 2)) if k else None
        return total if k % 2 else plus(total, times(read(a, k // 2), read(a, k // 2)))

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        (a,) = self.args
        return build.linear([(2, build.multiply(a, of(a)))])

    def num_operations(self, k: int) -> int:
        return k + 2


class Quotient(Operation):
    """Series y = a / b, from y b = a. The third argument is `Reciprocal` of b."""

    @property
    def sources(self) -> tuple[Operand, ...]:
        return self.args[:2]

    def coefficient(self, read: Read, k: int) -> Coefficient:
        a, b, inverse = self.args
        return times(read(inverse, 0), minus(read(a, k), cauchy(read, self.out, b, k, 0, k - 1)))

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        a, b, _ = self.args
        return build.divide(build.linear([(1, of(a)), (-1, build.multiply(self.out, of(b)))]), b)


class SquareRoot(Operation):
    """Series y = sqrt(a), from y^2 = a. The second argument is `Reciprocal` of y."""

    @property
    def sources(self) -> tuple[Operand, ...]:
        return self.args[:1]

    def coefficient(self, read: Read, k: int) -> Coefficient:
        a, inverse = self.args
        if k == 0:
            return jnp.sqrt(read(a, 0))
        total = times(2.0, cauchy(read, self.out, self.out, k, 1, (k - 1) // 2))
        if k % 2 == 0:
            total = plus(total, times(read(self.out, k // 2), read(self.out, k // 2)))
        return times(0.5, times(read(inverse, 0), minus(read(a, k), total)))

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

    def coefficient(self, read: Read, k: int) -> Coefficient:
        if k == 0:
            return self.value(*(read(a, 0) for a in self.of))
        total = None
        for c, slope, g in zip(self.factors, self.args[::3], self.args[1::3], strict=True):
            total = plus(total, times(c / k, cauchy(read, slope, g, k, 1, k)))
        return total

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

    @property
    def sources(self) -> tuple[Operand, ...]:
        return self.args[:1]

    def coefficient(self, read: Read, k: int) -> Coefficient:
        x, g, slope, inverse = self.args
        if k == 0:
            return self.value(read(x, 0))
        return times(read(inverse, 0), minus(read(x, k), times(1 / k, cauchy(read, slope, g, k, 1, k - 1))))

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return build.divide(of(self.args[0]), self.args[1])


class Chosen(Operation):
    """One of several series. The first argument is the constant that says which: a flag, or the number of the case."""

    @property
    def sources(self) -> tuple[Operand, ...]:
        return self.args[1:]

    def coefficient(self, read: Read, k: int) -> Coefficient:
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

    @property
    def sources(self) -> tuple[Operand, ...]:
        return ()

    def coefficient(self, read: Read, k: int) -> Coefficient:
        return times(float(k), read(self.args[0], k)) if k else None

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        raise NotImplementedError("No function of it reaches a result.")

    def num_operations(self, k: int) -> int:
        return 1


class Fixed(Operation):
    """Number that does not change along the motion: it has order 0 alone, and no derivative."""

    @property
    def sources(self) -> tuple[Operand, ...]:
        return ()

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return np.float64(0)

    def num_operations(self, k: int) -> int:
        return 0 if k else 1


@dataclass(eq=False, frozen=True)
class Computed(Fixed):
    """A function of numbers that do not change."""

    function: Callable

    def coefficient(self, read: Read, k: int) -> Coefficient:
        return None if k else self.function(*(a if is_known(a) else read(a, 0) for a in self.args))


class Reciprocal(Fixed):
    """1 / a_0."""

    def coefficient(self, read: Read, k: int) -> Coefficient:
        return None if k else 1 / read(self.args[0], 0)


@dataclass(eq=False, frozen=True)
class BranchFlag(Fixed):
    """Flag that a guard is above a knot, as its mode says. The argument is the series of the mode."""

    knot: int

    def coefficient(self, read: Read, k: int) -> Coefficient:
        return None if k else jnp.greater(read(self.args[0], 0), self.knot)


def is_zero(operand: Operand) -> bool:
    """True for the known number zero."""
    return is_known(operand) and bool(operand == 0)
