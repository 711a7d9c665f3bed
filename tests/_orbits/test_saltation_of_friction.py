"""Saltation matrices of machines whose forces switch: closed forms, and the product with flights."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_maps import flight_matrix

import vijax as vx

ROUNDING = 1e-13
MASS, DAMPING, STIFFNESS, AMPLITUDE, FREQUENCY, LEVEL, RESTITUTION = 1.3, 0.1, 2.0, 0.7, 0.9, 0.25, 0.6
LOAD = vx.Harmonic([AMPLITUDE], FREQUENCY)
STOP = vx.Stop(0, 0.3, "upper", RESTITUTION)
RUBBING = (vx.Friction(0, LEVEL),)
TIME, SPEED = 1.1, 0.8


def oscillator(stops=(STOP,), friction=RUBBING, **own) -> vx.ImpactSystem:
    return vx.ImpactSystem(
        [MASS], [[DAMPING]], [[STIFFNESS]], LOAD, list(stops), friction=list(friction), **own
    )


def acceleration(v: float) -> float:
    load = AMPLITUDE * np.cos(FREQUENCY * TIME)
    return (load - DAMPING * v - STIFFNESS * 0.3 - np.sign(v) * LEVEL) / MASS


def expected(speed: float = SPEED) -> np.ndarray:
    """An earlier impact leaves the velocity a+ + r a- for each unit of time, of which there is 1 / v for each of x."""
    rebound = RESTITUTION * acceleration(speed) + acceleration(-RESTITUTION * speed)
    return np.array([[-RESTITUTION, 0.0], [rebound / speed, -RESTITUTION]])


@pytest.mark.slow
def test_friction_turns_at_an_impact():
    matrix = vx.saltation_matrix(oscillator(), TIME, [0.3], [SPEED], 0)
    np.testing.assert_allclose(matrix, expected(), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_in_programs_and_beside_lanes_without_an_impact():
    def matrix(v, stop, throw=True):
        return vx.saltation_matrix(oscillator(), TIME, [0.3], v[None], stop, throw=throw)

    np.testing.assert_allclose(jax.jit(matrix)(jnp.array(SPEED), 0), expected(), rtol=0, atol=ROUNDING)
    speeds, stops = jnp.array([SPEED, jnp.nan, SPEED, 0.5]), jnp.array([0, 0, 1, 0])
    found = np.asarray(jax.vmap(lambda v, stop: matrix(v, stop, False))(speeds, stops))
    assert np.isnan(found[1:3]).all()
    for k in (0, 3):
        np.testing.assert_allclose(found[k], expected(float(speeds[k])), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_block_at_rest_is_kicked_out_of_its_friction():
    """Until the impact the block has no velocity of its own, whatever that of its neighbours."""
    e, level = 0.5, 0.2
    contact = vx.Contact({0: 1.0, 1: -1.0}, 0.0, e)
    friction = [vx.Friction(1, level)]
    system = vx.ImpactSystem(
        [1.0, 2.0], np.zeros((2, 2)), np.zeros((2, 2)), None, [contact], friction=friction
    )
    matrix = vx.saltation_matrix(system, 0.0, [0.4, 0.4], [1.0, 0.0], 0)
    reset = np.array([[1 - 2 * (1 + e) / 3, 2 * (1 + e) / 3], [(1 + e) / 3, 1 - (1 + e) / 3]])
    before, after = np.array([1.0, 0.0]), reset[:, 0]
    row, at_rest = np.array([1.0, -1.0]), np.diag([1.0, 0.0])
    accelerations = np.array([0.0, -level / 2])
    expected = np.block(
        [
            [np.eye(2) + np.outer(after - before, row), np.zeros((2, 2))],
            [np.outer(accelerations, row), reset @ at_rest],
        ]
    )
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_run_is_a_product_of_flights_and_the_saltation():
    stiffness, damping = np.array([[2.0, -1.0], [-1.0, 1.0]]), np.array([[0.2, -0.1], [-0.1, 0.1]])
    friction = [vx.Friction(0, 0.1), vx.Friction({0: 1.0, 1: -1.0}, 0.05)]
    load = vx.Harmonic([0.5, 0.0], 0.8)
    system = vx.ImpactSystem([1.0, 1.0], damping, stiffness, load, [STOP], friction=friction)
    start = [0.1, -0.2], [0.9, 0.3]
    sol = vx.simulate(system, 0.2, 0.6, *start)
    kinds = np.asarray(sol.events.kind[: int(sol.num_events)]).tolist()
    assert kinds == [vx.IMPACT]
    hit = float(sol.events.t[0])
    x, v = sol.evaluate(hit)
    v = v.at[0].set(sol.events.velocity_minus[0])
    saltation = vx.saltation_matrix(system, hit, x, v, 0)
    product = flight_matrix(system, 0.6 - hit) @ saltation @ flight_matrix(system, hit - 0.2)

    def end(y):
        sol = vx.simulate(system, 0.2, 0.6, y[:2], y[2:])
        return jnp.concatenate([sol.x1, sol.v1])

    whole = jax.jacfwd(end)(jnp.concatenate([jnp.array(a) for a in start]))
    np.testing.assert_allclose(whole, product, rtol=0, atol=10 * ROUNDING)


@pytest.mark.slow
def test_the_state_of_a_jenkins_element_belongs_to_the_matrix():
    system = oscillator(friction=(), hysteresis=[vx.Jenkins(0, 3.0, 0.2)])
    matrix = vx.saltation_matrix(system, TIME, [0.3], [SPEED], 0)
    assert matrix.shape == vx.monodromy_matrix(system, [0.0], [0.0]).shape


def test_a_compliant_stop_is_refused():
    system = oscillator(stops=(STOP, vx.CompliantStop(0, 0.2, "upper", 10.0)))
    with pytest.raises(ValueError, match="`stop` must be the number of a rigid stop, but 1 is compliant"):
        vx.saltation_matrix(system, TIME, [0.2], [SPEED], 1)
