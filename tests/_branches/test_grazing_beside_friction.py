"""Grazings in machines with friction, Jenkins elements and compliant stops: their square roots, and the orbits that leave them."""

import numpy as np
import pytest
from combinations import KINDS, machine

import vijax as vx

# The programs take a minute to compile.
pytestmark = pytest.mark.slow
FREQUENCY, BOUNDS = "forcing.frequency", (2.15, 2.6)
NAMES = "compliant stop", "friction", "friction of a contact", "Jenkins element"


def branch_from(name: str, frequency: float) -> vx.Branch:
    """The branch from the orbit at a frequency: with impacts below the grazing, without above."""
    system = KINDS[name].of(frequency, 0.1)
    sol = vx.simulate(system, 0.0, 200 * system.forcing.period, max_events=4096)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, BOUNDS, progress=False)


def grazing_of(branch: vx.Branch) -> vx.Bifurcation:
    (point,) = (one for one in branch.bifurcations if one.kind == "gr")
    return point


@pytest.fixture(scope="module", params=NAMES)
def grazing(request) -> vx.Bifurcation:
    """A grazing met from the side with impacts."""
    point = grazing_of(branch_from(request.param, 2.2))
    assert point.branch.points["num_impacts"].values[:, 0].max() == 1
    return point


def test_the_square_root_is_what_the_stop_adds_to_a_neighbour(grazing, request):
    """The period from a neighbour that would pass the stop by a depth, with the stop and without it."""
    form, orbit = grazing.normal_form, grazing.orbit
    name = request.node.callspec.params["grazing"]
    free = KINDS[name].of(float(orbit.system.forcing.frequency), 10.0)
    size, period = orbit.system.num_masses, orbit.system.forcing.period
    # The stretches of Jenkins elements stay as they are.
    is_mass = np.tile(np.arange(len(orbit.x0)) < size, 2)
    gradient = np.where(is_mass, form.gradient, 0.0)
    errors = []
    for depth in (1e-6, 1e-8):
        x0, v0 = np.split(np.concatenate([orbit.x0, orbit.v0]) - depth * gradient / (gradient @ gradient), 2)
        ends = [vx.simulate(one, 0.0, period, x0, v0) for one in (orbit.system, free)]
        added = np.concatenate([ends[0].x1 - ends[1].x1, ends[0].v1 - ends[1].v1]) / np.sqrt(depth)
        errors.append(np.max(np.abs(added - form.square_root[is_mass])))
    assert errors[0] < 0.05
    assert errors[1] < errors[0] / 8


def test_the_machine_follows_the_orbit_of_two_periods_that_leaves(grazing):
    (other,) = vx.switch_branch(grazing)
    assert other.num_periods == 2
    assert int(other.num_impacts[0]) == 1
    assert 0 < abs(float(other.system.forcing.frequency) - grazing.value) < 2e-3
    sol = other.solution()
    np.testing.assert_allclose(sol.x1, other.x0[: other.system.num_masses], rtol=0, atol=1e-10)
    assert int(np.count_nonzero((sol.events.kind == vx.IMPACT) & (sol.events.stop == 0))) == 1


def test_from_the_side_without_impacts_it_is_the_same_grazing():
    one, other = (grazing_of(branch_from("friction", frequency)) for frequency in (2.2, 2.5))
    np.testing.assert_allclose(one.normal_form.square_root, other.normal_form.square_root, rtol=1e-6)
    (leaves,), (same) = (vx.switch_branch(point) for point in (one, other))
    np.testing.assert_allclose(leaves.x0, same[0].x0, rtol=0, atol=1e-9)


def test_a_compliant_stop_that_is_just_reached_is_refused():
    system = machine(2.5, 10.0, stops=[vx.CompliantStop(0, 0.1, "upper", 0.5)])
    sol = vx.simulate(system, 0.0, 200 * system.forcing.period, max_events=4096)
    branch = vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, (2.2, 2.6), progress=False)
    point = grazing_of(branch)
    with pytest.raises(
        ValueError, match="The compliant stop 1 pushes a mass that just reaches it by no impact"
    ):
        vx.switch_branch(point)
