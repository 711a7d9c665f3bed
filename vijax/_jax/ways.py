"""Functions with their derivatives, each traced once: the parts of `both_ways.py`.

`jax.jit` traces anew under every other transformation, and the trace of a step of a trajectory takes half a second.
"""

from collections.abc import Callable
from functools import cache, lru_cache, partial
from itertools import chain
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive, jaxpr_as_fun
from jaxtyping import Array, PyTree

from .arrays import add_up
from .concrete import is_staged

Arrays = list[Any]  # JAX arrays, or their stand-ins while a function is traced
Function = Callable[[Arrays, Arrays], tuple[Arrays, Arrays]]
# Size of the caches of traces and compilations, in functions.
CACHE_SIZE = 256
# Most inputs for which reverse-mode derivatives are built from forward ones. Even for so many this is no slower (0.5
# times as long for 21, 1.2 for 36), and it needs no bounded loop, which takes up to twice as long to compile.
MAX_FORWARD_INPUTS = 32

values, with_tangents, tangents = map(Primitive, ("values", "values_with_tangents", "tangents"))


class TangentMaps(NamedTuple):
    """A function of `fixed` and `x` with its derivatives along `dx`.

    Attributes:
        values: function of (fixed, x), by the unbounded loop.
        backwards: the same by the bounded loop.
        joint: function of (fixed, x, dx) that returns values and tangents, by the unbounded loop.
        transposable: the same by the bounded loop.
        pullback: takes flags of the cotangents of `y` that are given; returns a function of (fixed, x, these
            cotangents) that gives the cotangents of `dx`. They are zero if all given ones are.
        hollow: zeros in the shapes of the results of `joint`, without a trace of the derivative.
        compiled: compiles the functions.
        sizes: number of results that have derivatives, and of other results.
        lanes: for a batch, the `TangentMaps` of one lane, the batch axes of `fixed` and `x`, and the number of lanes.
        of_many: if given, takes the batch axes of `fixed` and `x` and the batch size; returns `values` of the batch.
        watch: returns derivatives unchanged and reports what is wrong with them. Its flag `of_results` is true for
            derivatives of results, false for derivatives with respect to arguments.
    """

    values: Function
    backwards: Function
    joint: Callable
    transposable: Callable
    pullback: Callable
    hollow: Callable
    compiled: Callable
    sizes: tuple[int, int]
    lanes: tuple[Any, tuple, int] | None = None
    of_many: Callable[[tuple, int], Function] | None = None
    watch: Callable[[Arrays, bool], Arrays] = lambda derivatives, of_results: derivatives


@lru_cache(CACHE_SIZE)
def tangent_maps_of(
    forwards: Function,
    backwards: Function,
    compiled: Callable,
    sizes: tuple[int, int],
    moves: tuple[bool, ...],
) -> TangentMaps:
    """`TangentMaps` of a function given as `forwards` and `backwards`, along the entries of `x` flagged by `moves`."""
    joint, transposable = (
        Traced(partial(_derivative, function, moves), compiled) for function in (forwards, backwards)
    )

    @cache
    def pullback(given: tuple[bool, ...]) -> Callable:
        return Traced(partial(_pullback, ways, moves, given), compiled)

    hollow = partial(_hollow, forwards)
    ways = TangentMaps(forwards, backwards, joint, transposable, pullback, hollow, compiled, sizes)
    return ways


def _hollow(function: Function, fixed: Arrays, x: Arrays, dx: Arrays) -> tuple[Arrays, Arrays, Arrays]:
    del dx  # its batch axis is that of the tangents, which `jax.vmap` adds
    found = shapes_of(function, fixed, x)
    y, rest = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), found)
    return y, rest, y


def _derivative(
    function: Function, moves: tuple[bool, ...], fixed: Arrays, x: Arrays, dx: Arrays
) -> tuple[Arrays, Arrays, Arrays]:
    of_moving, moving = _restricted(function, moves, fixed, x)
    y, dy, rest = jax.jvp(of_moving, (moving,), (dx,), has_aux=True)
    return y, rest, dy


