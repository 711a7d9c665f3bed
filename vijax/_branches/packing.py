"""Trees packed into one array for each dtype, because the cost of a call grows with its number of arrays."""

import math
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.dtypes import canonicalize_dtype

from .._jax.arrays import array_namespace


class Layout(NamedTuple):
    """Positions of the leaves of a tree in its packed arrays.

    Attributes:
        structure: structure of the tree.
        parts: for each leaf the number of its packed array, its begin and end there, and its shape.
    """

    structure: Any
    parts: tuple[tuple[int, int, int, tuple[int, ...]], ...]


class Packed(NamedTuple):
    """A packed tree, or a batch of such trees, a row each.

    Attributes:
        arrays: one for each dtype, (numbers,) or (rows, numbers).
        layout: layout of the tree.
    """

    arrays: tuple[Any, ...]
    layout: Layout

    def at(self, rows: Any) -> "Packed":
        """One row, or several."""
        return Packed(tuple(a[rows] for a in self.arrays), self.layout)

    def tree(self) -> Any:
        """The unpacked tree."""
        # `[()]` turns a NumPy array without axes into a number.
        leaves = [
            self.arrays[k][..., begin:end].reshape((*self.arrays[k].shape[:-1], *shape))[()]
            for k, begin, end, shape in self.layout.parts
        ]
        return jax.tree.unflatten(self.layout.structure, leaves)


def pack(tree: Any, *, has_rows: bool) -> Packed:
    """Pack a tree, in the precision in which JAX computes."""
    leaves, structure = jax.tree.flatten(tree)
    lead, names = int(has_rows), [str(canonicalize_dtype(a.dtype)) for a in leaves]
    kinds = sorted(set(names))
    parts, flat = [], [[] for _ in kinds]
    ends = [0] * len(kinds)
    for a, name in zip(leaves, names, strict=True):
        k, shape = kinds.index(name), np.shape(a)[lead:]
        begin, ends[k] = ends[k], ends[k] + math.prod(shape)
        parts.append((k, begin, ends[k], shape))
        flat[k].append(a.reshape(*np.shape(a)[:lead], -1).astype(name))
    arrays = tuple(array_namespace(*own).concatenate(own, axis=lead) for own in flat)
    return Packed(arrays, Layout(structure, tuple(parts)))
