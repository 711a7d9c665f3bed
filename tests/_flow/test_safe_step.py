"""Steps that are proved free of events."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._flow.safe_step import Bound, safe_step

# Error of times of impacts in units of the least one: those of the steps of a half cycle add up.
ROUNDING = 100


def test_an_event_within_a_short_step_is_found_however_loose_the_bound_of_a_long_one():
    """A mass that leaves a stop in a light bounce returns long before the bound of the first trial gives anything."""
    gap, speed, pull = 1.8e-13, 1.13e-6, 0.6
    bound = Bound(*(jnp.asarray(a) for a in (gap, speed, -pull / 2, 1.0)))
    step, is_root = safe_step(bound, jnp.asarray(1.0), jnp.asarray(1.4e-5))
    assert is_root
    exact = (speed + np.sqrt(speed**2 + 2 * pull * gap)) / pull
    # The step is too short by the third order: rest * U / pull, with U the length of the trial.
    np.testing.assert_allclose(step, exact, rtol=1e-4)
    assert step < exact


def test_an_event_after_which_the_bound_rises_again_within_a_short_step_is_found():
    """The bound of a long trial says that there is none up to 1.5 times its root, which is less than the shortest step."""
    gap, speed, bend, short = 5.482528e-13, -2.785119e-7, 0.0352574896, 4.3e-6
    bound = Bound(*(jnp.asarray(a) for a in (gap, speed, bend, 0.0, 0.0058762)))
    step, is_root = safe_step(bound, jnp.asarray(1.777), jnp.asarray(short))
    assert is_root
    np.testing.assert_allclose(step, np.roots([bend, speed, gap]).min(), rtol=1e-8)


@pytest.mark.parametrize("depth", [1e-14, 1e-13])
def test_an_impact_that_is_hardly_one_is_found_with_its_speed_wherever_the_motion_ends(depth):
    """A free mass turns back behind its stop by `depth` of its amplitude; its speed there is that of its lost energy."""
    system = vx.ImpactSystem([1.0], [[0.0]], [[2.0]], stops=[vx.Stop(0, -1.0, "lower", 0.0)])
    start = 1.0 + depth
    for end in np.linspace(2.3, 6.2, 20):
        sol = vx.simulate(system, 0.0, end, [start], [0.0])
        assert sol.num_events == 1
        energy = sol.events.velocity_minus[0] ** 2 / 2
        np.testing.assert_allclose(energy, (start - 1) * (start + 1), atol=10 * np.finfo(float).eps)


def test_a_mass_whose_motion_has_died_out_far_from_its_stop_delays_no_other_one():
    """Its numbers are about the least that a double can hold, and their products are zero."""
    stops = [
        vx.Stop(0, 2.6e-4, "upper", 0.5),
        vx.Stop(1, 6.1e-3, "upper", 0.3),
        vx.Stop(0, -2.5e-3, "lower", 0.2),
    ]
    damping, stiffness = [[0.861695, 0], [0, 7.46116]], [[0.92007, 0], [0, 7.96661]]
    system = vx.ImpactSystem([40.0407, 3.47004], damping, stiffness, vx.Harmonic([0.0, 0.0], 0.07), stops)
    dead = vx.simulate(system, 0.0, 160.0, [-5e-7, 0.0], [5e-8, 0.0])
    for x, v in ((-4.26e-307, 4.149e-306), (-3e-308, 0.0), (4e-307, 3e-306), (2e-306, -5e-306)):
        sol = vx.simulate(system, 0.0, 160.0, [-5e-7, x], [5e-8, v])
        np.testing.assert_allclose(sol.x1[0], dead.x1[0], rtol=1e-12)
        assert sol.num_steps < 2 * dead.num_steps


@pytest.mark.filterwarnings("ignore:vijax works in float32")
@pytest.mark.parametrize("is_double", [True, False], ids=["double", "single"])
def test_a_motion_that_dies_out_at_its_stop_comes_to_its_end(is_double):
    """Every half cycle takes more than half of its speed, until the squares of what is left are zero, and then all of it."""
    with jax.enable_x64(is_double):
        stop = vx.Stop(0, 0.0, "lower", 0.5)
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], stops=[stop])
        sol = vx.simulate(system, 0.0, 3000.0, [0.0], [1.0])
        information = np.finfo(sol.x1.dtype)
        dead = float(information.tiny) ** 0.45
        # Events of the last part are not found to their last digit: it may end behind its stop, and goes on from there.
        after = vx.simulate(system, 0.0, 30.0, [-(dead**1.2)], [-(dead**1.2)])
    assert max(abs(one) for end in (sol, after) for one in (end.x1[0], end.v1[0])) < dead
    assert sol.num_steps < 5000
    is_alive = np.asarray(sol.events.velocity_plus) > dead
    exact = np.pi / np.sqrt(1 - 0.05**2) * (1 + np.arange(is_alive.sum()))
    np.testing.assert_allclose(sol.events.t[is_alive], exact, rtol=ROUNDING * information.eps)
