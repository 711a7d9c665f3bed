"""Search and sorting of events in the log, against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._trajectory.event_log import _count_places, _flag_of_number, _in_order, _split


@pytest.mark.parametrize("shape", [(40, 6), (3, 3), (9, 30)])
@pytest.mark.parametrize("room", [3, 40])
def test_flags_are_found_row_by_row(shape, room):
    flags = np.random.default_rng(0).random(shape) < 0.3
    expected = np.argwhere(flags)[:room]
    row, number = _split(jax.jit(_count_places, static_argnums=1)(jnp.asarray(flags), room), shape[1])
    found = np.stack([row, _flag_of_number(jnp.asarray(flags)[row], number)], axis=1)
    np.testing.assert_array_equal(found[: len(expected)], expected)


@pytest.mark.parametrize("size", [0, 1, 2, 3, 17, 64])
def test_lanes_of_times_are_ordered_like_by_a_stable_sort(size):
    times = np.random.default_rng(0).integers(0, 9, (5, size)).astype(float)
    events = np.broadcast_to(np.arange(size), times.shape)
    found = jax.jit(jax.vmap(_in_order))(jnp.asarray(times), jnp.asarray(events))
    np.testing.assert_array_equal(found, np.argsort(times, axis=1, kind="stable"))
