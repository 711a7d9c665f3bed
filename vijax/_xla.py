"""What the compiler needs to be told."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Bool


def compute_once(always: Bool[Array, ""], function: Callable, *args):
    """Call `function` so that XLA computes what it shares once, not once per result.

    On a CPU XLA fuses every result of a loop body separately and repeats in each whatever they share.
    A conditional ends a fusion. `always` is True, but traced, so that it is not optimised away, and
    without lanes, so that it stays a conditional.
    """
    shapes = jax.eval_shape(function, *args)
    zeros = lambda *_: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)  # noqa: E731
    return jax.lax.cond(always, function, zeros, *args)


def while_any(is_live: Callable, step: Callable, carry):
    """Loop `step` while `is_live(carry)`, for any lane of a `vmap`.

    `step` itself must leave a lane alone that is not live. A plain `while_loop` under `vmap` copies
    the whole carry each time to do that, logs and all.
    """
    return jax.lax.while_loop(lambda c: unvmap_any(is_live(c)), step, carry)
