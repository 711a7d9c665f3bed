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
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir, partial_eval
from jaxtyping import Array, PyTree

from .arrays import add_up
from .traced import CACHE_SIZE, Traced, kind

Arrays = list[Any]  # JAX arrays, or their stand-ins while a function is traced
Flags = tuple[bool, ...]

values, tangents = map(Primitive, ("values", "tangents"))


class Layer(NamedTuple):
    """One axis of a batch.

    Attributes:
        axes: axes of `fixed` and of `x`, None where all members share an array. Tangents have it first.
        size: number of members.
    """

    axes: tuple[tuple[int | None, ...], tuple[int | None, ...]]
    size: int

    @property
    def is_of_tangents(self) -> bool:
        """True where only tangents differ."""
        return all(axis is None for part in self.axes for axis in part)


class Functions(NamedTuple):
    """A function of lists of arrays, `fixed` and `x`, and what its derivatives need.

    Attributes:
        values: gives the results that have derivatives, and the others.
        smooth: takes flags of the former; returns a function with the same results, of those flagged, which is differentiable forwards.
        many: `values` of a batch as a function of a layer; None if `jax.vmap` serves.
        smooth_many: `smooth` of a batch, a function of a layer and of flags, likewise.
        always: flags of the results whose derivatives are always computed, for `watch`.
        watch: takes and returns derivatives of all results, None where not computed, or derivatives by the arguments.
        compiled: compiles a function that is not part of a larger program.
    """

    values: Callable[[Arrays, Arrays], tuple[Arrays, Arrays]]
    smooth: Callable[[Flags], Callable[[Arrays, Arrays], Arrays]]
    many: Callable | None
    smooth_many: Callable | None
    always: Flags
    watch: Callable[[Arrays, bool], Arrays] | None
    compiled: Callable


class Derivation(NamedTuple):
    """A function, the axes of a batch from the inside out, and which of its inputs move and results are wanted."""

    functions: Functions
    layers: tuple[Layer, ...] = ()
    moves: Flags = ()
    wanted: Flags = ()


