"""The edge state between two attractors against the saddle as a periodic orbit, and the refusals."""

import numpy as np
import pytest

import vijax as vx

# With a quarter of this damping the boundary is fractal: which saddle is found, if any, depends on rounding there.
SYSTEM = vx.models.two_sided_oscillator(3.0, damping_ratio=0.1)


@pytest.fixture(scope="module")
def found():
    return vx.attractors(SYSTEM, 60, progress=False)


@pytest.mark.slow
def test_the_edge_state_is_the_saddle_between_the_attractors(found):
    edge = vx.edge_state(found, progress=False)
    assert edge["num_periods"] > 0
    assert list(edge["goes_to"]) == [0, 1]
    error = float(edge["size_error"] + edge["recurrence_error"])
    assert error < 1e-6
    saddle = vx.periodic_orbit(SYSTEM, edge["x0"].values, edge["v0"].values, int(edge["num_periods"]))
    assert abs(float(edge["x0"][0] - saddle.x0[0])) < error
    assert abs(float(edge["v0"][0] - saddle.v0[0])) < 10 * error
    assert np.count_nonzero(np.abs(saddle.multipliers) > 1) == 1


@pytest.mark.thorough
def test_starts_of_one_attractor_are_refused(found):
    with pytest.raises(ValueError, match="Both starts lead to attractor 1"):
        vx.edge_state(found, 1, 1, progress=False)
    with pytest.raises(ValueError, match="`start_b` lies beyond a stop"):
        vx.edge_state(found, 0, ([9.0], [0.0]), progress=False)
    with pytest.raises(ValueError, match="`start_a` must be less than 2"):
        vx.edge_state(found, 2, 0, progress=False)
    with pytest.raises(ValueError, match="`start_b` must be positions and velocities"):
        vx.edge_state(found, 0, ([0.0, 1.0], [0.0]), progress=False)
