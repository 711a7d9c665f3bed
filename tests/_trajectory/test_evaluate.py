"""`Solution.evaluate` is as exact as the states saved at `ts`, at all times."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

FREQUENCY = 0.9
PERIOD = 2 * np.pi / FREQUENCY


def quiet(damping=0.02, frequency=FREQUENCY) -> vx.ImpactSystem:
    """Two masses that never hit their stop."""
    load = vx.Harmonic([0.1, 0.02], frequency)
    return vx.chain([1.0, 0.8], [damping, damping], [1.0, 1.3], load, [vx.Stop(1, 50.0, "upper", 0.7)])


MACHINES = {
    "damped": quiet(),
    "undamped": quiet(0.0),
    "constant load": vx.chain([1.0], [0.01], [1.0], vx.Harmonic([0.5], 0.0), [vx.Stop(0, 9.0, "upper", 0.7)]),
    "held": vx.chain(
        [1.0, 1.0], [0.05, 0.05], [1.0, 1.0], vx.Harmonic([0.1, 0.0], 0.9, mean=[0.0, 3.0]), [vx.Stop(1, 0.3)]
    ),
}


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("periods", [3, 1000, 20_000, pytest.param(100_000, marks=pytest.mark.thorough)])
@pytest.mark.slow
def test_it_agrees_with_saved_states_long_after_the_last_event(name, periods):
    system = MACHINES[name]
    start = ([0.3, 0.0] if name == "held" else [0.5] * system.num_masses)[: system.num_masses]
    if name == "held":
        start = [0.0, 0.3]
    end = (periods + 1) * PERIOD
    ts = periods * PERIOD + np.array([0.0, 0.123, 2.5, PERIOD])
    sol = vx.simulate(system, 0.0, end, start, ts=ts)
    assert sol.num_events == 0
    x, v = sol.evaluate(ts)
    # Each unit of time costs a rounding, as the time itself is rounded; an undamped motion keeps all of them.
    tolerance = 1e-14 * (10 + end)
    np.testing.assert_allclose(x, sol.xs, rtol=0, atol=tolerance)
    np.testing.assert_allclose(v, sol.vs, rtol=0, atol=tolerance)


@pytest.mark.thorough
def test_it_agrees_with_an_exact_answer_after_a_hundred_thousand_periods():
    """One undamped mass at rest under a load far from resonance: x = a (cos W t - cos w t)."""
    w, frequency, force = 1.0, 0.5, 0.3
    load = vx.Harmonic([force], frequency)
    system = vx.ImpactSystem([1.0], [[0.0]], [[w * w]], load, [vx.Stop(0, 9.0, "upper", 0.7)])
    end = 2 * np.pi / frequency * 100_000
    sol = vx.simulate(system, 0.0, end)
    t = np.array([end - 7.7, end])
    x, _ = sol.evaluate(t)
    a = force / (w * w - frequency * frequency)
    # The time is rounded to 1e-10, and W t with it.
    np.testing.assert_allclose(x[:, 0], a * (np.cos(frequency * t) - np.cos(w * t)), rtol=0, atol=1e-9)


@pytest.mark.slow
def test_its_cost_does_not_grow_with_the_distance_from_the_last_event():
    """Steps of a loop cannot be counted from outside, but steps over a hundred million periods would take minutes."""
    end = 1e8 * PERIOD
    early = vx.simulate(quiet(), 0.0, 10.0, [0.5, 0.5])
    sol = eqx.tree_at(lambda s: (s.t1, s.known_until), early, (jnp.asarray(end), jnp.asarray(end)))
    x, v = sol.evaluate(end - 1.0)
    assert np.isfinite(x).all()
    assert np.isfinite(v).all()


@pytest.mark.slow
def test_a_motion_of_a_solver_goes_on_for_periods_as_well():
    system = vx.models.duffing_oscillator(1.0)
    ts = np.linspace(0.0, 60.0, 7)
    sol = vx.simulate(system, 0.0, 60.0, ts=ts)
    x, v = sol.evaluate(ts)
    np.testing.assert_allclose(x, sol.xs, atol=1e-8)
    np.testing.assert_allclose(v, sol.vs, atol=1e-8)


@pytest.fixture(scope="module")
def short() -> tuple[vx.Solution, Callable]:
    """A motion, and its positions as a compiled function of time."""
    sol = vx.simulate(quiet(), 0.0, 10.0)
    return sol, jax.jit(lambda t: sol.evaluate(t)[0])


@pytest.mark.parametrize("t", [-0.1, 10.1, np.nan, [1.0, 11.0]])
def test_times_outside_are_refused(short, t):
    sol, positions = short
    with pytest.raises(ValueError, match=r"Argument `t` must lie within \[t0, t1\]"):
        sol.evaluate(t)
    with pytest.raises(ValueError, match=r"Argument `t` must lie within \[t0, t1\]"):
        sol.contact_force(t)
    with pytest.raises((RuntimeError, ValueError), match=r"Argument `t` must lie within \[t0, t1\]"):
        jax.block_until_ready(positions(np.resize(t, 2)))


def test_an_end_that_rounding_moved_is_inside():
    sol = vx.simulate(quiet(), 0.0, 0.3)
    x, _ = sol.evaluate(0.1 + 0.2)
    np.testing.assert_array_equal(x, sol.x1)
