"""Behind a change of the sequence of events a branch goes on in the same way, whatever the units."""

import numpy as np
import pytest

import vijax as vx

FREQUENCY = "forcing.frequency"


def rubbing(frequency: float, length: float, time: float, mass: float) -> vx.ImpactSystem:
    """One mass with a stop and friction, in units of its own."""
    force = mass * length / time**2
    load, stop = vx.Harmonic([force], frequency / time), vx.Stop(0, 0.4 * length, "upper", 0.7)
    dry = [vx.Friction(0, 0.3 * force)]
    return vx.ImpactSystem([mass], [[0.1 * mass / time]], [[mass / time**2]], load, [stop], friction=dry)


def branch_of(system: vx.ImpactSystem, bounds: tuple[float, float]) -> vx.Branch:
    sol = vx.simulate(system, 0.0, 150 * system.forcing.period, max_events=4096)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, bounds, progress=False)


@pytest.mark.slow
@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0), (1e-3, 1e3, 3.0), (1e2, 1 / 7, 1 / 3)])
def test_a_slip_that_vanishes_is_passed_in_all_units(units):
    # In small units forces below 1e-14 counted as none, and the branch turned back; in large ones it ended.
    time = units[1]
    branch = branch_of(rubbing(1.02, *units), (1.0 / time, 1.08 / time))
    (point,) = branch.bifurcations
    assert point.kind == "switching_sliding"
    assert point.value * time == pytest.approx(1.04585571, abs=1e-8)
    np.testing.assert_allclose(branch.values[[0, -1]] * time, (1.0, 1.08), rtol=1e-12)
