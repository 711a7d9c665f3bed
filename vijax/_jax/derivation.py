"""Values, tangents and their transpose for the primitives of `differentiable.py`, for any batch."""

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import chain
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jaxtyping import Array

from .arrays import add_up
from .traced import CACHE_SIZE, Traced

Arrays = list[Any]  # JAX arrays, or their stand-ins while a function is traced
Flags = tuple[bool, ...]

values, tangents = map(Primitive, ("values", "tangents"))


class BatchAxis(NamedTuple):
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
        has_reverse: whether `smooth` is differentiable in reverse too.
        compiled: compiles a function that is not part of a larger program.
        compiled_many: the same for values of a batch.
    """

    values: Callable[[Arrays, Arrays], tuple[Arrays, Arrays]]
    smooth: Callable[[Flags], Callable[[Arrays, Arrays], Arrays]]
    many: Callable | None
    smooth_many: Callable | None
    always: Flags
    watch: Callable[[Arrays, bool], Arrays] | None
    has_reverse: bool
    compiled: Callable
    compiled_many: Callable


class Derivation(NamedTuple):
    """A function, the axes of a batch from the inside out, and flags of the inputs that move and of the wanted results."""

    functions: Functions
    layers: tuple[BatchAxis, ...] = ()
    moves: Flags = ()
    wanted: Flags = ()


@lru_cache(CACHE_SIZE)
def values_of(functions: Functions, layers: tuple[BatchAxis, ...]) -> Callable:
    """`Functions.values` of a batch."""
    if not layers:
        return functions.values
    *inner, layer = layers
    inside = values_of(functions, tuple(inner))
    if functions.many is None or not layer.size:
        of_all = jax.vmap(inside, tuple(map(list, layer.axes)))
    elif not inner:
        of_all = functions.many(layer)
    else:
        of_all = partial(_in_turn, inside, layer)
    return Traced(of_all, functions.compiled_many)


def _in_turn(function: Callable, layer: BatchAxis, fixed: Arrays, x: Arrays, *rest: Arrays) -> Any:
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
def tangents_of(derivation: Derivation) -> Callable:
    """Function of (fixed, x, dx) that returns the tangents of the wanted results."""
    return Traced(push_of(derivation), derivation.functions.compiled)


def push_of(derivation: Derivation) -> Callable:
    functions, layers, moves, wanted = derivation
    if not layers:
        return partial(_along, functions.smooth(wanted), moves)
    *inner, layer = layers
    if layer.is_of_tangents:
        return jax.vmap(push_of(derivation._replace(layers=tuple(inner))), (None, None, 0))
    if functions.smooth_many is not None and layer.size and all(one.is_of_tangents for one in inner):
        # Lanes inside, all tangents of a lane outside: what belongs to the lane alone is computed once.
        push = partial(_along_lanes, functions.smooth_many, wanted, moves, layer)
        for _ in inner:
            push = jax.vmap(push, (None, None, 0))
        return partial(_with_axis_inside, push, len(inner))
    inside = push_of(derivation._replace(layers=tuple(inner)))
    if functions.smooth_many is not None and layer.size:
        return partial(_in_turn, inside, layer)
    return jax.vmap(inside, (*map(list, layer.axes), 0))


def _along(smooth: Callable, moves: Flags, fixed: Arrays, x: Arrays, dx: Arrays) -> Arrays:
    """Derivative of `smooth` along tangents of the arrays that move; the others cost nothing."""
    of_moving, moving = _of_moving(smooth, moves, fixed, x)
    return jax.jvp(of_moving, (moving,), (dx,))[1]


def _of_moving(smooth: Callable, moves: Flags, fixed: Arrays, x: Arrays) -> tuple[Callable, Arrays]:
    """`smooth` as a function of the arrays that move, and these."""

    def of_moving(moving: Arrays) -> Arrays:
        moving = list(moving)
        return smooth(fixed, [moving.pop(0) if move else a for a, move in zip(x, moves, strict=True)])

    return of_moving, [a for a, move in zip(x, moves, strict=True) if move]


def _along_lanes(
    smooth_of: Callable, wanted: Flags, moves: Flags, layer: BatchAxis, fixed: Arrays, x: Arrays, dx: Arrays
) -> Arrays:
    """`_along` of a batch, whose lanes have tangents of their own of what they share."""
    of_fixed, of_x = layer.axes
    pairs = list(zip(x, of_x, moves, strict=True))
    x = [lanes_first(a, axis, layer.size) if move else a for a, axis, move in pairs]
    own = layer._replace(axes=(of_fixed, tuple(0 if move else axis for _, axis, move in pairs)))
    return _along(smooth_of(own, wanted), moves, fixed, x, dx)


def lanes_first(a: Any, axis: int | None, size: int) -> Array:
    """Array with the batch axis first, repeated where all members share it."""
    return jnp.broadcast_to(a, (size, *jnp.shape(a))) if axis is None else jnp.moveaxis(a, axis, 0)


def axis_last(arrays: Arrays, axes: tuple[int | None, ...]) -> Arrays:
    """Arrays with the batch axis last, of length one where all members share the array."""
    return [
        a[..., None] if axis is None else jnp.moveaxis(a, axis, -1)
        for a, axis in zip(arrays, axes, strict=True)
    ]


def _with_axis_inside(push: Callable, place: int, fixed: Arrays, x: Arrays, dx: Arrays) -> Arrays:
    """Call a function whose tangents have their first axis at another place."""
    found = push(fixed, x, [jnp.moveaxis(a, 0, place) for a in dx])
    return [jnp.moveaxis(a, place, 0) for a in found]


def members(layers: tuple[BatchAxis, ...], moves: Flags, dx: Arrays) -> Arrays:
    """Tangents of the entries of `x` that move, with the axes of a batch first."""
    if not layers:
        return dx
    *inner, layer = layers
    axes = [axis for axis, move in zip(layer.axes[1], moves, strict=True) if move]
    dx = [lanes_first(a, axis, layer.size) for a, axis in zip(dx, axes, strict=True)]
    return jax.vmap(partial(members, tuple(inner), moves))(dx) if inner else dx


# Transpose


@lru_cache(CACHE_SIZE)
def pullback_of(derivation: Derivation, shapes: tuple[tuple[int, ...], ...]) -> Callable:
    """Function of (fixed, x, cotangents) that returns those of the tangents, each of a shape, without a batch."""
    pull = _reversed(derivation) if derivation.functions.has_reverse else partial(_pull, derivation, shapes)
    return Traced(pull, derivation.functions.compiled)


def _reversed(derivation: Derivation) -> Callable:
    """The same by the reverse mode of JAX."""
    functions, layers, moves, wanted = derivation
    if not layers:
        return partial(_back, functions.smooth(wanted), moves)
    *inner, layer = layers
    axes = (None, None) if layer.is_of_tangents else tuple(map(list, layer.axes))
    return jax.vmap(_reversed(derivation._replace(layers=tuple(inner))), (*axes, 0))


def _back(smooth: Callable, moves: Flags, fixed: Arrays, x: Arrays, cotangents: Arrays) -> Arrays:
    of_moving, moving = _of_moving(smooth, moves, fixed, x)
    return jax.vjp(of_moving, moving)[1](cotangents)[0]


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
        total = [
            _weighed(c, jnp.expand_dims(d, axes), len(batch)) for c, d in zip(cotangents, found, strict=True)
        ]
        return add_up(total) if total else jnp.zeros(batch)

    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    units = np.split(np.eye(ends[-1]), ends[:-1], axis=1)
    pairs = zip(units, shapes, dtypes, strict=True)
    found = jax.vmap(along, out_axes=-1)(
        [jnp.asarray(u.reshape(-1, *shape), dtype) for u, shape, dtype in pairs]
    )
    parts = jnp.split(found, ends[:-1], axis=-1)
    return [a.reshape(*batch, *shape).astype(d) for a, shape, d in zip(parts, shapes, dtypes, strict=True)]


def _weighed(cotangent: Array, tangent: Array, rank: int) -> Array:
    """Sum over all but the axes of a batch. A zero cotangent gives zero, even where the tangent is infinite."""
    return jnp.sum(jnp.where(cotangent != 0, cotangent * tangent, 0), axis=tuple(range(rank, cotangent.ndim)))
