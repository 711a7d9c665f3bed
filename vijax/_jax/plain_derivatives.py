"""Derivatives by public JAX alone, for releases whose internals `differentiable.py` does not know."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, PyTree


@eqx.filter_jit
def plainly_differentiable(function: Callable, smooth: Callable | None, tree: Any) -> Any:
    """`differentiable` from public JAX alone: every derivative is a product with all derivatives, taken forwards."""
    moving, still = eqx.partition(tree, eqx.is_inexact_array)
    arrays, others = eqx.partition(still, eqx.is_array)
    flat, rebuild = ravel_pytree(moving)
    tree_of = lambda x, arrays: eqx.combine(rebuild(x), arrays, others)  # noqa: E731
    whole = lambda x, arrays: function(tree_of(x, arrays))  # noqa: E731
    found = eqx.filter_eval_shape(whole, flat, arrays)
    y, rest = eqx.partition(found, lambda a: isinstance(a, jax.ShapeDtypeStruct))
    wanted = jax.tree.map(lambda a: jnp.issubdtype(a.dtype, jnp.inexact), y)

    def values(x: Array, arrays: PyTree) -> Any:
        return eqx.filter(whole(x, arrays), eqx.is_array)

    def again(x: Array, arrays: PyTree) -> Any:
        tree = tree_of(x, arrays)
        return eqx.filter(function(tree) if smooth is None else smooth(tree, wanted), eqx.is_array)

    return eqx.combine(_by_jacobian(values, again)(flat, arrays), rest)


def _by_jacobian(values: Callable, again: Callable) -> Callable:
    """Function of a vector whose tangents are products with the derivatives of `again`, which are such a function too.

    Both take other arrays besides: JAX may not find traced ones that a rule of derivatives closes over.
    """

    def jacobian(x: Array, arrays: PyTree) -> Any:
        inexact = lambda x: eqx.filter(again(x, arrays), eqx.is_inexact_array)  # noqa: E731
        return jax.jacfwd(inexact)(x)

    @jax.custom_jvp
    def found(x: Array, arrays: PyTree) -> Any:
        return values(x, arrays)

    @found.defjvp
    def _(primals, tangents):
        y = found(*primals)
        slopes = _by_jacobian(jacobian, jacobian)(*primals)
        along = lambda a, slope: _no_tangent(a) if slope is None else slope @ tangents[0]  # noqa: E731
        return y, jax.tree.map(along, y, slopes)

    return found


def _no_tangent(a: Array) -> np.ndarray:
    return np.zeros(a.shape, jax.dtypes.float0)
