"""A machine run backwards returns to where it began, or not at all."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._manifolds.reversal import StateMap, no_inverse, reversed_machine

LOAD = vx.Harmonic([0.5], 0.85, [0.3])
SHAKEN = vx.Harmonic([0.1], 0.85, [0.7])


def machine(*stops, force=None):
    return vx.ImpactSystem([1.0], [[0.05]], [[1.0]], LOAD, stops, force=force)


def maps(system, args=None, phase=0.4):
    """The map of a machine forwards and backwards."""
    scale = np.array([float(system.forcing.frequency), 1.0])
    backwards = reversed_machine(system)
    return (
        StateMap(system, 1, jnp.asarray(phase), scale, None, args),
        StateMap(backwards, -1, jnp.asarray(-phase), scale, None, args),
    )


def states(high, count=40):
    return np.random.default_rng(0).uniform([-0.8, -1.0], [high, 1.0], (count, 2))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("stops", "high"),
    [
        pytest.param([], 1.0, id="no stop"),
        pytest.param([vx.Stop(0, 0.4, "upper", 0.7), vx.Stop(0, -1.5, "lower", 1.0)], 0.3, id="stops"),
        pytest.param([vx.Stop(0, 0.4, "upper", 0.7, SHAKEN)], 0.1, id="a moving stop"),
        pytest.param([vx.CompliantStop(0, 0.4, "upper", 5.0, preload=0.1)], 1.0, id="a compliant stop"),
    ],
)
def test_backwards_undoes_forwards(stops, high):
    forward, backward = maps(machine(*stops))
    z = states(high)
    ends = forward(z, 2)
    assert np.abs(ends - z).max() > 0.1
    np.testing.assert_allclose(backward(ends, 2), z, atol=1e-11)


class Driven(eqx.Module):
    """A force that depends on everything."""

    cubic: float

    def __call__(self, t, x, v, args):
        return -self.cubic * x**3 - 0.1 * v * x**2 + args * jnp.cos(0.85 * t + 0.2)


@pytest.mark.slow
def test_forces_run_backwards_too():
    forward, backward = maps(machine(vx.Stop(0, 0.8, "upper", 0.7), force=Driven(1.0)), args=0.1)
    z = states(0.6)
    np.testing.assert_allclose(backward(forward(z, 1), 1), z, atol=1e-7)


def test_what_nothing_comes_from_is_not_found():
    forward, backward = maps(machine(vx.Stop(0, 0.2, "upper", 0.5), vx.Stop(0, -0.2, "lower", 0.5)))
    z = np.array([[0.0, 3.0], [0.0, 0.1]])
    before = backward(z, 3)
    assert np.isnan(before[0]).all()  # every impact backwards doubles its speed
    assert not (np.abs(forward(before, 3) - z) < 1e-6).all()


def test_machines_without_an_inverse_are_named():
    assert no_inverse(machine(vx.Stop(0, 0.4, "upper", 0.7))) == ""
    assert "restitution 0" in no_inverse(machine(vx.Stop(0, 0.4, "upper", 0.0)))
    assert "damper of `stops[0]`" in no_inverse(machine(vx.CompliantStop(0, 0.4, "upper", 5.0, 0.1)))
    steel = vx.FallingRestitution
    assert "depends on the speed" in no_inverse(machine(vx.Stop(0, 0.4, "upper", steel(0.9, 1.0))))
    rubbed = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], LOAD, friction=[vx.Friction({0: 1.0}, 0.1)])
    assert "friction" in no_inverse(rubbed)


def test_no_state_has_no_image():
    forward, _ = maps(machine())
    assert forward(np.zeros((0, 2)), 1).shape == (0, 2)
