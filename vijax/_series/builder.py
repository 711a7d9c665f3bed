"""Series made of series: functions as core operations, each of them once, with known numbers folded."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .algebra import Operand, is_known
from .operations import (
    Chosen,
    Computed,
    Fixed,
    Integral,
    InverseIntegral,
    Linear,
    Operation,
    Product,
    Quotient,
    Reciprocal,
    Slope,
    Square,
    SquareRoot,
    chosen,
    is_zero,
)
from .powers import ClosingPower, CubeRoot, Power, PowerReciprocal, ScaledPower, power
from .switches import Switch


class Builder:
    """Operations that are made so far.

    Attributes:
        operations: each after those of its arguments, but for terms of lower order of itself.
        num_leaves: series that are given, the first ones.
        switches: choices between branches.
        fixed: series that do not change along the motion.
        not_negative: absolute values.
    """

    def __init__(self):
        self.operations: list[Operation] = []
        self.by_out: dict[int, Operation] = {}
        self.switches: list[Switch] = []
        self.fixed: set[int] = set()
        self.not_negative: set[Operand] = set()
        self._size = 0
        self._memo: dict[Hashable, Any] = {}

    def leaf(self, *, is_fixed: bool = False) -> int:
        """A series that is given."""
        leaf = self.new()
        if is_fixed:
            self.fixed.add(leaf)
        return leaf

    @property
    def size(self) -> int:
        """Number of series."""
        return self._size

    def new(self) -> int:
        """Number of a new series."""
        self._size += 1
        return self._size - 1

    def add(self, operation: Operation) -> int:
        """Add an operation; its series."""
        self.operations.append(operation)
        self.by_out[operation.out] = operation
        if isinstance(operation, Fixed):
            self.fixed.add(operation.out)
        return operation.out

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Result of `make`, made once for a key."""
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
        key = "computed", key, tuple(map(key_of, args))
        return self.once(key, lambda: self.add(Computed(self.new(), tuple(args), function)))

    def _is_fixed(self, *args: Operand) -> bool:
        return all(map(self.is_fixed, args))

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
        return self.once(key, lambda: self.add(Linear(self.new(), args, values, total)))

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
        return self.once(("multiply", args), lambda: self.add(Product(self.new(), args)))

    def square(self, a: Operand) -> Operand:
        """a^2."""
        if self._is_fixed(a):
            return self.compute(jnp.square, (a,), "square")
        return self.once(("square", a), lambda: self.add(Square(self.new(), (a,))))

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
        return self.once(("reciprocal", a), lambda: self.add(Reciprocal(self.new(), (a,))))

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
        make = lambda: self.add(Quotient(self.new(), (a, b, self.reciprocal(b))))  # noqa: E731
        return self.once(("divide", key_of(a), b), make)

    def sqrt(self, a: Operand) -> Operand:
        """Square root of what is not a square, see `roots.py`."""
        if self._is_fixed(a):
            return self.compute(jnp.sqrt, (a,), "sqrt")
        if self._chooser(a) is not None:  # may be zero for good
            return self.power(a, np.float64(0.5))

        def make() -> int:
            out, inverse = self.new(), self.new()
            self.add(SquareRoot(out, (a, inverse)))
            self._memo["reciprocal", out] = self.add(Reciprocal(inverse, (out,)))
            return out

        return self.once(("sqrt", a), make)

    def power(self, a: Operand, p: Operand) -> Operand:
        """a^p with a p that does not change."""
        if is_known(p) and float(p).is_integer() and abs(p) <= 64:
            return self.integer_power(a, int(p))
        is_clipped = not is_known(a) and self._chooser(a) is not None
        if self._is_fixed(a, p):
            return self.compute(lambda a, p: power(a, p, is_clipped), (a, p), ("power", is_clipped))

        def make() -> int:
            modes = self._modes_of(self._chooser(a)) if is_clipped else ()
            inverse = self.add(PowerReciprocal(self.new(), (a,), is_clipped, modes))
            plain = self.add(Power(self.new(), (a, p, inverse), is_clipped, modes))
            return self._closing(plain, a, float(p)) if is_clipped and is_known(p) else plain

        return self.once(("power", a, key_of(p)), make)

    def _closing(self, plain: int, a: int, p: float) -> int:
        """Power with the series in the root of time that a closing contact has."""
        modes = self._modes_of(self._chooser(a))
        if not modes or p < 1 or not (2 * p).is_integer():
            return plain
        scaled = [self.add(ScaledPower(self.new(), (a,), p, lead)) for lead in (2, 4)]
        return self.add(ClosingPower(self.new(), (plain, *scaled, a), p, modes))

    def cube_root(self, a: Operand) -> Operand:
        """Cube root, of negative numbers too."""
        third = lambda inverse: self.add(CubeRoot(self.new(), (a, inverse)))  # noqa: E731
        if self._is_fixed(a):
            return self.compute(jnp.cbrt, (a,), "cbrt")
        return self.once(("cbrt", a), lambda: third(self.add(PowerReciprocal(self.new(), (a,), False))))

    def _chooser(self, a: int) -> Operand | None:
        """Operand that decides about a chosen branch, times numbers: negative by rounding only where it is meant to be zero."""
        operation = self.by_out.get(a)
        if isinstance(operation, Chosen):
            return operation.args[0]
        if isinstance(operation, Linear) and len(operation.args) == 1 and not operation.constant:
            return self._chooser(operation.args[0])
        if isinstance(operation, Product) and self.is_fixed(operation.args[0]):
            return self._chooser(operation.args[-1])
        return None

    def _modes_of(self, which: Operand) -> tuple[int, ...]:
        """Modes that a flag or a number depends on."""
        modes = {switch.mode for switch in self.switches}
        found, waiting = set(), [which]
        while waiting:
            a = waiting.pop()
            if is_known(a) or a in found:
                continue
            found.add(a)
            waiting.extend(self.by_out[a].args if a in self.by_out else ())
        return tuple(sorted(found & modes))

    # functions with simple derivatives
    def slope(self, a: Operand) -> Operand:
        """Coefficients k a_k."""
        return self.once(("slope", a), lambda: self.add(Slope(self.new(), (a,))))

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
        return self.once((key, *map(key_of, of)), lambda: self._integrals(values, of, pairs))

    def _integrals(self, values: Sequence[Callable], of: tuple, pairs: Callable) -> list[Operand]:
        outs = [self.new() for _ in values]
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

    def tanh(self, a: Operand) -> Operand:
        """Hyperbolic tangent."""
        return self.integral(
            jnp.tanh, (a,), lambda y: [(1, self.linear([(-1, self.square(y))], 1), a)], "tanh"
        )

    def log(self, a: Operand) -> Operand:
        """Logarithm."""
        return self.inverse_integral(jnp.log, a, a, "log")

    def inverse_integral(self, value: Callable, a: Operand, g: Operand, key: Hashable) -> Operand:
        """Series y with y' g = a', whose value is `value` of a."""
        if self._is_fixed(a):
            return self.compute(value, (a,), key)

        def make() -> int:
            out, slope = self.new(), self.new()
            self.add(InverseIntegral(out, (a, g, slope, self.reciprocal(g)), value))
            self._memo["slope", out] = self.add(Slope(slope, (out,)))
            return out

        return self.once((key, a), make)

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
        key = "choose", *map(key_of, args)
        return self.once(key, lambda: self.add(Chosen(self.new(), args)))


def _sum(factors: Sequence[float], numbers: Sequence[Any], constant: float) -> Any:
    total = constant
    for c, a in zip(factors, numbers, strict=True):
        total = total + c * a
    return total


def key_of(operand: Operand) -> Hashable:
    return ("known", operand.tobytes(), operand.dtype.char) if is_known(operand) else operand


def _same(a: Operand, b: Operand) -> bool:
    return key_of(a) == key_of(b)
