"""Series made of series: functions as core operations, each of them once, with known numbers folded."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .operations import (
    Branch,
    Chosen,
    Computed,
    CubeRoot,
    Fixed,
    Integral,
    InverseIntegral,
    Linear,
    Operand,
    Operation,
    Power,
    PowerReciprocal,
    Product,
    Quotient,
    Reciprocal,
    Slope,
    Square,
    SquareRoot,
    chosen,
    is_known,
    is_zero,
    power,
)
from .switches import Switch


class Builder:
    """Operations that are made so far.

    Attributes:
        operations: each after those of its arguments, but for terms of lower order of itself.
        num_leaves: series that are given, the first ones.
        switches: choices between branches.
        fixed: series that do not change along the motion.
    """

    def __init__(self):
        self.operations: list[Operation] = []
        self.by_out: dict[int, Operation] = {}
        self.switches: list[Switch] = []
        self.fixed: set[int] = set()
        self._size = 0
        self._memo: dict[Hashable, Any] = {}

    def leaf(self, *, is_fixed: bool = False) -> int:
        """A series that is given."""
        leaf = self._new()
        if is_fixed:
            self.fixed.add(leaf)
        return leaf

    @property
    def size(self) -> int:
        """Number of series."""
        return self._size

    def _new(self) -> int:
        self._size += 1
        return self._size - 1

    def _add(self, operation: Operation) -> int:
        self.operations.append(operation)
        self.by_out[operation.out] = operation
        if isinstance(operation, Fixed):
            self.fixed.add(operation.out)
        return operation.out

    def _once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        if key not in self._memo:
            self._memo[key] = make()
        return self._memo[key]

    def is_fixed(self, operand: Operand) -> bool:
        """True for numbers that do not change along the motion."""
        return is_known(operand) or operand in self.fixed

    def compute(self, function: Callable, args: Sequence[Operand], key: Hashable) -> Operand:
        """A function of numbers that do not change; `key` names it."""
        if all(map(is_known, args)):
            with jax.ensure_compile_time_eval():
                return np.asarray(function(*args))[()]
        key = "computed", key, tuple(map(_key, args))
        return self._once(key, lambda: self._add(Computed(self._new(), tuple(args), function)))

    def _is_fixed(self, *args: Operand) -> bool:
        return all(map(self.is_fixed, args)) and not all(map(is_known, args))

    # sums and products
    def linear(self, terms: Sequence[tuple[Any, Operand]], constant: Any = 0.0) -> Operand:
        """Sum of c a, plus a constant."""
        factors: dict[int, float] = {}
        total = float(constant)
        for c, a in terms:
            if is_known(a):
                total += float(c) * float(a)
            else:
                factors[a] = factors.get(a, 0.0) + float(c)
        factors = {a: c for a, c in factors.items() if c}
        if not factors:
            return np.float64(total)
        if total == 0 and list(factors.values()) == [1.0]:
            return next(iter(factors))
        args, values = tuple(factors), tuple(factors.values())
        key = "linear", args, values, total
        if all(map(self.is_fixed, args)):
            return self.compute(lambda *a: _sum(values, a, total), args, key)
        return self._once(key, lambda: self._add(Linear(self._new(), args, values, total)))

    def multiply(self, a: Operand, b: Operand) -> Operand:
        """A b."""
        if is_known(a) or is_known(b):
            known, other = (a, b) if is_known(a) else (b, a)
            return np.float64(0) if is_zero(known) else self.linear([(known, other)])
        if a == b:
            return self.square(a)
        # What does not change comes first.
        args = tuple(sorted((a, b), key=lambda s: (s not in self.fixed, s)))
        if self._is_fixed(a, b):
            return self.compute(jnp.multiply, args, "multiply")
        return self._once(("multiply", args), lambda: self._add(Product(self._new(), args)))

    def square(self, a: Operand) -> Operand:
        """a^2."""
        if is_known(a):
            return np.float64(a * a)
        if self._is_fixed(a):
            return self.compute(jnp.square, (a,), "square")
        return self._once(("square", a), lambda: self._add(Square(self._new(), (a,))))

    def integer_power(self, a: Operand, n: int) -> Operand:
        """a^n by products."""
        if n < 0:
            return self.divide(np.float64(1), self.integer_power(a, -n))
        if n < 2:
            return a if n else np.float64(1)
        half = self.square(self.integer_power(a, n // 2))
        return self.multiply(half, a) if n % 2 else half

    # divisions and roots
    def reciprocal(self, a: Operand) -> Operand:
        """1 / a_0, which does not change."""
        return self._once(("reciprocal", a), lambda: self._add(Reciprocal(self._new(), (a,))))

    def divide(self, a: Operand, b: Operand) -> Operand:
        """A / b."""
        if is_zero(a):
            return a
        if is_known(b):
            return np.float64(a / b) if is_known(a) else self.linear([(1 / float(b), a)])
        if self._is_fixed(a, b):
            return self.compute(jnp.divide, (a, b), "divide")
        if self.is_fixed(b):
            return self.multiply(a, self.reciprocal(b))
        make = lambda: self._add(Quotient(self._new(), (a, b, self.reciprocal(b))))  # noqa: E731
        return self._once(("divide", _key(a), b), make)

    def sqrt(self, a: Operand) -> Operand:
        """Square root."""
        if self._is_fixed(a):
            return self.compute(jnp.sqrt, (a,), "sqrt")
        if self._comes_from_choice(a):  # may be zero for good
            return self.power(a, np.float64(0.5))

        def make() -> int:
            out, inverse = self._new(), self._new()
            self._add(SquareRoot(out, (a, inverse)))
            self._memo["reciprocal", out] = self._add(Reciprocal(inverse, (out,)))
            return out

        return self._once(("sqrt", a), make)

    def power(self, a: Operand, p: Operand) -> Operand:
        """a^p with a p that does not change."""
        if is_known(p) and float(p).is_integer() and abs(p) <= 64:
            return self.integer_power(a, int(p))
        is_clipped = not is_known(a) and self._comes_from_choice(a)
        if self._is_fixed(a, p):
            return self.compute(lambda a, p: power(a, p, is_clipped), (a, p), ("power", is_clipped))

        def make() -> int:
            inverse = self._add(PowerReciprocal(self._new(), (a,), is_clipped))
            return self._add(Power(self._new(), (a, p, inverse), is_clipped))

        return self._once(("power", a, _key(p)), make)

    def cube_root(self, a: Operand) -> Operand:
        """Cube root, of negative numbers too."""
        third = lambda inverse: self._add(CubeRoot(self._new(), (a, inverse)))  # noqa: E731
        if self._is_fixed(a):
            return self.compute(jnp.cbrt, (a,), "cbrt")
        return self._once(("cbrt", a), lambda: third(self._add(PowerReciprocal(self._new(), (a,), False))))

    def _comes_from_choice(self, a: int) -> bool:
        """True for a branch that was chosen, times numbers: negative by rounding only where it is meant to be zero."""
        operation = self.by_out.get(a)
        if isinstance(operation, Chosen):
            return True
        if isinstance(operation, Linear):
            return (
                len(operation.args) == 1
                and not operation.constant
                and self._comes_from_choice(operation.args[0])
            )
        if isinstance(operation, Product):
            return self.is_fixed(operation.args[0]) and self._comes_from_choice(operation.args[1])
        return False

    # functions with simple derivatives
    def slope(self, a: Operand) -> Operand:
        """Coefficients k a_k."""
        return self._once(("slope", a), lambda: self._add(Slope(self._new(), (a,))))

    def integral(
        self,
        value: Callable,
        of: Sequence[Operand],
        pairs: Callable[[int], Sequence[tuple[float, Operand, Operand]]],
        key: Hashable,
    ) -> Operand:
        """Series y with y' = sum of c g x', whose value is `value` of `of`.

        Args:
            value: function of numbers.
            of: its operands.
            pairs: function of the series y that gives (c, g, x); g may depend on y.
            key: name of the function.
        """
        of = tuple(of)
        if self._is_fixed(*of):
            return self.compute(value, of, key)
        return self.integrals([value], of, lambda outs: [pairs(outs[0])], key)[0]

    def integrals(
        self,
        values: Sequence[Callable],
        of: Sequence[Operand],
        pairs: Callable[[Sequence[int]], Sequence[Sequence[tuple[float, Operand, Operand]]]],
        key: Hashable,
    ) -> list[Operand]:
        """Series that need each other, see `integral`."""
        of = tuple(of)
        if self._is_fixed(*of):
            return [self.compute(value, of, (key, j)) for j, value in enumerate(values)]
        return self._once((key, *map(_key, of)), lambda: self._integrals(values, of, pairs))

    def _integrals(self, values: Sequence[Callable], of: tuple, pairs: Callable) -> list[Operand]:
        outs = [self._new() for _ in values]
        slopes: dict[Operand, Operand] = {}
        at = len(self.operations)
        for out, value, own in zip(outs, values, pairs(outs), strict=True):
            own = [(float(c), g, x) for c, g, x in own if not is_known(x)]
            for _, _, x in own:
                slopes[x] = self.slope(x)
            args = tuple(a for _, g, x in own for a in (slopes[x], g, x))
            made = Integral(out, args, value, of, tuple(c for c, _, _ in own))
            self.operations.append(made)
            self.by_out[out] = made
        return self._ordered(outs, at)

    def _ordered(self, outs: list[int], at: int) -> list[int]:
        """Integrals before the operations that were made from them: these are read at lower orders alone."""
        new = self.operations[at:]
        reach = set(outs)
        later = []
        earlier = []
        for operation in new:
            if operation.out in outs:
                continue
            if any(a in reach for a in operation.args if not is_known(a)):
                reach.add(operation.out)
                later.append(operation)
            else:
                earlier.append(operation)
        self.operations[at:] = [*earlier, *(o for o in new if o.out in outs), *later]
        return outs

    def exp(self, a: Operand) -> Operand:
        """Exponential."""
        return self.integral(jnp.exp, (a,), lambda y: [(1, y, a)], "exp")

    def log(self, a: Operand) -> Operand:
        """Logarithm."""
        return self.inverse_integral(jnp.log, a, a, "log")

    def inverse_integral(self, value: Callable, a: Operand, g: Operand, key: Hashable) -> Operand:
        """Series y with y' g = a', whose value is `value` of a."""
        if self._is_fixed(a):
            return self.compute(value, (a,), key)

        def make() -> int:
            out, slope = self._new(), self._new()
            self._add(InverseIntegral(out, (a, g, slope, self.reciprocal(g)), value))
            self._memo["slope", out] = self._add(Slope(slope, (out,)))
            return out

        return self._once((key, a), make)

    # choices
    def choose(self, which: Operand, cases: Sequence[Operand]) -> Operand:
        """The case that a flag or number says, which does not change."""
        if is_known(which):
            return cases[min(max(int(which), 0), len(cases) - 1)]
        if all(_same(case, cases[0]) for case in cases):
            return cases[0]
        args = (which, *cases)
        if all(map(self.is_fixed, cases)):
            return self.compute(lambda which, *cases: chosen(which, list(cases)), args, "choose")
        key = "choose", *map(_key, args)
        return self._once(key, lambda: self._add(Chosen(self._new(), args)))

    def above(self, a: Operand, b: Operand) -> Operand:
        """Flag that a > b."""
        terms, constant = self.terms(a)
        others, other = self.terms(b)
        for s, c in others.items():
            terms[s] = terms.get(s, 0.0) - c
        constant -= other
        moving = {s: c for s, c in terms.items() if c and s not in self.fixed}
        if not moving:
            still = self.linear([(c, s) for s, c in terms.items()], constant)
            return (
                np.bool_(still > 0)
                if is_known(still)
                else self.compute(lambda d: jnp.greater(d, 0), (still,), "above")
            )
        # Equal and opposite guards are one.
        unit = moving[min(moving)]
        guard = self.linear([(c / unit, s) for s, c in moving.items()])
        still = {s: c for s, c in terms.items() if c and s in self.fixed}
        knot = self.linear([(-c / unit, s) for s, c in still.items()], -constant / unit)
        flag = self.branch(guard, (knot,), 0)
        return flag if unit > 0 else self.compute(jnp.logical_not, (flag,), "not")

    def terms(self, a: Operand) -> tuple[dict[int, float], float]:
        """Factors of the series that a sum is made of, and its constant."""
        if is_known(a):
            return {}, float(a)
        operation = self.by_out.get(a)
        if not isinstance(operation, Linear):
            return {a: 1.0}, 0.0
        total, constant = {}, operation.constant
        for c, b in zip(operation.factors, operation.args, strict=True):
            inner, other = self.terms(b)
            constant += c * other
            for s, d in inner.items():
                total[s] = total.get(s, 0.0) + c * d
        return total, constant

    def switch(self, guard: int, knots: Sequence[Operand]) -> int:
        """Series of the mode of a switch: the number of knots below its guard."""

        def make() -> int:
            mode = self.leaf(is_fixed=True)
            self.switches.append(Switch(guard, tuple(knots), mode))
            return mode

        return self._once(("switch", guard, *map(_key, knots)), make)

    def branch(self, guard: int, knots: Sequence[Operand], knot: int) -> Operand:
        """Flag that a guard is above a knot."""
        mode = self.switch(guard, knots)
        return self._once(("branch", mode, knot), lambda: self._add(Branch(self._new(), (mode,), knot)))


def _sum(factors: Sequence[float], numbers: Sequence[Any], constant: float) -> Any:
    total = constant
    for c, a in zip(factors, numbers, strict=True):
        total = total + c * a
    return total


def _key(operand: Operand) -> Hashable:
    return ("known", operand.tobytes(), operand.dtype.char) if is_known(operand) else operand


def _same(a: Operand, b: Operand) -> bool:
    return _key(a) == _key(b)
