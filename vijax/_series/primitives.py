"""Series of the primitives of JAX.

To add one, add its function to `RULES`: it takes a `Builder`, the operands and the parameters of the primitive. Primitives of
numbers that do not change along the motion need no rule.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax

from .algebra import Operand, is_known
from .builder import Builder
from .choices import above, equal
from .graph_of_force import TABLE
from .operations import Linear, Product, Square
from .quotients import divide, logistic
from .refused import Refused
from .tables import table

Rule = Callable[..., Operand]
_ONE = np.float64(1)


def series_of(build: Builder, name: str, args: Sequence[Operand], params: dict[str, Any]) -> Operand:
    """Series of a primitive of series, of which one changes along the motion."""
    if name not in RULES:
        raise Refused(name)
    return RULES[name](build, *args, **params)


def _convert(build: Builder, a: Operand, *, new_dtype: Any, **_: Any) -> Operand:
    if not np.issubdtype(new_dtype, np.floating):
        raise Refused(f"convert_element_type to {np.dtype(new_dtype)}")
    return a


def _integer_power(build: Builder, a: Operand, *, y: int, **_: Any) -> Operand:
    if y < 0:
        return divide(build, _ONE, build.integer_power(a, -y))
    return build.integer_power(a, y)


def _square_root(build: Builder, a: Operand, **_: Any) -> Operand:
    found = _of_square(build, a)
    return build.sqrt(a) if found is None else build.linear([(math.sqrt(found[0]), _abs(build, found[1]))])


def _of_square(build: Builder, a: Operand) -> tuple[float, Operand] | None:
    """(c, b) if a is c b^2: its root is an absolute value, which has a corner where b is zero."""
    operation = None if is_known(a) else build.by_out.get(a)
    if isinstance(operation, Linear) and len(operation.args) == 1 and not operation.constant:
        found = _of_square(build, operation.args[0])
        c = operation.factors[0]
        return None if found is None or c < 0 else (c * found[0], found[1])
    if isinstance(operation, Product):  # of c b and b
        for one, b in zip(operation.args, reversed(operation.args), strict=True):
            factor = None if is_known(one) else build.by_out.get(one)
            if isinstance(factor, Linear) and factor.args == (b,) and not factor.constant:
                return None if factor.factors[0] < 0 else (factor.factors[0], b)
    return (1.0, operation.args[0]) if isinstance(operation, Square) else None


def _power(build: Builder, a: Operand, b: Operand, **_: Any) -> Operand:
    if build.is_fixed(b):
        square = None if is_known(b) and float(b).is_integer() else _of_square(build, a)
        if square is None:
            return build.power(a, b)
        c, root = square
        whole = build.power(_abs(build, root), build.linear([(2, b)]))
        return whole if c == 1 else build.multiply(build.power(np.float64(c), b), whole)
    if build.is_fixed(a):
        log = build.linear([(math.log(a), b)]) if is_known(a) else build.multiply(build.log(a), b)
    else:
        log = build.multiply(build.log(a), b)
    return build.integral(jnp.power, (a, b), lambda y: [(1, y, log)], "power")


def _exp2(build: Builder, a: Operand, **_: Any) -> Operand:
    return build.integral(jnp.exp2, (a,), lambda y: [(math.log(2), y, a)], "exp2")


def _circular(place: int) -> Rule:
    def rule(build: Builder, a: Operand, **_: Any) -> Operand:
        pairs = lambda y: [[(1, y[1], a)], [(-1, y[0], a)]]  # noqa: E731
        return build.integrals([jnp.sin, jnp.cos], (a,), pairs, "circular")[place]

    return rule


def _hyperbolic(place: int) -> Rule:
    def rule(build: Builder, a: Operand, **_: Any) -> Operand:
        pairs = lambda y: [[(1, y[1], a)], [(1, y[0], a)]]  # noqa: E731
        return build.integrals([jnp.sinh, jnp.cosh], (a,), pairs, "hyperbolic")[place]

    return rule


def _with_square(value: Callable, sign: int, key: str) -> Rule:
    """Y' = (1 + sign y^2) x'."""

    def rule(build: Builder, a: Operand, **_: Any) -> Operand:
        return build.integral(
            value, (a,), lambda y: [(1, build.linear([(sign, build.square(y))], 1), a)], key
        )

    return rule


def _erf(value: Callable, sign: int, key: str) -> Rule:
    def rule(build: Builder, a: Operand, **_: Any) -> Operand:
        bell = build.exp(build.linear([(-1, build.square(a))]))
        return build.integral(value, (a,), lambda y: [(sign * 2 / math.sqrt(math.pi), bell, a)], key)

    return rule


def _erf_inverse(build: Builder, a: Operand, **_: Any) -> Operand:
    pairs = lambda y: [(math.sqrt(math.pi) / 2, build.exp(build.square(y)), a)]  # noqa: E731
    return build.integral(lax.erf_inv, (a,), pairs, "erf_inv")


def _around(build: Builder, a: Operand) -> Operand:
    """(1 - a) (1 + a), accurate near its zeros."""
    return build.multiply(build.linear([(-1, a)], 1), build.linear([(1, a)], 1))


def _arcsin(build: Builder, a: Operand, **_: Any) -> Operand:
    return build.inverse_integral(jnp.arcsin, a, build.sqrt(_around(build, a)), "asin")


def _arccos(build: Builder, a: Operand, **_: Any) -> Operand:
    g = build.linear([(-1, build.sqrt(_around(build, a)))])
    return build.inverse_integral(jnp.arccos, a, g, "acos")


def _arctan(build: Builder, a: Operand, **_: Any) -> Operand:
    return build.inverse_integral(jnp.arctan, a, build.linear([(1, build.square(a))], 1), "atan")


def _arcsinh(build: Builder, a: Operand, **_: Any) -> Operand:
    g = build.sqrt(build.linear([(1, build.square(a))], 1))
    return build.inverse_integral(jnp.arcsinh, a, g, "asinh")


def _arccosh(build: Builder, a: Operand, **_: Any) -> Operand:
    g = build.sqrt(build.multiply(build.linear([(1, a)], -1), build.linear([(1, a)], 1)))
    return build.inverse_integral(jnp.arccosh, a, g, "acosh")


def _arctan2(build: Builder, y: Operand, x: Operand, **_: Any) -> Operand:
    """From r^2 angle' = x y' - y x'."""
    square = build.linear([(1, build.square(x)), (1, build.square(y))])
    pairs = lambda _: [(1, build.divide(x, square), y), (-1, build.divide(y, square), x)]  # noqa: E731
    return build.integral(jnp.arctan2, (y, x), pairs, "atan2")


