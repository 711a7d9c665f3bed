"""Least margins of cycles between their events."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._branches.admissibility import margins_of_cycle
from vijax._branches.margin_scan import LeastMargins
from vijax._hybrid.limits import RELEASE, SLIP
from vijax._machine.numbers import numbers_of
from vijax._machine.state import AHEAD, FREE, HELD, KEPT_AHEAD
from vijax._orbits.cycle import Problem, Unknowns, prepared, traverse
from vijax._orbits.sequence import Sequence


@pytest.mark.thorough
def test_friction_that_a_stop_kept_at_rest_turns_back_nowhere_after_the_release():
    # The mass leaves as the growing load 2 cos(wt) exceeds the friction. Its velocity is zero there and grows, so that
    # it has no minimum; rounding must not add one at the release itself.
    stop = vx.Stop(0, 0.0, "lower", restitution=0.0)
    mode = jnp.array([[HELD, KEPT_AHEAD], [FREE, AHEAD]], jnp.int8)
    leaves = Sequence(jnp.array([RELEASE]), jnp.array([0]), mode)

    def margins(force: jax.Array) -> LeastMargins:
        load = vx.Harmonic(amplitude=[2.0], frequency=0.8)
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [stop], friction=[vx.Friction(0, force)])
        half = jnp.array(0.5)
        machine, flow = prepared(numbers_of(system), vx.TaylorFlow(), half)
        problem = Problem(machine, flow, leaves, half, half, shifts=jnp.zeros((1, 1)))
        until_release = 0.5 - jnp.arccos(force / 2) / (2 * jnp.pi)
        return margins_of_cycle(problem, Unknowns(jnp.zeros(2), until_release[None]))

    slip = jax.jit(jax.vmap(margins))(jnp.linspace(0.1, 1.5, 30)).gap[:, 1]
    np.testing.assert_array_equal(slip, np.inf)


def test_friction_that_a_moving_belt_takes_along_begins_to_slip_without_a_speed():
    # The guard that vanishes is one of forces. The velocity of the belt beside a stop was taken for its speed, and the
    # orbit for one that passes through a stop.
    slips = Sequence(jnp.array([SLIP]), jnp.array([1]), jnp.array([[FREE, HELD], [FREE, AHEAD]], jnp.int8))
    system = vx.ImpactSystem(
        [1.0],
        [[0.1]],
        [[1.0]],
        vx.Harmonic([2.0], 0.8),
        [vx.Stop(0, 1.0)],
        friction=[vx.Friction(0, 0.5, velocity=-0.4)],
    )

    @jax.jit
    def speeds(flight: jax.Array) -> jax.Array:
        machine, flow = prepared(numbers_of(system), vx.TaylorFlow(), jnp.array(1.0))
        problem = Problem(machine, flow, slips, jnp.array(0.0), jnp.array(1.0), shifts=jnp.zeros((1, 1)))
        return traverse(problem, Unknowns(jnp.array([0.0, -0.4]), flight[None]), jnp.array(1))[1]

    np.testing.assert_array_equal(speeds(jnp.array(0.3)), 0.0)
