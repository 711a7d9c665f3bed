"""Divisions by functions that overflow, as other functions: the series of an infinite number are none.

1 / cosh has a series of its own, y' = -y tanh x', and 1 / (1 + exp) is a logistic function.
"""

import math
from typing import Any

import jax.numpy as jnp
from jax import lax

from .algebra import Operand, is_known
from .builder import Builder
from .choices import terms_of
from .operations import Integral, Linear, Product, Square


def divide(build: Builder, a: Operand, b: Operand) -> Operand:
    """A / b, by factors of b that overflow."""
    operation = None if is_known(b) else build.by_out.get(b)
    if operation is None or not _has_growing(build, b):
        return build.divide(a, b)
    if isinstance(operation, Square | Product):
        for factor in operation.args * (2 if isinstance(operation, Square) else 1):
            a = divide(build, a, factor)
        return a
    if isinstance(operation, Integral):
        return build.multiply(a, _INVERSES[operation.value](build, operation.of[0]))
    terms, constant = terms_of(build, b)
    ((g, c),) = terms.items()
    if not constant:
        return divide(build, build.linear([(1 / c, a)]), g)
    # 1 / (b + c exp(x)) with b / c > 0
    inner = build.by_out[g]
    assert isinstance(inner, Integral)
    x = build.linear([(-1, inner.of[0])], -math.log(c / constant))
    return build.multiply(build.linear([(1 / constant, a)]), logistic(build, x))


def _has_growing(build: Builder, b: Operand) -> bool:
    """Whether `divide` knows another form of a division by b."""
    operation = None if is_known(b) else build.by_out.get(b)
    if isinstance(operation, Square | Product):
        return any(_has_growing(build, factor) for factor in operation.args)
    if isinstance(operation, Linear):
        terms, constant = terms_of(build, b)
        if len(terms) != 1:
            return False
        ((g, c),) = terms.items()
        inner = build.by_out.get(g)
        is_exp = isinstance(inner, Integral) and inner.value is jnp.exp
        return is_exp and c * constant > 0 if constant else _has_growing(build, g)
    return isinstance(operation, Integral) and operation.value in _INVERSES


def logistic(build: Builder, a: Operand) -> Operand:
    """1 / (1 + exp(-a))."""
    pairs = lambda y: [(1, build.linear([(1, y), (-1, build.square(y))]), a)]  # noqa: E731
    return build.integral(lax.logistic, (a,), pairs, "logistic")


def _inverse_exponential(build: Builder, a: Operand) -> Operand:
    return build.exp(build.linear([(-1, a)]))


def inverse_cosh(x: Any) -> Any:
    """1 / cosh(x)."""
    small = jnp.exp(-jnp.abs(x))
    return 2 * small / (1 + small * small)


def _inverse_hyperbolic_cosine(build: Builder, a: Operand) -> Operand:
    tanh = build.tanh(a)
    return build.integral(inverse_cosh, (a,), lambda y: [(-1, build.multiply(y, tanh), a)], "inverse cosh")


_INVERSES = {jnp.exp: _inverse_exponential, jnp.cosh: _inverse_hyperbolic_cosine}
