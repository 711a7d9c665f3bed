"""NaN in place of unknown values, where a motion ended early."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from .arrays import Reals
from .concrete import is_traced
from .xla import differentiable


def known_or_nan(is_known: Reals, tree: PyTree) -> PyTree:
    """Return a tree of floating-point arrays if its values are known; otherwise NaN, in values and derivatives.

    An unknown lane of a batch that does not enter the result, left out of a sum for instance, spoils no derivative
    with respect to numbers that the lanes share. By JAX's own product rule its NaN, times zero, would.
    """
    both = jnp.asarray(is_known), tree
    return differentiable(_known_or_nan, both) if is_traced(both) else _known_or_nan(both)


def _known_or_nan(both: tuple[Bool[Array, ""], PyTree]) -> PyTree:
    """Multiply by 1 or NaN; a choice by `jnp.where` would have zero derivatives."""
    is_known, tree = both
    return jax.tree.map(lambda a: a * jnp.where(is_known, 1, jnp.nan).astype(a.dtype), tree)
