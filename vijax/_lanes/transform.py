"""`lanes_last`: a function of one trajectory, made into one of many."""

from collections.abc import Callable
from functools import wraps
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .control import needs_of  # and its rules
from .elements import as_elements, shaped
from .emission import emit
from .graph import Node, is_known
from .rules import Program


def lanes_last(function: Callable, *, fences: bool = True) -> Callable:
    """Make a function of one trajectory a function of many, with a lane axis last on every array.

    `function` is traced once; every element of its arrays then becomes an array over the lanes of its own, the form
    that a CPU vectorises. Moving elements is free; contractions are written out; equal operations are one; results
    that nothing needs are not computed. Compilation takes 2 to 3 ms an operation.

    Arguments and results are pytrees. The last axis of an array is that of the lanes, or has length one if all lanes
    share it, as have arrays without axes; what depends on shared numbers alone is computed once. NumPy arrays without
    lanes are constants. Other leaves are static.

    - Known numbers are folded: 0 * x and 0 / x are 0 whatever x is, NaN too, x + 0 is x, x * 1 is x. A division by a
      power of two becomes a product. Results may differ from those of `jax.vmap` by rounding.
    - Each lane has the numbers that it has among any others.
    - `cond` and `switch` with an index that is the same for all lanes, as from `is_any`, compute one case. Others
      become selections. `while_loop` ends with its last lane. `scan` is written out.
    - Derivatives belong inside of `function`. The result is no subject of `jax.grad` or `jax.vmap`.
    - Inside `in_one_kernel` as well as outside.

    Args:
        function: plain `jnp` for one trajectory.
        fences: compute once what several results share. Without, the numbers are the same to rounding.

    Returns:
        A function of the same arguments. It raises NotImplementedError for a primitive that it does not know.
    """

    @wraps(function)
    def of_lanes(*args: Any, **kwargs: Any) -> Any:
        arrays, static = eqx.partition((args, kwargs), eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        lanes = _num_lanes(leaves)
        is_constant = [isinstance(a, np.ndarray | np.generic) and _is_single(a, lanes) for a in leaves]
        found: list[Any] = []

        def of_one(leaves: list) -> list:
            args, kwargs = eqx.combine(jax.tree.unflatten(structure, leaves), static)
            given, others = eqx.partition(function(*args, **kwargs), eqx.is_array)
            found.append(others)
            given, tree = jax.tree.flatten(given)
            found.append(tree)
            return given

        closed = jax.make_jaxpr(of_one)([_one(a) for a in leaves])
        others, tree = found[-2:]
        program, values = Program(), {}
        given = [
            _constant(a) if known else _leaves(jnp.asarray(a), lanes, values)
            for a, known in zip(leaves, is_constant, strict=True)
        ]
        outs = program.run(closed, given)
        elements = [element for out in outs for element in out.flat]
        rows = iter(emit(elements, values, lanes, [False] * len(elements), fences=fences))
        stacked = [
            _stacked([next(rows) for _ in range(out.size)], out.shape, lanes, v.aval.dtype)
            for out, v in zip(outs, closed.jaxpr.outvars, strict=True)
        ]
        return eqx.combine(jax.tree.unflatten(tree, stacked), others)

    return of_lanes


def arrays_read(function: Callable, *args: Any) -> list[bool]:
    """For each array among the arguments, in order, whether a result of a function of one trajectory depends on it.

    Arguments may be shapes. What a result depends on only through a loop or a choice of all lanes counts as read.
    """
    arrays, static = eqx.partition(args, lambda a: eqx.is_array(a) or isinstance(a, jax.ShapeDtypeStruct))
    leaves, structure = jax.tree.flatten(arrays)

    def of_arrays(leaves: list) -> list:
        found = function(*eqx.combine(jax.tree.unflatten(structure, leaves), static))
        return jax.tree.leaves(eqx.filter(found, eqx.is_array))

    closed = jax.make_jaxpr(of_arrays)([jax.ShapeDtypeStruct(a.shape, a.dtype) for a in leaves])
    given = [
        shaped([Node(None, (), {}, a.dtype, False) for _ in range(int(np.prod(a.shape, dtype=int)))], a.shape)
        for a in leaves
    ]
    waiting = [e for out in Program().run(closed, given) for e in out.flat if not is_known(e)]
    needed: set[Node] = set()
    while waiting:
        node = waiting.pop()
        if node not in needed:
            needed.add(node)
            waiting.extend(needs_of(node))
    return [any(element in needed for element in own.flat) for own in given]


def _num_lanes(leaves: list) -> int:
    sizes = {a.shape[-1] for a in leaves if a.ndim} - {1}
    if len(sizes) > 1:
        raise ValueError(
            f"The last axes must have one length, or length one, but have the lengths {sorted(sizes)}."
        )
    return sizes.pop() if sizes else 1


def _is_single(array: Any, lanes: int) -> bool:
    return array.ndim == 0 or (array.shape[-1] == 1 and lanes > 1)


def _one(array: Any) -> jax.ShapeDtypeStruct:
    """Shape and type of an array for one trajectory."""
    return jax.ShapeDtypeStruct(array.shape[:-1], array.dtype, weak_type=getattr(array, "weak_type", False))


def _constant(array: Any) -> np.ndarray:
    array = np.asarray(array)
    return as_elements(array[..., 0] if array.ndim else array)


def _leaves(array: jax.Array, lanes: int, values: dict[Node, Any]) -> np.ndarray:
    """A leaf for every element of an argument; `values` takes its numbers."""
    shared = _is_single(array, lanes)
    shape = array.shape[:-1]
    leaves = [Node(None, (), {}, array.dtype, shared) for _ in range(int(np.prod(shape, dtype=int)))]
    for at, leaf in zip(np.ndindex(shape), leaves, strict=True):
        values[leaf] = array[(*at, 0)] if shared and array.ndim else array[at]
    return shaped(leaves, shape)


def _stacked(rows: list, shape: tuple[int, ...], lanes: int, dtype: Any) -> jax.Array:
    if not shape:
        return rows[0]
    if not rows:
        return jnp.zeros((*shape, lanes), dtype)
    return jnp.stack(rows).reshape(*shape, lanes)
