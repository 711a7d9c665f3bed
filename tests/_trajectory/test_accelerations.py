"""Accelerations of a run: slopes of its velocities, at saved times, at events, at knots, of held masses, in batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# Step of central differences of the velocity; their error is some 1e-10 of the scales here.
STEP, DIFFERENCE = 1e-5, 3e-9

_KNOTS = np.linspace(0.0, 20.0, 41)
_STEPS = vx.Tabulated(_KNOTS, np.random.default_rng(1).normal(size=(41, 2)), kind="previous")
_COUPLED = (0.1 * np.eye(2), [[2.0, -1.0], [-1.0, 1.5]])
_STOP = vx.Stop(0, 0.5, "upper", 0.7)


def shaken_table() -> vx.ImpactSystem:
    stop = vx.Stop(0, 0.0, "lower", 0.6, motion=vx.Harmonic([0.3], 1.2))
    return vx.ImpactSystem([2.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 1.2, mean=[-2.0]), [stop])


MACHINES = {
    "stops": vx.models.wagg_bishop_a(0.8),
    "steps of the load": vx.ImpactSystem([1.0, 2.0], *_COUPLED, _STEPS, [_STOP]),
    "a full mass matrix": vx.ImpactSystem(
        [[2.0, 0.3], [0.3, 1.0]], *_COUPLED, vx.Harmonic([1.5, 0.0], 0.6), [_STOP]
    ),
    "a moving stop": shaken_table(),
    "friction and a compliant stop": vx.ImpactSystem(
        [1.0, 1.0],
        *_COUPLED,
        vx.Harmonic([1.5, 0.0], 0.6),
        [_STOP, vx.CompliantStop(1, 0.3, "lower", 50.0, 1.0)],
        friction=[vx.Friction(0, 0.1)],
    ),
    "a force": vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([1.5], 0.6), [_STOP], force=vx.models.CubicSpring(1.0)
    ),
}
SHORT = {"stops", "steps of the load"}
CASES = [pytest.param(name, marks=() if name in SHORT else pytest.mark.thorough) for name in MACHINES]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_accelerations_are_slopes_of_velocities(name):
    system = MACHINES[name]
    sol = vx.simulate(system, 0.0, 20.0, x0=[0.5] if name == "a moving stop" else None)
    events = np.asarray(sol.events.t)[: int(sol.num_events)]
    t = np.random.default_rng(3).uniform(0.1, 19.9, 100)
    is_clear = np.abs(np.subtract.outer(t, np.append(events, _KNOTS))).min(axis=1) > 2 * STEP
    t = t[is_clear]
    after, before = (np.asarray(sol.evaluate(t + sign * STEP)[1]) for sign in (1, -1))
    np.testing.assert_allclose(sol.acceleration(t), (after - before) / (2 * STEP), atol=DIFFERENCE * 100)
    assert sol.acceleration(t[:6].reshape(2, 3)).shape == (2, 3, system.num_masses)


def test_at_saved_times_and_knots_they_are_those_after():
    sol = vx.simulate(MACHINES["steps of the load"], 0.0, 20.0, ts=_KNOTS)
    assert sol.accelerations.shape == (41, 2)
    np.testing.assert_array_equal(sol.accelerations, sol.acceleration(_KNOTS))
    np.testing.assert_allclose(sol.accelerations[:-1], sol.acceleration(_KNOTS[:-1] + 1e-9), atol=1e-7)


def test_after_an_impact_the_force_of_the_damper_has_changed():
    """Mass 1, damping c, free of springs and loads: x'' = -c v, of which v has jumped to -r v."""
    system = vx.ImpactSystem([1.0], [[0.3]], [[0.0]], stops=[vx.Stop(0, 1.0, "upper", 0.5)])
    t = -np.log(1 - 0.3 / 2.0) / 0.3  # 2 (1 - exp(-c t)) / c = 1
    sol = vx.simulate(system, 0.0, 2.0, v0=[2.0])
    hit = float(sol.events.t[0])
    assert hit == pytest.approx(t, rel=1e-14)
    assert float(sol.acceleration(hit)[0]) == pytest.approx(0.3 * 0.5 * (2.0 - 0.3), rel=1e-13)
    assert float(sol.acceleration(np.nextafter(hit, 0))[0]) == pytest.approx(-0.3 * (2.0 - 0.3), rel=1e-13)


def test_a_held_mass_has_the_acceleration_of_its_stop():
    """A mass that rests on a table moving by 0.3 cos 1.2 t, whose weight is larger than its inertia."""
    system = shaken_table()
    t = np.linspace(0.0, 5.0, 20)
    sol = vx.simulate(system, 0.0, 5.0, x0=[0.3], v0=[0.0])
    assert sol.stuck1[0]
    np.testing.assert_allclose(sol.acceleration(t)[:, 0], -0.3 * 1.44 * np.cos(1.2 * t), atol=1e-14)
    still = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.0], 0.0, mean=[2.0]), [_STOP])
    np.testing.assert_array_equal(vx.simulate(still, 0.0, 1.0, x0=[0.5]).acceleration(t / 5), 0)


@pytest.mark.slow
def test_batches_traces_and_derivatives():
    ts = jnp.linspace(0.0, 10.0, 5)
    run = lambda w: vx.simulate(vx.models.wagg_bishop_a(w), 0.0, 10.0, ts=ts)  # noqa: E731
    w = jnp.array([0.7, 0.8])
    batch = jax.jit(jax.vmap(run))(w)
    assert batch.accelerations.shape == (2, 5, 2)
    for k in range(2):
        np.testing.assert_allclose(batch.accelerations[k], run(w[k]).accelerations, atol=1e-12)
        np.testing.assert_allclose(batch.acceleration(3.0)[k], run(w[k]).acceleration(3.0), atol=1e-12)
    of_end = lambda w: vx.simulate(vx.models.wagg_bishop_a(w), 0.0, 10.0).acceleration(7.0)[0]  # noqa: E731
    difference = (of_end(0.8 + 1e-6) - of_end(0.8 - 1e-6)) / 2e-6
    assert float(jax.grad(of_end)(0.8)) == pytest.approx(float(difference), rel=1e-7)
    assert float(jax.jacfwd(of_end)(0.8)) == pytest.approx(float(difference), rel=1e-7)


def test_beyond_a_log_that_is_full_they_are_unknown():
    sol = vx.simulate(vx.models.wagg_bishop_a(0.8), 0.0, 50.0, ts=[1.0, 49.0], max_events=2, throw=False)
    assert np.isfinite(sol.accelerations[0]).all()
    assert np.isnan(sol.accelerations[1]).all()
