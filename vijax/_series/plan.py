"""From a force to the operations that make its Taylor series."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import inf
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._lanes.graph import Node
from .algebra import Operand, is_known
from .builder import Builder
from .graph_of_force import is_known as is_known_element, ordered_nodes, scalars_of
from .jacobian import derivatives
from .operations import Fixed, Integral, Linear, Operation, Product, Slope
from .powers import ClosingPower, Power
from .primitives import series_of
from .slopes import has_infinite_slope
from .switches import Switch


@dataclass(eq=False, frozen=True)
class Plan:
    """Operations that make the series of a force, in order. The first series are given: time, numbers, x, v.

    Attributes:
        num_masses: n.
        num_numbers: numbers of the force that are given.
        size: number of series.
        operations: all that is computed.
        forces: series of the forces, (n,).
        by_x: entries of the derivatives by positions that are not known to be zero, with `has_jacobian`.
        by_v: the same by velocities.
        switches: choices between branches.
        has_jacobian: whether the derivatives have series.
        has_infinite_slopes: whether any of these is infinite where a power begins.
        lanes: arrays have a last axis of lanes.
        is_given: for each array of the force, whether its numbers are given, or else known.
    """

    num_masses: int
    num_numbers: int
    size: int
    operations: tuple[Operation, ...]
    forces: tuple[Operand, ...]
    by_x: dict[tuple[int, int], Operand]
    by_v: dict[tuple[int, int], Operand]
    switches: tuple[Switch, ...]
    has_jacobian: bool
    has_infinite_slopes: bool
    lanes: bool
    is_given: tuple[bool, ...]

    @property
    def num_switches(self) -> int:
        """Number of modes."""
        return len(self.switches)

    @property
    def has_closing_powers(self) -> bool:
        """True if the force has powers of branches, which have no power series in time where they begin at zero."""
        return any(isinstance(operation, Power) and operation.is_clipped for operation in self.operations)

    @property
    def is_singular(self) -> bool:
        """True where the force of a contact that closes has a series in the root of time alone."""
        return any(isinstance(operation, ClosingPower) for operation in self.operations)

    def num_operations(self, order: int) -> int:
        """Estimate of the arithmetic operations of all coefficients below an order."""
        degrees, count = self._degrees(), 0
        for operation in self.operations:
            shortest = inf
            if isinstance(operation, Product | Integral):  # sums of products, as long as the shorter factor
                shortest = min(0.0 if is_known(a) else degrees[a] for a in operation.args)
            count += sum(operation.num_operations(int(min(k, shortest))) for k in range(order))
        return count

    @cached_property
    def moving(self) -> frozenset[int]:
        """Series that change along the motion."""
        return frozenset(series for series, degree in self._degrees().items() if degree)

    def _degrees(self) -> dict[int, float]:
        """Orders beyond which the coefficients of series are known to be zero."""
        first = 1 + self.num_numbers
        found = {0: 1.0, **dict.fromkeys(range(1, first), 0.0)}
        found |= dict.fromkeys(range(first, first + 2 * self.num_masses), inf)
        found |= {switch.mode: 0.0 for switch in self.switches}
        for operation in self.operations:
            own = [found.get(a, 0.0) for a in operation.args if not is_known(a)]
            if isinstance(operation, Fixed):
                degree = 0.0
            elif isinstance(operation, Linear | Slope):
                degree = max(own, default=0.0)
            else:
                degree = sum(own) if isinstance(operation, Product) else inf if any(own) else 0.0
            found[operation.out] = degree
        return found

    def numbers(self, force: Any) -> list[Array]:
        """Numbers of a force as scalars, one for each lane where they differ."""
        leaves = jax.tree.leaves(eqx.filter(force, eqx.is_array))
        given = (a for a, yes in zip(leaves, self.is_given, strict=True) if yes)
        return [row for a in given for row in _scalars(a, lanes=self.lanes)]


def plan_force(force: Any, num_masses: int, *, lanes: bool = False, jacobian: bool = False) -> Plan:
    """Plan the series of a force.

    Args:
        force: function of (t, x, v) for one trajectory, as a pytree. Its JAX arrays are numbers that may change; NumPy
            arrays are known.
        num_masses: n.
        lanes: the arrays of the force have the lanes last, or an axis of length one if all lanes share them.
        jacobian: whether the derivatives by positions and velocities get series too.

    Raises:
        Refused: an operation of the force has no Taylor series.
    """
    arrays, rest = eqx.partition(force, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    dtype = jnp.result_type(float)
    shapes = [jax.ShapeDtypeStruct(_shape_of_one(a, lanes=lanes), a.dtype) for a in leaves]
    is_constant = [
        not isinstance(a, jax.Array) and (not lanes or a.ndim == 0 or a.shape[-1] == 1) for a in leaves
    ]
    numbers = [_known(a, lanes=lanes) if yes else None for a, yes in zip(leaves, is_constant, strict=True)]
    known = [None, *numbers, None, None]
    row = jax.ShapeDtypeStruct((num_masses,), dtype)

    def of_arrays(t: Any, *given: Any) -> Any:
        *own, x, v = given
        return eqx.combine(jax.tree.unflatten(structure, own), rest)(t, x, v)

    nodes, elements = scalars_of(of_arrays, [jax.ShapeDtypeStruct((), dtype), *shapes, row, row], known)
    planner = _Planner(nodes)
    forces = tuple(planner.series(elements))
    build, (x, v) = planner.build, ([planner.at[n] for n in own] for own in nodes[-2:])
    by_x, by_v = (_jacobian(build, forces, own) if jacobian else {} for own in (x, v))
    in_time = _linear_in_time(build)
    switches = tuple(replace(w, is_time=w.guard in in_time) for w in build.switches)
    return Plan(
        num_masses,
        sum(map(len, nodes)) - 1 - 2 * num_masses,
        build.size,
        tuple(build.operations),
        forces,
        by_x,
        by_v,
        switches,
        jacobian,
        has_infinite_slope(build.operations, [*by_x.values(), *by_v.values()]),
        lanes,
        tuple(not yes for yes in is_constant),
    )


def _jacobian(
    build: Builder, forces: Sequence[Operand], leaves: Sequence[int]
) -> dict[tuple[int, int], Operand]:
    columns = [derivatives(build, forces, leaf) for leaf in leaves]
    entries = {(i, j): column[i] for i in range(len(forces)) for j, column in enumerate(columns)}
    return {at: entry for at, entry in entries.items() if not (is_known(entry) and entry == 0)}


class _Planner:
    """Series of scalars."""

    def __init__(self, leaves: Sequence[Sequence[Node]]):
        self.build = Builder()
        self.at: dict[Node, Operand] = {}
        moving = {*leaves[0], *leaves[-2], *leaves[-1]}
        for own in leaves:
            for node in own:
                self.at[node] = self.build.leaf(is_fixed=node not in moving)

    def series(self, elements: Sequence[Any]) -> list[Operand]:
        """Operands of elements."""
        for node in ordered_nodes(elements):
            if node not in self.at:
                self.at[node] = self._of(node)
        return [e if is_known_element(e) else self.at[e] for e in elements]

    def _of(self, node: Node) -> Operand:
        args = [e if is_known_element(e) else self.at[e] for e in node.args]
        if all(map(self.build.is_fixed, args)) and hasattr(node.primitive, "bind"):
            bind = partial(_bind, node.primitive, node.params, node.dtype)
            types = tuple(np.dtype(e.dtype) for e in node.args)
            return self.build.compute(partial(bind, types), args, (node.primitive.name, repr(node.params)))
        return series_of(self.build, node.primitive.name, args, node.params)


def _bind(primitive: Any, params: dict, dtype: Any, types: tuple, *args: Any) -> Any:
    """Primitive of numbers and of arrays over the lanes."""
    shape = np.broadcast_shapes(*(jnp.shape(a) for a in args))
    given = [jnp.broadcast_to(jnp.asarray(a, t), shape) for a, t in zip(args, types, strict=True)]
    return primitive.bind(*given, **params)


def _linear_in_time(build: Builder) -> set[int]:
    """Series that are linear in time between the knots."""
    found = {0}
    for operation in build.operations:
        moving = [a for a in operation.args if not build.is_fixed(a)]
        is_linear = isinstance(operation, Linear) or (isinstance(operation, Product) and len(moving) == 1)
        if is_linear and moving and all(a in found for a in moving):
            found.add(operation.out)
    return found


def _shape_of_one(array: Any, *, lanes: bool) -> tuple[int, ...]:
    return array.shape[:-1] if lanes and array.ndim else array.shape


def _known(array: Any, *, lanes: bool) -> np.ndarray:
    """Numbers that all lanes share, without an axis for the lanes."""
    array = np.asarray(array)
    return array[..., 0] if lanes and array.ndim else array


def _scalars(array: Any, *, lanes: bool) -> list[Array]:
    shape = _shape_of_one(array, lanes=lanes)
    return [array[at] for at in np.ndindex(shape)]
