"""Recorded values come back by name, whole numbers exactly."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._execution.records import (
    Impact,
    PeriodEnd,
    append,
    appended_at_once,
    appended_in_turn,
    impact_rows,
    joined,
    mark_rows,
    selected_rows,
    written_rows,
)

# First whole number that 32-bit floats cannot represent.
LARGE = 2**24 + 1
STOPS, LANES = 2, 3
KEPT = np.array([[True, False, True], [True, False, False]])
TIMES = np.array([[0.25, 0.5, 0.75], [1.0, 1.25, 1.5]])


# What `append` is on a processor, and elsewhere.
WAYS = (append, appended_in_turn, appended_at_once)


def recorded(dtype: type, way: Callable) -> Impact:
    """The three impacts of `KEPT`, recorded by a compiled program."""
    impact = Impact(
        time=jnp.asarray(TIMES, dtype),
        velocity=jnp.asarray(-TIMES, dtype),
        chatter=jnp.zeros((STOPS, LANES), dtype),
        stop=jnp.arange(STOPS)[:, None],
        point=LARGE + jnp.arange(LANES),
        number=jnp.full((STOPS, LANES), LARGE),
    )
    return written_rows(jax.jit(way)(impact_rows(8, dtype), jnp.asarray(KEPT), impact))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("is_64_bit", [False, True])
def test_impacts_come_back_in_order_and_whole_numbers_exactly(is_64_bit, way):
    dtype = np.float64 if is_64_bit else np.float32
    with jax.enable_x64(is_64_bit):
        found = recorded(dtype, way)
    assert found.time.dtype == dtype
    np.testing.assert_array_equal(found.time, TIMES[KEPT])
    np.testing.assert_array_equal(found.velocity, -TIMES[KEPT])
    np.testing.assert_array_equal(found.stop, [0, 0, 1])
    np.testing.assert_array_equal(found.point, LARGE + np.array([0, 2, 0]))
    np.testing.assert_array_equal(found.number, [LARGE] * 3)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("is_64_bit", [False, True])
def test_on_the_host_whole_numbers_have_32_bits_whatever_the_device_has(is_64_bit, way):
    """They count points of a queue, stops and rows: more bits would only take memory."""
    with jax.enable_x64(is_64_bit):
        found = recorded(np.float64 if is_64_bit else np.float32, way)
    assert {found.stop.dtype, found.point.dtype, found.number.dtype} == {np.dtype(np.int32)}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("has_growth", [False, True])
@pytest.mark.parametrize("num_stops", [0, 2])
def test_marks_come_back_with_a_column_for_each_mass_and_stop(num_stops, has_growth, way):
    x = jnp.arange(2.0 * LANES).reshape(2, LANES)
    held_time = jnp.ones((num_stops, LANES))
    growth = jnp.concatenate([x, -x]) if has_growth else None
    mark = PeriodEnd(jnp.arange(LANES), jnp.array(LARGE), x=x, v=-x, held_time=held_time, growth=growth)
    room = mark_rows(4, 2, num_stops, np.float64, has_growth=has_growth)
    found = written_rows(way(room, jnp.array([False, True, True]), mark))
    np.testing.assert_array_equal(found.point, [1, 2])
    np.testing.assert_array_equal(found.mark, [LARGE, LARGE])
    np.testing.assert_array_equal(found.x, [[1, 4], [2, 5]])
    np.testing.assert_array_equal(found.v, -found.x)
    np.testing.assert_array_equal(found.held_time, np.ones((2, num_stops)))
    assert (found.growth is not None) == has_growth
    if has_growth:
        np.testing.assert_array_equal(found.growth, np.concatenate([found.x, -found.x], axis=1))


def test_room_is_what_is_left():
    rows = impact_rows(2, np.float64)
    assert rows.has_room(2)
    assert not rows.has_room(3)


def test_rows_are_chosen_and_joined_column_by_column():
    found = recorded(np.float64, append)
    both = joined([selected_rows(found, found.stop == 1), selected_rows(found, found.stop == 0)])
    np.testing.assert_array_equal(both.time, [1.0, 0.25, 0.75])
    np.testing.assert_array_equal(both.point, LARGE + np.array([0, 0, 2]))


@pytest.mark.parametrize(("platform", "is_scattered"), [("cpu", False), ("cuda", True)])
def test_rows_are_scattered_but_for_processors(platform, is_scattered):
    """A kernel of a processor cannot contain a scatter; a graphics card takes 75 microseconds for a turn of a loop."""
    marks = mark_rows(4, 2, 1, np.float64, has_growth=False)
    x = jnp.zeros((2, LANES))
    mark = PeriodEnd(jnp.arange(LANES), jnp.array(0), x=x, v=x, held_time=jnp.zeros((1, LANES)))
    traced = jax.jit(append).trace(marks, jnp.ones(LANES, bool), mark)
    text = traced.lower(lowering_platforms=(platform,)).as_text()
    assert ("stablehlo.scatter" in text) == is_scattered
    assert ("stablehlo.while" in text) != is_scattered
