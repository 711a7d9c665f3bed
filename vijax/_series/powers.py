"""Core operations of powers, which begin anew where a contact closes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from .algebra import Coefficient, Factor, Operand, Order, Read, is_known, plus, times
from .operations import Fixed, Operation


@dataclass(eq=False, frozen=True)
class PowerReciprocal(Fixed):
    """1 / a_0, and zero where a_0 is; `is_clipped` and `modes` as of `Power`."""

    is_clipped: bool
    modes: tuple[int, ...] = ()

    def first(self, read: Read) -> Coefficient:
        a = _from_knot(read, self.args[0], self.modes)
        is_zero = _is_off(a, self.is_clipped)
        return jnp.where(is_zero, 0.0, 1 / jnp.where(is_zero, 1.0, a))


@dataclass(eq=False, frozen=True)
class Power(Operation):
    """Series y = a^p, from a y' = p y a'. The arguments are a, p, and `PowerReciprocal` of a.

    Where a is zero, y is zero for good: force of a contact that is open.

    Attributes:
        is_clipped: a is not negative but by rounding, because a branch was chosen.
        modes: series of the modes that choose the branch: at a knot of these a is zero, and what rounding leaves of it is no
            distance, of which the coefficients would overflow.
    """

    is_clipped: bool
    modes: tuple[int, ...] = ()

    num_sources = 1

    def first(self, read: Read) -> Coefficient:
        return power(_from_knot(read, self.args[0], self.modes), self._exponent(read), self.is_clipped)

    def later(self, read: Read, k: Order) -> Coefficient:
        a, _, inverse = self.args
        return times(read(inverse, 0), read.weighted(a, self.out, self._exponent(read), k))

    def _exponent(self, read: Read) -> Coefficient:
        p = self.args[1]
        return float(p) if is_known(p) else read(p, 0)

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        return weighted_pairs(self.args[0], self.out)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        a, p, _ = self.args
        lower = build.power(a, build.linear([(1, p)], -1))
        return build.multiply(p, build.multiply(lower, of(a)))

    def num_operations(self, k: int) -> int:
        return 4 * k + 1 if k else 60


@dataclass(eq=False, frozen=True)
class ScaledPower(Operation):
    """(a / s)^p s^p, with s = w^lead, in the root w of time: a power of what begins as s. Nothing otherwise.

    Attributes:
        exponent: p; times `lead` it is a whole number.
        lead: order at which a begins.
    """

    exponent: float
    lead: int

    def first(self, read: Read) -> Coefficient:
        return None

    def later(self, read: Read, k: Order) -> Coefficient:
        (a,), shift = self.args, round(self.lead * self.exponent)
        if read.fresh is None or k < shift or read(a, self.lead) is None:
            return None
        first = read(a, self.lead)
        is_off = jnp.less_equal(first, 0)
        if k == shift:
            return power(first, self.exponent, is_clipped=True)
        total, m = None, k - shift
        for j in range(1, m + 1):
            factor = self.exponent * (j / m) - (m - j) / m
            total = plus(total, times(factor, times(read(a, j + self.lead), read(self.out, k - j))))
        return times(jnp.where(is_off, 0.0, 1 / jnp.where(is_off, 1.0, first)), total)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        raise NotImplementedError("`ClosingPower` has the derivative.")


@dataclass(eq=False, frozen=True)
class ClosingPower(Operation):
    """a^p of a chosen branch a. The arguments are `Power` of a, and `ScaledPower` with the leads 2 and 4; then a.

    A contact that closes has a force like time^p, which is no power series, but one in the root of time if 2 p is whole: the
    depth begins as the second power of the root, or the fourth where it closes at rest.

    Attributes:
        exponent: p.
        modes: series of the modes that choose the branch.
    """

    exponent: float
    modes: tuple[int, ...]

    @property
    def sources(self) -> tuple[Operand, ...]:
        return self.args[3:]

    def first(self, read: Read) -> Coefficient:
        return self.later(read, 0)

    def later(self, read: Read, k: Order) -> Coefficient:
        plain, moving, resting, a = self.args
        found = read(plain, k)
        if read.fresh is None:
            return found
        is_new = read.fresh[self.modes[0]]
        for mode in self.modes[1:]:
            is_new = is_new | read.fresh[mode]
        new = 0.0
        if k >= 2 * self.exponent:
            first = read(a, 2)
            pair = [0.0 if c is None else c for c in (read(moving, k), read(resting, k))]
            new = jnp.where(jnp.greater(0.0 if first is None else first, 0), *pair)
        return jnp.where(is_new, new, 0.0 if found is None else found)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        p, a = self.exponent, self.args[3]
        return build.linear([(p, build.multiply(build.power(a, np.float64(p - 1)), of(a)))])

    def num_operations(self, k: int) -> int:
        return 0


def weighted_pairs(a: Operand, y: Operand) -> tuple[tuple[Factor, Factor], ...]:
    """Pairs of `Read.weighted`."""
    return ((a, True), (y, False)), ((a, False), (y, True))


def power(a: Coefficient, p: Coefficient, is_clipped: bool) -> Coefficient:
    """a^p, with a derivative of zero where a is zero, or below if `is_clipped`.

    There the slope of a known power below 1 counts as zero too: what it is multiplied with is zero, see `slopes.py`.
    """
    is_zero = _is_off(a, is_clipped)
    negative = 0.0 if is_clipped and isinstance(p, float) else jnp.inf
    at_zero = jnp.where(jnp.greater(p, 0), 0.0, jnp.where(jnp.equal(p, 0), 1.0, negative))
    return jnp.where(is_zero, at_zero, jnp.power(jnp.where(is_zero, 1.0, a), p))


class CubeRoot(Operation):
    """Series y = cbrt(a), from 3 a y' = y a'. The second argument is `PowerReciprocal` of a."""

    num_sources = 1

    def first(self, read: Read) -> Coefficient:
        return jnp.cbrt(read(self.args[0], 0))

    def later(self, read: Read, k: Order) -> Coefficient:
        a, inverse = self.args
        return times(read(inverse, 0), read.weighted(a, self.out, 1 / 3, k))

    @property
    def pairs(self) -> tuple[tuple[Factor, Factor], ...]:
        return weighted_pairs(self.args[0], self.out)

    def derivative(self, build: Any, of: Callable[[Operand], Operand]) -> Operand:
        return build.divide(build.linear([(1 / 3, of(self.args[0]))]), build.square(self.out))

    def num_operations(self, k: int) -> int:
        return 4 * k + 1 if k else 60


def _from_knot(read: Read, a: Operand, modes: tuple[int, ...]) -> Coefficient:
    """a_0, zero at a knot of its modes."""
    found = read(a, 0)
    for mode in modes:
        if mode in read.at_knot:
            found = jnp.where(read.at_knot[mode], 0.0, found)
    return found


def _is_off(a: Coefficient, is_clipped: bool) -> Coefficient:
    return jnp.less_equal(a, 0) if is_clipped else jnp.equal(a, 0)
