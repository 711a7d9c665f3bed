"""Arrays of elements: NumPy arrays of objects, in which moving an element costs nothing."""

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from typing import Any

import jax
import numpy as np

from .graph import Element, Graph


def as_elements(numbers: Any) -> np.ndarray:
    """Known numbers as elements, which keep their type."""
    numbers = np.asarray(numbers)
    return numbers if numbers.dtype == object else shaped(numbers.reshape(-1), numbers.shape)


def shaped(elements: Sequence[Element] | np.ndarray, shape: Sequence[int]) -> np.ndarray:
    """Elements in an array of this shape."""
    out = np.empty(len(elements), object)
    for k, element in enumerate(elements):
        out[k] = element
    return out.reshape(shape)


def regrouped(elements: Sequence[Element], arrays: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Elements in arrays of the same shapes as `arrays`."""
    rest: Iterator[Element] = iter(elements)
    return [shaped([next(rest) for _ in range(a.size)], a.shape) for a in arrays]


def flat(arrays: Sequence[np.ndarray]) -> list[Element]:
    """All elements, one array after another."""
    return [element for array in arrays for element in array.flat]


def rows_of(array: np.ndarray, axis: int = 0) -> list[np.ndarray]:
    """Arrays along an axis, arrays without axes too, which NumPy would replace by their elements."""
    array = np.moveaxis(array, axis, 0)
    return [array[k : k + 1].reshape(array.shape[1:]) for k in range(len(array))]


class Arithmetic:
    """Operations on arrays of elements, made of operations of a graph."""

    def __init__(self, graph: Graph):
        self.graph = graph

    def each(
        self, name: str, arrays: Sequence[np.ndarray], dtype: Any, params: Any = None, primitive: Any = None
    ):
        """Apply an elementwise primitive; scalars go with every element."""
        arrays = np.broadcast_arrays(*arrays)
        rows = zip(*(a.flat for a in arrays), strict=True)
        made = [self.graph.make(name, row, dtype, params, primitive) for row in rows]
        return shaped(made, arrays[0].shape)

    def fold(self, name: str, x: np.ndarray, axes: Sequence[int], dtype: Any, empty: Any) -> np.ndarray:
        """Combine all elements along axes, one after another."""
        rows = np.moveaxis(x, tuple(axes), range(len(axes)))
        rows = rows.reshape(-1, *rows.shape[len(axes) :])
        if not len(rows):
            return as_elements(np.full(rows.shape[1:], empty, dtype))
        return reduce(lambda a, b: self.each(name, (a, b), dtype), rows_of(rows))

    def accumulate(self, name: str, x: np.ndarray, axis: int, dtype: Any, *, reverse: bool) -> np.ndarray:
        """Combine each element with those before it, or after it."""
        rows = rows_of(x, axis)[:: -1 if reverse else 1]
        for k in range(1, len(rows)):
            rows[k] = self.each(name, (rows[k - 1], rows[k]), dtype)
        return np.moveaxis(np.stack(rows[:: -1 if reverse else 1]), 0, axis) if rows else x

    def dot(self, x: np.ndarray, y: np.ndarray, dimensions: Any, dtype: Any) -> np.ndarray:
        """Contract, written out; zeros that are known cost nothing."""
        (cx, cy), (bx, by) = dimensions
        fx = [d for d in range(x.ndim) if d not in (*cx, *bx)]
        fy = [d for d in range(y.ndim) if d not in (*cy, *by)]
        size = lambda a, axes: int(np.prod([a.shape[d] for d in axes], dtype=int))  # noqa: E731
        u = x.transpose(*bx, *fx, *cx).reshape(size(x, bx), size(x, fx), 1, size(x, cx))
        v = y.transpose(*by, *fy, *cy).reshape(size(y, by), 1, size(y, fy), size(y, cy))
        product = self.each("mul", (u, v), dtype)
        out = self.fold("add", product, (3,), dtype, 0)
        return out.reshape([x.shape[d] for d in (*bx, *fx)] + [y.shape[d] for d in fy])

    def choose(self, index: Element, cases: Sequence[np.ndarray], dtype: Any) -> np.ndarray:
        """The case with the number `index`, by selections; the last one beyond all."""
        out = cases[0]
        for k, case in enumerate(cases[1:], 1):
            is_beyond = index
            if index.dtype != bool:
                is_beyond = self.graph.make("ge", (index, index.dtype.type(k)), bool)
            out = self.each("select_n", (shaped([is_beyond], ()), out, case), dtype)
        return out

    def extreme(self, x: np.ndarray, axis: int, dtype: Any, *, largest: bool) -> np.ndarray:
        """First place of the largest or smallest number along an axis; that of NaN if there is one."""
        rows = rows_of(x, axis)
        best, place = rows[0], as_elements(np.zeros(rows[0].shape, dtype))
        for k in range(1, len(rows)):
            is_better = self.each("gt" if largest else "lt", (rows[k], best), bool)
            is_nan = self.each("ne", (rows[k], rows[k]), bool)
            was_nan = self.each("ne", (best, best), bool)
            is_new = self.each(
                "and", (self.each("or", (is_better, is_nan), bool), self.each("not", (was_nan,), bool)), bool
            )
            best = self.each("select_n", (is_new, best, rows[k]), x.flat[0].dtype)
            place = self.each("select_n", (is_new, place, as_elements(np.full(place.shape, k, dtype))), dtype)
        return place


def moved(
    primitive: Any, params: dict, arrays: Sequence[np.ndarray], movable: Callable[[int], bool], dtype: Any
):
    """Apply a primitive that rearranges elements to their places instead, with indices that are known.

    Args:
        primitive: gather, scatter, pad, slices and the like.
        params: its parameters.
        arrays: operands.
        movable: true for the operands that are rearranged; the others are indices.
        dtype: of the result.
    """
    start, places, pool = 0, [], []
    for k, array in enumerate(arrays):
        if movable(k):
            places.append(np.arange(start, start + array.size, dtype=np.int32).reshape(array.shape))
            pool.extend(array.flat)
            start += array.size
        else:
            places.append(
                np.asarray(array.tolist(), array.flat[0].dtype if array.size else np.int32).reshape(
                    array.shape
                )
            )
    with jax.ensure_compile_time_eval():
        at = np.asarray(primitive.bind(*map(jax.numpy.asarray, places), **params))
    # Reads beyond the end are NaN, as in `jnp`.
    is_nan = primitive.name == "gather" and np.issubdtype(dtype, np.inexact)
    beyond = np.dtype(dtype).type(np.nan if is_nan else 0)
    return shaped([pool[k] if 0 <= k < len(pool) else beyond for k in at.flat], at.shape)
