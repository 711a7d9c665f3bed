"""NaN in place of what is not known, where a motion ended early."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from .arrays import Reals, is_traced
from .xla import differentiable


def known_or_nan(is_known: Reals, tree: PyTree) -> PyTree:
    """A tree of floating-point arrays, if they are known; otherwise NaN, as are all derivatives.

    A lane of a batch that is not known and that nobody asks about, because a sum leaves it out for instance, spoils no
    derivative by what the lanes share. By JAX's own rule of a product its NaN, times zero, would.
    """
    both = jnp.asarray(is_known), tree
    return differentiable(_known_or_nan, _known_or_nan, both) if is_traced(both) else _known_or_nan(both)


def _known_or_nan(both: tuple[Bool[Array, ""], PyTree]) -> PyTree:
    """A product and no choice, whose derivatives would be zero."""
    is_known, tree = both
    return jax.tree.map(lambda a: a * jnp.where(is_known, 1, jnp.nan).astype(a.dtype), tree)
