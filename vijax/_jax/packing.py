"""Trees packed into two arrays, one of reals and one of whole numbers.

A call of a compiled program costs one to two microseconds for every array that goes in or comes out: a hundred of them
take longer than most trajectories.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.dtypes import canonicalize_dtype
from jaxtyping import PyTree

from .arrays import Reals
from .concrete import concrete_evaluation, is_tracer
from .xla import in_one_kernel


@dataclass(frozen=True)
class Place:
    """Place of an array in a packed tree.

    Attributes:
        is_real: whether it lies among the reals; complex numbers do, all real parts first.
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

    @property
    def is_complex(self) -> bool:
        """True for complex numbers."""
        return self.dtype.kind == "c"


class Layout:
    """All of a tree but its numbers, as part of the structure of a packed one. Immutable.

    Attributes:
        structure: structure of the tree.
        leaves: for every array its `Place`, for any other leaf the leaf itself.
        dtypes: types of the packed integers and of the packed reals.
        places: places of all arrays.
        sizes: numbers of packed integers and of packed reals.
    """

    def __init__(self, structure: Any, leaves: tuple[Any, ...], dtypes: tuple[np.dtype, np.dtype]):
        self.structure, self.leaves, self.dtypes = structure, leaves, dtypes
        # Every call of a program needs these.
        self._hash = hash((structure, leaves, dtypes))
        self.places = tuple(at for at in leaves if isinstance(at, Place))
        self.sizes = tuple(
            max((at.end for at in self.places if at.is_real is kind), default=0) for kind in (False, True)
        )

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if self is other or not isinstance(other, Layout):
            return self is other
        ours, others = ((a.structure, a.leaves, a.dtypes) for a in (self, other))
        return self._hash == other._hash and ours == others

    def __reduce__(self) -> tuple[Any, ...]:
        # JAX pickles no structure with nodes that it does not know, but a tree of places is like any other.
        return _layout_of_places, (jax.tree.unflatten(self.structure, self.leaves), self.dtypes)

    def __repr__(self) -> str:
        return f"Layout({len(self.leaves)} leaves)"

    def arrays_in(self, leaves: list) -> list:
        """The arrays among the leaves of a tree."""
        if len(leaves) == len(self.places):
            return leaves
        return [leaf for leaf, at in zip(leaves, self.leaves, strict=True) if isinstance(at, Place)]

    def arrays_of(self, reals: Reals, wholes: Reals) -> list[Reals]:
        """The arrays in packed numbers."""
        return [_at(reals if at.is_real else wholes, at) for at in self.places]

    def tree_of(self, arrays: Iterable) -> PyTree:
        """The tree with these arrays."""
        if len(self.leaves) > len(self.places):
            given = iter(arrays)
            arrays = [next(given) if isinstance(at, Place) else at for at in self.leaves]
        return jax.tree.unflatten(self.structure, arrays)

    def shapes(self) -> PyTree:
        """The tree, with shapes and types in place of its arrays."""
        return self.tree_of([jax.ShapeDtypeStruct(at.shape, at.dtype) for at in self.places])


# One object for equal layouts, because programs compare them at every call.
_one_layout = lru_cache(maxsize=1024)(Layout)


def _layout_of_places(tree: PyTree, dtypes: tuple[np.dtype, np.dtype]) -> Layout:
    leaves, structure = jax.tree.flatten(tree)
    return _one_layout(structure, tuple(leaves), dtypes)


@partial(jax.tree_util.register_dataclass, data_fields=("reals", "wholes"), meta_fields=("layout",))
@dataclass(frozen=True, eq=False)
class Packed:
    """A packed tree, made by `pack`; a batch of them has its axes first.

    This is no module of Equinox, because every call makes some and a module takes 50 microseconds.

    Attributes:
        reals: its floating-point numbers, (reals,).
        wholes: its integers and flags, (wholes,).
        layout: all else.
    """

    reals: Reals
    wholes: Reals
    layout: Layout

    def unpacked(self) -> PyTree:
        """The tree: parts of the packed arrays if these are of NumPy or traced, otherwise JAX arrays of their own."""
        arrays = self.reals, self.wholes
        if isinstance(self.reals, np.ndarray) or any(map(is_tracer, arrays)):
            return self._cut(*arrays)
        # Slices by JAX would each be compiled, and traced where `jit` traces.
        cut = self._cut(*map(np.asarray, arrays))
        with concrete_evaluation():
            return jax.tree.map(
                lambda a: jax.device_put(a) if isinstance(a, np.ndarray | np.generic) else a, cut
            )

    def each_unpacked(self) -> list[PyTree]:
        """The trees of a batch in NumPy arrays: it is cut once."""
        if not len(self.reals):
            return []
        rows = zip(*self.layout.arrays_of(np.asarray(self.reals), np.asarray(self.wholes)), strict=True)
        return [self.layout.tree_of(own) for own in rows]

    def unpacked_by_kernel(self) -> PyTree:
        """`unpacked` in a program, by one kernel and not by one for each array."""
        return self.layout.tree_of(in_one_kernel(self.layout.arrays_of, self.reals, self.wholes))

    def at(self, rows: Any) -> "Packed":
        """One tree of a batch, or several."""
        return Packed(self.reals[rows], self.wholes[rows], self.layout)

    def in_numpy(self) -> "Packed":
        """The same in NumPy arrays."""
        return Packed(np.asarray(self.reals), np.asarray(self.wholes), self.layout)

    def _cut(self, reals: Reals, wholes: Reals) -> PyTree:
        return self.layout.tree_of(self.layout.arrays_of(reals, wholes))


