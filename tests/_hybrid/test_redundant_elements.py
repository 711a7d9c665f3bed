"""Elements at rest of which there are more than needed: what one lets go another takes over, from its own bound."""

import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

_ROUNDING = 1e-12


def _leans(order: int) -> vx.ImpactSystem:
    """A driven mass that leans on a second one, with friction under both, in one of two orders."""
    nothing, friction = np.zeros((2, 2)), [vx.Friction(0, 0.1), vx.Friction(1, 0.2)]
    contact = vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.3)
    load = vx.Harmonic([0.4, 0.0], 1.0)
    return vx.ImpactSystem([0.5, 2.0], nothing, nothing, load, [contact], friction=friction[::order])


def _slides_from(grip: float, mass: float, t: float) -> tuple[float, float]:
    """Motion under 0.4 cos t against friction, at rest until that falls to the grip."""
    start = np.arccos(-grip / 0.4)
    v = (0.4 * (np.sin(t) - np.sin(start)) + grip * (t - start)) / mass
    way = 0.4 * (np.cos(start) - np.cos(t) - np.sin(start) * (t - start)) + grip * (t - start) ** 2 / 2
    return way / mass, v


@pytest.mark.thorough
@pytest.mark.parametrize("order", [1, -1])
def test_friction_that_takes_over_at_its_bound_holds_to_the_other(order):
    sol = vx.simulate(_leans(order), 1.06, 3.0, [1.0, 2.0], [0.0, 0.0])
    way, v = _slides_from(0.1, 0.5, 3.0)
    np.testing.assert_allclose(sol.x1, [1 + way, 2], rtol=0, atol=_ROUNDING)
    np.testing.assert_allclose(sol.v1, [v, 0], rtol=0, atol=_ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, -1])
def test_elements_side_by_side_take_over_as_their_sum(order):
    friction = [vx.Friction(0, 0.1), vx.Friction(0, 0.2)][::order]
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.4], 1.0), friction=friction)
    sol = vx.simulate(system, 1.0, 3.5, [0.0], [0.0])
    np.testing.assert_allclose([sol.x1[0], sol.v1[0]], _slides_from(0.3, 1.0, 3.5), rtol=0, atol=_ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, -1])
def test_forces_at_rest_balance_the_load(order):
    sol = vx.simulate(_leans(order), 1.06, 1.8, [1.0, 2.0], [0.0, 0.0])
    t = jnp.linspace(1.07, 1.79, 12)
    friction, contact = sol.friction_force(t)[:, ::order], sol.contact_force(t)[:, 0]
    np.testing.assert_allclose(friction[:, 0] + contact, 0.4 * np.cos(t), rtol=0, atol=_ROUNDING)
    np.testing.assert_allclose(friction[:, 1], contact, rtol=0, atol=_ROUNDING)
    assert np.min(contact) >= 0
    assert np.max(np.abs(friction) - np.array([0.1, 0.2])) <= _ROUNDING


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1 / 3, 1 / 7])
def test_bodies_whose_loads_are_their_friction_stay_at_rest_in_any_unit(unit):
    """The loads of three add up to the grips, 0.4: a difference that only rounding leaves anything of."""
    stiffness = np.diag([0.3, 0.3, 0.0, 0.3]) * unit
    load = vx.Harmonic(np.array([0, 0, 0, 0.3]) * unit, 0.7, mean=np.array([0.5, 0.1, 0.1, 0.0]) * unit)
    stops = [vx.Contact({i: 1.0, i + 1: -1.0}, -1.0, 0.5) for i in range(3)]
    friction = [vx.Friction(2, 0.1 * unit), vx.Friction(1, 0.3 * unit)]
    masses = np.array([2.0, 2.0, 2.0, 1.0]) * unit
    damping = np.diag([0.0, 0.0, 0.1, 0.0]) * unit
    system = vx.ImpactSystem(masses, damping, stiffness, load, stops, friction=friction)
    x0 = [0.0, 1.0, 2.0, 3.4]
    sol = vx.simulate(system, 0.0, 0.5, x0, np.zeros(4), max_steps=50, throw=False)
    assert sol.result == vx.RESULTS.successful
    np.testing.assert_allclose(sol.x1[:3], x0[:3], rtol=0, atol=_ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, -1])
def test_six_elements_hold_as_long_as_some_forces_within_their_grips_do(order):
    """The loads, -0.5 + 0.7 cos 1.3 t in all, reach the grips of the ground, 0.85, where cos 1.3 t = -0.5."""
    nothing, load = np.zeros((2, 2)), vx.Harmonic([0.3, 0.4], 1.3, mean=[-0.1, -0.4])
    stops = [vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.5), vx.Stop(1, 1.0, "upper", 0.3)]
    between, ground = (
        vx.Friction({0: 1.0, 1: -1.0}, 0.3, 0.36),
        [vx.Friction(0, 0.2, 0.3), vx.Friction(0, 0.3)],
    )
    friction = [ground[1], between, vx.Friction(1, 0.25), ground[0]]
    system = vx.ImpactSystem([1.0, 1.0], nothing, nothing, load, stops[::order], friction=friction)
    sol = vx.simulate(system, 0.0, 1.7, [0.0, 1.0], [0.0, 0.0])
    np.testing.assert_allclose(sol.events.t[0], np.arccos(-0.5) / 1.3, rtol=0, atol=_ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1 / 7, 7.3e4])
def test_friction_that_an_impact_moves_does_not_stick_at_an_impact_of_rounding_speed(unit):
    """The impact stops the light body beside a wall, where rounding leaves it a speed towards that."""
    nothing, load = np.zeros((2, 2)), vx.Harmonic([0.0, 0.0], 1.0, mean=np.array([-0.2, -0.2]) * unit)
    stops = [vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.5), vx.Stop(1, 1.0, "upper", 0.5)]
    between = vx.Friction({0: 1.0, 1: -1.0}, 0.25 * unit, 0.375 * unit)
    friction = [vx.Friction(0, 0.1 * unit, 0.12 * unit), between]
    system = vx.ImpactSystem(np.array([2.0, 1.0]) * unit, nothing, nothing, load, stops, friction=friction)
    sol = vx.simulate(system, 0.0, 0.4, [0.0, 1.0], [0.0, -0.8])
    np.testing.assert_allclose(sol.v1, [-0.4 + 0.075 * 0.4, -0.45 * 0.4], rtol=0, atol=_ROUNDING)
