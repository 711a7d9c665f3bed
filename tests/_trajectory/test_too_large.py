"""Derivatives too large to be useful give one warning, and others give none."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import slow_except

import vijax as vx
from vijax._trajectory import derivative_growth

SYSTEM = vx.models.impact_oscillator(2.4, restitution=0.4, damping_ratio=0.1)
# Factor on start and end, as of a tiny unit of length: derivatives grow by its square.
TINY_UNIT = 1e21
SENTENCE = "Derivatives through a trajectory have grown to 1e"


@pytest.fixture(autouse=True)
def _not_told_yet():
    """Forget warnings of other tests."""
    derivative_growth._warn.cache_clear()
    yield
    derivative_growth._warn.cache_clear()


def end(y, unit=TINY_UNIT, throw=True):
    """Position after a period, by the start, both scaled by `unit`, so that forward and reverse seeds have its size."""
    start = -0.1 + unit * y
    sol = vx.simulate(SYSTEM, 0.0, 2.6, start[None], jnp.array([0.1]), max_events=16, throw=throw)
    return unit * sol.x1[0]


def told_by(derivative, *args) -> list[str]:
    """Warnings from a derivative that is taken twice."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(2):
            jax.block_until_ready(derivative(*args))
    return [str(warning.message) for warning in caught]


WAYS = {
    "forward": jax.jacfwd(end),
    "reverse": jax.grad(end),
    "forward of a batch": jax.vmap(jax.jacfwd(end)),
    "reverse of a batch": jax.vmap(jax.grad(end)),
    "forward, compiled": jax.jit(jax.jacfwd(end)),
    "reverse, compiled": jax.jit(jax.grad(end)),
    "forward of a batch, compiled": jax.jit(jax.vmap(jax.jacfwd(end))),
    "reverse of a batch, compiled": jax.jit(jax.vmap(jax.grad(end))),
}


@pytest.mark.thorough
@pytest.mark.parametrize("way", slow_except(["reverse"], WAYS))
def test_they_are_told_of_once_whatever_they_are_taken_by(way):
    told = told_by(WAYS[way], jnp.zeros(3) if "batch" in way else jnp.zeros(()))
    assert len(told) == 1
    assert told[0].startswith(SENTENCE)
    assert all(remedy in told[0] for remedy in ("shorter spans", "multiple shooting", "`vx.periodic_orbit`"))


@pytest.mark.slow
def test_one_bad_lane_of_a_batch_is_enough():
    by_unit = jax.vmap(jax.grad(end), in_axes=(None, 0))
    assert told_by(by_unit, jnp.zeros(()), jnp.array([1.0, TINY_UNIT, 1.0]))[0].startswith(SENTENCE)


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.grad])
@pytest.mark.slow
def test_others_are_not_told_of_and_stay_what_they_are(derivative):
    small, large = derivative(end)(jnp.zeros(()), 1.0), None
    assert told_by(derivative(end), jnp.zeros(()), 1.0) == []
    with pytest.warns(UserWarning, match=SENTENCE):
        large = derivative(end)(jnp.zeros(()))
    np.testing.assert_allclose(large, TINY_UNIT**2 * small, rtol=1e-12)


def test_what_is_infinite_is_not_told_of():
    """At grazing, derivatives are infinite for spans of any length."""
    assert told_by(lambda: derivative_growth.warn_if_large([jnp.array([np.inf, -np.inf, np.nan, 1.0])])) == []
    assert told_by(lambda: derivative_growth.warn_if_large([jnp.array([np.inf, -1e20])])) != []


@pytest.mark.slow
def test_a_chaotic_motion_over_many_periods_is_told_of():
    system = vx.models.wagg_bishop_b(2.0)
    with pytest.warns(UserWarning, match=SENTENCE):
        matrix = vx.monodromy_matrix(system, [0.0, 0.0], [0.0, 0.1], 100)
    assert np.abs(matrix).max() > 1e20


@pytest.mark.slow
@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.grad])
def test_a_compiled_program_calls_back_only_where_it_does_so_anyway(derivative):
    """JAX never keeps programs that call back into Python in the folder of compiled programs."""
    for throw in (False, True):
        compiled = jax.jit(derivative(lambda y, throw=throw: end(y, throw=throw)))
        assert ("callback" in compiled.lower(jnp.zeros(())).as_text()) == throw