def with_derivatives(
    function: Callable,
    tree: PyTree,
    *,
    smooth: Callable | None = None,
    many: Callable | None = None,
    smooth_many: Callable | None = None,
    watch: Callable | None = None,
    always: Callable | None = None,
    compiled: Callable = jax.jit,
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
        compiled: compiles a function that is not part of a larger program.
    """
    arrays, others = eqx.partition(tree, lambda a: isinstance(a, jax.Array))
    moving, fixed = eqx.partition(arrays, eqx.is_inexact_array)
    (fixed, of_fixed), (x, of_x), (others, of_others) = map(jax.tree.flatten, (fixed, moving, others))
    functions, join = _functions(
        (function, smooth, many, smooth_many, watch, always, compiled),
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
    function, smooth, many, smooth_many, watch, always, compiled = given
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

    def of_many(layer: Layer, fixed: Arrays, x: Arrays) -> tuple[Arrays, Arrays]:
        return of_lists(lambda tree: many(tree, layer.size), *map(_axis_last, (fixed, x), layer.axes))

    def smooth_of_many(layer: Layer, wanted: Flags, fixed: Arrays, x: Arrays) -> Arrays:
        own = lambda tree, flags: smooth_many(tree, flags, layer.size)  # noqa: E731
        return flagged(wanted, own, *map(_axis_last, (fixed, x), layer.axes))

    def watched(derivatives: Arrays, of_results: bool) -> Arrays:
        if not of_results:
            return list(watch(derivatives))
        structure = found[0][0]
        return structure.flatten_up_to(watch(jax.tree.unflatten(structure, derivatives)))

    own = Traced(partial(of_lists, function), compiled)
    y, _ = own.shapes(*[[jax.ShapeDtypeStruct(*kind) for kind in part] for part in kinds])
    needed = (False,) * len(y)
    if always is not None:
        tree = jax.tree.unflatten(found[0][0], needed)
        needed = tuple(jax.tree.leaves(eqx.tree_at(always, tree, replace_fn=lambda _: True)))
    if smooth is None:
        smooth_of = lambda wanted: partial(flagged, wanted, lambda tree, _: function(tree))  # noqa: E731
    else:
        smooth_of = lambda wanted: partial(flagged, wanted, smooth)  # noqa: E731
    functions = Functions(
        values=own,
        smooth=smooth_of,
        many=None if many is None else lambda layer: partial(of_many, layer),
        smooth_many=None
        if smooth_many is None
        else lambda layer, wanted: partial(smooth_of_many, layer, wanted),
        always=needed,
        watch=None if watch is None else watched,
        compiled=compiled,
    )
    return functions, join


# Values


@lru_cache(CACHE_SIZE)
def _values_of(functions: Functions, layers: tuple[Layer, ...]) -> Callable:
    """`Functions.values` of a batch."""
    if not layers:
        return functions.values
    *inner, layer = layers
    inside = _values_of(functions, tuple(inner))
    if functions.many is None or not layer.size:
        of_all = jax.vmap(inside, tuple(map(list, layer.axes)))
    elif not inner:
        of_all = functions.many(layer)
    else:
        of_all = partial(_in_turn, inside, layer)
    return Traced(of_all, functions.compiled)


def _in_turn(function: Callable, layer: Layer, fixed: Arrays, x: Arrays, *rest: Arrays) -> Any:
    """Call a function for one member of the batch after another; `rest` has the batch axis first."""
    pairs = list(zip([*fixed, *x], chain(*layer.axes), strict=True))
    own = [None if axis is None else jnp.moveaxis(a, axis, 0) for a, axis in pairs]

    def of_one(own: tuple) -> Any:
        own, rest = own
        row = [a if axis is None else one for (a, axis), one in zip(pairs, own, strict=True)]
        return function(row[: len(fixed)], row[len(fixed) :], *rest)

    return jax.lax.map(of_one, (own, rest))


# Tangents


@lru_cache(CACHE_SIZE)
def _tangents_of(derivation: Derivation) -> Callable:
    """Function of (fixed, x, dx) that returns the tangents of the wanted results."""
    return Traced(_push(derivation), derivation.functions.compiled)


def _push(derivation: Derivation) -> Callable:
    functions, layers, moves, wanted = derivation
    if not layers:
        return partial(_along, functions.smooth(wanted), moves)
    *inner, layer = layers
    if layer.is_of_tangents:
        return jax.vmap(_push(derivation._replace(layers=tuple(inner))), (None, None, 0))
    if functions.smooth_many is not None and layer.size and all(one.is_of_tangents for one in inner):
        # Lanes inside, all tangents of a lane outside: what belongs to the lane alone is computed once.
        push = partial(_along_lanes, functions.smooth_many, wanted, moves, layer)
        for _ in inner:
            push = jax.vmap(push, (None, None, 0))
        return partial(_with_axis_inside, push, len(inner))
    inside = _push(derivation._replace(layers=tuple(inner)))
    if functions.smooth_many is not None and layer.size:
        return partial(_in_turn, inside, layer)
    return jax.vmap(inside, (*map(list, layer.axes), 0))


def _along(smooth: Callable, moves: Flags, fixed: Arrays, x: Arrays, dx: Arrays) -> Arrays:
    """Derivative of `smooth` along tangents of the arrays that move; the others cost nothing."""

    def of_moving(moving: Arrays) -> Arrays:
        moving = list(moving)
        return smooth(fixed, [moving.pop(0) if move else a for a, move in zip(x, moves, strict=True)])

    moving = [a for a, move in zip(x, moves, strict=True) if move]
    return jax.jvp(of_moving, (moving,), (dx,))[1]


def _along_lanes(
    smooth_of: Callable, wanted: Flags, moves: Flags, layer: Layer, fixed: Arrays, x: Arrays, dx: Arrays
) -> Arrays:
    """`_along` of a batch, whose lanes have tangents of their own of what they share."""
    of_fixed, of_x = layer.axes
    pairs = list(zip(x, of_x, moves, strict=True))
    x = [_lanes_first(a, axis, layer.size) if move else a for a, axis, move in pairs]
    own = layer._replace(axes=(of_fixed, tuple(0 if move else axis for _, axis, move in pairs)))
    return _along(smooth_of(own, wanted), moves, fixed, x, dx)


def _lanes_first(a: Any, axis: int | None, size: int) -> Array:
    """Array with the batch axis first, repeated where all members share it."""
    return jnp.broadcast_to(a, (size, *jnp.shape(a))) if axis is None else jnp.moveaxis(a, axis, 0)


def _axis_last(arrays: Arrays, axes: tuple[int | None, ...]) -> Arrays:
    """Arrays with the batch axis last, of length one where all members share the array."""
    return [
        a[..., None] if axis is None else jnp.moveaxis(a, axis, -1)
        for a, axis in zip(arrays, axes, strict=True)
    ]


def _with_axis_inside(push: Callable, place: int, fixed: Arrays, x: Arrays, dx: Arrays) -> Arrays:
    """Call a function whose tangents have their first axis at another place."""
    found = push(fixed, x, [jnp.moveaxis(a, 0, place) for a in dx])
    return [jnp.moveaxis(a, place, 0) for a in found]


def _members(layers: tuple[Layer, ...], moves: Flags, dx: Arrays) -> Arrays:
    """Tangents of the entries of `x` that move, with the axes of a batch first."""
    if not layers:
        return dx
    *inner, layer = layers
    axes = [axis for axis, move in zip(layer.axes[1], moves, strict=True) if move]
    dx = [_lanes_first(a, axis, layer.size) for a, axis in zip(dx, axes, strict=True)]
    return jax.vmap(partial(_members, tuple(inner), moves))(dx) if inner else dx


# Transpose


@lru_cache(CACHE_SIZE)
def _pullback_of(derivation: Derivation, shapes: tuple[tuple[int, ...], ...]) -> Callable:
    """Function of (fixed, x, cotangents) that returns those of the tangents, each of a shape, without a batch."""
    return Traced(partial(_pull, derivation, shapes), derivation.functions.compiled)


def _pull(
    derivation: Derivation, shapes: tuple[tuple[int, ...], ...], fixed: Arrays, x: Arrays, cotangents: Arrays
) -> Arrays:
    """Product with the derivatives along every single number, of all members of a batch at once."""
    batch = tuple(layer.size for layer in reversed(derivation.layers))
    dtypes = [a.dtype for a, move in zip(x, derivation.moves, strict=True) if move]
    # Derivatives do not depend on tangents: one evaluation serves the layers that differ in these alone.
    inner = [layer for layer in derivation.layers if not layer.is_of_tangents]
    of_lanes = tuple(layer.size for layer in reversed(inner))
    own = derivation._replace(layers=tuple(inner), functions=derivation.functions._replace(watch=None))
    # By the primitive, so that a batch of this product is one of its lanes.
    push = partial(tangents.bind, derivation=own, sizes=(len(fixed), len(x), len(shapes)))
    axes = [k for k, layer in enumerate(reversed(derivation.layers)) if layer.is_of_tangents]
    rank = len(of_lanes)

    def along(unit: Arrays) -> Array:
        full = [jnp.broadcast_to(a.reshape(*[1] * rank, *a.shape), (*of_lanes, *a.shape)) for a in unit]
        found = push(*fixed, *x, *full)
        total = [_weighed(c, jnp.expand_dims(d, axes), len(batch)) for c, d in zip(cotangents, found, strict=True)]
        return add_up(total) if total else jnp.zeros(batch)

    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    units = np.split(np.eye(ends[-1]), ends[:-1], axis=1)
    pairs = zip(units, shapes, dtypes, strict=True)
    found = jax.vmap(along, out_axes=-1)([jnp.asarray(u.reshape(-1, *shape), dtype) for u, shape, dtype in pairs])
    parts = jnp.split(found, ends[:-1], axis=-1)
    return [a.reshape(*batch, *shape).astype(d) for a, shape, d in zip(parts, shapes, dtypes, strict=True)]


def _weighed(cotangent: Array, tangent: Array, rank: int) -> Array:
    """Sum over all but the axes of a batch. A zero cotangent gives zero, even where the tangent is infinite."""
    return jnp.sum(jnp.where(cotangent != 0, cotangent * tangent, 0), axis=tuple(range(rank, cotangent.ndim)))


# Rules of the primitives


def _parts(row: Any, sizes: tuple[int, ...]) -> list[list]:
    ends = [sum(sizes[: k + 1]) for k in range(len(sizes))]
    return [list(row[end - size : end]) for size, end in zip(sizes, ends, strict=True)]


def _evaluate(primitive: Primitive, *row: Any, derivation: Derivation, sizes: tuple[int, ...]) -> Arrays:
    parts, functions = _parts(row, sizes), derivation.functions
    if primitive is values:
        return list(chain(*_values_of(functions, derivation.layers)(*parts)))
    wanted = derivation.wanted
    if functions.watch is None:
        return list(_tangents_of(derivation)(*parts))
    all_ = tuple(a or b for a, b in zip(wanted, functions.always, strict=True))
    found = iter(_tangents_of(derivation._replace(wanted=all_))(*parts))
    watched = functions.watch([next(found) if yes else None for yes in all_], True)
    return [a for a, yes in zip(watched, wanted, strict=True) if yes]


def _shapes(primitive: Primitive, *row: Any, derivation: Derivation, sizes: tuple[int, ...]) -> list:
    parts = _parts([jax.ShapeDtypeStruct(a.shape, a.dtype) for a in row], sizes)
    of_values = _values_of(derivation.functions, _of_lanes(derivation.layers))
    y, rest = _shapes_of(of_values, *parts[:2])
    if primitive is tangents:
        y = [a for a, yes in zip(y, derivation.wanted, strict=True) if yes]
        return [ShapedArray(_with_tangents(a.shape, derivation.layers), a.dtype) for a in y]
    return [ShapedArray(a.shape, a.dtype) for a in chain(y, rest)]


def _shapes_of(function: Callable, *parts: Arrays) -> Any:
    return function.shapes(*parts) if isinstance(function, Traced) else jax.eval_shape(function, *parts)


def _of_lanes(layers: tuple[Layer, ...]) -> tuple[Layer, ...]:
    return tuple(layer for layer in layers if not layer.is_of_tangents)


def _with_tangents(shape: tuple[int, ...], layers: tuple[Layer, ...]) -> tuple[int, ...]:
    """Shape with the axes of layers that only tangents have."""
    own = list(shape)
    for k, layer in enumerate(reversed(layers)):
        if layer.is_of_tangents:
            own.insert(k, layer.size)
    return tuple(own)


def _differentiate(primitive: Primitive, row: Any, changes: Any, *, derivation: Derivation, sizes: tuple[int, ...]):
    """Results of a primitive, and their tangents."""
    fixed, *moving = _parts(row, sizes)
    x, dx = list(chain(*moving)), changes[len(fixed) :]
    found = primitive.bind(*row, derivation=derivation, sizes=sizes)
    own = derivation if primitive is values else _of_tangents(derivation, sizes)
    num = len(own.functions.always)
    moves = tuple(type(t) is not ad.Zero for t in dx)
    own = own._replace(moves=moves, wanted=(True,) * num)
    dx = _members(own.layers, moves, [t for t, move in zip(dx, moves, strict=True) if move])
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
        push = _push(Derivation(functions, (), moves, tuple(yes and next(some) for yes in wanted)))
        return lambda fixed, both: push(fixed, *_parts(both, sizes[1:]))

    own = Functions(
        values=lambda fixed, both: (smooth((True,) * sum(wanted))(fixed, both), []),
        smooth=smooth,
        many=None,
        smooth_many=None,
        always=(False,) * sum(wanted),
        watch=None,
        compiled=functions.compiled,
    )
    layers = tuple(
        layer._replace(axes=(layer.axes[0], (*layer.axes[1], *[0] * num_dx))) for layer in layers
    )
    return Derivation(own, layers)


def _batch(primitive: Primitive, row: Any, axes: Any, *, derivation: Derivation, sizes: tuple[int, ...]):
    size = next(a.shape[axis] for a, axis in zip(row, axes, strict=True) if axis is not None)
    (fixed, x, *dx), (of_fixed, of_x, *of_dx) = _parts(row, sizes), _parts(axes, sizes)
    layer = Layer((tuple(of_fixed), tuple(of_x)), size)
    dx = [_lanes_first(a, axis, size) for a, axis in zip(*dx, *of_dx, strict=True)] if dx else []
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
    found = _pullback_of(own, shapes)(fixed, x, [c for c, yes in zip(cotangents, given, strict=True) if yes])
    watch = derivation.functions.watch
    return [None] * (sizes[0] + sizes[1]) + (found if watch is None else watch(found, False))


def _without_unused(used: list[bool], equation: Any) -> tuple[list[bool], Any]:
    """Compute only the tangents that are used."""
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
