"""Exponential of a machine's matrix minus the identity, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from vijax._flow.exponential import _differentiable_increments, _increments

SIZE = 5
MATRIX = jnp.asarray(np.random.default_rng(0).normal(size=(SIZE, SIZE)))
RATE = jnp.linalg.norm(MATRIX)
# Rounding of some tens of products of matrices, relative to the largest number.
ROUNDED = 1e-13


def assert_near(a, b):
    np.testing.assert_allclose(a, b, rtol=0, atol=ROUNDED * np.abs(b).max())


@pytest.mark.parametrize("span", [0.3, 7.0, -2.0])
def test_it_is_that_of_scipy(span):
    assert_near(
        _increments(MATRIX, jnp.asarray(span), RATE),
        scipy.linalg.expm(span * np.asarray(MATRIX)) - np.eye(SIZE),
    )


def test_a_short_time_loses_no_digits():
    assert_near(_increments(MATRIX, jnp.asarray(1e-12), RATE), 1e-12 * MATRIX + 5e-25 * MATRIX @ MATRIX)


def test_lanes_are_doubled_each_as_often_as_it_needs():
    spans = jnp.array([0.01, 3.0, 1e9, jnp.nan])
    found = jax.vmap(lambda span: _increments(MATRIX, span, RATE))(spans)
    for span, one in zip(spans[:2], found, strict=False):
        assert_near(one, scipy.linalg.expm(float(span) * MATRIX) - np.eye(SIZE))
    assert np.isnan(found[2:]).all()  # too long to be computed


def test_derivatives_are_those_of_all_its_products():
    at = MATRIX, jnp.asarray(0.7)
    for which in (0, 1):
        expected = jax.jacfwd(lambda a, span: _differentiable_increments(a, span, RATE), which)(*at)
        for derivative in (jax.jacfwd, jax.jacrev):
            assert_near(derivative(lambda a, span: _increments(a, span, RATE), which)(*at), expected)
