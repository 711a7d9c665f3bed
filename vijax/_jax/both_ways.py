"""A function computed one way and differentiated two ways.

A loop without a bound on its steps can be differentiated forwards but not backwards. A bounded loop can be
differentiated both ways, but is cut at the bound. Neither JAX nor equinox has a loop that is unbounded forwards and
also goes backwards, and a differentiation rule (`jax.custom_jvp`) does not receive the direction. The tangents show
the direction: backwards they are unknown at first and transposed later ("known" and "unknown" as in JAX's partial
evaluation). One function therefore has three primitives:

- `values`, its results;
- `with_tangents`, the derivative of `values`: values and tangents together, by the unbounded loop;
- `tangents`, the remainder of `with_tangents` where values are known and tangents are not (`jax.grad`). It is linear.
  Its transpose uses the bounded loop; for few numbers it is a product with the forward derivative along each.

Derivatives of derivatives follow: `with_tangents` and `tangents` are functions too, and the derivative of each is
`with_tangents` of it. `jax.custom_derivatives.linear_call` was tried, but does not support `vmap`.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import chain
from typing import Any

import equinox as eqx
import jax
from jax.core import ShapedArray
from jax.extend.core import Primitive, Var
from jax.interpreters import ad, batching, mlir, partial_eval
from jaxtyping import PyTree

from .ways import (
    CACHE_SIZE,
    Arrays,
    TangentMaps,
    Traced,
    batch_axis_first,
    batch_axis_last,
    bind,
    kind,
    of_batch,
    of_batch_of_tangents,
    of_lanes,
    shapes_of,
    tangent_maps_along,
    tangent_maps_of,
    tangents,
    values,
    with_tangents,
)


def both_ways(
    forwards: Callable,
    backwards: Callable,
    tree: PyTree,
    compiled: Callable = jax.jit,
    of_many: Callable | None = None,
    watch: Callable | None = None,
) -> PyTree:
    """Return `forwards(tree)`, whose reverse-mode derivative is that of `backwards`.

    Traces and compilations are cached by the functions, the non-array leaves, and the shapes of the arrays.

    Args:
        forwards: function of `tree` that returns a tree of arrays.
        backwards: the same function, written so that JAX can transpose its derivative.
        tree: floating-point arrays, which are the variables of the derivative, and any other leaves.
        compiled: compiles a function that is not part of a larger program.
        of_many: if given, `forwards` of a batch. It takes a tree whose arrays have the batch axis last, of length one
            where all members share the array, and the size of the batch. Its results have the batch axis first.
        watch: if given, takes first derivatives and returns them. They are those of the results in their tree, or a
            list of those with respect to the arguments.
    """
    arrays, others = eqx.partition(tree, lambda a: isinstance(a, jax.Array))
    moving, fixed = eqx.partition(arrays, eqx.is_inexact_array)
    parts = [jax.tree.flatten(part) for part in (fixed, moving, others)]
    (fixed, _), (x, _), (others, _) = parts
    kinds = [tuple(map(kind, part)) for part in (fixed, x)]
    structures = tuple(structure for _, structure in parts)
    ways, join = _build_tangent_maps(
        forwards, backwards, of_many, watch, compiled, structures, tuple(others), *kinds
    )
    y, rest = _parts(bind(values, ways, fixed, x), ways.sizes)
    return join(y, rest)


@lru_cache(CACHE_SIZE)
def _build_tangent_maps(
    forwards: Callable,
    backwards: Callable,
    of_many: Callable | None,
    watch: Callable | None,
    compiled: Callable,
    structures: tuple,
    others: tuple,
    *kinds: tuple,
) -> tuple[TangentMaps, Callable[[Arrays, Arrays], PyTree]]:
    """`TangentMaps` of lists of arrays, and a function that rebuilds the tree of results from lists."""
    found = []

    def of_lists(function: Callable, fixed: Arrays, x: Arrays) -> tuple[Arrays, Arrays]:
        tree = eqx.combine(*map(jax.tree.unflatten, structures, (fixed, x, others)))
        arrays, rest = eqx.partition(function(tree), eqx.is_array)
        parts = *eqx.partition(arrays, eqx.is_inexact_array), rest
        (y, of_y), (whole, of_whole), (rest, of_rest) = map(jax.tree.flatten, parts)
        found[:] = (of_y, of_whole, of_rest), rest
        return y, whole

    def join(y: Arrays, whole: Arrays) -> PyTree:
        structures, rest = found
        return eqx.combine(*map(jax.tree.unflatten, structures, (y, whole, rest)))

    both = [Traced(partial(of_lists, function), compiled) for function in (forwards, backwards)]
    shapes = [[jax.ShapeDtypeStruct(*kind) for kind in part] for part in kinds]
    y, whole = shapes_of(both[0], *shapes)
    ways = tangent_maps_of(*both, compiled, (len(y), len(whole)), ())
    if of_many is not None:

        def of_lists_of_many(over: tuple, size: int, *parts: Arrays) -> tuple[Arrays, Arrays]:
            return of_lists(lambda tree: of_many(tree, size), *map(batch_axis_last, parts, over))

        ways = ways._replace(
            of_many=lambda over, size: Traced(partial(of_lists_of_many, over, size), compiled)
        )
    if watch is not None:

        def watched(derivatives: Arrays, of_results: bool) -> Arrays:
            structure = found[0][0] if of_results else jax.tree.structure(derivatives)
            return jax.tree.leaves(watch(jax.tree.unflatten(structure, derivatives)))

        ways = ways._replace(watch=watched)
    return ways, join


def _parts(row: Any, sizes: tuple[int, ...]) -> list[list]:
    ends = [sum(sizes[: k + 1]) for k in range(len(sizes))]
    return [list(row[end - size : end]) for size, end in zip(sizes, ends, strict=True)]


def _evaluate(primitive: Primitive, *row: Any, ways: TangentMaps, sizes: tuple[int, ...]) -> Arrays:
    parts = _parts(row, sizes)
    if primitive is values:
        return list(chain(*ways.values(*parts)))
    y, rest, dy = ways.joint(*parts)
    dy = ways.watch(dy, True)
    return [*y, *rest, *dy] if primitive is with_tangents else list(dy)


def _shapes(primitive: Primitive, *row: Any, ways: TangentMaps, sizes: tuple[int, ...]) -> list:
    parts = _parts([jax.ShapeDtypeStruct(a.shape, a.dtype) for a in row], sizes)
    if primitive is values:
        found = shapes_of(ways.values, *parts)
    else:
        y, rest, dy = jax.eval_shape(ways.hollow, *parts)
        found = (y, rest, dy) if primitive is with_tangents else (dy,)
    return [ShapedArray(a.shape, a.dtype) for a in chain(*found)]


def _differentiate(
    primitive: Primitive, row: Any, changes: Any, *, ways: TangentMaps, sizes: tuple[int, ...]
):
    """Values of a primitive and their tangents, as functions of all inputs that can change."""
    fixed, *moving = _parts(row, sizes)
    at, dx = list(chain(*moving)), changes[len(fixed) :]
    if primitive is not values:
        ways = _of_derivative(primitive, ways, sizes)
    moves = tuple(type(t) is not ad.Zero for t in dx)
    dx = of_lanes(ways, moves, [t for t, move in zip(dx, moves, strict=True) if move])
    ways = tangent_maps_along(ways, moves)
    found = bind(with_tangents, ways, fixed, at, dx)
    y, rest, dy = _parts(found, (*ways.sizes, ways.sizes[0]))
    nothing = [ad.Zero(jax.typeof(a).to_tangent_aval()) for a in rest]
    if primitive is not with_tangents:
        return [*y, *rest], [*dy, *nothing]
    # Tangents of the first derivative are values of the second. Restore their order.
    half = len(y) // 2
    return [*y[:half], *rest, *y[half:]], [*dy[:half], *nothing, *dy[half:]]


@lru_cache(CACHE_SIZE)
def _of_derivative(primitive: Primitive, ways: TangentMaps, sizes: tuple[int, ...]) -> TangentMaps:
    """`TangentMaps` of a primitive with tangents, as functions of `fixed` and of `x` and `dx` in one list."""

    def of_all(joint: Callable, fixed: Arrays, both: Arrays) -> tuple[Arrays, Arrays]:
        y, rest, dy = joint(fixed, *_parts(both, sizes[1:]))
        return ([*y, *dy], rest) if primitive is with_tangents else (dy, [])

    forwards, backwards = partial(of_all, ways.joint), partial(of_all, ways.transposable)
    num, rest = ways.sizes
    sizes_found = (2 * num, rest) if primitive is with_tangents else (num, 0)
    return tangent_maps_of(forwards, backwards, ways.compiled, sizes_found, ())


def _batch(primitive: Primitive, row: Any, axes: Any, *, ways: TangentMaps, sizes: tuple[int, ...]):
    size = next(a.shape[axis] for a, axis in zip(row, axes, strict=True) if axis is not None)
    (fixed, x, *dx), (of_fixed, of_x, *of_dx) = _parts(row, sizes), _parts(axes, sizes)
    over = tuple(of_fixed), tuple(of_x)
    if primitive is values:
        ways = of_batch(ways, over, size)
        found = bind(values, ways, fixed, x)
        return found, [0] * len(found)
    # Tangents get the batch axis because their cotangents have it.
    dx = batch_axis_first(dx[0], of_dx[0], size)
    ways, of_values = of_batch_of_tangents(ways, over, size)
    found = bind(primitive, ways, fixed, x, dx)
    num_tangents = ways.sizes[0]
    return found, [of_values] * (len(found) - num_tangents) + [0] * num_tangents


def _transpose(cotangents: Any, *row: Any, ways: TangentMaps, sizes: tuple[int, ...]) -> list:
    fixed, x, _ = _parts(row, sizes)
    given = tuple(type(c) is not ad.Zero for c in cotangents)
    found = ways.pullback(given)(fixed, x, [c for c, yes in zip(cotangents, given, strict=True) if yes])
    return [None] * (sizes[0] + sizes[1]) + ways.watch(list(found), False)


def _split_while_tracing(trace: Any, *row: Any, ways: TangentMaps, sizes: tuple[int, ...]) -> list:
    """Compute values now where all their inputs are known; leave the tangents to a later equation."""
    wait = partial(trace.default_process_primitive, tracers=row, params={"ways": ways, "sizes": sizes})
    is_known = [t.pval.is_known() for t in row]
    if not all(is_known[: sizes[0] + sizes[1]]) or all(is_known):
        return wait(with_tangents)
    fixed, x, _ = _parts([t.pval.get_known() for t in row], sizes)
    return [*map(trace.new_const, bind(values, ways, fixed, x)), *wait(tangents)]


def _split_in_checkpoint(saveable: Any, is_unknown: Any, is_there: Any, equation: Any) -> tuple:
    """Apply the same rule to an equation of a function under `jax.checkpoint`."""
    del saveable
    sizes, ways = equation.params["sizes"], equation.params["ways"]
    num_known, num_values = sizes[0] + sizes[1], sum(ways.sizes)
    pairs = zip(equation.invars, is_there, strict=True)
    wanted = [a for a, there in pairs if isinstance(a, Var) and not there]
    if any(is_unknown[:num_known]):
        all_ = [True] * len(equation.outvars)
        return None, equation, all_, all_, wanted
    known = equation.replace(
        primitive=values,
        invars=equation.invars[:num_known],
        outvars=equation.outvars[:num_values],
        params=equation.params | {"sizes": sizes[:2]},
    )
    waiting = equation.replace(primitive=tangents, outvars=equation.outvars[num_values:])
    unknown = [False] * num_values + [True] * ways.sizes[0]
    return known, waiting, unknown, unknown, wanted


for _primitive in (values, with_tangents, tangents):
    _primitive.multiple_results = True
    _primitive.def_impl(partial(_evaluate, _primitive))
    _primitive.def_abstract_eval(partial(_shapes, _primitive))
    mlir.register_lowering(_primitive, mlir.lower_fun(partial(_evaluate, _primitive), multiple_results=True))
    ad.primitive_jvps[_primitive] = partial(_differentiate, _primitive)
    batching.primitive_batchers[_primitive] = partial(_batch, _primitive)
ad.primitive_transposes[tangents] = _transpose
partial_eval.custom_partial_eval_rules[with_tangents] = _split_while_tracing
partial_eval.partial_eval_jaxpr_custom_rules[with_tangents] = _split_in_checkpoint
