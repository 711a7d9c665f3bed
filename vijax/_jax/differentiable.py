"""A function with derivatives of its own: computed one way, differentiated another.

A loop whose number of steps is not known can be differentiated forwards but not backwards, and a differentiation rule
(`jax.custom_jvp`) needs a transposable one. Two primitives serve:

- `values`, the results of the function;
- `tangents`, the derivative of its results along given tangents, from another function with the same results, which
  is differentiable forwards. It is linear in the tangents: its transpose is a product with the derivatives along each
  number.

Derivatives of derivatives follow: `tangents` is a function too, of inputs and tangents, and its derivative is
`tangents` of it. A batch is kept as a list of layers, so that its derivatives are computed lane by lane: the cotangents of
one lane affect no other. `jax.custom_derivatives.linear_call` was tried, but does not support `vmap`.
`jax.lax.custom_linear_solve` would store every state of a loop.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import chain
from typing import Any

import equinox as eqx
import jax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir, partial_eval
from jaxtyping import PyTree

from .derivation import (
    Arrays,
    BatchAxis,
    Derivation,
    Flags,
    Functions,
    axis_last,
    lanes_first,
    members,
    pullback_of,
    push_of,
    tangents,
    tangents_of,
    values,
    values_of,
)
from .traced import CACHE_SIZE, Traced, kind


def with_derivatives(
    function: Callable,
    tree: PyTree,
    *,
    smooth: Callable | None = None,
    many: Callable | None = None,
    smooth_many: Callable | None = None,
    watch: Callable | None = None,
    always: Callable | None = None,
    has_reverse: bool = False,
    compiled: Callable = jax.jit,
    compiled_many: Callable | None = None,
) -> PyTree:
    """Return `function(tree)`, with the derivatives of `smooth`.

    Traces and compilations are cached by the functions, the non-array leaves, and the shapes of the arrays.

    Args:
        function: function of `tree` that returns a tree of arrays.
        tree: floating-point arrays, which are the variables of the derivative, and any other leaves.
        smooth: function of `tree` and of the tree of results with flags, false for those that are not wanted. Its
            results are those of `function` where wanted, and it is differentiable forwards, any number of times.
        many: if given, `function` of a batch. It takes a tree whose arrays have the batch axis last, of length one where
            all members share the array, and the size of the batch. Its results have it first.
        smooth_many: if given, `smooth` of a batch, likewise.
        watch: if given, takes first derivatives and returns them. They are those of the results in their tree, or a
            list of those with respect to the arguments.
        always: selects the results whose derivatives `watch` needs.
        has_reverse: whether `smooth` is differentiable in reverse too. Otherwise the transpose is a product with the
            derivatives along each number.
        compiled: compiles a function that is not part of a larger program.
        compiled_many: the same for a batch; `compiled` if left out.
    """
    arrays, others = eqx.partition(tree, lambda a: isinstance(a, jax.Array))
    moving, fixed = eqx.partition(arrays, eqx.is_inexact_array)
    (fixed, of_fixed), (x, of_x), (others, of_others) = map(jax.tree.flatten, (fixed, moving, others))
    functions, join = _functions(
        (
            function,
            smooth,
            many,
            smooth_many,
            watch,
            always,
            has_reverse,
            compiled,
            compiled_many or compiled,
        ),
        (of_fixed, of_x, of_others),
        tuple(others),
        *(tuple(map(kind, part)) for part in (fixed, x)),
    )
    derivation = Derivation(functions)
    found = values.bind(*fixed, *x, derivation=derivation, sizes=(len(fixed), len(x)))
    return join(found[: len(functions.always)], found[len(functions.always) :])


@lru_cache(CACHE_SIZE)
def _functions(given: tuple, structures: tuple, others: tuple, *kinds: tuple) -> tuple[Functions, Callable]:
    """`Functions` of lists of arrays, and a function that rebuilds the tree of results from lists."""
    function, smooth, many, smooth_many, watch, always, has_reverse, compiled, compiled_many = given
    found: list = []

    def tree_of(fixed: Arrays, x: Arrays) -> PyTree:
        return eqx.combine(*map(jax.tree.unflatten, structures, (fixed, x, others)))

    def of_lists(function: Callable, fixed: Arrays, x: Arrays) -> tuple[Arrays, Arrays]:
        arrays, rest = eqx.partition(function(tree_of(fixed, x)), eqx.is_array)
        parts = *eqx.partition(arrays, eqx.is_inexact_array), rest
        (y, of_y), (whole, of_whole), (rest, of_rest) = map(jax.tree.flatten, parts)
        found[:] = (of_y, of_whole, of_rest), rest
        return y, whole

    def join(y: Arrays, whole: Arrays) -> PyTree:
        structures, rest = found
        return eqx.combine(*map(jax.tree.unflatten, structures, (y, whole, rest)))

    def flagged(wanted: Flags, function: Callable, fixed: Arrays, x: Arrays) -> Arrays:
        flags = jax.tree.unflatten(found[0][0], wanted)
        y, _ = of_lists(lambda tree: function(tree, flags), fixed, x)
        return [a for a, yes in zip(y, wanted, strict=True) if yes]

    def of_many(layer: BatchAxis, fixed: Arrays, x: Arrays) -> tuple[Arrays, Arrays]:
        return of_lists(lambda tree: many(tree, layer.size), *map(axis_last, (fixed, x), layer.axes))

    def smooth_of_many(layer: BatchAxis, wanted: Flags, fixed: Arrays, x: Arrays) -> Arrays:
        own = lambda tree, flags: smooth_many(tree, flags, layer.size)  # noqa: E731
        return flagged(wanted, own, *map(axis_last, (fixed, x), layer.axes))

    def watched(derivatives: Arrays, of_results: bool) -> Arrays:
        if not of_results:
            return list(watch(derivatives))
        structure = found[0][0]
        return structure.flatten_up_to(watch(jax.tree.unflatten(structure, derivatives)))

    own = Traced(partial(of_lists, function), compiled)
    own.shapes(*[[jax.ShapeDtypeStruct(*kind) for kind in part] for part in kinds])
    if smooth is None:
        smooth = lambda tree, _: function(tree)  # noqa: E731
    functions = Functions(
        values=own,
        smooth=lambda wanted: partial(flagged, wanted, smooth),
        many=None if many is None else lambda layer: partial(of_many, layer),
        smooth_many=None
        if smooth_many is None
        else lambda layer, wanted: partial(smooth_of_many, layer, wanted),
        always=_selected(always, found[0][0]),
        watch=None if watch is None else watched,
        has_reverse=has_reverse,
        compiled=compiled,
        compiled_many=compiled_many,
    )
    return functions, join


def _selected(select: Callable | None, structure: Any) -> Flags:
    """Flags of the results that `select` gives, none if it is None."""
    flags = [False] * structure.num_leaves
    if select is None:
        return tuple(flags)
    tree = jax.tree.unflatten(structure, flags)
    return tuple(jax.tree.leaves(eqx.tree_at(select, tree, replace_fn=lambda _: True)))


# Rules of the primitives


def _parts(row: Any, sizes: tuple[int, ...]) -> list[list]:
    ends = [sum(sizes[: k + 1]) for k in range(len(sizes))]
    return [list(row[end - size : end]) for size, end in zip(sizes, ends, strict=True)]


def _evaluate(primitive: Primitive, *row: Any, derivation: Derivation, sizes: tuple[int, ...]) -> Arrays:
    parts, functions = _parts(row, sizes), derivation.functions
    if primitive is values:
        return list(chain(*values_of(functions, derivation.layers)(*parts)))
    wanted = derivation.wanted
    if functions.watch is None:
        return list(tangents_of(derivation)(*parts))
    all_ = tuple(a or b for a, b in zip(wanted, functions.always, strict=True))
    found = iter(tangents_of(derivation._replace(wanted=all_))(*parts))
    watched = functions.watch([next(found) if yes else None for yes in all_], True)
    return [a for a, yes in zip(watched, wanted, strict=True) if yes]


def _shapes(primitive: Primitive, *row: Any, derivation: Derivation, sizes: tuple[int, ...]) -> list:
    parts = _parts([jax.ShapeDtypeStruct(a.shape, a.dtype) for a in row], sizes)
    of_values = values_of(derivation.functions, _of_lanes(derivation.layers))
    y, rest = _shapes_of(of_values, *parts[:2])
    if primitive is tangents:
        y = [a for a, yes in zip(y, derivation.wanted, strict=True) if yes]
        return [ShapedArray(_with_tangents(a.shape, derivation.layers), a.dtype) for a in y]
    return [ShapedArray(a.shape, a.dtype) for a in chain(y, rest)]


def _shapes_of(function: Callable, *parts: Arrays) -> Any:
    return function.shapes(*parts) if isinstance(function, Traced) else jax.eval_shape(function, *parts)


def _of_lanes(layers: tuple[BatchAxis, ...]) -> tuple[BatchAxis, ...]:
    return tuple(layer for layer in layers if not layer.is_of_tangents)


def _with_tangents(shape: tuple[int, ...], layers: tuple[BatchAxis, ...]) -> tuple[int, ...]:
    """Shape with the axes of layers that only tangents have."""
    own = list(shape)
    for k, layer in enumerate(reversed(layers)):
        if layer.is_of_tangents:
            own.insert(k, layer.size)
    return tuple(own)


def _differentiate(
    primitive: Primitive, row: Any, changes: Any, *, derivation: Derivation, sizes: tuple[int, ...]
):
    """Results of a primitive, and their tangents."""
    fixed, *moving = _parts(row, sizes)
    x, dx = list(chain(*moving)), changes[len(fixed) :]
    found = primitive.bind(*row, derivation=derivation, sizes=sizes)
    own = derivation if primitive is values else _of_tangents(derivation, sizes)
    num = len(own.functions.always)
    moves = tuple(type(t) is not ad.Zero for t in dx)
    own = own._replace(moves=moves, wanted=(True,) * num)
    dx = members(own.layers, moves, [t for t, move in zip(dx, moves, strict=True) if move])
    slopes = tangents.bind(*fixed, *x, *dx, derivation=own, sizes=(len(fixed), len(x), len(dx)))
    nothing = [ad.Zero(jax.typeof(a).to_tangent_aval()) for a in found[num:]]
    return found, [*slopes, *nothing]


@lru_cache(CACHE_SIZE)
def _of_tangents(derivation: Derivation, sizes: tuple[int, ...]) -> Derivation:
    """The derivative as a function of `fixed` and of `x` and `dx` in one list."""
    functions, layers, moves, wanted = derivation
    num_dx = sizes[2]

    def smooth(flags: Flags) -> Callable:
        some = iter(flags)
        push = push_of(Derivation(functions, (), moves, tuple(yes and next(some) for yes in wanted)))
        return lambda fixed, both: push(fixed, *_parts(both, sizes[1:]))

    own = Functions(
        values=lambda fixed, both: (smooth((True,) * sum(wanted))(fixed, both), []),
        smooth=smooth,
        many=None,
        smooth_many=None,
        always=(False,) * sum(wanted),
        watch=None,
        has_reverse=functions.has_reverse,
        compiled=functions.compiled,
        compiled_many=functions.compiled_many,
    )
    layers = tuple(layer._replace(axes=(layer.axes[0], (*layer.axes[1], *[0] * num_dx))) for layer in layers)
    return Derivation(own, layers)


def _batch(primitive: Primitive, row: Any, axes: Any, *, derivation: Derivation, sizes: tuple[int, ...]):
    size = next(a.shape[axis] for a, axis in zip(row, axes, strict=True) if axis is not None)
    (fixed, x, *dx), (of_fixed, of_x, *of_dx) = _parts(row, sizes), _parts(axes, sizes)
    layer = BatchAxis((tuple(of_fixed), tuple(of_x)), size)
    dx = [lanes_first(a, axis, size) for a, axis in zip(*dx, *of_dx, strict=True)] if dx else []
    derivation = derivation._replace(layers=(*derivation.layers, layer))
    found = primitive.bind(*fixed, *x, *dx, derivation=derivation, sizes=sizes)
    return found, [0] * len(found)


def _transpose(cotangents: Any, *row: Any, derivation: Derivation, sizes: tuple[int, ...]) -> list:
    fixed, x, dx = _parts(row, sizes)
    given = [type(c) is not ad.Zero for c in cotangents]
    if not any(given):
        return [None] * (sizes[0] + sizes[1]) + [ad.Zero(a.aval) for a in dx]
    some = iter(given)
    own = derivation._replace(wanted=tuple(yes and next(some) for yes in derivation.wanted))
    rank = len(derivation.layers)
    shapes = tuple(a.aval.shape[rank:] for a in dx)
    found = pullback_of(own, shapes)(fixed, x, [c for c, yes in zip(cotangents, given, strict=True) if yes])
    watch = derivation.functions.watch
    return [None] * (sizes[0] + sizes[1]) + (found if watch is None else watch(found, False))


def _without_unused(used: list[bool], *rest: Any) -> tuple[list[bool], Any]:
    """Compute only the tangents that are used. Since JAX 0.12 a rule gets flags of live inputs before the equation."""
    equation = rest[-1]
    if not any(used):
        return [False] * len(equation.invars), None
    derivation, some = equation.params["derivation"], iter(used)
    wanted = tuple(yes and next(some) for yes in derivation.wanted)
    outvars = [var for var, yes in zip(equation.outvars, used, strict=True) if yes]
    params = equation.params | {"derivation": derivation._replace(wanted=wanted)}
    return [True] * len(equation.invars), equation.replace(outvars=outvars, params=params)


for _primitive in (values, tangents):
    _primitive.multiple_results = True
    _primitive.def_impl(partial(_evaluate, _primitive))
    _primitive.def_abstract_eval(partial(_shapes, _primitive))
    mlir.register_lowering(_primitive, mlir.lower_fun(partial(_evaluate, _primitive), multiple_results=True))
    ad.primitive_jvps[_primitive] = partial(_differentiate, _primitive)
    batching.primitive_batchers[_primitive] = partial(_batch, _primitive)
ad.primitive_transposes[tangents] = _transpose
partial_eval.dce_rules[tangents] = _without_unused
