"""Derivatives from the flights of a trajectory are those of all its steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import slow_except
from jaxtyping import Array

import vijax as vx
from vijax._trajectory import single_call

# Derivatives of the order of one to a hundred, by two orders of the same operations; chatter magnifies a little more.
ROUNDING = 1e-11
TIMES = np.array([0.3, 0.7, 1.0])
MACHINES = {
    "no stops": (vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], vx.Harmonic([1.0, 0.0], 0.8), []), 12.0, 0.0),
    "sticking": (vx.models.wagg_bishop_b(0.3), 30.0, 0.0),
    "moving stop": (vx.models.ball_on_table(9.0, 0.2), 6.0, 0.01),
    "contacts": (vx.models.impact_damper(1.0), 12.0, 0.0),
    "full mass": (vx.models.cantilever(2.0, num_elements=1), 12.0, 0.0),
}


def described(
    system: vx.ImpactSystem, end: float, x: Array, scale: Array, max_events: int = 300
) -> list[Array]:
    """All floating-point results of a trajectory, by its start and a factor of its load."""
    system = eqx.tree_at(lambda s: s.forcing.amplitude, system, scale * system.forcing.amplitude)
    system = eqx.tree_at(lambda s: s.forcing.frequency, system, scale * system.forcing.frequency)
    x0 = jnp.zeros(system.num_masses).at[0].set(x)
    sol = vx.simulate(system, 0.0, end, x0, ts=end * TIMES, max_events=max_events, throw=False)
    x_between, v_between = sol.evaluate(end * np.array([0.11, 0.55, 0.9]))
    events = [sol.events.t, sol.events.velocity_minus, sol.events.velocity_plus, sol.events.impulse]
    return [sol.x1, sol.v1, sol.xs, sol.vs, x_between, v_between, *events]


def slopes(system: vx.ImpactSystem, end: float, x: Array) -> list[Array]:
    of = lambda x, scale: described(system, end, x, scale)  # noqa: E731
    return jax.jit(jax.jacfwd(of, (0, 1)))(x, jnp.asarray(1.0))


def along_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Differentiate through every step, as where a flow has no flow map."""
    monkeypatch.setattr(single_call, "_repeat_whole", lambda whole, wanted: single_call._run_whole(whole))


def assert_alike(found: list[Array], expected: list[Array]) -> None:
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        known = np.isfinite(b)
        np.testing.assert_array_equal(np.isfinite(a), known)
        size = np.maximum(1.0, np.max(np.abs(b), where=known, initial=0.0))
        np.testing.assert_allclose(np.where(known, a, 0), np.where(known, b, 0), rtol=0, atol=ROUNDING * size)


@pytest.mark.slow
@pytest.mark.parametrize("name", slow_except(["sticking"], MACHINES))
def test_all_derivatives_are_those_of_the_steps(name, monkeypatch):
    system, end, x = MACHINES[name]
    found = slopes(system, end, jnp.asarray(x))
    along_the_steps(monkeypatch)
    assert_alike(found, slopes(system, end, jnp.asarray(x)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sticking", "moving stop", "contacts"])
def test_derivatives_of_a_batch_are_those_of_its_lanes(name):
    system, end, x = MACHINES[name]
    starts = x + jnp.array([0.0, 1e-3, 2e-3]) * (1 if name == "moving stop" else -1)
    batch = jax.jit(jax.vmap(lambda x: slopes(system, end, x)))(starts)
    for k, start in enumerate(starts):
        assert_alike(jax.tree.map(lambda a, k=k: a[k], batch), slopes(system, end, start))


@pytest.mark.slow
def test_the_length_of_the_log_does_not_change_derivatives():
    system, end, x = MACHINES["sticking"]
    ends = lambda size: lambda x: described(system, end, x, jnp.asarray(1.0), size)[:4]  # noqa: E731
    short, long = (jax.jit(jax.jacrev(ends(size)))(jnp.asarray(x)) for size in (0, 300))
    assert_alike(short, long)


@pytest.mark.slow
def test_a_lane_that_does_not_begin_changes_no_derivative_of_the_others():
    system = vx.models.wagg_bishop_b(1.1)

    def end(x):
        return vx.simulate(system, 0.0, 12.0, jnp.stack([x, 0.0 * x]), throw=False).x1[0]

    both = jax.jit(jax.vmap(jax.grad(end)))(jnp.array([0.0, 100.0]))
    np.testing.assert_allclose(both[0], jax.jit(jax.grad(end))(0.0), rtol=1e-12)
