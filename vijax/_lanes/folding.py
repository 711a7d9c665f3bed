"""Results known before any number is: exact rules and known zeros.

0 * x is 0 and x + 0 is x whatever x is, NaN, infinity and the sign of zero included: the zeros are those of literals
and derivatives. A division stays one, unless by a power of two.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np


def _divided(a: Any, b: Any) -> Any:
    return a / b if np.issubdtype(a.dtype, np.inexact) else NotImplemented


EXACT: dict[str, Callable] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": _divided,
    "neg": np.negative,
    "max": np.maximum,
    "min": np.minimum,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "floor": np.floor,
    "ceil": np.ceil,
    "square": np.square,
    "eq": np.equal,
    "ne": np.not_equal,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "not": np.invert,
    "and": np.bitwise_and,
    "or": np.bitwise_or,
    "xor": np.bitwise_xor,
}


def simplified(make: Callable, name: str, args: tuple, dtype: np.dtype, params: dict[str, Any]) -> Any:
    """Simpler element with the same value, or None."""
    rule = _RULES.get(name)
    return None if rule is None else rule(make, args, dtype, params)


def _is(element: Any, number: int) -> bool:
    return isinstance(element, np.generic) and bool(element == number)


def _name(element: Any) -> str | None:
    return getattr(getattr(element, "primitive", None), "name", None)


def _add(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    a, b = args
    if _is(a, 0) or _is(b, 0):
        return b if _is(a, 0) else a
    if _name(b) == "neg":
        return make("sub", (a, b.args[0]), dtype)
    if _name(a) == "neg":
        return make("sub", (b, a.args[0]), dtype)
    return None


def _sub(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    a, b = args
    if _is(b, 0):
        return a
    if _is(a, 0):
        return make("neg", (b,), dtype)
    return make("add", (a, b.args[0]), dtype) if _name(b) == "neg" else None


def _mul(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    for x, y in (args, args[::-1]):
        if _is(x, 0):
            return dtype.type(0)
        if _is(x, 1):
            return y
        if _is(x, -1):
            return make("neg", (y,), dtype)
        if _name(x) == "neg":
            return make("neg", (make("mul", (x.args[0], y), dtype),), dtype)
    return None


def _div(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    a, b = args
    if _is(b, 1):
        return a
    if not np.issubdtype(dtype, np.inexact):
        return None
    if _is(a, 0):
        return dtype.type(0)
    if _is_power_of_two(b):
        return make("mul", (a, dtype.type(1 / b)), dtype)
    return make("neg", (make("div", (a.args[0], b), dtype),), dtype) if _name(a) == "neg" else None


def _is_power_of_two(number: Any) -> bool:
    """True for known powers of two, of either sign, far from the ends of the range: their reciprocal is exact."""
    if not isinstance(number, np.floating):
        return False
    mantissa, exponent = np.frexp(number)
    return bool(abs(mantissa) == 0.5 and abs(exponent) < 64)


def _neg(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    (a,) = args
    if _name(a) == "neg":
        return a.args[0]
    return make("sub", a.args[::-1], dtype) if _name(a) == "sub" else None


def _integer_pow(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    (a,), power = args, params["y"]
    times = partial(make, "mul", dtype=dtype)
    if power == 1:
        return a
    square = times((a, a))
    return {2: lambda: square, 3: lambda: times((a, square)), 4: lambda: times((square, square))}.get(
        power, lambda: None
    )()


def _select(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    which, *cases = args
    if isinstance(which, np.generic):
        return cases[int(which)]
    first = cases[0]
    same = all(c is first or _same_number(c, first) for c in cases[1:])
    if same:
        return first
    if dtype.kind == "b" and len(cases) == 2 and which.dtype.kind == "b":
        return _chosen_flag(make, which, *cases)
    return None


def _same_number(a: Any, b: Any) -> bool:
    return isinstance(a, np.generic) and isinstance(b, np.generic) and a.tobytes() == b.tobytes()


def _chosen_flag(make: Callable, which: Any, off: Any, on: Any) -> Any:
    """Flag `on` where `which` is set, else `off`, if one of them is known."""
    if isinstance(on, np.generic):
        other = make("not", (which,), bool)
        return make("or", (which, off), bool) if on else make("and", (other, off), bool)
    if isinstance(off, np.generic):
        other = make("not", (which,), bool)
        return make("or", (other, on), bool) if off else make("and", (which, on), bool)
    return None


def _logic(identity: bool) -> Callable:
    def rule(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
        if dtype.kind != "b":
            return None
        for x, y in (args, args[::-1]):
            if isinstance(x, np.generic):
                return y if bool(x) == identity else np.bool_(not identity)
        return args[0] if args[0] is args[1] else None

    return rule


def _not(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    return args[0].args[0] if dtype.kind == "b" and _name(args[0]) == "not" else None


def _convert(make: Callable, args: tuple, dtype: np.dtype, params: dict) -> Any:
    return args[0] if args[0].dtype == dtype else None


_RULES: dict[str, Callable] = {
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "neg": _neg,
    "integer_pow": _integer_pow,
    "square": lambda make, args, dtype, params: make("mul", args * 2, dtype),
    "select_n": _select,
    "and": _logic(True),
    "or": _logic(False),
    "not": _not,
    "convert_element_type": _convert,
    "copy": lambda make, args, dtype, params: args[0],
}
