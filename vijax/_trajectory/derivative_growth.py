"""A warning where derivatives have grown beyond all use: a gradient of 1e28 is a number like any other.

Neighbours of a chaotic motion part by a factor in each period, so that derivatives over hundreds of periods are those of
nothing that can be seen. It shows at the end of the motion, in forward mode, or in what is asked for, in reverse.

What is known is looked at here. Under `jax.jit` nothing is known before the program runs: it calls back, but only
where it may do so anyway, with `throw`, as a program that calls back into Python cannot be kept in a folder.
"""

import warnings
from functools import cache, reduce

import jax
import jax.numpy as jnp
import numpy as np
from equinox.internal import unvmap_max
from jaxtyping import ArrayLike, PyTree

from .._jax.arrays import Reals, concrete
from .solution import Solution

_MOST = 1e20


def warn_if_large(derivatives: PyTree) -> PyTree:
    """The same derivatives, of a trajectory or by what it depends on; warns if some are too large, as far as that is known."""
    _told(_largest(derivatives))
    return derivatives


def watch_closely(derivatives: PyTree) -> PyTree:
    """The same, also where it is known when the program runs."""
    largest = _largest(derivatives)
    if _told(largest):
        return derivatives
    shape = jax.ShapeDtypeStruct((), largest.dtype)

    def tell(largest: ArrayLike) -> ArrayLike:
        _told(largest)
        return np.ones(shape.shape, shape.dtype)

    # The callback is left out where nothing depends on what it returns.
    one = jax.lax.cond(
        largest >= _MOST, lambda: jax.pure_callback(tell, shape, largest), lambda: jnp.ones_like(largest)
    )
    return jax.tree.map(lambda a: a * one.astype(a.dtype), derivatives)


def _largest(derivatives: PyTree) -> Reals:
    """The largest finite magnitude. Of a trajectory its end is looked at, which is computed whatever is asked for."""
    is_forward = isinstance(derivatives, Solution)
    looked_at = jax.tree.leaves((derivatives.x1, derivatives.v1) if is_forward else derivatives)
    # Of JAX every operation would be a program.
    known = [a for a in map(concrete, looked_at) if a is not None]
    if len(known) == len(looked_at):
        return max((np.max(np.abs(a), where=np.isfinite(a), initial=0) for a in known), default=np.zeros(()))
    sizes = [jnp.abs(jax.lax.stop_gradient(a)) for a in looked_at]
    largest = [jnp.max(jnp.where(jnp.isfinite(a), a, 0), initial=0) for a in sizes]
    return unvmap_max(reduce(jnp.maximum, largest))


def _told(largest: ArrayLike) -> bool:
    """Whether the largest derivative is known; warns if it is too large."""
    known = concrete(largest)
    if known is not None and known >= _MOST:
        _warn()
    return known is not None


@cache
def _warn() -> None:
    warnings.warn(
        f"Derivatives through a trajectory have grown to {_MOST:.0e} and more: over so long a span the motion is chaotic, or very "
        "unstable, and what happens there depends on no number in a way that could be used. Differentiate over shorter "
        "spans, join several by multiple shooting, or take the derivatives of a periodic orbit by `vx.periodic_orbit`.",
        stacklevel=2,
    )