def _pullback(
    ways: TangentMaps,
    moves: tuple[bool, ...],
    given: tuple[bool, ...],
    fixed: Arrays,
    x: Arrays,
    cotangents: Arrays,
) -> Arrays:
    moving = [a for a, move in zip(x, moves, strict=True) if move]
    if sum(a.size for a in moving) <= MAX_FORWARD_INPUTS:
        return _product(ways, given, fixed, x, moving, cotangents)
    of_moving, moving = _restricted(ways.backwards, moves, fixed, x)

    def wanted(moving: Arrays) -> Arrays:
        return [a for a, yes in zip(of_moving(moving)[0], given, strict=True) if yes]

    pulled = jax.vjp(wanted, moving)[1](cotangents)[0]
    # Zero cotangents give zero derivatives, even where JAX computes 0 times infinity: a lane left out of a sum spoils
    # no derivative with respect to numbers that the lanes share. NaN cotangents give NaN.
    weights = jnp.concatenate([jnp.ravel(c) for c in cotangents])
    factor = jnp.where(jnp.any(jnp.isnan(weights)), jnp.nan, 1)
    return [jnp.where(jnp.any(weights != 0), a * factor.astype(a.dtype), 0) for a in pulled]


def _product(
    ways: TangentMaps,
    given: tuple[bool, ...],
    fixed: Arrays,
    x: Arrays,
    moving: Arrays,
    cotangents: Arrays,
) -> Arrays:
    """Compute the pullback as a product with the tangents along every single number."""

    def pulled(dx: Arrays) -> Array:
        dy = bind(with_tangents, ways, fixed, x, dx)[sum(ways.sizes) :]
        pairs = zip(cotangents, [d for d, yes in zip(dy, given, strict=True) if yes], strict=True)
        # A zero cotangent gives zero, even where the tangent is infinite.
        return add_up([jnp.sum(jnp.where(c != 0, c * d, 0)) for c, d in pairs])

    ends = np.cumsum([a.size for a in moving])
    units = np.split(np.eye(ends[-1]), ends[:-1], axis=1)
    pairs = list(zip(units, moving, strict=True))
    found = jax.vmap(pulled)([jnp.asarray(u.reshape(-1, *a.shape), a.dtype) for u, a in pairs])
    parts = jnp.split(found, ends[:-1])
    return [part.reshape(a.shape).astype(a.dtype) for part, a in zip(parts, moving, strict=True)]


def bind(primitive: Primitive, ways: TangentMaps, *parts: Arrays) -> Arrays:
    """Bind a primitive to lists of arrays and return its results."""
    return primitive.bind(*chain(*parts), ways=ways, sizes=tuple(map(len, parts)))


def _restricted(
    function: Function, moves: tuple[bool, ...], fixed: Arrays, x: Arrays
) -> tuple[Callable, Arrays]:
    """The function of its moving arguments alone, so that the others cost nothing, and these arguments."""

    def of_moving(moving: Arrays) -> tuple[Arrays, Arrays]:
        moving = list(moving)
        return function(fixed, [moving.pop(0) if move else a for a, move in zip(x, moves, strict=True)])

    return of_moving, [a for a, move in zip(x, moves, strict=True) if move]


@lru_cache(CACHE_SIZE)
def of_batch(ways: TangentMaps, over: tuple, size: int) -> TangentMaps:
    """`TangentMaps` of a batch with the given axes of `fixed` and `x`; for its derivatives see `tangent_maps_along`."""
    own = ways.of_many if size else None
    values = _batched(ways.values, ways, over) if own is None else own(over, size)
    found = tangent_maps_of(values, _batched(ways.backwards, ways, over), ways.compiled, ways.sizes, ())
    of_many = None if own is None else partial(_in_turn, values, ways.compiled)
    return found._replace(lanes=(ways, over, size), of_many=of_many, watch=ways.watch)


def _in_turn(values: Function, compiled: Callable, over: tuple, size: int) -> Function:
    """Values of a batch of batches, one batch after another."""
    axes = list(chain(*over))

    def of_all(fixed: Arrays, x: Arrays) -> tuple[Arrays, Arrays]:
        pairs = list(zip([*fixed, *x], axes, strict=True))
        own = [None if axis is None else jnp.moveaxis(a, axis, 0) for a, axis in pairs]

        def of_one(own: Arrays) -> tuple[Arrays, Arrays]:
            row = [a if axis is None else one for (a, axis), one in zip(pairs, own, strict=True)]
            return values(row[: len(fixed)], row[len(fixed) :])

        return jax.lax.map(of_one, own)

    return Traced(of_all, compiled)


@lru_cache(CACHE_SIZE)
def of_batch_of_tangents(ways: TangentMaps, over: tuple, size: int) -> tuple[TangentMaps, int | None]:
    """`TangentMaps` of a batch of tangents, and the batch axis of their values: None if all lanes share them."""
    shared = all(axis is None for part in over for axis in part)
    axis, of_all = None if shared else 0, (*over, 0)
    ways = ways._replace(
        values=ways.values if shared else _batched(ways.values, ways, over),
        backwards=ways.backwards if shared else _batched(ways.backwards, ways, over),
        joint=_batched(ways.joint, ways, of_all, (axis, axis, 0)),
        transposable=_batched(ways.transposable, ways, of_all, (axis, axis, 0)),
        hollow=jax.vmap(ways.hollow, *_axes(of_all, (axis, axis, 0))),
        pullback=cache(lambda given, pullback=ways.pullback: _batched(pullback(given), ways, of_all)),
        lanes=ways.lanes if shared else (ways, over, size),
    )
    return ways, axis


