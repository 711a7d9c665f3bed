"""Numbers of many points as the rows of one array: a call of a program takes two arrays instead of a hundred."""

import math
from collections.abc import Hashable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, PyTree

from .records import Column


class Leaf(NamedTuple):
    """One array of a packed tree.

    Attributes:
        shape: its axes, without that of the points.
        dtype: its type; flags are packed as 0 and 1.
        is_own: whether every point has its own numbers.
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    is_own: bool

    @property
    def size(self) -> int:
        """Number of rows."""
        return math.prod(self.shape)


class PointLayout(NamedTuple):
    """Places of the arrays of a tree in a `PackedPoints`; hashable.

    Attributes:
        structure: structure of the tree, with all that is no array.
        leaves: its arrays.
    """

    structure: Hashable
    leaves: tuple[Leaf, ...]

    @property
    def dtype(self) -> np.dtype:
        """Type of the packed numbers."""
        return np.result_type(*(leaf.dtype for leaf in self.leaves if leaf.dtype.kind == "f"))

    def num_rows(self, *, is_own: bool) -> int:
        """Number of rows of numbers of every point, or of shared ones."""
        return sum(leaf.size for leaf in self.leaves if leaf.is_own is is_own)

    def places(self) -> list[slice]:
        """Rows of each array."""
        end, places = {True: 0, False: 0}, []
        for leaf in self.leaves:
            places.append(slice(end[leaf.is_own], end[leaf.is_own] + leaf.size))
            end[leaf.is_own] += leaf.size
        return places

    def empty(self, num_points: int) -> "PackedPoints":
        """Room for the numbers of some points."""
        own = np.empty((self.num_rows(is_own=True), num_points), self.dtype)
        return PackedPoints(own, np.empty(self.num_rows(is_own=False), self.dtype))


class PackedPoints(NamedTuple):
    """Numbers of some points.

    Attributes:
        own: numbers of every point, (rows, points).
        shared: numbers that all points share, (rows,).
    """

    own: Float[Column, "rows points"]
    shared: Float[Column, " rows"]


def pack(
    tree: PyTree, which: Int[np.ndarray, " points"], *, repeated: PyTree | bool
) -> tuple[PointLayout, PackedPoints]:
    """Pack arrays, points last, for some points.

    Args:
        tree: arrays whose last axis has all points, or a length of one where all share the numbers.
        which: the points.
        repeated: whether shared numbers are repeated for every point, so that the layout does not depend on them; a flag
            for all arrays, or a tree of flags.
    """
    arrays, structure = jax.tree.flatten(tree)
    arrays = [np.asarray(a) for a in arrays]
    flags = [repeated] * len(arrays) if isinstance(repeated, bool) else jax.tree.leaves(repeated)
    is_own = [flag or a.shape[-1] > 1 for flag, a in zip(flags, arrays, strict=True)]
    kinds = [Leaf(a.shape[:-1], a.dtype, own) for a, own in zip(arrays, is_own, strict=True)]
    layout = PointLayout(structure, tuple(kinds))
    packed = layout.empty(which.size)
    rows = {True: packed.own, False: packed.shared[:, None]}
    for leaf, place, a in zip(layout.leaves, layout.places(), arrays, strict=True):
        flat = a.reshape(leaf.size, a.shape[-1])
        rows[leaf.is_own][place] = flat[:, which] if a.shape[-1] > 1 else flat
    return layout, packed


def unpack(layout: PointLayout, packed: PackedPoints) -> Any:
    """Tree that was packed; arrays have points last, or an axis of length one."""
    own, shared = jnp.asarray(packed.own), jnp.asarray(packed.shared)[:, None]
    arrays = []
    for leaf, place in zip(layout.leaves, layout.places(), strict=True):
        rows = own if leaf.is_own else shared
        a = rows[place].reshape(*leaf.shape, rows.shape[1])
        arrays.append(a != 0 if leaf.dtype == bool else a.astype(leaf.dtype))
    return jax.tree.unflatten(layout.structure, arrays)
