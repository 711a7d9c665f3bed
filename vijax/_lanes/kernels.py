"""Functions of one trajectory made into single kernels for many."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._jax.xla import in_one_kernel
from .transform import arrays_read, lanes_last


def kernel_of(function: Callable) -> Callable:
    """A function of one trajectory made into one kernel for many, lanes last."""

    def of_lanes(*args: Any) -> Any:
        # A kernel hands back what it may not read.
        return in_one_kernel(lambda *args: (lanes_last(function)(*args), args), *args)[0]

    return of_lanes


def pruned(function: Callable, tree: Any, *others: Any) -> tuple[Callable, Callable]:
    """Function that picks those arrays of a tree that another one reads, and this other one as a function of them.

    Arguments are shapes.
    """
    shapes, rest = eqx.partition(tree, lambda a: isinstance(a, jax.ShapeDtypeStruct))
    leaves, structure = jax.tree.flatten(shapes)
    is_read = arrays_read(function, tree, *others)[: len(leaves)]
    unread = [None if yes else np.zeros(a.shape, a.dtype) for a, yes in zip(leaves, is_read, strict=True)]

    def picked(tree: Any) -> list:
        arrays = jax.tree.leaves(eqx.filter(tree, eqx.is_array))
        return [a for a, yes in zip(arrays, is_read, strict=True) if yes]

    def of_picked(read: list, *others: Any) -> Any:
        given = iter(read)
        arrays = [next(given) if a is None else jnp.asarray(a) for a in unread]
        return function(eqx.combine(jax.tree.unflatten(structure, arrays), rest), *others)

    return picked, of_picked
