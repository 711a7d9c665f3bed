"""Machine and flow as the loop of a trajectory used them."""

from typing import Any, NamedTuple

import jax
import numpy as np

from .._flow.interface import AbstractFlow
from .._jax.concrete import concrete_evaluation
from .._jax.packing import Layout, Packed, layout_of
from .._machine.machine import Machine


class Parts(NamedTuple):
    """What is prepared, see `Prepared`."""

    machine: Machine
    flow: AbstractFlow


@jax.tree_util.register_pytree_with_keys_class
class Prepared:
    """Machine and flow of a trajectory after their preparation, for its evaluation.

    They have half of all the arrays of a trajectory, and few trajectories are asked for them. A compiled program
    therefore returns them packed, and each becomes an array of its own when one of them is first asked for, by an
    attribute or as part of a tree. This is no `equinox.Module`, since one has all its fields from the start.
    """

    def __init__(self, machine: Machine, flow: AbstractFlow):
        self._parts: Parts | None = Parts(machine, flow)
        self._packed: tuple[Layout, Packed] | None = None

    @classmethod
    def from_packed(cls, layout: Layout, packed: Packed) -> "Prepared":
        """The same from its packed form, a tuple of machine and flow."""
        new = object.__new__(cls)
        new._parts, new._packed = None, (layout, packed)
        return new

    @property
    def parts(self) -> Parts:
        """Machine and flow."""
        if self._parts is None:
            assert self._packed is not None
            self._parts = _unpacked(*self._packed)
        return self._parts

    @property
    def packed(self) -> tuple[Layout, Packed]:
        """Layout of the parts, and their numbers; concrete numbers only."""
        if self._packed is None:
            parts = tuple(self.parts)
            layout = layout_of(parts)
            self._packed = layout, layout.pack(parts)
        return self._packed

    @property
    def machine(self) -> Machine:
        """The prepared machine."""
        return self.parts.machine

    @property
    def flow(self) -> AbstractFlow:
        """The prepared flow."""
        return self.parts.flow

    def tree_flatten_with_keys(self) -> tuple[list[tuple[Any, Any]], None]:
        """Children of this node of a tree."""
        return [(jax.tree_util.GetAttrKey(name), part) for name, part in self.parts._asdict().items()], None

    def tree_flatten(self) -> tuple[tuple[Any, ...], None]:
        """Children without their names."""
        return tuple(self.parts), None

    @classmethod
    def tree_unflatten(cls, _: None, children: Any) -> "Prepared":
        """Node with other children, which may be anything."""
        new = object.__new__(cls)
        new._parts, new._packed = Parts(*children), None
        return new

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return Prepared.tree_unflatten, (None, tuple(self.parts))


def _unpacked(layout: Layout, packed: Packed) -> Parts:
    """Machine and flow in JAX arrays, which stay concrete where a program that is traced asks first."""
    in_numpy = layout.unpack(Packed(*map(np.asarray, packed)))
    with concrete_evaluation():
        return Parts(*jax.tree.map(lambda a: jax.device_put(a) if isinstance(a, np.ndarray) else a, in_numpy))
