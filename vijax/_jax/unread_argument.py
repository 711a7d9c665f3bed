"""A fault of XLA's CPU compiler in plain JAX: `python vijax/_jax/unread_argument.py` ends in an abort, JAX 0.10 to 0.12.

`xla_cpu_small_call` makes a call one kernel. XLA simplifies `k * 0`, and JAX or XLA drops the result that hands `k` back,
as nobody uses it. The kernel then has an argument that nothing reads: `ir_emitter.cc: All or none of the slices should
have an explicit index`. With `--barrier` all results are used, as far as both can see, and it prints the right values.
"""

import sys

import jax
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata


def kernel(x: jax.Array, k: jax.Array) -> tuple[jax.Array, jax.Array]:
    """2 sin(x), and an argument that does not matter."""
    return jnp.sin(x) * 2 + k * 0, k


@jax.jit
def caller(x: jax.Array, k: jax.Array) -> jax.Array:
    """The first result of the kernel."""
    with set_xla_metadata(inlineable="false", xla_cpu_small_call="true"):
        found = jax.jit(kernel)(x, k)
    return (jax.lax.optimization_barrier(found) if "--barrier" in sys.argv else found)[0]


if __name__ == "__main__":
    sys.stdout.write(f"{caller(jnp.ones(64), jnp.arange(64))[:3]}\n")
