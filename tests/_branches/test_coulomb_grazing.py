"""Grazing of a stop by a mass with friction of a contact, against a closed form."""

import jax
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import vijax as vx

# The programs take two minutes to compile.
pytestmark = pytest.mark.slow
FREQUENCY, POSITION = "forcing.frequency", "stops[0].position"
DAMPING, GRIP, PUSH, PLACE = 0.1, 0.05, 0.5, 0.1
LOW, HIGH = 2.3, 2.7


def machine(frequency=2.35, position=PLACE) -> vx.ImpactSystem:
    """A mass on a spring before a stop; a pad, pressed by 1 on a floor of its own, rubs on it."""
    load = vx.Harmonic([PUSH, 0.0], frequency, mean=[0.0, -1.0])
    stops = [vx.Stop(0, position, "upper", 0.7), vx.Contact({1: -1.0}, 0.0, restitution=0.5)]
    rubbing = vx.Friction(0, coefficient=GRIP, contact=1)
    return vx.ImpactSystem(
        [1.0, 1.0], np.diag([DAMPING, 0.0]), np.diag([1.0, 1.0]), load, stops, friction=[rubbing]
    )


def push_for(frequency: float, amplitude: float) -> float:
    """Amplitude of the load under which the mass slides between its turns at -+ amplitude, as J. P. Den Hartog (1931) found.

    States are x, v, the load, its rate / frequency, and 1. From a turn to the next, half a period later, the mass slides back.
    """
    w = frequency
    field = np.array(
        [[0, 1, 0, 0, 0], [-1, -DAMPING, 1, 0, GRIP], [0, 0, 0, w, 0], [0, 0, -w, 0, 0], [0, 0, 0, 0, 0]]
    )
    half = scipy.linalg.expm(field * np.pi / w)
    missing = np.array([-amplitude, 0.0]) - half[:2, [0, 4]] @ np.array([amplitude, 1.0])
    return float(np.linalg.norm(np.linalg.solve(half[:2, 2:4], missing)))


def grazing_at(position: float) -> float:
    excess = lambda w: push_for(w, position) - PUSH  # noqa: E731
    return float(scipy.optimize.root_scalar(excess, bracket=(LOW, HIGH), xtol=1e-14).root)


@pytest.fixture(scope="module")
def branch() -> vx.Branch:
    system = machine()
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period, max_events=2, throw=False)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, (LOW, HIGH), progress=False)


def grazing_of(branch: vx.Branch) -> vx.Bifurcation:
    (point,) = (one for one in branch.bifurcations if one.kind == "gr")
    return point


def test_the_branch_passes_its_grazing_to_the_motion_without_impacts(branch):
    assert branch.ends == ("bounds", "bounds")
    assert grazing_of(branch).value == pytest.approx(grazing_at(PLACE), rel=1e-10)
    assert sorted({int(one) for one in branch.points["num_impacts"].isel(stop=0)}) == [0, 1]
    free = branch.points.isel(point=np.flatnonzero(branch.points["num_impacts"].isel(stop=0) == 0))
    assert bool(free["is_admissible"].all())


def test_the_grazing_is_a_differentiable_function_of_the_position(branch):
    value = lambda position: vx.bifurcation_value(grazing_of(branch), machine(position=position))  # noqa: E731
    for position in (PLACE, 1.02 * PLACE):
        assert float(value(position)) == pytest.approx(grazing_at(position), rel=1e-10)
    step = 1e-5
    slope = (grazing_at(PLACE + step) - grazing_at(PLACE - step)) / (2 * step)
    assert float(jax.grad(value)(PLACE)) == pytest.approx(slope, rel=1e-7)


def test_the_curve_of_the_grazing_is_that_of_the_closed_form(branch):
    bounds = {FREQUENCY: (LOW, HIGH), POSITION: (0.9 * PLACE, 1.1 * PLACE)}
    curve = vx.bifurcation_curve(grazing_of(branch), POSITION, bounds, progress=False)
    exact = [push_for(*pair) for pair in zip(curve[FREQUENCY].values, curve[POSITION].values, strict=True)]
    assert len(exact) > 4
    np.testing.assert_allclose(exact, PUSH, rtol=1e-9)
