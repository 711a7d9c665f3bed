"""The side to which a switch of branches goes does not hang on rounding."""

import numpy as np
import pytest
from combinations import FREQUENCY, KINDS, POSITION

import vijax as vx
from vijax._branches.pitchfork import leading_entry


@pytest.mark.parametrize("vector", [[0.1, -0.7, 0.7, 0.1], [0.6, -0.8], [0.0, 1e-9, -1.0]])
def test_the_leading_entry_has_the_sign_of_a_vector_whatever_rounds(vector):
    vector = np.asarray(vector)
    for rounded in (vector, vector * (1 + 1e-15 * np.arange(len(vector))), vector - 1e-16):
        for turned in (rounded, -rounded):
            assert np.sign(leading_entry(turned)) * np.sign(turned @ vector) == np.sign(leading_entry(vector))


@pytest.mark.slow
def test_a_machine_written_in_two_ways_doubles_its_period_to_the_same_side():
    starts = []
    for written in (KINDS["harmonic load"].of, KINDS["harmonic load"].twin):
        machine = written(FREQUENCY, POSITION)
        sol = vx.simulate(machine, 0.0, 200 * machine.forcing.period, max_events=1024)
        orbit = vx.periodic_orbit(machine, sol.x1, sol.v1)
        branch = vx.continuation(orbit, "forcing.frequency", (FREQUENCY, 2.3), progress=False)
        (doubling,) = branch.bifurcations
        (doubled,) = vx.switch_branch(doubling)
        starts.append(np.concatenate([doubled.x0, doubled.v0]))
    np.testing.assert_allclose(*starts, rtol=0, atol=1e-8)
