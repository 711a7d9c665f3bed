"""Independent lanes in `jax.vmap` and `jax.jit` of `simulate`."""

import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

FREQUENCIES = np.array([0.5, 0.8, 1.1, 1.4, 2.0])
END = 25.0
LOG = 24
# Some hundred roundings; a batch adds up in another order than a single trajectory.
ROUNDING = 1e-13
NUDGE = 1e-8


def run(system, t1, x0) -> vx.Solution:
    return vx.simulate(system, 0.0, t1, x0, max_events=LOG, throw=False)


def run_case_b(frequency, t1, x0) -> vx.Solution:
    return run(vx.models.wagg_bishop_b(frequency), t1, x0)


REST = jnp.zeros(2)
STARTS = jnp.array([[0.0, 0.0], [0.1, -0.2], [-0.3, 0.1], [0.3, 0.05]])
ENDS = jnp.array([0.0, 3.0, 11.7, END])
one = jax.jit(run_case_b)
of_frequency = jax.jit(jax.vmap(run_case_b, in_axes=(0, None, None)))
of_end = jax.jit(jax.vmap(run_case_b, in_axes=(None, 0, None)))
of_start = jax.jit(jax.vmap(run_case_b, in_axes=(None, None, 0)))
of_system = jax.jit(jax.vmap(run, in_axes=(0, None, None)))


def systems(frequencies) -> vx.ImpactSystem:
    """Batch of case (b) machines."""
    return jax.vmap(vx.models.wagg_bishop_b)(jnp.asarray(frequencies))


def lane(batch: vx.Solution, k: int) -> vx.Solution:
    return jax.tree.map(lambda a: a[k] if eqx.is_array(a) else a, batch)


def amplification(frequency, t1, x0) -> float:
    """Factor by which a small change of the start grows until the end."""
    near, far = (one(frequency, t1, x0 + jnp.array([d, -d])) for d in (0.0, NUDGE))
    change = jnp.concatenate([near.x1 - far.x1, near.v1 - far.v1])
    return max(1.0, float(jnp.abs(change).max() / NUDGE))


def assert_same(batch: vx.Solution, k: int, alone: vx.Solution, tolerance: float):
    found = lane(batch, k)
    assert found.result == alone.result
    assert int(found.num_events) == int(alone.num_events)
    for name in ("kind", "stop"):
        np.testing.assert_array_equal(getattr(found.events, name), getattr(alone.events, name))
    for name in ("t", "velocity_minus", "velocity_plus"):
        np.testing.assert_allclose(
            getattr(found.events, name), getattr(alone.events, name), rtol=0, atol=tolerance * END
        )
    for name in ("x1", "v1", "xs", "vs"):
        np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=0, atol=tolerance)
    np.testing.assert_array_equal(found.stuck1, alone.stuck1)


@pytest.mark.thorough
def test_a_batch_over_frequencies_equals_a_loop():
    batch = of_system(systems(FREQUENCIES), END, REST)
    assert int(batch.num_events.min()) > 3
    for k, frequency in enumerate(FREQUENCIES):
        alone = one(frequency, END, REST)
        assert_same(batch, k, alone, ROUNDING * amplification(frequency, END, REST))


@pytest.mark.slow
def test_a_batch_over_starts_equals_a_loop():
    # The last two start on the lower stop of mass 0 and away from the stops.
    batch = of_start(0.8, END, STARTS)
    for k, start in enumerate(STARTS):
        tolerance = ROUNDING * (1.0 if k == 2 else amplification(0.8, END, start))
        assert_same(batch, k, one(0.8, END, start), max(tolerance, 100 * ROUNDING))


@pytest.mark.slow
def test_a_batch_over_end_times_equals_a_loop():
    batch = of_end(0.8, ENDS, REST)
    np.testing.assert_array_equal(lane(batch, 0).x1, REST)
    for k, end in enumerate(ENDS):
        assert_same(batch, k, one(0.8, end, REST), 100 * ROUNDING)


@pytest.mark.slow
def test_a_batch_over_systems_equals_a_batch_over_what_they_are_made_of():
    made_inside = of_frequency(jnp.asarray(FREQUENCIES), END, REST)
    made_outside = of_system(systems(FREQUENCIES), END, REST)
    for k, frequency in enumerate(FREQUENCIES):
        tolerance = ROUNDING * amplification(frequency, END, REST)
        assert_same(made_outside, k, lane(made_inside, k), tolerance)


