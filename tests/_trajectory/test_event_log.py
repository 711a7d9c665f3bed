"""Search and sorting of events in the log, against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
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


def test_a_log_grows_with_the_motion_unless_its_length_is_given():
    machine = vx.models.impact_oscillator(1.1, position=0.2, damping_ratio=0.05, restitution=0.8)
    span = 1500 * np.pi
    long, cut = vx.simulate(machine, 0.0, span), vx.simulate(machine, 0.0, span, max_events=2000)
    count = int(long.num_events)
    assert count == long.events.t.shape[0] == cut.num_events > 1024
    np.testing.assert_array_equal(long.events.t, cut.events.t[:count])
    np.testing.assert_array_equal(long.evaluate(span - 1)[0], cut.evaluate(span - 1)[0])
    assert vx.simulate(machine, 0.0, 9.0).events.t.shape == (1024,)


@pytest.mark.slow
def test_a_log_grows_with_the_motion_of_a_machine_of_several_kinds():
    stops = [vx.CompliantStop(0, 0.5, "upper", 40.0, 0.5), vx.Stop(0, -0.5, "lower", 0.8)]
    load, rubs = vx.Harmonic([2.0], 1.3), [vx.Friction(0, 0.1)]
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, stops, friction=rubs)
    long, cut = vx.simulate(machine, 0.0, 1500.0), vx.simulate(machine, 0.0, 1500.0, max_events=4000)
    count = int(long.num_events)
    assert count == long.events.t.shape[0] == int(cut.num_events) > 1024
    np.testing.assert_array_equal(long.events.t, cut.events.t[:count])
    np.testing.assert_array_equal(long.x1, cut.x1)
