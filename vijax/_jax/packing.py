"""Trees packed into two arrays, one of reals and one of whole numbers.

A call of a compiled program costs one to two microseconds for every array that goes in or comes out: a hundred of them
take longer than most trajectories.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.dtypes import canonicalize_dtype
from jaxtyping import Array, PyTree

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


class Layout:
    """All of a tree but its numbers, as part of the structure of a packed one. Immutable.

    Attributes:
        structure: structure of the tree.
        leaves: for every array its `Place`, for any other leaf the leaf itself.
        dtypes: types of the packed integers and of the packed reals.
    """

    def __init__(self, structure: Any, leaves: tuple[Any, ...], dtypes: tuple[np.dtype, np.dtype]):
        self.structure, self.leaves, self.dtypes = structure, leaves, dtypes
        # Every call of a program needs it.
        self._hash = hash((structure, leaves, dtypes))

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

    @property
    def places(self) -> list[Place]:
        """Places of all arrays."""
        return [at for at in self.leaves if _is_place(at)]

    def shapes(self) -> PyTree:
        """The tree, with shapes and types in place of its arrays."""
        leaves = [jax.ShapeDtypeStruct(at.shape, at.dtype) if _is_place(at) else at for at in self.leaves]
        return jax.tree.unflatten(self.structure, leaves)


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
        leaves, structure = jax.tree.flatten(self.unpacked())
        return [jax.tree.unflatten(structure, own) for own in zip(*leaves, strict=True)]

    def unpacked_by_kernel(self) -> PyTree:
        """`unpacked` in a program, by one kernel and not by one for each array."""
        places = self.layout.places

        def cut(reals: Array, wholes: Array) -> list[Array]:
            return [_at(reals if at.is_real else wholes, at) for at in places]

        parts = iter(in_one_kernel(cut, self.reals, self.wholes))
        leaves = [next(parts) if _is_place(at) else at for at in self.layout.leaves]
        return jax.tree.unflatten(self.layout.structure, leaves)

    def at(self, rows: Any) -> "Packed":
        """One tree of a batch, or several."""
        return Packed(self.reals[rows], self.wholes[rows], self.layout)

    def in_numpy(self) -> "Packed":
        """The same in NumPy arrays."""
        return Packed(np.asarray(self.reals), np.asarray(self.wholes), self.layout)

    def _cut(self, reals: Reals, wholes: Reals) -> PyTree:
        leaves = [
            _at(reals if at.is_real else wholes, at) if _is_place(at) else at for at in self.layout.leaves
        ]
        return jax.tree.unflatten(self.layout.structure, leaves)


def _at(numbers: Reals, place: Place) -> Reals:
    if place.dtype.kind == "c":
        middle = (place.begin + place.end) // 2
        of_part = replace(place, dtype=numbers.dtype)
        real, imaginary = replace(of_part, end=middle), replace(of_part, begin=middle)
        return _complex(_at(numbers, real), _at(numbers, imaginary)).astype(place.dtype)
    lead = numbers.shape[:-1]
    if isinstance(numbers, np.ndarray):  # in few calls: a branch of orbits cuts many rows
        if not place.shape:
            part = numbers[..., place.begin][()]  # a number, not an array without axes
        else:
            part = numbers[..., place.begin : place.end]
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
    layout = layout_of(tree, has_rows=has_rows) if layout is None else layout
    parts: tuple[list, list] = ([], [])
    for leaf, at in zip(jax.tree.leaves(tree), layout.leaves, strict=True):
        if _is_place(at):
            parts[at.is_real].extend(_real_parts(leaf))
    lead = next((np.shape(a)[:1] for own in parts for a in own), ()) if has_rows else ()
    wholes, reals = (_joined(own, dtype, lead) for own, dtype in zip(parts, layout.dtypes, strict=True))
    return Packed(reals, wholes, layout)


def layout_of(tree: PyTree, *, has_rows: bool = False) -> Layout:
    """Layout of a tree in the precision in which JAX computes, see `pack`."""
    leaves, structure = jax.tree.flatten(tree)
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


def _real_parts(a: Reals) -> list[Reals]:
    return [a.real, a.imag] if np.dtype(a.dtype).kind == "c" else [a]


def _joined(arrays: list[Reals], dtype: np.dtype, lead: tuple[int, ...]) -> Reals:
    """The numbers of some arrays, behind their first axes `lead`."""
    xp = jnp if any(map(is_tracer, arrays)) else np
    flat = [xp.reshape(xp.asarray(a), (*lead, math.prod(a.shape[len(lead) :]))) for a in arrays]
    return xp.concatenate([xp.zeros((*lead, 0), dtype), *flat], axis=-1, dtype=dtype)


def _is_place(leaf: Any) -> bool:
    return isinstance(leaf, Place)
