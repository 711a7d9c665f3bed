"""Powers of affine maps by repeated squaring."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

_Map = tuple[Array, Array, Array]


def affine_power(
    function: Callable[[Array], Array],
    z: Float[Array, " n"],
    count: Int[Array, ""],
    digits: int | None = None,
) -> Float[Array, " n"]:
    """Value after `count` applications of an affine function.

    Args:
        function: the function.
        z: the value before.
        count: number of applications.
        digits: binary digits of `count`, which a scan traverses: it has reverse derivatives. A loop over those that it has
            if left out.
    """
    origin = jnp.zeros_like(z)
    start = z, jax.jacfwd(function)(origin), function(origin)

    def squared(carry: _Map, is_one: Array) -> _Map:
        z, matrix, shift = carry
        z = jnp.where(is_one, matrix @ z + shift, z)
        return z, matrix @ matrix, matrix @ shift + shift

    if digits is not None:
        end, _ = jax.lax.scan(
            lambda carry, k: (squared(carry, (count >> k) & 1 > 0), None), start, jnp.arange(digits)
        )
        return end[0]
    halved = lambda carry: (squared(carry[0], carry[1] % 2 == 1), carry[1] // 2)  # noqa: E731
    return jax.lax.while_loop(lambda carry: carry[1] > 0, halved, (start, count))[0][0]
