"""Events are found in the log, and put in order, as NumPy does both."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._trajectory.event_log import _in_order, _places


@pytest.mark.parametrize("shape", [(40, 6), (3, 3), (9, 30)])
@pytest.mark.parametrize("room", [3, 40])
def test_flags_are_found_row_by_row(shape, room):
    flags = np.random.default_rng(0).random(shape) < 0.3
    expected = np.argwhere(flags)[:room]
    found = np.stack(jax.jit(_places, static_argnums=1)(jnp.asarray(flags), room), axis=1)
    np.testing.assert_array_equal(found[: len(expected)], expected)


@pytest.mark.parametrize("size", [0, 1, 2, 3, 17, 64])
def test_lanes_of_times_are_ordered_like_by_a_stable_sort(size):
    times = np.random.default_rng(0).integers(0, 9, (5, size)).astype(float)
    found = jax.jit(jax.vmap(_in_order))(jnp.asarray(times))
    np.testing.assert_array_equal(found, np.argsort(times, axis=1, kind="stable"))
