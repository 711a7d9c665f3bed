"""Warning about derivatives that have grown beyond use: a gradient of 1e28 looks like any other number.

Neighbours of a chaotic motion separate by a factor in each period, so derivatives over hundreds of periods describe
nothing observable. In forward mode the growth shows at the end of the motion, in reverse mode in the result.

Concrete values are tested here. Under `jax.jit` none is concrete before the program runs, so the program calls back,
but only with `throw`, where it does so anyway: a program with callbacks into Python cannot be cached on disk.
"""

import warnings
from functools import cache, reduce

import jax
import jax.numpy as jnp
import numpy as np
from equinox.internal import unvmap_max
from jaxtyping import ArrayLike, PyTree

from .._jax.arrays import Reals
from .._jax.concrete import concrete
from .solution import Solution

_MOST = 1e20


def warn_if_large(derivatives: PyTree) -> PyTree:
    """Return derivatives, of a trajectory or by its arguments, unchanged; warn if concrete ones are too large."""
    _told(_largest(derivatives))
    return derivatives


def watch_closely(derivatives: PyTree) -> PyTree:
    """`warn_if_large` that also warns when a compiled program runs."""
    largest = _largest(derivatives)
    if _told(largest):
        return derivatives
    shape = jax.ShapeDtypeStruct((), largest.dtype)

    def tell(largest: ArrayLike) -> ArrayLike:
        _told(largest)
        return np.ones(shape.shape, shape.dtype)

    # JAX drops a callback whose result is not used.
    one = jax.lax.cond(
        largest >= _MOST, lambda: jax.pure_callback(tell, shape, largest), lambda: jnp.ones_like(largest)
    )
    return jax.tree.map(lambda a: a * one.astype(a.dtype), derivatives)


def _largest(derivatives: PyTree) -> Reals:
    """Largest finite magnitude; of a trajectory that of its end, which is always computed."""
    is_forward = isinstance(derivatives, Solution)
    looked_at = jax.tree.leaves((derivatives.x1, derivatives.v1) if is_forward else derivatives)
    # By NumPy: in JAX every operation would compile a program.
    known = [a for a in map(concrete, looked_at) if a is not None]
    if len(known) == len(looked_at):
        return max((np.max(np.abs(a), where=np.isfinite(a), initial=0) for a in known), default=np.zeros(()))
    sizes = [jnp.abs(jax.lax.stop_gradient(a)) for a in looked_at]
    largest = [jnp.max(jnp.where(jnp.isfinite(a), a, 0), initial=0) for a in sizes]
    return unvmap_max(reduce(jnp.maximum, largest))


def _told(largest: ArrayLike) -> bool:
    """Test whether the largest derivative is concrete; warn if it is too large."""
    known = concrete(largest)
    if known is not None and known >= _MOST:
        _warn()
    return known is not None


@cache
def _warn() -> None:
    warnings.warn(
        f"Derivatives through a trajectory have grown to {_MOST:.0e} and more: over this span the motion is chaotic or very "
        "unstable, and its derivatives are useless. Differentiate over shorter "
        "spans, join several by multiple shooting, or take the derivatives of a periodic orbit by `vx.periodic_orbit`.",
        stacklevel=2,
    )
