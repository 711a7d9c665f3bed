"""Balls that touch and are dropped on a floor: whatever their masses, they leave it as one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

EXACT = 1e-12
HEIGHT, RESTITUTION, END = 1.0, 0.5, 0.88


def stack(mass, gravity, floor) -> vx.ImpactSystem:
    mass = jnp.asarray(mass)
    num = len(mass)
    contacts = [vx.Contact({i: 1.0, i + 1: -1.0}, 0.0, RESTITUTION) for i in range(num - 1)]
    nothing, load = np.zeros((num, num)), vx.Harmonic(np.zeros(num), 1.0, mean=-gravity * mass)
    return vx.ImpactSystem(mass, nothing, nothing, load, [floor, *contacts])


def dropped(mass, gravity, height=HEIGHT, end=END) -> vx.Solution:
    floor = vx.Stop(0, 0.0, "lower", RESTITUTION)
    return vx.simulate(stack(mass, gravity, floor), 0.0, end, height * jnp.ones(len(mass)))


def after_one_bounce(gravity, height=HEIGHT, end=END):
    since, speed = end - jnp.sqrt(2 * height / gravity), RESTITUTION * jnp.sqrt(2 * gravity * height)
    return speed * since - gravity * since**2 / 2, speed - gravity * since


MASSES = [[1.0, 3.0], [5.0, 3.0], [3.0, 0.1], [1.0, 3.0, 0.2]]
_FEW = [m if m != MASSES[-1] else pytest.param(m, marks=pytest.mark.slow) for m in MASSES]


@pytest.mark.parametrize("gravity", [9.81, 10.0])
@pytest.mark.parametrize("mass", _FEW)
def test_dropped_balls_leave_the_floor_with_one_speed(mass, gravity):
    sol = dropped(mass, gravity)
    assert sol.events.kind[: int(sol.num_events)].tolist() == [vx.IMPACT]
    x, v = after_one_bounce(gravity)
    np.testing.assert_allclose(sol.x1, x, rtol=0, atol=EXACT)
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=EXACT)


@pytest.mark.parametrize("gravity", [pytest.param(9.81, marks=pytest.mark.slow), 1e-3, 7e5])
def test_so_they_do_side_by_side_in_any_unit_of_mass_and_time(gravity):
    units, end = jnp.array([1.0, 3.0, 1 / 7, 1e-9]), END * np.sqrt(9.81 / gravity)
    sol = jax.vmap(lambda unit: dropped(unit * jnp.array([1.0, 3.0]), gravity, end=end))(units)
    x, v = after_one_bounce(gravity, end=end)
    np.testing.assert_array_equal(sol.num_events, 1)
    np.testing.assert_allclose(sol.x1, x, rtol=0, atol=EXACT)
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=EXACT * max(1.0, float(abs(v))))


@pytest.mark.slow
@pytest.mark.parametrize("derivative", [jax.jacfwd, pytest.param(jax.jacrev, marks=pytest.mark.slow)])
def test_derivatives_by_height_and_weight_are_those_of_one_ball(derivative):
    at = jnp.array([9.81, HEIGHT])
    found = derivative(lambda p: dropped([1.0, 3.0], p[0], p[1]).x1)(at)
    one = jax.jacfwd(lambda p: after_one_bounce(p[0], p[1])[0])(at)
    np.testing.assert_allclose(found, [one, one], rtol=0, atol=1e-11)


@pytest.mark.parametrize("mass", _FEW)
def test_balls_in_touch_leave_a_soft_floor_as_one_mass_does(mass):
    gravity, stiffness = 9.81, 2000.0
    floor = vx.CompliantStop(0, 0.0, "lower", stiffness)
    sol = vx.simulate(stack(mass, gravity, floor), 0.0, END, [HEIGHT] * len(mass), max_steps=1000)
    w, speed = np.sqrt(stiffness / np.sum(mass)), np.sqrt(2 * gravity * HEIGHT)
    in_touch = 2 * (np.pi - np.arctan2(speed * w, gravity)) / w
    since = END - speed / gravity - in_touch
    assert since > 0
    np.testing.assert_allclose(sol.x1, speed * since - gravity * since**2 / 2, rtol=0, atol=10 * EXACT)
    np.testing.assert_allclose(sol.v1, speed - gravity * since, rtol=0, atol=100 * EXACT)
    assert sol.events.kind[: int(sol.num_events)].tolist() == [vx.CLOSE, vx.OPEN]


@pytest.mark.parametrize(
    "mass", [[5.0, 3.0], [2.0, 7.0], pytest.param([1.0, 1.0, 4.0], marks=pytest.mark.slow)]
)
def test_a_column_of_beads_moves_on_its_table_as_one_bead(mass):
    def end(own):
        column = vx.models.bead_column(2 * np.pi * 10, 0.02, num_beads=len(own), restitution=0.5, mass=own)
        return vx.simulate(column, 0.0, 2.0).x1

    np.testing.assert_allclose(end(mass), float(end([1.0])[0]), rtol=0, atol=1e-9)
