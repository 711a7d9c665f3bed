"""Derivatives after many periods and many impacts: their error grows no faster than the rounding of the time does."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

FREQUENCY = 0.2
PERIOD = 2 * np.pi / FREQUENCY
# Roundings of one period, of a motion that repeats.
REPEATS = 1e-12


def end_by_amplitude(factor, periods: int):
    system = vx.models.wagg_bishop_b(FREQUENCY)
    system = eqx.tree_at(lambda s: s.forcing.amplitude, system, system.forcing.amplitude * factor)
    sol = vx.simulate(system, 0.0, periods * PERIOD, max_events=0, throw=False)
    return jnp.concatenate([sol.x1, sol.v1])


def end_by_frequency(factor, periods: int):
    frequency = FREQUENCY * factor
    sol = vx.simulate(
        vx.models.wagg_bishop_b(frequency), 0.0, periods * 2 * np.pi / frequency, max_events=0, throw=False
    )
    return jnp.concatenate([sol.x1, sol.v1])


@pytest.mark.parametrize("periods", [1000, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("end", [pytest.param(end_by_amplitude, marks=pytest.mark.slow), end_by_frequency])
def test_a_settled_motion_has_the_derivatives_of_a_hundred_periods(end, periods):
    early, late = (jax.jvp(partial(end, periods=n), (1.0,), (1.0,))[1] for n in (100, periods))
    assert np.abs(early).max() > 0.1
    # Times are rounded to a spacing at most; accelerations and their derivatives are below 2.
    tolerance = REPEATS + 2 * np.spacing(periods * PERIOD)
    np.testing.assert_allclose(late, early, rtol=0, atol=tolerance)


@pytest.mark.parametrize("half_swings", [1000, pytest.param(100_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("mode", ["forward", pytest.param("reverse", marks=pytest.mark.slow)])
def test_an_elastic_mass_at_its_rest_position_has_those_of_its_swing(half_swings, mode):
    """x = -0.1 |cos w t|, hit at each half swing: by k it is 0.1 t sin(w t) sign(cos w t) / (2 w)."""

    def end(stiffness):
        system = vx.ImpactSystem([1.0], [[0.0]], stiffness[None, None], None, [vx.Stop(0, 0.0, "upper", 1.0)])
        return vx.simulate(system, 0.0, t, [-0.1], [0.0], max_events=0, throw=False).x1[0]

    k = 1.7
    w, t = np.sqrt(k), (half_swings + 0.3) * np.pi / np.sqrt(k)
    derivative = {"forward": jax.jacfwd, "reverse": jax.jacrev}[mode]
    found = float(derivative(end)(jnp.array(k)))
    right = 0.1 * t * np.sin(w * t) * np.sign(np.cos(w * t)) / (2 * w)
    # A rounding of each of the hits moves the next ones: their sum is within that of the time, in a derivative as large as it.
    assert abs(found - right) <= 1e-14 * half_swings * abs(right)
