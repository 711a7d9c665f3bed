"""Second derivatives of orbits and of bifurcations, forward and reverse, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from one_impact import Numbers, after_impact, discriminant, speed

import vijax as vx

pytestmark = pytest.mark.slow

PERIODS, FREQUENCY = 2, 2.45
NUMBERS = np.array([1.5, 0.8, 0.03, 1.0])
# Error relative to the largest second derivative.
ROUNDING = 1e-11


def start():
    numbers = Numbers(*NUMBERS)
    return after_impact(FREQUENCY, numbers, PERIODS, float(speed(FREQUENCY, numbers, PERIODS)))


def assert_second_derivatives(function, exact):
    expected = np.asarray(jax.hessian(exact)(NUMBERS))
    for found in (jax.hessian(function)(NUMBERS), jax.jacfwd(jax.jacfwd(function))(NUMBERS)):
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING * abs(expected).max())


def test_second_derivatives_of_the_speed_of_an_orbit():
    guess = start()

    def found(numbers):
        system = Numbers(*numbers).machine(FREQUENCY)
        return vx.periodic_orbit(system, *guess, PERIODS, max_events=8).events.velocity_minus[0]

    assert_second_derivatives(found, lambda numbers: speed(FREQUENCY, Numbers(*numbers), PERIODS))


def test_second_derivatives_of_a_fold():
    orbit = vx.periodic_orbit(Numbers(*NUMBERS).machine(FREQUENCY), *start(), PERIODS, max_events=8)
    branch = vx.continuation(orbit, "forcing.frequency", (2.0, 3.0), progress=False)
    fold = next(point for point in branch.bifurcations if point.kind == "fold")

    def exact(numbers):
        """Fold by Newton's method from its value: each step makes one more order of derivatives exact."""
        w, at = jnp.asarray(fold.value), Numbers(*numbers)
        for _ in range(3):
            w = w - discriminant(w, at, PERIODS) / jax.grad(discriminant)(w, at, PERIODS)
        return w

    found = lambda numbers: vx.bifurcation_value(fold, Numbers(*numbers).machine(FREQUENCY))  # noqa: E731
    assert float(found(NUMBERS)) == pytest.approx(float(exact(NUMBERS)), rel=1e-13)
    assert_second_derivatives(found, exact)