def _at(numbers: Reals, place: Place) -> Reals:
    if place.is_complex:
        middle = (place.begin + place.end) // 2
        of_part = replace(place, dtype=numbers.dtype)
        real, imaginary = replace(of_part, end=middle), replace(of_part, begin=middle)
        return _complex(_at(numbers, real), _at(numbers, imaginary)).astype(place.dtype)
    lead = numbers.shape[:-1]
    if isinstance(numbers, np.ndarray):  # in few calls: a branch of orbits cuts many rows
        where = slice(place.begin, place.end) if place.shape else place.begin
        # With an ellipsis a number would be an array without axes.
        part = numbers[..., where] if lead else numbers[where]
        part = part.reshape((*lead, *place.shape)) if len(place.shape) > 1 else part
        return part if part.dtype == place.dtype else part.astype(place.dtype)
    part = jax.lax.slice_in_dim(numbers, place.begin, place.end, axis=len(lead))
    return part.reshape(*lead, *place.shape).astype(place.dtype)


def _complex(real: Reals, imaginary: Reals) -> Reals:
    """Numbers with these parts, infinite ones too, which `real + 1j * imaginary` would spoil."""
    if not isinstance(real, np.ndarray | np.generic):
        return jax.lax.complex(real, imaginary)
    whole = np.empty(np.shape(real), np.result_type(real, np.complex64))
    whole.real, whole.imag = real, imaginary
    return whole[()]


def pack(tree: PyTree, layout: Layout | None = None, *, has_rows: bool = False) -> Packed:
    """Pack a tree: by NumPy, or by JAX where an array is traced.

    Args:
        tree: the tree; leaves that are no arrays must be hashable.
        layout: its layout, to save the time to find it.
        has_rows: whether it is a batch of trees, whose arrays have it as their first axis.
    """
    leaves, structure = jax.tree.flatten(tree)
    layout = _layout_of_leaves(leaves, structure, has_rows=has_rows) if layout is None else layout
    arrays = layout.arrays_in(leaves)
    lead = np.shape(arrays[0])[:1] if has_rows and arrays else ()
    parts: tuple[list, list] = ([], [])
    for a, at in zip(arrays, layout.places, strict=True):
        parts[at.is_real].extend((a.real, a.imag) if at.is_complex else (a,))
    wholes, reals = (
        _joined(own, size, dtype, lead)
        for own, size, dtype in zip(parts, layout.sizes, layout.dtypes, strict=True)
    )
    return Packed(reals, wholes, layout)


def _joined(arrays: list[Reals], size: int, dtype: np.dtype, lead: tuple[int, ...]) -> Reals:
    """The numbers of some arrays, behind their first axes `lead`."""
    if any(map(is_tracer, arrays)):
        flat = [jnp.reshape(jnp.asarray(a), (*lead, math.prod(a.shape[len(lead) :]))) for a in arrays]
        return jnp.concatenate([jnp.zeros((*lead, 0), dtype), *flat], axis=-1, dtype=dtype)
    # Each is written once, where it stands: a branch of orbits packs many small ones.
    found, begin = np.empty((*lead, size), dtype), 0
    for a in arrays:
        end = begin + math.prod(a.shape[len(lead) :])
        found[..., begin:end] = np.asarray(a).reshape((*lead, end - begin))
        begin = end
    return found


def layout_of(tree: PyTree, *, has_rows: bool = False) -> Layout:
    """Layout of a tree in the precision in which JAX computes, see `pack`."""
    return _layout_of_leaves(*jax.tree.flatten(tree), has_rows=has_rows)


def _layout_of_leaves(leaves: list, structure: Any, *, has_rows: bool) -> Layout:
    kinds = tuple(
        _Kind(leaf.shape[int(has_rows) :], leaf.dtype)
        if isinstance(leaf, jax.Array | np.ndarray | np.generic)
        else (type(leaf), leaf)
        for leaf in leaves
    )
    return _layout_of_kinds(structure, kinds, jax.config.read("jax_enable_x64"))


class _Kind(NamedTuple):
    shape: tuple[int, ...]
    dtype: np.dtype


@lru_cache(maxsize=1024)
def _layout_of_kinds(structure: Any, kinds: tuple, has_doubles: bool) -> Layout:
    """Layout of a tree with these shapes and types, or types and values of leaves that are no arrays."""
    del has_doubles  # it decides about types
    ends, places, floats = [0, 0], [], []
    for own in kinds:
        if not isinstance(own, _Kind):
            places.append(own[1])
            continue
        dtype, shape = np.dtype(canonicalize_dtype(own.dtype)), own.shape
        is_complex = bool(jnp.issubdtype(dtype, jnp.complexfloating))
        kind = int(is_complex or jnp.issubdtype(dtype, jnp.floating))
        begin, ends[kind] = ends[kind], ends[kind] + math.prod(shape) * (1 + is_complex)
        places.append(Place(bool(kind), begin, ends[kind], shape, dtype))
        floats += [jnp.finfo(dtype).dtype] if kind else []
    return _one_layout(structure, tuple(places), (jnp.result_type(int), jnp.result_type(float, *floats)))
