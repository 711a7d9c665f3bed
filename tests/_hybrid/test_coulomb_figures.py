"""Friction of contacts: motions whose figures are known."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# Machines of a kind share a program, which takes some ten seconds to compile.
_with_program = pytest.mark.thorough
_NONE = np.zeros((2, 2))


def _block(
    rubbing: vx.Friction, *, restitution=0.5, stiffness=0.0, load: vx.Harmonic | None = None
) -> vx.ImpactSystem:
    """A block of unit mass on a floor: coordinate 0 along it, coordinate 1 its height."""
    floor = vx.Stop(mass=1, position=0.0, side="lower", restitution=restitution)
    weight = vx.Harmonic([0.0, 0.0], 1.0, mean=[0.0, -1.0]) if load is None else load
    return vx.ImpactSystem([1.0, 1.0], _NONE, np.diag([stiffness, 0.0]), weight, [floor], friction=[rubbing])


def _kinds(sol: vx.Solution, element: int) -> list[int]:
    log = sol.events
    return np.asarray(log.kind)[np.asarray(log.stop) == element].tolist()


def _times(sol: vx.Solution, element: int, kind: int) -> np.ndarray:
    log = sol.events
    return np.asarray(log.t)[(np.asarray(log.stop) == element) & (np.asarray(log.kind) == kind)]


@pytest.mark.slow
@_with_program
def test_a_mass_on_a_spring_turns_twice_and_rests():
    sol = vx.simulate(
        _block(vx.Friction(0, coefficient=0.3), stiffness=1.0), 0.0, 20.0, [2.0, 0.0], [0.0, 0.0]
    )
    np.testing.assert_allclose(_times(sol, 1, vx.TURN), [np.pi, 2 * np.pi], rtol=1e-14)
    np.testing.assert_allclose(_times(sol, 1, vx.STICK), [3 * np.pi], rtol=1e-14)
    np.testing.assert_allclose(sol.x1, [-0.2, 0.0], atol=1e-14)
    assert bool(sol.sticking1[0])


@_with_program
@pytest.mark.parametrize("restitution", [*(pytest.param(e, marks=pytest.mark.slow) for e in (0.0, 0.5)), 0.6])
def test_a_dropped_block_rests_when_its_momentum_is_used_up_whatever_its_bounces(restitution):
    system = _block(vx.Friction(0, coefficient=0.3), restitution=restitution)
    sol = vx.simulate(system, 0.0, 20.0, [0.0, 1.0], [2.0, 0.0])
    assert abs(_times(sol, 1, vx.STICK)[-1] - 2.0 / 0.3) < 1e-10
    if restitution == 0.5:
        np.testing.assert_allclose(_times(sol, 0, vx.STICK), [3 * np.sqrt(2.0)], rtol=1e-9)
        np.testing.assert_allclose(sol.x1[0], 6.966666666666667, rtol=1e-12)


def _ball(restitution: float = 0.75) -> vx.ImpactSystem:
    """A ball of radius 1 and inertia .4 over a floor: along it, height, angle."""
    floor = vx.Stop(mass=1, position=0.0, side="lower", restitution=restitution)
    rubbing = vx.Friction({0: 1.0, 2: 1.0}, coefficient=0.25)
    weight = vx.Harmonic([0.0] * 3, 1.0, mean=[0.0, -1.0, 0.0])
    none = np.zeros((3, 3))
    return vx.ImpactSystem([1.0, 1.0, 0.4], none, none, weight, [floor], friction=[rubbing])


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 0.999, 1.001, 2.0])
def test_a_ball_sticks_in_an_impact_if_it_slides_slowly(share):
    u = 1.0
    most = 0.25 * 1.75 * u * 3.5
    system = _ball()
    sol = vx.simulate(system, 0.0, 0.1, [0.0, 0.0, 0.0], [share * most, -u, 0.0])
    expected = share * most / 3.5 if share <= 1 else 0.25 * 1.75 * u
    np.testing.assert_allclose(np.asarray(sol.events.friction_impulse)[0], expected, rtol=1e-13)
    np.testing.assert_allclose(sol.events.impulse[0], 1.75 * u, rtol=1e-13)
    left = sol.v1[0] + sol.v1[2]
    np.testing.assert_allclose(left, share * most - 3.5 * expected, atol=1e-13)


@_with_program
def test_a_contact_opens_while_it_slips():
    load = vx.Harmonic([0.0, 1.3], 0.7, [0.0, 2.5], mean=[0.0, -1.0])
    sol = vx.simulate(_block(vx.Friction(0, coefficient=0.3), load=load), 0.0, 5.0, [0.0, 0.0], [9.0, 0.0])
    np.testing.assert_allclose(_times(sol, 0, vx.RELEASE), [4.414321999433], rtol=1e-12)
    assert _kinds(sol, 1) == []
    np.testing.assert_allclose(sol.friction_force(4.9), [0.0])


@_with_program
def test_a_belt_drags_and_lets_go():
    mu, static, belt = 0.2, 0.5, 0.3
    rubbing = vx.Friction(0, velocity=belt, coefficient=mu, static_coefficient=static)
    sol = vx.simulate(_block(rubbing, stiffness=1.0), 0.0, 60.0, [static, 0.0], [belt, 0.0])
    slips, sticks = _times(sol, 1, vx.SLIP), _times(sol, 1, vx.STICK)
    # The slip from the start is no event.
    np.testing.assert_allclose(sticks[4] - slips[3], np.pi + 2 * np.arctan(belt / (static - mu)), rtol=1e-12)
    np.testing.assert_allclose(slips[3] - sticks[3], 2 * (static - mu) / belt, rtol=1e-12)


@pytest.mark.slow
@_with_program
def test_one_program_serves_all_coefficients_and_derivatives_follow():
    def rests_at(mu):
        system = _block(vx.Friction(0, coefficient=mu), restitution=0.5)
        return vx.simulate(system, 0.0, 20.0, [0.0, 1.0], [2.0, 0.0]).x1[0]

    # Way of the flights and of the slide: friction takes (2 - mu sqrt(2) ...) at each impact.
    mu, step = 0.3, 1e-5
    slope = jax.jit(jax.jacfwd(rests_at))(jnp.array(mu))
    differences = (rests_at(mu + step) - rests_at(mu - step)) / (2 * step)
    np.testing.assert_allclose(slope, differences, rtol=1e-6)


def _rod(coefficient: float, *, tangent: float = 2.0) -> vx.ImpactSystem:
    """A slender rod of unit length and mass whose lower end may touch a floor: along it, height, angle."""
    angle = np.arctan(tangent)
    floor = vx.Contact({1: -1.0, 2: np.cos(angle)}, 0.0, 0.5)
    rubbing = vx.Friction({0: 1.0, 2: np.sin(angle)}, coefficient=coefficient)
    none = np.zeros((3, 3))
    return vx.ImpactSystem([1.0, 1.0, 1 / 3], none, none, None, [floor], friction=[rubbing])


def test_a_contact_that_cannot_carry_a_force_while_it_slips_is_refused():
    with pytest.raises(
        ValueError, match=r"Contact 0 with coefficient 1\.34 cannot carry a force while it slips"
    ) as told:
        _rod(1.34)
    assert "negative direction" in str(told.value)
    assert "must be below 1.3333." in str(told.value)
    _rod(1.33)


@pytest.mark.slow
def test_where_no_choice_agrees_with_the_laws_the_result_tells_so():
    # A traced coefficient is not checked. Sliding down at a slope of 2 the rod would need a negative force.
    load = vx.Harmonic([0.0] * 3, 1.0, mean=[0.0, -1.0, 0.0])

    @jax.jit
    def run(coefficient):
        rod = eqx.tree_at(lambda s: s.friction[0].coefficient, _rod(1.0), coefficient)
        rod = eqx.tree_at(lambda s: s.forcing, rod, load)
        return vx.simulate(rod, 0.0, 0.2, v0=[-2.0, 0.0, 0.0], throw=False)

    stopped, sound = run(jnp.array(1.5)), run(jnp.array(1.3))
    assert stopped.result == vx.RESULTS.friction_paradox
    np.testing.assert_array_equal(stopped.x1, np.zeros(3))
    assert sound.result == vx.RESULTS.successful


@pytest.mark.slow
@_with_program
def test_a_bouncing_ball_with_spin_rolls_at_last():
    # Of Siconos: radius .5, restitution .9, coefficient .1, spin 2; it rolls with 2/7 and 4/7.
    floor = vx.Stop(mass=1, position=0.5, side="lower", restitution=0.9)
    rubbing = vx.Friction({0: 1.0, 2: -0.5}, coefficient=0.1)
    weight = vx.Harmonic([0.0] * 3, 1.0, mean=[0.0, -9.81, 0.0])
    none = np.zeros((3, 3))
    ball = vx.ImpactSystem([1.0, 1.0, 0.1], none, none, weight, [floor], friction=[rubbing])
    sol = vx.simulate(ball, 0.0, 10.0, [0.0, 1.0, 0.0], [0.0, 0.0, 2.0])
    np.testing.assert_allclose(_times(sol, 0, vx.STICK), [6.066233140], atol=1e-9)
    np.testing.assert_allclose(np.asarray(sol.v1)[[0, 2]], [2 / 7, 4 / 7], rtol=1e-12)
    np.testing.assert_allclose(sol.x1[0], 2.765921306, atol=1e-9)
