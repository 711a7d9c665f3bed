"""Derivatives of motions that start exactly on a stop are those of starts just before it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import end_of
from jax import Array

import vijax as vx

pytestmark = pytest.mark.thorough

# Step of one-sided differences, and their error.
STEP, BY_DIFFERENCES = 1e-6, 2e-5
GRAVITY, RESTITUTION = 9.81, 0.7
DERIVATIVES = {"forward": jax.jacfwd, "reverse": jax.jacrev}


def ball(restitution: float = RESTITUTION) -> vx.ImpactSystem:
    load = vx.Harmonic([0.0], 1.0, mean=[-GRAVITY])
    return vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [vx.Stop(0, 0.0, "lower", restitution)])


@pytest.mark.parametrize("mode", DERIVATIVES)
def test_a_ball_that_starts_on_its_stop_moving_in_depends_on_its_height(mode):
    speed, span, r = 2.0, 0.1, RESTITUTION
    found = DERIVATIVES[mode](end_of(ball(), span))(jnp.array([0.0, -speed]))
    # A higher start hits later, by 1 / speed, and faster, by g / speed.
    later, faster = 1 / speed, GRAVITY / speed
    right = [-(r * speed - GRAVITY * span) * later + r * faster * span, GRAVITY * later + r * faster]
    np.testing.assert_allclose(found[:, 0], right, rtol=1e-12)
    assert abs(right[0] - 0.13385) < 1e-12


def test_batches_and_events_have_the_same_derivative():
    speeds = jnp.array([0.5, 1.0, 2.0, 4.0])

    def first_impact(x0: Array, speed: Array) -> Array:
        run = vx.simulate(ball(), 0.0, 0.1, x0[None], -speed[None])
        return run.events.t[0]

    found = jax.vmap(jax.grad(first_impact), (None, 0))(jnp.array(0.0), speeds)
    np.testing.assert_allclose(found, 1 / speeds, rtol=1e-12)


def test_a_ball_that_starts_on_its_stop_moving_out_moves_with_its_start():
    found = jax.jacfwd(end_of(ball(), 0.1))(jnp.array([0.0, 2.0]))
    np.testing.assert_allclose(found, [[1, 0.1], [0, 1]], rtol=1e-12)


def test_a_held_ball_stays_whatever_its_start():
    found = jax.jacfwd(end_of(ball(), 0.1))(jnp.array([0.0, 0.0]))
    np.testing.assert_array_equal(found, np.zeros((2, 2)))


def test_the_position_of_the_stop_counts_as_the_start_does():
    def end(position: Array) -> Array:
        load = vx.Harmonic([0.0], 1.0, mean=[-GRAVITY])
        stop = vx.Stop(0, position, "lower", RESTITUTION)
        machine = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [stop])
        return vx.simulate(machine, 0.0, 0.1, [0.0], [-2.0]).x1[0]

    # Shifted with its stop, the whole motion is.
    np.testing.assert_allclose(jax.grad(end)(jnp.array(0.0)), 1 - 0.13385, rtol=1e-12)


def two_masses(**elements) -> vx.ImpactSystem:
    load = vx.Harmonic([0.3, 0.1], 1.3, mean=[0.2, -0.1])
    stiffness, damping = np.array([[2.0, -1.0], [-1.0, 1.5]]), np.diag([0.1, 0.2])
    return vx.ImpactSystem([1.0, 2.0], damping, stiffness, load, **elements)


# Machine, start on the contact and moving in, and the direction of positions away from it.
BETWEEN = vx.Contact({0: 1.0, 1: -1.0}, 0.2, 0.6)
SHAKEN = vx.Stop(0, 0.2, "upper", 0.8, motion=vx.Harmonic([0.05], 1.3, phase=[0.4]))
MACHINES = {
    "contact": (two_masses(stops=[BETWEEN]), [0.2, 0.0, 1.0, 0.3], [-1.0, 0.5, 0.3, 0.1]),
    "contact beside friction": (
        two_masses(stops=[BETWEEN], friction=[vx.Friction(1, 0.2)]),
        [0.2, 0.0, 1.0, 0.3],
        [-1.0, 0.5, 0.3, 0.1],
    ),
    "moving stop": (two_masses(stops=[SHAKEN]), None, [-1.0, 0.4, 0.2, 0.1]),
    # It pushes from the start, without an event, as a motion does that starts deeper in it.
    "compliant stop": (
        two_masses(stops=[vx.CompliantStop(0, 0.2, "upper", 50.0, 0.8)]),
        [0.2, 0.0, 1.0, 0.3],
        [1.0, 0.5, 0.3, 0.1],
    ),
    "compliant stop, moving out": (
        two_masses(stops=[vx.CompliantStop(0, 0.2, "upper", 50.0, 0.8)]),
        [0.2, 0.0, -1.0, 0.3],
        [-1.0, 0.5, 0.3, 0.1],
    ),
    "pulled from rest": (
        two_masses(stops=[vx.Stop(0, 0.3, "upper", 0.8)]),
        [0.3, 0.0, 0.0, 0.3],
        [-1.0, 0.5, -0.3, 0.1],
    ),
}


def _marks(name: str, mode: str) -> list:
    """Marks of a case: those that take longest to compile belong to the long runs."""
    is_quick = (name, mode) in (("contact", "reverse"), ("compliant stop", "forward"))
    return [pytest.mark.thorough if is_quick else pytest.mark.slow]


_CASES = [pytest.param(name, mode, marks=_marks(name, mode)) for name in MACHINES for mode in DERIVATIVES]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "mode"), _CASES)
def test_derivatives_of_starts_on_contacts_are_one_sided_differences(name, mode):
    machine, start, away = MACHINES[name]
    if start is None:
        start = [0.2 + 0.05 * np.cos(0.4), 0.0, 1.0, 0.3]
    end, start, away = end_of(machine, 0.7), jnp.array(start), jnp.array(away)
    found = DERIVATIVES[mode](end)(start) @ away
    beside = [end(start + k * STEP * away) for k in range(3)]
    right = (4 * beside[1] - beside[2] - 3 * beside[0]) / (2 * STEP)
    np.testing.assert_allclose(found, right, atol=BY_DIFFERENCES)
