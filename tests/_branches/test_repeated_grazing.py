"""A branch of cycles of four periods ends where that of one period grazes: three of its impacts vanish at once."""

import numpy as np
import pytest

import vijax as vx

FREQUENCY = "forcing.frequency"


def machine(frequency: float) -> vx.ImpactSystem:
    return vx.ImpactSystem(
        [0.918773, 0.974639],
        [[0.282186, -0.229181], [-0.229181, 0.229181]],
        [[1.592374, -0.700822], [-0.700822, 0.700822]],
        vx.Harmonic([0.817988, 0.607275], frequency),
        [vx.Stop(0, 0.70028, "upper", 0.456959), vx.Stop(1, -0.5631, "lower", 0.785713)],
    )


@pytest.mark.slow
def test_it_ends_at_the_grazing_of_the_shorter_cycle():
    frequency = 1.56872
    orbit = vx.periodic_orbit(machine(frequency), [-0.476161, -0.46606], [0.909469, -0.459481], 4)
    assert orbit.num_impacts.tolist() == [4, 3]
    branch = vx.continuation(orbit, FREQUENCY, (1.5685, 1.5705), progress=False)
    assert set(branch.ends) == {"gr", "bounds"}
    (end,) = [point for point in branch.bifurcations if point.kind == "gr"]

    shorter = vx.periodic_orbit(machine(1.5699), end.orbit.x0, end.orbit.v0)
    assert shorter.num_impacts.tolist() == [1, 0]
    of_one = vx.continuation(shorter, FREQUENCY, (1.5685, 1.5705), progress=False)
    grazings = [point.value for point in of_one.bifurcations if point.kind == "gr"]
    assert np.abs(np.array(grazings) - end.value).min() < 1e-10
