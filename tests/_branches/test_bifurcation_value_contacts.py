"""Grazing of a moving contact of a machine with a full mass matrix, in closed form, with derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.slow

# Off-diagonal entry of the mass matrix, a coefficient of the row, the position, the amplitude of the contact.
NUMBERS = np.array([0.2, -0.7, 0.9, 0.05])
DAMPING, STIFFNESS = np.array([[0.2, -0.05], [-0.05, 0.1]]), np.array([[2.0, -0.8], [-0.8, 1.5]])
LOAD, PHASE, MOTION_PHASE = np.array([0.4, 0.1]), np.array([0.0, 0.7]), 1.1


def mass(entry):
    return jnp.array([[1.0, 0.0], [0.0, 1.3]]) + entry * jnp.array([[0.0, 1.0], [1.0, 0.0]])


def machine(numbers, w):
    entry, coefficient, position, motion = numbers
    shaken = vx.Harmonic(jnp.stack([motion]), w, np.array([MOTION_PHASE]))
    contact = vx.Contact({0: 1.0, 1: coefficient}, position, 0.7, shaken)
    return vx.ImpactSystem(mass(entry), DAMPING, STIFFNESS, vx.Harmonic(LOAD, w, PHASE), [contact])


def excess(w, numbers):
    """Penetration of the motion without impacts: amplitude of the relative motion minus the position."""
    entry, coefficient, position, motion = numbers
    impedance = STIFFNESS - w * w * mass(entry) + 1j * w * DAMPING
    response = jnp.linalg.solve(impedance, LOAD * np.exp(1j * PHASE))
    relative = response[0] + coefficient * response[1] - motion * np.exp(1j * MOTION_PHASE)
    return jnp.abs(relative) - position


def exact(w, numbers):
    for _ in range(6):
        w = w - excess(w, numbers) / jax.grad(excess)(w, numbers)
    return w


def test_a_grazed_contact_and_its_derivatives_in_closed_form():
    low, high = 1.7, 2.0
    orbit = vx.periodic_orbit(machine(NUMBERS, high), np.zeros(2), np.zeros(2), max_events=8)
    assert int(orbit.num_impacts[0]) == 0
    branch = vx.continuation(orbit, "forcing.frequency", (low, high), progress=False, max_points=60)
    grazing = next(point for point in branch.bifurcations[::-1] if point.kind == "gr")
    found = lambda numbers: vx.bifurcation_value(grazing, machine(numbers, high))  # noqa: E731
    known = lambda numbers: exact(jnp.asarray(grazing.value), numbers)  # noqa: E731
    assert grazing.value == pytest.approx(float(known(NUMBERS)), rel=1e-12)
    other = NUMBERS + np.array([0.02, 0.03, -0.01, 0.01])
    assert float(found(other)) == pytest.approx(float(known(other)), rel=1e-12)
    slopes = jax.grad(known)(NUMBERS)
    np.testing.assert_allclose(jax.grad(found)(NUMBERS), slopes, rtol=0, atol=1e-11 * abs(slopes).max())
    np.testing.assert_allclose(jax.jacfwd(found)(NUMBERS), slopes, rtol=0, atol=1e-11 * abs(slopes).max())
