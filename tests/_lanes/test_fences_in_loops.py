"""Fenced calls in loops: XLA must not take one for unchanged, and lanes may end at different turns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._jax.xla import compute_once, in_one_kernel
from vijax._lanes.transform import lanes_last

# Tests are compiled without the pass that went wrong.
AS_USERS_DO = {"xla_disable_hlo_passes": ""}
X = jnp.linspace(0.2, 3.0, 8)


def turn(x, count):
    """A fenced step that decides itself who goes on."""
    live = jnp.abs(x) > 0.1
    return jnp.where(live, x * 0.7, x), jnp.where(live, count + 1, count)


def counted(step):
    goes_on = lambda carry: jnp.any(jnp.abs(carry[0]) > 0.1)  # noqa: E731
    return lambda x: jax.lax.while_loop(goes_on, lambda carry: step(*carry), (x, jnp.zeros_like(x)))


def expected() -> np.ndarray:
    x, count = np.asarray(X), np.zeros(len(X))
    while np.any(live := np.abs(x) > 0.1):
        x, count = np.where(live, x * 0.7, x), count + live
    return count


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
@pytest.mark.parametrize("is_kernel", [False, True])
def test_a_call_that_is_the_whole_body_of_a_loop_is_computed_in_every_turn(is_kernel, order):
    once = lambda *carry: compute_once(lambda *c: turn(*c)[order], *carry)[order]  # noqa: E731
    loop = counted(once)
    run = (lambda x: in_one_kernel(loop, x)) if is_kernel else loop
    compiled = jax.jit(run, compiler_options=AS_USERS_DO).lower(X).compile()
    # A call that was moved out of the loop would let it run for ever. XLA calls such a loop wide.
    assert "wide." not in str(compiled.as_text())
    np.testing.assert_array_equal(compiled(X)[1], expected())


def lane(x):
    """The loop of one lane, with results that need each other."""

    def body(carry):
        x, count, total = carry
        y = jnp.sin(x) * 0.5 + x * 0.25
        return y, count + 1, total + y * y / (1 + y) + jnp.sqrt(jnp.abs(y))

    return jax.lax.while_loop(lambda c: (jnp.abs(c[0]) > 0.1) & (c[1] < 40), body, (x, 0, 0.0))


def test_final_states_of_lanes_are_the_same_with_and_without_fences():
    runs = [
        jax.jit(lanes_last(lane, fences=fences), compiler_options=AS_USERS_DO)(X) for fences in (True, False)
    ]
    alone = [jnp.stack(column) for column in zip(*(jax.jit(lane)(x) for x in X), strict=True)]
    assert len(set(np.asarray(runs[0][1]).tolist())) > 1, "all lanes end at the same turn"
    for a, b, c in zip(*runs, alone, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)
        np.testing.assert_allclose(a, c, rtol=1e-14)
