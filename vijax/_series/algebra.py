"""Arithmetic of coefficients, of which numbers that are known stay numbers."""

import abc
from typing import Any

import numpy as np

Operand = Any
Coefficient = Any
Order = Any
# A series, and whether its coefficients are times their order.
Factor = tuple[Operand, bool]


class Read(abc.ABC):
    """Coefficients that are there.

    Attributes:
        fresh: for the series of every mode, whether it has just changed, if the series are in the root of time; else None.
        at_knot: for the series of every mode, whether its guard is at a knot.
    """

    fresh: dict[int, Coefficient] | None
    at_knot: dict[int, Coefficient]

    @abc.abstractmethod
    def __call__(self, operand: Operand, k: Order) -> Coefficient:
        """Coefficient k of an operand."""

    @abc.abstractmethod
    def products(
        self, a: Operand, b: Operand, k: Order, *, first: bool = True, last: bool = True
    ) -> Coefficient:
        """Sum of a_j b_{k-j} over 0 < j < k, with j = 0 if `first` and j = k if `last`."""

    @abc.abstractmethod
    def weighted(self, a: Operand, b: Operand, p: Coefficient, k: Order) -> Coefficient:
        """Sum of (p j - (k - j)) / k a_j b_{k-j} over 0 < j <= k."""


def is_known(operand: Operand) -> bool:
    """True for known numbers, False for series."""
    return isinstance(operand, np.generic)


def number(operand: Operand) -> Any:
    """A known number as a coefficient."""
    return float(operand) if np.issubdtype(operand.dtype, np.floating) else operand


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


def pair(a: Operand, b: Operand) -> tuple[Factor, Factor]:
    """The pair of two series as they are."""
    return (a, False), (b, False)