def _compare(*, turned: bool) -> Rule:
    def rule(build: Builder, a: Operand, b: Operand, **_: Any) -> Operand:
        return above(build, b, a) if turned else above(build, a, b)

    return rule


def _is_one(a: Operand, b: Operand) -> bool:
    return not is_known(a) and not is_known(b) and a == b


def _abs(build: Builder, a: Operand, **_: Any) -> Operand:
    found = build.choose(above(build, a, np.float64(0)), [build.linear([(-1, a)]), a])
    build.not_negative.add(found)
    return found


def _sign(build: Builder, a: Operand, **_: Any) -> Operand:
    return build.choose(above(build, a, np.float64(0)), [np.float64(-1), _ONE])


def _larger(build: Builder, a: Operand, b: Operand, **_: Any) -> Operand:
    for one, other in ((a, b), (b, a)):
        if is_known(one) and np.isinf(one):
            return one if one > 0 else other
    return a if _is_one(a, b) else build.choose(above(build, a, b), [b, a])


def _smaller(build: Builder, a: Operand, b: Operand, **_: Any) -> Operand:
    for one, other in ((a, b), (b, a)):
        if is_known(one) and np.isinf(one):
            return one if one < 0 else other
    return a if _is_one(a, b) else build.choose(above(build, a, b), [a, b])


RULES: dict[str, Rule] = {
    **dict.fromkeys(("copy", "reduce_precision", "stop_gradient"), lambda build, a, **_: a),
    "convert_element_type": _convert,
    "add": lambda build, a, b, **_: build.linear([(1, a), (1, b)]),
    "sub": lambda build, a, b, **_: build.linear([(1, a), (-1, b)]),
    "neg": lambda build, a, **_: build.linear([(-1, a)]),
    "mul": lambda build, a, b, **_: build.multiply(a, b),
    "square": lambda build, a, **_: build.square(a),
    "integer_pow": _integer_power,
    "div": lambda build, a, b, **_: divide(build, a, b),
    "sqrt": _square_root,
    "rsqrt": lambda build, a, **_: divide(build, _ONE, _square_root(build, a)),
    "cbrt": lambda build, a, **_: build.cube_root(a),
    "pow": _power,
    "exp": lambda build, a, **_: build.exp(a),
    "exp2": _exp2,
    "expm1": lambda build, a, **_: build.integral(jnp.expm1, (a,), lambda y: [(1, build.exp(a), a)], "expm1"),
    "sin": _circular(0),
    "cos": _circular(1),
    "sinh": _hyperbolic(0),
    "cosh": _hyperbolic(1),
    "tanh": lambda build, a, **_: build.tanh(a),
    "tan": _with_square(jnp.tan, 1, "tan"),
    "logistic": lambda build, a, **_: logistic(build, a),
    "erf": _erf(lax.erf, 1, "erf"),
    "erfc": _erf(lax.erfc, -1, "erfc"),
    "erf_inv": _erf_inverse,
    "log": lambda build, a, **_: build.log(a),
    "log1p": lambda build, a, **_: build.inverse_integral(jnp.log1p, a, build.linear([(1, a)], 1), "log1p"),
    "asin": _arcsin,
    "acos": _arccos,
    "atan": _arctan,
    "asinh": _arcsinh,
    "acosh": _arccosh,
    "atanh": lambda build, a, **_: build.inverse_integral(jnp.arctanh, a, _around(build, a), "atanh"),
    "atan2": _arctan2,
    **dict.fromkeys(("gt", "ge"), _compare(turned=False)),
    **dict.fromkeys(("lt", "le"), _compare(turned=True)),
    "eq": lambda build, a, b, **_: equal(build, a, b),
    "ne": lambda build, a, b, **_: build.compute(jnp.logical_not, (equal(build, a, b),), "not"),
    "is_finite": lambda build, a, **_: np.bool_(True),
    "abs": _abs,
    "sign": _sign,
    "max": _larger,
    "min": _smaller,
    "clamp": lambda build, low, a, high, **_: _smaller(build, _larger(build, a, low), high),
    "select_n": lambda build, which, *cases, **_: build.choose(which, cases),
    TABLE: table,
}
