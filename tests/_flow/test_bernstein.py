"""First zero crossings of polynomials in Bernstein form."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._flow.bernstein import bernstein, derivative_coefficients, divided, first_crossing, nodes
from vijax._flow.diffrax_flow import degree_inside


def test_events_are_looked_for_in_the_polynomial_that_the_solver_has():
    solvers = [diffrax.Heun(), diffrax.Bosh3(), diffrax.Tsit5(), diffrax.Dopri5(), diffrax.Dopri8()]
    assert [degree_inside(solver) for solver in solvers] == [3, 3, 4, 4, 6]


@pytest.mark.parametrize("degree", [3, 4, 6])
def test_the_first_zero_of_a_polynomial_is_found_and_never_passed(degree):
    rng = np.random.default_rng(degree)
    roots = rng.uniform(-0.5, 1.5, (2000, degree))
    # Every third polynomial has two zeros close together, which the signs at the ends do not reveal.
    roots[::3, 1] = roots[::3, 0] + 1e-3
    inside = np.where((roots > 0) & (roots <= 1), roots, 1.0)
    values = np.prod(nodes(degree)[:, None, None] - roots[None], axis=-1)
    values *= np.sign(values[0])
    found = jax.jit(jax.vmap(lambda v: first_crossing(bernstein(v)), 1))(jnp.asarray(values))
    np.testing.assert_allclose(found, inside.min(axis=-1), rtol=0, atol=1e-6)


@pytest.mark.parametrize("degree", [3, 4, 6])
def test_bernstein_coefficients_of_a_slope_and_of_a_quotient_are_those_of_their_values(degree):
    times, powers = nodes(degree), np.random.default_rng(degree).normal(size=degree)
    values = np.polynomial.Polynomial([0.0, *powers])  # zero at 0
    found = bernstein(jnp.asarray(values(times)))
    for coefficients, expected in (
        (derivative_coefficients(found), values.deriv()),
        (divided(found, jnp.asarray(powers[0])), np.polynomial.Polynomial(powers)),
    ):
        np.testing.assert_allclose(coefficients, bernstein(jnp.asarray(expected(times))), rtol=0, atol=1e-11)