def test_under_jit_it_gives_what_it_gives_without():
    plain = run_case_b(0.8, END, REST)
    jitted = one(0.8, END, REST)
    assert plain.result == vx.RESULTS.successful
    np.testing.assert_array_equal(plain.events.kind, jitted.events.kind)
    np.testing.assert_allclose(plain.x1, jitted.x1, rtol=0, atol=100 * ROUNDING)
    np.testing.assert_allclose(plain.v1, jitted.v1, rtol=0, atol=100 * ROUNDING)


FAILURES = {
    "damping of NaN": (lambda s: s.damping, jnp.full((2, 2), jnp.nan), "non_finite"),
    "load without bound": (lambda s: s.forcing.amplitude, jnp.full(2, jnp.inf), "non_finite"),
    "growing motion": (lambda s: s.stiffness, jnp.full((2, 2), -1e4), "non_finite"),
    "too many events": (
        lambda s: (s.stops[0].position, s.stops[1].position),
        (jnp.array(-0.01), jnp.array(0.01)),
        "max_events_reached",
    ),
}


# All lanes take one of two branches, depending on whether any lane sticks. Both compute the same, but programs
# compiled without optimisation round differently.
bit_for_bit = pytest.mark.skipif("VIJAX_COMPILE_FULLY" not in os.environ, reason="see conftest.py")


@bit_for_bit
@pytest.mark.parametrize("name", FAILURES)
def test_a_lane_that_fails_leaves_the_others_alone_bit_for_bit(name):
    where, bad, code = FAILURES[name]
    sound = systems(FREQUENCIES)
    replace = lambda old, new: old.at[2].set(new)  # noqa: E731
    broken = eqx.tree_at(where, sound, jax.tree.map(replace, where(sound), bad))
    before, after = (of_system(s, END, REST) for s in (sound, broken))
    assert lane(after, 2).result == getattr(vx.RESULTS, code)
    for k in (0, 1, 3, 4):
        assert lane(before, k).result == vx.RESULTS.successful
        old, new = (jax.tree.leaves(eqx.filter(lane(b, k), eqx.is_array)) for b in (before, after))
        for a, b in zip(old, new, strict=True):
            np.testing.assert_array_equal(a, b)


@bit_for_bit
def test_a_lane_that_starts_beyond_a_stop_is_told_so_and_leaves_the_others_alone():
    sound = of_start(0.8, END, STARTS)
    unsound = of_start(0.8, END, STARTS.at[1, 1].set(0.2))
    assert lane(unsound, 1).result == vx.RESULTS.unsound_start
    for k in (0, 2, 3):
        assert lane(unsound, k).result == vx.RESULTS.successful
        np.testing.assert_array_equal(unsound.x1[k], sound.x1[k])
        np.testing.assert_array_equal(unsound.events.t[k], sound.events.t[k])


@pytest.mark.slow
def test_a_lane_that_has_ended_takes_no_more_steps():
    starts = STARTS.at[1, 1].set(0.2).at[2, 0].set(1.7e308)
    batch = of_start(0.8, END, starts)
    assert lane(batch, 0).num_steps > 20
    assert (lane(batch, 1).result, int(lane(batch, 1).num_steps)) == (vx.RESULTS.unsound_start, 0)
    np.testing.assert_array_equal(lane(batch, 1).x1, starts[1])
    assert (lane(batch, 2).result, int(lane(batch, 2).num_steps)) == (vx.RESULTS.non_finite, 1)


@pytest.mark.slow
@pytest.mark.parametrize("n", [5, 8])
def test_a_large_batch_of_a_large_machine_is_compiled(n):
    """With so many lanes XLA would divide operations of the kernel among threads, which it cannot compile."""
    stops = [vx.Stop(i, 0.3, "upper", 0.7) for i in range(n)]
    load = vx.Harmonic([0.3] + [0.0] * (n - 1), 0.8)
    system = vx.chain([1.0] * n, [0.1] * n, [1.0] * n, load, stops)
    ends = jax.jit(jax.vmap(lambda x0: run(system, END, x0).x1))(jnp.zeros((256, n)))
    np.testing.assert_allclose(ends, np.tile(run(system, END, jnp.zeros(n)).x1, (256, 1)), atol=1e-12)
