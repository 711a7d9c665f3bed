"""Batches of any size and shape, of all kinds of machines, equal their lanes one by one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import slow_except

import vijax as vx

END = 12.0
ROUNDING = 1e-12
MAKES = {
    "no stops": lambda: vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], vx.Harmonic([1.0, 0.0], 0.8), []),
    "moving stop": lambda: vx.models.ball_on_table(9.0, 0.2),
    "contacts": lambda: vx.models.impact_damper(1.0),
    "full mass": lambda: vx.models.cantilever(2.0, num_elements=1),
    "six masses": lambda: vx.models.uniform_chain(0.9, num_masses=6),
}


def follow(system: vx.ImpactSystem, x: jax.Array, max_events: int = 40) -> vx.Solution:
    """Trajectory from a start at rest."""
    x0 = jnp.zeros(system.num_masses).at[0].set(x)
    return vx.simulate(system, 0.0, END, x0, ts=[0.4 * END, END], max_events=max_events, throw=False)


def assert_alike(batch: vx.Solution, index: tuple[int, ...], alone: vx.Solution):
    found = jax.tree.map(lambda a: a[index], (batch.events, batch.xs, batch.v1, batch.num_events))
    expected = alone.events, alone.xs, alone.v1, alone.num_events
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize("size", slow_except([5], [1, 5, 131]))
@pytest.mark.thorough
def test_batches_of_a_known_machine_of_any_size(size):
    system, starts = vx.models.wagg_bishop_b(1.1), -1e-3 * jnp.arange(size)
    batch = jax.jit(jax.vmap(lambda x: follow(system, x)))(starts)
    assert batch.x1.shape == (size, 2)
    assert int(batch.num_events.min()) > 3
    for k in {0, size // 2, size - 1}:
        assert_alike(batch, (k,), follow(system, starts[k]))


@pytest.mark.parametrize("max_events", [0, 3])
@pytest.mark.slow
def test_logs_that_are_too_short_end_alike(max_events):
    system, starts = vx.models.wagg_bishop_b(1.1), -1e-3 * jnp.arange(131)
    batch = jax.jit(jax.vmap(lambda x: follow(system, x, max_events)))(starts)
    alone = follow(system, starts[-1], max_events)
    assert_alike(batch, (130,), alone)
    assert alone.result == jax.tree.map(lambda a: a[130], batch).result


def test_a_batch_of_nothing():
    assert jax.vmap(lambda x: follow(vx.models.wagg_bishop_b(1.1), x))(jnp.zeros(0)).x1.shape == (0, 2)


@pytest.mark.slow
def test_a_batch_of_batches():
    starts, frequencies = -1e-2 * jnp.arange(3), jnp.array([0.9, 1.1])
    of_starts = jax.vmap(lambda x, w: follow(vx.models.wagg_bishop_b(w), x), (0, None))
    batch = jax.vmap(of_starts, (None, 0))(starts, frequencies)
    for i, w in enumerate(frequencies):
        for k, x in enumerate(starts):
            assert_alike(batch, (i, k), follow(vx.models.wagg_bishop_b(w), x))


@pytest.mark.slow
def test_a_program_of_constants_alone():
    batch = jax.jit(
        lambda: jax.vmap(lambda x: follow(vx.models.wagg_bishop_b(1.1), x))(np.array([0.0, -0.1]))
    )()
    assert_alike(batch, (1,), follow(vx.models.wagg_bishop_b(1.1), jnp.array(-0.1)))


@pytest.mark.slow
@pytest.mark.parametrize("make", MAKES)
def test_machines_of_every_make(make):
    system = MAKES[make]()
    starts = jnp.linspace(0.0, 1e-2, 3) * (1 if make == "moving stop" else -1)
    batch = jax.jit(jax.vmap(follow, (None, 0)))(system, starts)
    for k, x in enumerate(starts):
        assert_alike(batch, (k,), follow(system, x))


@pytest.mark.slow
def test_derivatives_of_a_batch_of_batches():
    """Derivatives by shared parameters are the sum over the lanes, forward and reverse."""
    starts, factors = -1e-2 * jnp.arange(3), jnp.array([0.9, 1.0])

    def end(x, w):
        return follow(vx.models.wagg_bishop_b(w), x).x1.sum()

    def total(w):
        return jax.vmap(jax.vmap(end, (0, None)), (None, 0))(starts, w * factors).sum()

    slopes = [c * jax.grad(end, 1)(x, 1.1 * c) for x in starts for c in factors]
    for derivative in (jax.grad, jax.jacfwd):
        np.testing.assert_allclose(derivative(total)(1.1), sum(slopes), rtol=1e-11)


@pytest.mark.slow
def test_lanes_without_an_event_stay_as_they_are():
    """Friction beside a stop that holds leaves elements without events, which the events of other lanes once opened."""
    free = vx.models.two_sided_oscillator(3.0, damping_ratio=0.01)
    given = free.mass, free.damping, free.stiffness, free.forcing, free.stops
    system = vx.ImpactSystem(*given, friction=[vx.Friction(0, 0.05)])

    def end(v0):
        return vx.simulate(
            system, 0.0, END, [0.33369921634684335], v0[None], max_events=100, max_steps=1000, throw=False
        )

    speeds = jnp.linspace(2.875, 2.885, 64)
    batch = jax.jit(jax.vmap(end))(speeds)
    sticks = np.array(batch.events.kind == vx.STICK).sum(axis=1)
    assert (sticks > 1).any()
    assert (sticks == 0).any()
    for k, v0 in enumerate(speeds):
        assert_alike(batch, (k,), end(v0))


@pytest.mark.slow
def test_steps_that_are_tried_again_are_not_disturbed_by_events_of_other_lanes():
    """A rigid and a soft stop, friction and a cubic spring: every point of such a sweep once stood still at an opening."""
    load = vx.Harmonic([1.0, 0.0], 0.9)
    free = vx.chain([1.0, 1.2], [0.05] * 2, [1.0] * 2, load, [vx.Stop(0, 0.3, "upper", 0.7)])
    system = vx.ImpactSystem(
        free.mass,
        free.damping,
        free.stiffness,
        free.forcing,
        [*free.stops, vx.CompliantStop(1, 0.3, "upper", 20.0, 0.1)],
        friction=[vx.Friction(0, 0.1)],
        force=lambda t, x, v, args: -0.1 * x**3,
    )
    frequencies = np.linspace(0.7, 0.735, 8)
    how = {"transient": 4, "record": 2, "max_steps": 3000, "progress": False}
    ds = vx.sweep(system, {"forcing.frequency": frequencies}, **how)
    assert (ds.result == 0).all()
    one = eqx.tree_at(lambda s: s.forcing.frequency, system, frequencies[0])
    alone = vx.simulate(one, 0.0, 6 * one.forcing.period, max_events=1000)
    np.testing.assert_allclose(ds.x[0], alone.x1, rtol=0, atol=1e-7)
