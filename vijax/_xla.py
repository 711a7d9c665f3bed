"""What the compiler needs to be told."""

import os

from collections.abc import Callable

import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any
from jaxtyping import Array, Bool


def ask_for_fused_loops() -> None:
    """Let XLA compute what several results of a loop share once instead of once per result.

    On a CPU that is an option of XLA, off by default, which makes the loops of this library 2 to 5
    times faster and quicker to compile (measured with jaxlib 0.10.2; results are unchanged). It
    can only be given in the environment, before JAX first computes anything: import vijax before. An
    `XLA_FLAGS` that already holds backend options is left alone.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if "xla_backend_extra_options" not in flags:
        option = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion"
        os.environ["XLA_FLAGS"] = f"{flags} {option}".strip()


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
