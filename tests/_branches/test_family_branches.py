"""Branches, bifurcations and their derivatives along the values of a family."""

import jax
import numpy as np
import pytest
from families import rotor
from helpers import counted

import vijax as vx
from vijax._branches.starts import family_of, starting_orbits
from vijax._flow.modal import ModalFlow
from vijax._flow.taylor import TaylorFlow

pytestmark = pytest.mark.thorough

SPEED = 0.7
BOUNDS = {"frequency": (0.5, 1.5), "clearance": (0.3, 0.9)}
# The same point on two branches, solved to rounding.
ROUNDING = 1e-11
# Central differences of values.
DIFFERENCES = 1e-6


def settled(system, num_periods=1):
    sol = vx.simulate(system, 0.0, 200 * system.forcing.period, max_events=1, throw=False)
    return vx.periodic_orbit(system, sol.x1, sol.v1, num_periods)


@pytest.fixture(scope="module")
def family():
    return vx.Family(rotor, frequency=SPEED)


@pytest.fixture(scope="module")
def orbit(family):
    return settled(family)


@pytest.fixture(scope="module")
def branch(orbit):
    return vx.continuation(orbit, "frequency", BOUNDS["frequency"], progress=False)


@pytest.fixture(scope="module")
def of_machine():
    """Branch of the machine at the speed of the period doubling, by the amplitude of its load."""
    return vx.continuation(settled(rotor(SPEED)), "forcing.amplitude[0]", (0.05, 0.6), progress=False)


def point_of(branch, kind):
    return next(point for point in branch.bifurcations if point.kind == kind)


def test_an_orbit_keeps_its_family(family, orbit):
    assert isinstance(orbit.system, vx.Family)
    alone = settled(rotor(SPEED))
    np.testing.assert_array_equal(orbit.x0, alone.x0)
    np.testing.assert_array_equal(orbit.multipliers, alone.multipliers)
    (found,) = vx.find_periodic_orbits(family, [[float(orbit.x0[0]), float(orbit.v0[0])]], 1, progress=False)
    assert isinstance(found.system, vx.Family)


def test_points_of_a_branch_are_orbits_at_its_values(branch):
    k = len(branch) // 2
    there = branch.orbit(k)
    assert isinstance(there.system, vx.Family)
    assert float(there.system.values["frequency"]) == branch.values[k]
    machine = rotor(branch.values[k])
    again = vx.periodic_orbit(machine, there.x0, there.v0)
    np.testing.assert_allclose(again.x0, there.x0, atol=ROUNDING)
    np.testing.assert_allclose(
        np.sort(np.abs(again.multipliers)), np.sort(np.abs(there.multipliers)), atol=1e-9
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gr", "pd"])
def test_bifurcations_by_eccentricity_are_those_by_amplitude(kind, orbit, of_machine):
    bounds = (0.05 / SPEED**2, 0.6 / SPEED**2)
    own = point_of(vx.continuation(orbit, "eccentricity", bounds, progress=False), kind)
    other = point_of(of_machine, kind)
    assert own.value * SPEED**2 == pytest.approx(other.value, rel=ROUNDING)
    np.testing.assert_allclose(own.orbit.x0, other.orbit.x0, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("gr", marks=pytest.mark.slow), "pd"])
def test_values_of_bifurcations_have_the_derivatives_of_the_chain_rule(kind, family, branch, of_machine):
    """At a bifurcation e W^2 = A(W), where A is that of the machine: (A' - 2 e W) dW = W^2 de."""
    point, amplitude = point_of(branch, kind), point_of(of_machine, kind)
    speed = lambda e: vx.bifurcation_value(point, family.at(eccentricity=e))  # noqa: E731
    w, slope = jax.value_and_grad(speed)(0.5)
    assert float(w) == pytest.approx(point.value, rel=ROUNDING)
    a, of_speed = jax.value_and_grad(lambda w: vx.bifurcation_value(amplitude, rotor(w)))(w)
    assert float(a) == pytest.approx(0.5 * float(w) ** 2, rel=ROUNDING)
    assert float(slope) == pytest.approx(float(w**2 / (of_speed - w)), rel=1e-9)
    step = 1e-5
    differences = (speed(0.5 + step) - speed(0.5 - step)) / (2 * step)
    assert float(slope) == pytest.approx(float(differences), rel=DIFFERENCES)


