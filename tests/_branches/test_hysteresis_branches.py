"""Branches of machines whose Jenkins elements stick all along: those of springs in their place."""

import numpy as np
import pytest

import vijax as vx

# The programs take some minutes to compile.
pytestmark = pytest.mark.slow
LOW, HIGH = 2.2, 2.5
STIFFNESS, SLIDERS = 1.0, (0.35, 0.25)


def machine(frequency=2.2, limit=100.0, sliders=SLIDERS) -> vx.ImpactSystem:
    load, stop = vx.Harmonic([0.5], frequency), vx.Stop(0, 0.1, "upper", 0.7)
    joints = [vx.Jenkins(0, k, limit, slider=0.0) for k in sliders]
    return vx.ImpactSystem([1.0], [[0.1]], [[STIFFNESS - sum(sliders)]], load, [stop], hysteresis=joints)


def branch_of(system, path: str) -> vx.Branch:
    at = system.system if isinstance(system, vx.Family) else system
    sol = vx.simulate(system, 0.0, 300 * at.forcing.period, max_events=2, throw=False)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
    return vx.continuation(orbit, path, (LOW, HIGH), progress=False)


@pytest.mark.parametrize("is_family", [False, True])
def test_two_sliders_that_stick_all_along_are_springs(is_family):
    springs = branch_of(machine(sliders=()), "forcing.frequency")
    joints, path = machine(), "forcing.frequency"
    if is_family:
        joints, path = vx.Family(machine, frequency=2.2), "frequency"
    found = branch_of(joints, path)
    assert found.ends == ("bounds", "bounds")
    kinds = lambda branch: [point.kind for point in branch.bifurcations]  # noqa: E731
    assert kinds(found) == kinds(springs) == ["pd", "gr"]
    values = lambda branch: [point.value for point in branch.bifurcations]  # noqa: E731
    np.testing.assert_allclose(values(found), values(springs), rtol=1e-10)
    # A multiplier of 1 for each slider, which may be anywhere, beside those of the springs.
    multipliers, expected = (branch.points["multipliers"].values[0] for branch in (found, springs))
    sorted_ = lambda numbers: np.sort(np.abs(numbers))[::-1]  # noqa: E731
    np.testing.assert_allclose(sorted_(multipliers)[:4], sorted_([1.0, 1.0, *expected]), atol=1e-9)
