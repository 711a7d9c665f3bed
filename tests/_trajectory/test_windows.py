"""A concrete trajectory, computed call by call, equals that of one call with traced values."""

import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

# Some roundings of the time.
ROUNDING = 1e-15
LONG = 3000.0
MACHINE = vx.models.wagg_bishop_b(0.3)


def known_and_traced(t1: float, **options) -> tuple[vx.Solution, vx.Solution]:
    traced = jax.jit(lambda t0: vx.simulate(MACHINE, t0, t1, **options))
    return vx.simulate(MACHINE, 0.0, t1, **options), traced(jnp.zeros(()))


def assert_same(ours: vx.Solution, other: vx.Solution) -> None:
    scale = max(float(ours.t1), 1.0)
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(other), strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        np.testing.assert_allclose(a, b, rtol=0, atol=100 * ROUNDING * scale)


@pytest.mark.parametrize(
    ("max_events", "times"),
    [(0, [100.0]), (7, []), (1500, [0.0, 0.0, 50.0, 50.0])],
)
def test_a_log_of_any_length_and_any_number_of_saved_states_are_the_same(max_events, times):
    ours, other = known_and_traced(100.0, max_events=max_events, ts=np.array(times), throw=False)
    assert_same(ours, other)
    assert int(ours.num_events) <= max_events


@pytest.mark.parametrize("max_events", [2000, 20_000])
def test_more_events_and_saved_states_than_one_call_holds_are_joined(max_events):
    ours, other = known_and_traced(LONG, max_events=max_events, ts=np.linspace(0.0, LONG, 700), throw=False)
    assert int(other.num_events) > 1500
    assert_same(ours, other)


def test_a_motion_that_ends_too_early_fills_up_what_was_asked_with_its_end():
    ours, other = known_and_traced(100.0, ts=np.linspace(0.0, 100.0, 600), max_steps=57, throw=False)
    assert ours.result == vx.RESULTS.max_steps_reached
    assert_same(ours, other)
    assert (np.asarray(ours.xs[-300:]) == np.asarray(ours.x1)).all()


def test_saved_states_are_those_that_are_evaluated():
    times = np.linspace(0.0, LONG, 1001)
    sol = vx.simulate(MACHINE, 0.0, LONG, ts=times, max_events=20_000)
    x, v = sol.evaluate(times)
    np.testing.assert_allclose(x, sol.xs, rtol=0, atol=100 * ROUNDING)
    np.testing.assert_allclose(v, sol.vs, rtol=0, atol=100 * ROUNDING)


def test_threads_do_not_disturb_each_other():
    frequencies, ends = 0.3 + 0.1 * np.arange(6), [None] * 6

    def follow(k: int) -> None:
        ends[k] = vx.simulate(vx.models.wagg_bishop_b(frequencies[k]), 0.0, 50.0).x1

    threads = [threading.Thread(target=follow, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for frequency, end in zip(frequencies, ends, strict=True):
        np.testing.assert_array_equal(end, vx.simulate(vx.models.wagg_bishop_b(frequency), 0.0, 50.0).x1)
