"""Scalars of a force, without repetition, from its jaxpr."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_jaxpr

from .._lanes.control import needs_of  # and its rules
from .._lanes.elements import as_elements, shaped
from .._lanes.graph import Element, Node, is_known, ordered
from .._lanes.rules import RULES, Program
from .refused import Refused

# Name of `jnp.interp` among the primitives of scalars.
TABLE = "table"


class Table:
    """Stand-in for the primitive that `jnp.interp` is not: a table, its numbers after its argument."""

    name = TABLE


class ForceProgram(Program):
    """Evaluation of a force into a graph of scalars, which keeps tables whole."""

    def _apply(self, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
        name = equation.primitive.name
        if equation.params.get("name") == "_interp":
            return [_table(equation, xs)]
        is_call = any(key in equation.params for key in ("jaxpr", "call_jaxpr", "fun_jaxpr"))
        is_complex = any(np.issubdtype(v.aval.dtype, np.complexfloating) for v in equation.outvars)
        if is_complex and not is_call:
            raise Refused("complex numbers", "have no Taylor series here")
        if name == "while":
            raise Refused(name)
        try:
            return super()._apply(equation, xs)
        except NotImplementedError as error:
            reason = "needs indices that are known" if name in RULES else "has no Taylor series"
            raise Refused(name, reason) from error


def _table(equation: Any, xs: list[np.ndarray]) -> np.ndarray:
    x, knots, values, *_ = xs
    inner = equation.params["jaxpr"]
    if len(xs) > 3:
        raise Refused("jnp.interp with left, right or period")
    params = {"ends": _ends(inner, len(knots)), "size": len(knots)}
    dtype = equation.outvars[0].aval.dtype
    made = [Node(Table, (e, *knots.flat, *values.flat), params, dtype, False) for e in x.flat]
    return shaped(made, x.shape)


def _ends(inner: Any, size: int) -> tuple[bool, bool]:
    """Flags of extrapolation of a table below and above, by a trial: they are no parameters of the jaxpr."""
    x, knots, values = inner.in_avals
    line = np.arange(size, dtype=knots.dtype)
    found = []
    with jax.ensure_compile_time_eval():
        for at in (-1.0, float(size)):
            given = jnp.full(x.shape, at, x.dtype), jnp.asarray(line), jnp.asarray(line, values.dtype)
            found.append(np.asarray(eval_jaxpr(inner.jaxpr, inner.consts, *given)[0]).flat[0])
    return bool(found[0] < -0.5), bool(found[1] > size - 0.5)


def scalars_of(
    function: Callable, shapes: Sequence[Any], known: Sequence[Any]
) -> tuple[list[list[Node]], list[Element]]:
    """Scalars of the arguments and results of a function of arrays.

    Args:
        function: the function.
        shapes: shapes of its arguments.
        known: for each argument its numbers if they are known, else None.
    """
    closed = jax.make_jaxpr(function)(*shapes)
    given, leaves = [], []
    for shape, numbers in zip(shapes, known, strict=True):
        if numbers is not None:
            given.append(as_elements(numbers))
            leaves.append([])
            continue
        size = int(np.prod(shape.shape, dtype=int))
        nodes = [Node(None, (), {}, shape.dtype, False) for _ in range(size)]
        given.append(shaped(nodes, shape.shape))
        leaves.append(nodes)
    outs = ForceProgram().run(closed, given)
    return leaves, [e for out in outs for e in out.flat]


def ordered_nodes(elements: Sequence[Element]) -> list[Node]:
    """Nodes that elements need, each after those that it needs itself."""
    return ordered([e for e in elements if not is_known(e)], needs_of)