@pytest.mark.slow
def test_a_fold_of_the_family_is_that_of_the_machine(family, branch):
    (doubled,) = vx.switch_branch(point_of(branch, "pd"))
    other = vx.continuation(doubled, "frequency", (0.7, 0.79), progress=False)
    fold = point_of(other, "fold")
    machine = rotor(fold.value)
    there = fold.orbit
    start = vx.PeriodicOrbit(**{**vars(there), "system": machine})
    amplitude = 0.5 * fold.value**2
    of_machine = vx.continuation(
        start, "forcing.amplitude[0]", (0.9 * amplitude, 1.1 * amplitude), progress=False
    )
    same = point_of(of_machine, "fold")
    assert same.value == pytest.approx(amplitude, rel=1e-9)
    slope = jax.grad(lambda e: vx.bifurcation_value(fold, family.at(eccentricity=e)))(0.5)
    of_speed = jax.grad(lambda w: vx.bifurcation_value(same, rotor(w)))(fold.value)
    assert float(slope) == pytest.approx(fold.value**2 / (float(of_speed) - fold.value), rel=1e-7)


@pytest.mark.slow
def test_a_curve_over_two_values_passes_through_bifurcations_of_both(family, branch):
    curve = vx.bifurcation_curve(point_of(branch, "pd"), "clearance", BOUNDS, max_points=20, progress=False)
    assert list(curve.coords) == ["frequency", "clearance"]
    k = 3
    machine = family.at(clearance=float(curve.clearance[k]))
    value = vx.bifurcation_value(point_of(branch, "pd"), machine)
    assert float(value) == pytest.approx(float(curve.frequency[k]), rel=1e-9)


def test_branches_through_a_sweep(family, branch):
    ds = vx.sweep(family, {"W": ("frequency", np.linspace(0.5, 0.75, 6))}, progress=False)
    found = vx.branches(ds, depth=0, progress=False)
    assert found[0].path == "frequency"
    assert point_of(found[0], "gr").value == pytest.approx(point_of(branch, "gr").value, rel=ROUNDING)


def test_a_saved_branch_takes_the_function_back(branch):
    for again in (
        vx.Branch(branch.points, family=rotor),
        vx.Branch(branch.points, allow_forces=["families"]),
    ):
        assert isinstance(again.orbit(0).system, vx.Family)
        np.testing.assert_array_equal(again.orbit(0).x0, branch.orbit(0).x0)


def test_quantities_and_monitors_along_a_value(orbit):
    found = vx.continuation(
        orbit,
        "frequency",
        (0.65, 0.75),
        quantities=["max_position"],
        monitor={"reach": lambda sol: float(sol.x1[0]) - 0.5},
        progress=False,
    )
    touch = point_of(found, "gr")
    assert float(found.points.max_position[touch.index, 0]) == pytest.approx(0.6, abs=1e-9)
    assert "reach" in found.points


CELL = """
def cell(w, e=0.5):
    load = vx.Harmonic([e * w**2], w)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.6, "upper", 0.7)])
"""


def followed_by_cell():
    names = {"vx": vx}
    exec(CELL, names)
    start = settled(vx.Family(names["cell"], w=SPEED))  # pyright: ignore[reportArgumentType]
    return vx.continuation(start, "w", (0.6, 0.7), progress=False)


def test_the_cell_of_a_notebook_run_again_compiles_nothing():
    first = followed_by_cell()
    with counted() as compilations:
        again = followed_by_cell()
        again.orbit(0)
    assert compilations == []
    np.testing.assert_array_equal(first.points.x0, again.points.x0)


def flow_of(family, path, bounds):
    (start,) = starting_orbits(settled(family))
    return family_of(start, path, *bounds).flow


def test_the_flow_serves_all_machines_between_the_bounds(family):
    assert isinstance(flow_of(family, "clearance", (0.5, 0.7)), ModalFlow)
    assert isinstance(flow_of(family, "frequency", (0.6, 0.8)), ModalFlow)

    def stiffened(k):
        return vx.ImpactSystem(
            [1.0], [[0.1]], [[k]], vx.Harmonic([0.2], 0.7), [vx.Stop(0, 0.9, "upper", 0.7)]
        )

    assert isinstance(flow_of(vx.Family(stiffened, k=1.0), "k", (0.9, 1.1)), TaylorFlow)


def test_what_does_not_fit_gets_a_sentence(family, orbit, branch):
    with pytest.raises(ValueError, match=r"values of the family are frequency, eccentricity, clearance"):
        vx.continuation(orbit, "stops[0].position", (0.1, 0.9), progress=False)
    with pytest.raises(ValueError, match="give a family"):
        vx.bifurcation_value(point_of(branch, "pd"), rotor(SPEED))
    with pytest.raises(ValueError, match="does not lie within the bounds"):
        vx.continuation(orbit, "frequency", (0.8, 0.9), progress=False)
