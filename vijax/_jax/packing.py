"""Trees packed into two arrays, one of reals and one of whole numbers.

A call of a compiled program costs one to two microseconds for every array that goes in or comes out: a hundred of them
take longer than most trajectories.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .arrays import Reals


class Packed(NamedTuple):
    """The numbers of a tree, in NumPy or JAX arrays.

    Attributes:
        reals: all floating-point numbers, (reals,).
        wholes: all integers and flags, (wholes,).
    """

    reals: Reals
    wholes: Reals


class Place(NamedTuple):
    """Place of an array in a packed tree.

    Attributes:
        is_real: whether it lies among the reals.
        begin: index of its first number.
        end: index behind its last.
        shape: its shape.
        dtype: its type.
    """

    is_real: bool
    begin: int
    end: int
    shape: tuple[int, ...]
    dtype: np.dtype


class Layout(NamedTuple):
    """All of a tree but its numbers. Hashable: a program is compiled for each.

    Attributes:
        structure: structure of the tree.
        leaves: for every array its place, for any other leaf the leaf itself.
        real: type of the packed reals.
    """

    structure: Any
    leaves: tuple[Any, ...]
    real: np.dtype

    def pack(self, tree: PyTree) -> Packed:
        """Pack a tree of this layout: by NumPy, or by JAX where a number is traced."""
        arrays = [
            a for a, at in zip(jax.tree.leaves(tree), self.leaves, strict=True) if isinstance(at, Place)
        ]
        is_traced = any(isinstance(a, jax.core.Tracer) for a in arrays)
        library = jnp if is_traced else np
        parts: tuple[list, list] = ([], [])
        for a, place in zip(arrays, self.places, strict=True):
            parts[place.is_real].append(library.ravel(library.asarray(a)))
        wholes, reals = (
            library.concatenate([library.zeros(0, dtype), *own], dtype=dtype)
            for own, dtype in zip(parts, (jnp.result_type(int), self.real), strict=True)
        )
        return Packed(reals, wholes)

    def unpack(self, packed: Packed) -> PyTree:
        """Inverse of `pack`: views of NumPy arrays where possible, slices of JAX arrays."""
        leaves = [_cut(packed, at) if isinstance(at, Place) else at for at in self.leaves]
        return jax.tree.unflatten(self.structure, leaves)

    def shapes(self) -> PyTree:
        """The tree with shapes and types in place of arrays."""
        leaves = [
            jax.ShapeDtypeStruct(at.shape, at.dtype) if isinstance(at, Place) else at for at in self.leaves
        ]
        return jax.tree.unflatten(self.structure, leaves)

    @property
    def places(self) -> list[Place]:
        """Places of all arrays."""
        return [at for at in self.leaves if isinstance(at, Place)]


def _cut(packed: Packed, place: Place) -> Reals:
    numbers = packed.reals if place.is_real else packed.wholes
    if isinstance(numbers, np.ndarray):
        return numbers[place.begin : place.end].reshape(place.shape).astype(place.dtype, copy=False)
    return jax.lax.slice(numbers, (place.begin,), (place.end,)).reshape(place.shape).astype(place.dtype)


def layout_of(tree: PyTree) -> Layout:
    """Layout of a tree; its leaves that are no arrays must be hashable."""
    leaves, structure = jax.tree.flatten(tree)
    real = np.dtype(jnp.result_type(float))
    ends, found = {False: 0, True: 0}, []
    for leaf in leaves:
        if not isinstance(leaf, jax.Array | np.ndarray | np.generic):
            found.append(leaf)
            continue
        is_real = leaf.dtype.kind == "f"
        real = np.promote_types(real, leaf.dtype) if is_real else real
        begin, shape = ends[is_real], np.shape(leaf)
        ends[is_real] = begin + math.prod(shape)
        found.append(Place(is_real, begin, ends[is_real], shape, np.dtype(leaf.dtype)))
    return Layout(structure, tuple(found), real)