def tangent_maps_along(ways: TangentMaps, moves: tuple[bool, ...]) -> TangentMaps:
    """`TangentMaps` along the entries of `x` that move. For a batch they take tangents as `of_lanes` returns them.

    The derivative of a batch is a batch of derivatives: every lane has its own copy of the numbers that lanes share.
    The cotangents of one lane therefore affect no other lane, see `_pullback`.
    """
    if ways.lanes is None:
        found = tangent_maps_of(ways.values, ways.backwards, ways.compiled, ways.sizes, moves)
        return found._replace(watch=ways.watch)
    one, over, size = ways.lanes
    return of_batch_of_tangents(tangent_maps_along(one, moves), over, size)[0]


def of_lanes(ways: TangentMaps, moves: tuple[bool, ...], dx: Arrays) -> Arrays:
    """Tangents of the entries of `x` that move, with the lanes of a batch first."""
    if ways.lanes is None:
        return dx
    one, (_, of_x), size = ways.lanes
    dx = batch_axis_first(dx, [axis for axis, move in zip(of_x, moves, strict=True) if move], size)
    return jax.vmap(partial(of_lanes, one, moves))(dx)


def batch_axis_first(arrays: Arrays, axes: list[int | None], size: int) -> Arrays:
    """Arrays with the batch axis first; those that all lanes share are repeated."""
    return [
        jnp.broadcast_to(a, (size, *jnp.shape(a))) if axis is None else jnp.moveaxis(a, axis, 0)
        for a, axis in zip(arrays, axes, strict=True)
    ]


def batch_axis_last(arrays: Arrays, axes: tuple[int | None, ...]) -> Arrays:
    """Arrays with the batch axis last, of length one where all lanes share the array."""
    return [
        a[..., None] if axis is None else jnp.moveaxis(a, axis, -1)
        for a, axis in zip(arrays, axes, strict=True)
    ]


def _batched(function: Callable, ways: TangentMaps, over: tuple, to: Any = 0) -> Callable:
    return Traced(jax.vmap(function, *_axes(over, to)), ways.compiled)


def _axes(over: tuple, to: Any) -> tuple[tuple, Any]:
    """Axes of lists of arrays, in the form that `jax.vmap` takes."""
    return tuple(list(part) if isinstance(part, tuple) else part for part in over), to


def kind(a: Any) -> tuple[tuple[int, ...], Any]:
    """Shape and dtype of an array or its stand-in."""
    a = a if isinstance(a, jax.ShapeDtypeStruct) else jax.typeof(a)
    return a.shape, a.dtype


class Traced:
    """A function traced once for each kind of arguments; `jax.jit` traces anew under other transformations."""

    def __init__(self, function: Callable, compiled: Callable):
        self._traced = cache(partial(_traced, function, compiled))

    def __call__(self, *args: PyTree) -> PyTree:
        arrays, (run, run_alone, found) = self._look_up(args)
        return jax.tree.unflatten(jax.tree.structure(found), (run if is_staged() else run_alone)(*arrays))

    def shapes(self, *args: PyTree) -> PyTree:
        """Shapes of the results as from `jax.eval_shape`, without evaluating the trace again."""
        return self._look_up(args)[1][2]

    def _look_up(self, args: PyTree) -> tuple[list, tuple[Callable, Callable, PyTree]]:
        arrays, structure = jax.tree.flatten(args)
        return arrays, self._traced(structure, tuple(map(kind, arrays)))


def _traced(
    function: Callable, compiled: Callable, structure: Any, kinds: tuple
) -> tuple[Callable, Callable, PyTree]:
    """The trace as a function of arrays, the same compiled, and the shapes of its results."""
    shapes = [jax.ShapeDtypeStruct(*kind) for kind in kinds]
    jaxpr, found = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(structure, shapes))
    run = jaxpr_as_fun(jaxpr)
    return run, compiled(run), found


def shapes_of(function: Callable, *args: PyTree) -> PyTree:
    """Shapes of the results as from `jax.eval_shape`, looked up for a `Traced` function."""
    return function.shapes(*args) if isinstance(function, Traced) else jax.eval_shape(function, *args)
