"""A function that is computed in one way, and differentiated in two.

A loop without a bound on its steps can be differentiated forwards but not backwards, one with a bound both
ways, but it is cut at the bound. Neither JAX nor equinox has a loop that is without a bound forwards
and goes backwards too, and a rule of differentiation (`jax.custom_jvp`) is not told which way it is asked
for. The difference shows in what becomes of a tangent: backwards it is unknown at first, and then
transposed. So there are three primitives, of one function:

- `_values`, what the function returns;
- `_with_tangents`, the derivative of the first, by the unbounded loop, values and tangents at once;
- `_tangents`, which is left of the second where values are known and tangents are not (`jax.grad`). It
  is linear, and transposed by the bounded loop.

Derivatives of derivatives follow: the second and the third are functions too, and their derivatives
are the second again, of these. `jax.custom_derivatives.linear_call` was tried, but knows no `vmap`.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import chain
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive, Var, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir, partial_eval
from jaxtyping import PyTree

Arrays = list[Any]  # of JAX, or what stands for them while a function is traced
Function = Callable[[Arrays, Arrays], tuple[Arrays, Arrays]]


def both_ways(forwards: Callable, backwards: Callable, tree: PyTree) -> PyTree:
    """Return `forwards(tree)`, which is differentiated backwards as `backwards`.

    Args:
        forwards: what is computed, a tree of arrays.
        backwards: the same function, made so that JAX can transpose its derivative.
        tree: floating-point arrays, by which it is differentiated, and anything else.
    """
    arrays, static = eqx.partition(tree, lambda a: isinstance(a, jax.Array))
    moving, fixed = eqx.partition(arrays, eqx.is_inexact_array)
    (x, of_x), (others, of_others) = jax.tree.flatten(moving), jax.tree.flatten(fixed)

    def of_arrays(function: Callable, others: Arrays, x: Arrays) -> PyTree:
        tree = jax.tree.unflatten(of_x, x), jax.tree.unflatten(of_others, others), static
        return function(eqx.combine(*tree))

    def of_lists(function: Callable, others: Arrays, x: Arrays) -> tuple[Arrays, Arrays]:
        y, rest = eqx.partition(function(others, x), has_derivative)
        return jax.tree.leaves(y), jax.tree.leaves(rest)

    both = [_traced_once(partial(of_arrays, function)) for function in (forwards, backwards)]
    shape = jax.eval_shape(both[0], others, x)
    has_derivative = jax.tree.map(lambda a: jnp.issubdtype(a.dtype, jnp.inexact), shape)
    moves = jax.tree.leaves(has_derivative)
    sizes = sum(moves), len(moves) - sum(moves)
    found = _bind(_values, _ways(*(partial(of_lists, function) for function in both), sizes), others, x)
    y, rest = _parts(found, sizes)
    return jax.tree.map(lambda moves: (y if moves else rest).pop(0), has_derivative)


def _traced_once(function: Callable) -> Callable:
    """The function, traced once however often it is asked for: `jax.jit` does so anew under other transformations."""

    @cache
    def traced(structure: Any, kinds: tuple) -> tuple[Callable, Any]:
        shapes = [jax.ShapeDtypeStruct(*kind) for kind in kinds]
        jaxpr, shape = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(structure, shapes))
        return jaxpr_as_fun(jaxpr), jax.tree.structure(shape)

    def call(*args: PyTree) -> PyTree:
        arrays, structure = jax.tree.flatten(args)
        run, of_found = traced(structure, tuple((a.shape, a.dtype) for a in map(jax.typeof, arrays)))
        return jax.tree.unflatten(of_found, run(*arrays))

    return call


class _Ways(NamedTuple):
    """A function of `fixed` and `x` with its derivatives along `dx`.

    Attributes:
        values: (fixed, x), by the unbounded loop.
        backwards: the same by the bounded loop.
        joint: (fixed, x, dx), values and tangents, by the unbounded loop.
        transposable: the same by the bounded loop.
        pullback: (fixed, x, cotangents), the cotangents of `dx`.
        sizes: how many arrays it returns that have derivatives, and others.
    """

    values: Function
    backwards: Function
    joint: Callable
    transposable: Callable
    pullback: Callable
    sizes: tuple[int, int]


def _ways(
    forwards: Function, backwards: Function, sizes: tuple[int, int], moves: Sequence[bool] = ()
) -> _Ways:
    joint, transposable = (
        _traced_once(partial(_derivative, function, moves)) for function in (forwards, backwards)
    )
    pullback = _traced_once(partial(_pullback, backwards, moves))
    return _Ways(forwards, backwards, joint, transposable, pullback, sizes)


def _derivative(
    function: Function, moves: Sequence[bool], fixed: Arrays, x: Arrays, dx: Arrays
) -> tuple[Arrays, Arrays, Arrays]:
    of_moving, moving = _restricted(function, moves, fixed, x)
    y, dy, rest = jax.jvp(of_moving, (moving,), (dx,), has_aux=True)
    return y, rest, dy


def _pullback(
    function: Function, moves: Sequence[bool], fixed: Arrays, x: Arrays, cotangents: Arrays
) -> Arrays:
    of_moving, moving = _restricted(function, moves, fixed, x)
    return jax.vjp(of_moving, moving, has_aux=True)[1](cotangents)[0]


def _restricted(
    function: Function, moves: Sequence[bool], fixed: Arrays, x: Arrays
) -> tuple[Callable, Arrays]:
    """The same as a function of the moving arguments alone, so that the others cost nothing."""

    def of_moving(moving: Arrays) -> tuple[Arrays, Arrays]:
        moving = list(moving)
        return function(fixed, [moving.pop(0) if move else a for a, move in zip(x, moves, strict=True)])

    return of_moving, [a for a, move in zip(x, moves, strict=True) if move]


_values, _with_tangents, _tangents = map(Primitive, ("values", "values_with_tangents", "tangents"))


def _bind(primitive: Primitive, ways: _Ways, *parts: Arrays) -> Arrays:
    return primitive.bind(*chain(*parts), ways=ways, sizes=tuple(map(len, parts)))


def _parts(row: Any, sizes: tuple[int, ...]) -> list[list]:
    ends = [sum(sizes[: k + 1]) for k in range(len(sizes))]
    return [list(row[end - size : end]) for size, end in zip(sizes, ends, strict=True)]


def _evaluate(primitive: Primitive, *row: Any, ways: _Ways, sizes: tuple[int, ...]) -> Arrays:
    parts = _parts(row, sizes)
    if primitive is _values:
        return list(chain(*ways.values(*parts)))
    y, rest, dy = ways.joint(*parts)
    return [*y, *rest, *dy] if primitive is _with_tangents else list(dy)


def _shapes(primitive: Primitive, *row: Any, ways: _Ways, sizes: tuple[int, ...]) -> list:
    row = tuple(jax.ShapeDtypeStruct(a.shape, a.dtype) for a in row)
    found = jax.eval_shape(partial(_evaluate, primitive, ways=ways, sizes=sizes), *row)
    return [ShapedArray(a.shape, a.dtype) for a in found]


def _differentiate(primitive: Primitive, row: Any, changes: Any, *, ways: _Ways, sizes: tuple[int, ...]):
    """The values of a primitive and their tangents: it is a function of all that can change."""
    fixed, *moving = _parts(row, sizes)
    at, dx = list(chain(*moving)), changes[len(fixed) :]
    if primitive is not _values:
        ways = _of_derivative(primitive, ways, sizes)
    moves = [type(t) is not ad.Zero for t in dx]
    ways = _ways(ways.values, ways.backwards, ways.sizes, moves)
    found = _bind(_with_tangents, ways, fixed, at, [t for t, move in zip(dx, moves, strict=True) if move])
    y, rest, dy = _parts(found, (*ways.sizes, ways.sizes[0]))
    nothing = [ad.Zero(jax.typeof(a).to_tangent_aval()) for a in rest]
    if primitive is not _with_tangents:
        return [*y, *rest], [*dy, *nothing]
    # The tangents of the first derivative are values of the second: back to their places.
    half = len(y) // 2
    return [*y[:half], *rest, *y[half:]], [*dy[:half], *nothing, *dy[half:]]


def _of_derivative(primitive: Primitive, ways: _Ways, sizes: tuple[int, ...]) -> _Ways:
    """The ways of a primitive with tangents, as a function of `fixed` and of `x` and `dx` in one list."""

    def of_all(joint: Callable, fixed: Arrays, both: Arrays) -> tuple[Arrays, Arrays]:
        y, rest, dy = joint(fixed, *_parts(both, sizes[1:]))
        return ([*y, *dy], rest) if primitive is _with_tangents else (dy, [])

    forwards, backwards = partial(of_all, ways.joint), partial(of_all, ways.transposable)
    num, rest = ways.sizes
    sizes_found = (2 * num, rest) if primitive is _with_tangents else (num, 0)
    return _ways(forwards, backwards, sizes_found)


def _batch(primitive: Primitive, row: Any, axes: Any, *, ways: _Ways, sizes: tuple[int, ...]):
    size = next(a.shape[axis] for a, axis in zip(row, axes, strict=True) if axis is not None)
    (fixed, x, *dx), (of_fixed, of_x, *of_dx) = _parts(row, sizes), _parts(axes, sizes)
    if primitive is _values:
        over = (of_fixed, of_x)
        ways = _ways(_batched(ways.values, over), _batched(ways.backwards, over), ways.sizes)
        found = _bind(_values, ways, fixed, x)
        return found, [0] * len(found)
    # Tangents get the axis, for their cotangents will have it.
    dx = _in_front(dx[0], of_dx[0], size)
    shared = all(axis is None for axis in (*of_fixed, *of_x))
    over, of_values = (of_fixed, of_x), None if shared else 0
    ways = ways._replace(
        values=ways.values if shared else _batched(ways.values, over),
        backwards=ways.backwards if shared else _batched(ways.backwards, over),
        joint=_batched(ways.joint, (*over, 0), (of_values, of_values, 0)),
        transposable=_batched(ways.transposable, (*over, 0), (of_values, of_values, 0)),
        pullback=_batched(ways.pullback, (*over, 0)),
    )
    found = _bind(primitive, ways, fixed, x, dx)
    num_tangents = ways.sizes[0]
    return found, [of_values] * (len(found) - num_tangents) + [0] * num_tangents


def _batched(function: Callable, over: tuple, to: Any = 0) -> Callable:
    return _traced_once(jax.vmap(function, over, to))


def _in_front(arrays: Arrays, axes: list[int | None], size: int) -> Arrays:
    return [
        jnp.broadcast_to(a, (size, *jnp.shape(a))) if axis is None else jnp.moveaxis(a, axis, 0)
        for a, axis in zip(arrays, axes, strict=True)
    ]


def _transpose(cotangents: Any, *row: Any, ways: _Ways, sizes: tuple[int, ...]) -> list:
    fixed, x, _ = _parts(row, sizes)
    cotangents = [ad.instantiate_zeros(c) for c in cotangents]
    return [None] * (sizes[0] + sizes[1]) + list(ways.pullback(fixed, x, cotangents))


def _split_while_tracing(trace: Any, *row: Any, ways: _Ways, sizes: tuple[int, ...]) -> list:
    """Values at once, where all that they depend on is known; tangents by the primitive that waits."""
    wait = partial(trace.default_process_primitive, tracers=row, params={"ways": ways, "sizes": sizes})
    is_known = [t.pval.is_known() for t in row]
    if not all(is_known[: sizes[0] + sizes[1]]) or all(is_known):
        return wait(_with_tangents)
    fixed, x, _ = _parts([t.pval.get_known() for t in row], sizes)
    return [*map(trace.new_const, _bind(_values, ways, fixed, x)), *wait(_tangents)]


def _split_in_checkpoint(saveable: Any, is_unknown: Any, is_there: Any, equation: Any) -> tuple:
    """The same for an equation of a function under `jax.checkpoint`."""
    del saveable
    sizes, ways = equation.params["sizes"], equation.params["ways"]
    num_known, num_values = sizes[0] + sizes[1], sum(ways.sizes)
    pairs = zip(equation.invars, is_there, strict=True)
    wanted = [a for a, there in pairs if isinstance(a, Var) and not there]
    if any(is_unknown[:num_known]):
        all_ = [True] * len(equation.outvars)
        return None, equation, all_, all_, wanted
    known = equation.replace(
        primitive=_values,
        invars=equation.invars[:num_known],
        outvars=equation.outvars[:num_values],
        params=equation.params | {"sizes": sizes[:2]},
    )
    waiting = equation.replace(primitive=_tangents, outvars=equation.outvars[num_values:])
    unknown = [False] * num_values + [True] * ways.sizes[0]
    return known, waiting, unknown, unknown, wanted


for _primitive in (_values, _with_tangents, _tangents):
    _primitive.multiple_results = True
    _primitive.def_impl(partial(_evaluate, _primitive))
    _primitive.def_abstract_eval(partial(_shapes, _primitive))
    mlir.register_lowering(_primitive, mlir.lower_fun(partial(_evaluate, _primitive), multiple_results=True))
    ad.primitive_jvps[_primitive] = partial(_differentiate, _primitive)
    batching.primitive_batchers[_primitive] = partial(_batch, _primitive)
ad.primitive_transposes[_tangents] = _transpose
partial_eval.custom_partial_eval_rules[_with_tangents] = _split_while_tracing
partial_eval.partial_eval_jaxpr_custom_rules[_with_tangents] = _split_in_checkpoint
