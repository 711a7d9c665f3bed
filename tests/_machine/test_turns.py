"""Turns of loads in whole periods of another, against rational arithmetic."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._machine.turns import Turns

COUNTS = np.array([0, 1, 7, 10**6, 10**6 + 1, 2**31 - 1])


@pytest.mark.parametrize(
    ("frequency", "clock"), [(2.3, 1.0), (np.sqrt(2), 0.77), (1e-5, 3.3), (123456.789, 0.1), (0.3, 0.3)]
)
def test_the_phase_after_any_number_of_periods_is_exact(frequency: float, clock: float):
    turns = Turns.of(jnp.asarray(frequency), jnp.asarray(clock))
    whole, rest = jax.jit(lambda n: turns.in_periods(n))(jnp.asarray(COUNTS))
    for count, *found in zip(COUNTS.tolist(), whole.tolist(), rest.tolist(), strict=True):
        exact = count * Fraction(frequency) / Fraction(clock)
        assert abs(found[1]) <= 0.5
        assert abs(Fraction(found[0]) + Fraction(found[1]) - exact) < 2**-53


def test_derivatives_are_those_of_the_quotient():
    def rest(w):
        return Turns.of(w[0], w[1]).in_periods(jnp.asarray(1000))[1]

    np.testing.assert_allclose(jax.grad(rest)(jnp.array([2.3, 0.7])), [1000 / 0.7, -1000 * 2.3 / 0.49])


def test_no_periods_are_counted_without_a_clock():
    whole, rest = Turns.of(jnp.asarray(2.3), jnp.asarray(0.0)).in_periods(jnp.asarray(0))
    assert (float(whole), float(rest)) == (0, 0)
