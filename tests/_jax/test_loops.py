"""Loops under `vmap`: their bodies are traced once, with the same results."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from vijax._jax.xla import in_lanes_of


def batched_loop(*, is_prepared: bool) -> tuple[list[int], tuple[Array, ...]]:
    """Sizes of the batches for which the body of a loop was traced, and the results; two of its numbers begin alike."""
    traced = []

    @jax.custom_batching.custom_vmap
    def following(x):
        return x + 1

    @following.def_vmap
    def _(size, batched, x):
        traced.append(size)
        return x + 1, batched[0]

    def of_one(x):
        carry = jnp.zeros(()), jnp.zeros(()), x
        carry = in_lanes_of(x, carry) if is_prepared else carry
        return jax.lax.while_loop(lambda c: c[2] < 3, lambda c: (c[1], c[2], following(c[2])), carry)

    return traced, jax.vmap(of_one)(jnp.arange(3.0))


def test_a_body_is_traced_once_for_a_batch_if_all_that_is_carried_is_of_its_lanes():
    traced, found = batched_loop(is_prepared=True)
    again, expected = batched_loop(is_prepared=False)
    assert traced == [3]
    assert len(again) > 1
    np.testing.assert_array_equal(found, expected)
