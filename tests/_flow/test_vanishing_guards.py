"""Contacts that touch without a force, or nearly so: no cost, no event, no end."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vijax as vx

# An exact step covers 1.5 time scales of the motion, so that a run without events takes a few steps only.
FEW_STEPS = 10
# Rounding of the motion over a few periods.
EXACT = 1e-12


def pair(mass, damping=0.0, restitution=1.0, mean=(0.0, 0.0), change=0.0):
    """Two bodies in touch with equal k / m and c / m, up to a relative `change` of one stiffness."""
    mass = np.asarray(mass)
    load = vx.Harmonic(amplitude=[0.0, 0.0], frequency=1.0, mean=list(mean))
    stiffness = np.diag(mass * [1.0, 1.0 + change])
    contact = vx.Contact({0: 1.0, 1: -1.0}, 0.0, restitution)
    return vx.ImpactSystem(mass, damping * np.diag(mass), stiffness, load, [contact])


def swing(t, damping=0.0):
    w = np.sqrt(1 - damping**2 / 4)
    return np.exp(-damping * t / 2) * (np.cos(w * t) + damping / (2 * w) * np.sin(w * t))


@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize(("mass", "restitution"), [([1.0, 1.0], 1.0), ([5.0, 3.0], 1.0), ([5.0, 3.0], 0.5)])
def test_equal_pendula_in_touch_swing_as_one(mass, restitution, damping):
    sol = vx.simulate(pair(mass, damping, restitution), 0.0, 3.0, [0.1, 0.1], [0.0, 0.0], max_steps=1000)
    np.testing.assert_allclose(sol.x1, 0.1 * swing(3.0, damping), atol=EXACT)
    assert sol.num_steps < FEW_STEPS


@pytest.mark.parametrize("force", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
def test_a_light_pressing_force_costs_no_more_steps_than_a_heavy_one(force):
    system = pair([1.0, 1.0], mean=(force, -force))
    sol = vx.simulate(system, 0.0, 3.0, [0.1, 0.1], [0.0, 0.0], max_steps=1000)
    np.testing.assert_allclose(sol.x1, 0.1 * swing(3.0), atol=EXACT)
    assert sol.num_events == 0
    assert sol.num_steps < FEW_STEPS


@pytest.mark.parametrize("change", [1e-6, 1e-9, 1e-12])
def test_nearly_equal_pendula_part_at_the_lowest_point(change):
    sol = vx.simulate(pair([1.0, 1.0], change=-change), 0.0, 3.0, [-0.1, -0.1], [0.0, 0.0], max_steps=1000)
    np.testing.assert_allclose(sol.x1, -0.1 * swing(3.0), atol=EXACT + change)
    assert sol.num_steps < 2 * FEW_STEPS


@pytest.mark.slow
def test_lanes_and_units_do_not_matter():
    def at(size):
        sol = vx.simulate(
            pair([5.0, 3.0], 0.1, 0.5), 0.0, 3.0, size * jnp.ones(2), jnp.zeros(2), max_steps=1000
        )
        return sol.x1 / size, sol.num_steps

    x, steps = jax.vmap(at)(jnp.array([1e-9, 0.1, 1e6]))
    np.testing.assert_allclose(x, swing(3.0, 0.1), atol=EXACT)
    assert np.all(steps < FEW_STEPS)


@pytest.mark.parametrize("num", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_cradle_in_touch_takes_the_steps_of_one_with_gaps(num):
    def steps(gap):
        contacts = [vx.Contact({i: 1.0, i + 1: -1.0}, gap, 1.0) for i in range(num - 1)]
        system = vx.ImpactSystem(np.ones(num), np.zeros((num, num)), 49.05 * np.eye(num), None, contacts)
        x0 = np.zeros(num)
        x0[0] = -0.1
        sol = vx.simulate(system, 0.0, 2.0, x0, np.zeros(num), max_steps=1000)
        return sol.num_steps

    assert steps(0.0) <= 2 * steps(1e-3)


@pytest.mark.thorough
def test_three_loaded_bodies_in_touch_move_as_one_in_a_sweep_too():
    mass = np.array([2.0, 3.0, 0.7])
    contacts = [vx.Contact({i: 1.0, i + 1: -1.0}, 0.0, 0.6) for i in (0, 1)]
    load = vx.Harmonic(amplitude=0.3 * mass, frequency=1.1, mean=0.2 * mass)
    system = vx.ImpactSystem(mass, 0.1 * np.diag(mass), 1.7 * np.diag(mass), load, contacts)
    sol = vx.simulate(system, 0.0, 50.0, [0.1] * 3, [0.0] * 3, max_steps=1000)

    def rate(t, y):
        return [y[1], 0.3 * np.cos(1.1 * t) + 0.2 - 0.1 * y[1] - 1.7 * y[0]]

    alone = solve_ivp(rate, (0, 50), [0.1, 0.0], rtol=1e-12, atol=1e-13).y[0, -1]
    np.testing.assert_allclose(sol.x1, alone, atol=1e-9)
    assert sol.num_steps < 100


@pytest.mark.thorough
@pytest.mark.parametrize(
    "contact",
    [
        vx.Contact({1: 1.0, 2: -1.0}, 0.0, 0.5),
        vx.CompliantContact({1: 1.0, 2: -1.0}, 0.0, 50.0, 0.0),
        vx.CompliantContact({1: 1.0, 2: -1.0}, 0.0, 50.0, 0.5),
        vx.CompliantContact({1: 1.0, 2: -1.0}, 0.0, 50.0, 0.0, preload=0.1),
    ],
    ids=["rigid", "compliant", "damped", "preloaded"],
)
def test_equal_buildings_in_touch_move_as_one(contact):
    stiffness = np.array([[7.0, -1.0, -1.0], [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    mass, damping = np.array([3.0, 1.0, 1.0]), 0.04 * stiffness
    load = vx.Harmonic(amplitude=[1.0, 0.0, 0.0], frequency=1.3)
    system = vx.ImpactSystem(mass, damping, stiffness, load, [contact])
    sol = vx.simulate(system, 0.0, 40.0, [0.0] * 3, [0.0] * 3, max_steps=1000)

    def rate(t, y):
        force = np.array([np.cos(1.3 * t), 0.0, 0.0]) - damping @ y[3:] - stiffness @ y[:3]
        return np.concatenate([y[3:], force / mass])

    free = solve_ivp(rate, (0, 40), np.zeros(6), rtol=1e-12, atol=1e-13, method="DOP853").y[:3, -1]
    np.testing.assert_allclose(sol.x1, free, atol=1e-9)
    assert sol.num_events == 0
    assert sol.num_steps < 100


@pytest.mark.slow
def test_friction_at_its_bound_all_along_does_not_stop_three_blocks():
    friction = [vx.Friction(0, 1.5), vx.Friction({1: 1.0, 0: -1.0}, 1.0), vx.Friction({2: 1.0, 1: -1.0}, 0.5)]
    load = vx.Harmonic(amplitude=[6.0, 0.0, 0.0], frequency=0.7)
    system = vx.ImpactSystem(
        np.ones(3), 0.1 * np.eye(3), np.diag([1.0, 0.0, 0.0]), load, [], friction=friction
    )
    sol = vx.simulate(system, 0.0, 1.0, [0.0] * 3, [0.0] * 3, max_steps=1000)
    # Blocks 2 and 3 are driven by .5 each: m v' = .5 - c v.
    alone = 5 * (1.0 - (1 - np.exp(-0.1)) / 0.1)
    np.testing.assert_allclose(sol.x1[1:], alone, atol=1e-10)
    assert sol.num_steps < FEW_STEPS


@pytest.mark.thorough
@pytest.mark.parametrize("num", [3, 5])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_mass_that_symmetry_keeps_on_its_stop_does_not_delay_the_others(num, restitution):
    stiffness = 2 * np.eye(num) - np.eye(num, k=1) - np.eye(num, k=-1)
    amplitude = np.linspace(0.3, -0.3, num)
    load = vx.Harmonic(amplitude=list(amplitude), frequency=0.7)
    middle = vx.Stop(num // 2, 0.0, "upper", restitution)
    x0, v0 = list(amplitude), [0.0] * num
    systems = [
        vx.ImpactSystem(np.ones(num), 0.05 * stiffness, stiffness, load, stops) for stops in ([middle], [])
    ]
    with_stop, free = (vx.simulate(s, 0.0, 20.0, x0, v0, max_steps=1000) for s in systems)
    np.testing.assert_allclose(with_stop.x1, free.x1, atol=EXACT)
    # Rounding moves the middle mass, and only that.
    light = np.abs(with_stop.events.velocity_minus[: with_stop.num_events])
    assert light.max(initial=0.0) < EXACT


@pytest.mark.slow
def test_a_load_that_begins_with_no_force_lifts_a_body_off_in_few_steps():
    """A (1 - cos wt): the gap grows as t^4, and no coefficient below is more than rounding."""
    lifted = 0.15 * 9 - 0.3 / 0.49 * (1 - np.cos(2.1))

    def end(system: vx.ImpactSystem, x0: list[float]) -> vx.Solution:
        sol = vx.simulate(system, 0.0, 3.0, x0)
        assert sol.num_events == 0
        assert sol.num_steps < 40
        return sol

    load = vx.Harmonic([-0.3], 0.7, mean=[0.3])
    cushion = vx.CompliantStop(0, 0.0, "lower", 5.0)
    alone = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [cushion])
    np.testing.assert_allclose(end(alone, [0.0]).x1, lifted, rtol=1e-12)
    # The last of four bodies in touch: friction holds the two in the middle, and one leans on them.
    row = [vx.Contact({k: 1.0, k + 1: -1.0}, -1.0, 0.5) for k in range(3)]
    rubbing = [vx.Friction(1, 0.25), vx.Friction(2, 0.2)]
    load = vx.Harmonic([0.0, 0.0, -0.3, -0.3], 0.7, mean=[0.4, -0.2, 0.0, 0.3])
    for damping in (0.0, 0.1):
        bodies = vx.ImpactSystem(
            [0.5, 1.0, 2.0, 1.0], np.diag([damping, 0, 0, 0]), np.zeros((4, 4)), load, row, friction=rubbing
        )
        np.testing.assert_allclose(
            end(bodies, [0.0, 1.0, 2.0, 3.0]).x1, [0, 1, 2, 3 + lifted], rtol=0, atol=1e-12
        )


ROW = [vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.5), vx.Contact({1: 1.0, 2: -1.0}, 0.0, 1.0)]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("masses", "stops"),
    [
        pytest.param([1.0], [vx.Stop(0, 0.0, "lower", 0.5)], marks=pytest.mark.slow),
        ([2.5], [vx.Stop(0, 0.0, "lower", 0.0)]),
        pytest.param([1.0, 3.0], ROW[:1], marks=pytest.mark.slow),
        pytest.param([1.0, 0.2, 3.0], ROW, marks=pytest.mark.slow),
    ],
)
def test_so_it_does_off_rigid_contacts(masses, stops):
    num, size, w, end = len(masses), 0.3, 0.7, 3.0

    def last(size):
        last_alone = jnp.zeros(num).at[-1].set(size)
        load = vx.Harmonic(-last_alone, w, mean=last_alone)
        system = vx.ImpactSystem(masses, np.zeros((num, num)), np.zeros((num, num)), load, stops)
        sol = vx.simulate(system, 0.0, end, np.zeros(num))
        return sol.x1, sol.num_steps, sol.num_events

    lifted = (end**2 / 2 - (1 - np.cos(w * end)) / w**2) / masses[-1]
    x, steps, num_events = last(size)
    assert steps < 60
    # Nothing holds them at the start.
    assert num_events == 0
    np.testing.assert_allclose(x, [0.0] * (num - 1) + [size * lifted], rtol=1e-12, atol=1e-15)
    # Of one trajectory, and of a batch of loads.
    slope = jax.jacfwd(lambda size: last(size)[0])(size)
    np.testing.assert_allclose(slope[-1], lifted, rtol=1e-12)
    sizes = jnp.array([1e-6, 0.3, 50.0])
    x, steps, num_events = jax.vmap(last)(sizes)
    assert steps.max() < 60
    assert num_events.max() == 0
    np.testing.assert_allclose(x[:, -1], sizes * lifted, rtol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "units", [(1.0, 1.0, 1.0), (95.42658730564736, 0.18355836533808104, 0.05380833027899771)]
)
def test_equal_bodies_that_a_load_begins_to_move_together_do_not_bounce_by_rounding(units):
    mass, length, time = units
    load = np.full(2, 0.2 * mass * length / time**2)
    system = vx.ImpactSystem(
        np.full(2, 0.5 * mass),
        np.zeros((2, 2)),
        np.diag([mass / time**2, 0.0]),
        vx.Harmonic(load, 1.0 / time, phase=np.full(2, np.pi / 2)),
        [vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.7)],
    )
    sol = vx.simulate(system, 0.0, 3.0 * time, max_steps=1000)
    # The spring presses one on the other: both move as a mass of 1 on it, x'' + x = -.4 sin t.
    np.testing.assert_allclose(sol.x1 / length, 0.2 * (3.0 * np.cos(3.0) - np.sin(3.0)), rtol=1e-11)
    assert sol.num_steps < 2 * FEW_STEPS


@pytest.mark.thorough
def test_a_release_where_a_load_passes_zero_is_one_in_any_units():
    def end(units):
        mass, length, time = units
        load = vx.Harmonic(
            jnp.array([0.4, 0.0]) * mass * length / time**2, 1.3 / time, phase=np.full(2, np.pi / 2)
        )
        links = mass / time**2 * jnp.array([[2.0, -1.0], [-1.0, 2.0]])
        stops = [vx.Stop(1, 0.7 * length, "upper", 1.0), vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.0)]
        system = vx.ImpactSystem(mass * jnp.full(2, 0.5), np.zeros((2, 2)), links, load, stops)
        x0, v0 = jnp.array([0.0, 0.2 * length]), jnp.array([0.8 * length / time, 0.0])
        periods = 24 * np.pi / 1.3
        sol = vx.simulate(system, 0.0, periods * time, x0, v0, max_steps=1000, throw=False)
        return sol.x1 / length, sol.num_events, sol.num_steps

    # At the end of a period the force between the bodies vanishes, and their velocities differ by a rounding error.
    units = 10 ** np.random.default_rng(1).uniform(-3, 3, (40, 3))
    x, num_events, num_steps = jax.vmap(end)(jnp.array([[1.0, 1.0, 1.0], [1e5, 0.1, 100.0], *units]))
    assert set(num_events.tolist()) == {46}
    assert num_steps.max() < 200
    np.testing.assert_allclose(x, np.broadcast_to(x[0], x.shape), rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_friction_whose_load_begins_at_either_bound_moves_alike_in_any_units():
    """At the ends of periods the load is at the lower bound of friction, or, mirrored, at the upper one."""

    @jax.jit
    def end(units, side):
        mass, length, time = units
        force = mass * length / time**2
        load = vx.Harmonic(
            side * jnp.array([0.4]) * force, 1.3 / time, [np.pi / 2], mean=side * jnp.array([0.3]) * force
        )
        rubs = [vx.Friction(0, 0.3 * force, static=0.36 * force)]
        spring = 0.5 * mass / time**2 * jnp.ones((1, 1))
        system = vx.ImpactSystem(mass * jnp.ones(1), np.zeros((1, 1)), spring, load, [], friction=rubs)
        sol = vx.simulate(system, 0.0, 24 * np.pi / 1.3 * time, max_steps=1000, throw=False)
        return side * sol.x1 / length, sol.num_events, sol.num_steps

    units = [np.ones(3), *(10 ** np.random.default_rng(5).uniform(-3, 3, (20, 3)))]
    x, num_events, num_steps = (
        np.stack(a) for a in zip(*(end(u, s) for u in units for s in (1.0, -1.0)), strict=True)
    )
    assert set(num_events.tolist()) == {int(num_events[0])}
    assert num_events[0] > 24
    assert num_steps.max() < 200
    np.testing.assert_allclose(x, np.broadcast_to(x[0], x.shape), rtol=0, atol=1e-12)
