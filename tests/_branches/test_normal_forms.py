"""Normal forms of folds, period doublings and Neimark-Sacker points, held against the orbits beside them."""

import numpy as np
import pytest
import scipy.linalg

import vijax as vx

pytestmark = pytest.mark.slow

AMPLITUDE = "forcing.amplitude[0]"


def oscillator(amplitude, frequency, damping=0.04, restitution=0.9):
    """One mass with unit stiffness and a stop at 1."""
    stop = vx.Stop(0, 1.0, "upper", restitution)
    return vx.ImpactSystem([1.0], [[damping]], [[1.0]], vx.Harmonic([amplitude], frequency), [stop])


def length(x, v, frequency):
    return float(np.hypot(np.linalg.norm(x), np.linalg.norm(v) / frequency))


def check_convergence(distances, ratios):
    """The ratio of a distance and what the normal form tells goes to 1 at least with the root of the distance."""
    errors = np.abs(np.array(ratios) - 1)
    assert errors.min() < 3e-3
    assert np.all(errors < 20 * np.sqrt(np.abs(distances)))


def test_a_doubled_orbit_is_as_far_as_the_normal_form_says():
    w = 0.84091
    orbit = vx.periodic_orbit(oscillator(0.4, w), [0.43252758], [0.148], 2, max_events=32)
    branch = vx.continuation(orbit, AMPLITUDE, (0.1, 0.5), progress=False)
    (point,) = (point for point in branch.bifurcations if point.kind == "pd")
    form = point.normal_form
    (twice,) = vx.switch_branch(point)
    doubled = vx.continuation(twice, AMPLITUDE, (0.3, 0.35), max_points=12, progress=False)
    near = [k for k in range(len(doubled)) if 1e-8 < abs(doubled.values[k] - point.value) < 1e-3]
    distances, ratios = doubled.values[near] - point.value, []
    for k, distance in zip(near, distances, strict=True):
        one = doubled.orbit(k)
        sol = vx.simulate(one.system, 0.0, one.period / 2, one.x0, one.v0, max_events=32)
        ratios.append(length(sol.x1 - one.x0, sol.v1 - one.v0, w) / 2 / form.amplitude(float(distance)))
    assert len(near) >= 3
    check_convergence(distances, ratios)
    stable = doubled.points.is_stable.values[near]
    assert set(stable) == {form.criticality == "supercritical"}
    assert set(distances > 0) == {form.side == "above"}


@pytest.fixture(scope="module")
def branch():
    system = vx.models.impact_oscillator(1.0, 1.0, position=1.0, restitution=0.8, damping_ratio=0.05)
    settled = vx.simulate(system, 0.0, 40 * system.forcing.period)
    orbit = vx.periodic_orbit(system, settled.x1, settled.v1)
    return vx.continuation(orbit, AMPLITUDE, (0.05, 1.0), progress=False)


def test_two_orbits_meet_at_a_fold_as_its_normal_form_says(branch):
    (fold,) = (point for point in branch.bifurcations if point.kind == "fold")
    form = fold.normal_form
    assert (form.criticality, form.side) == ("", "above")
    distances, ratios = np.array([1e-7, 1e-6]), []
    for distance in distances:
        machine = vx.models.impact_oscillator(
            1.0, fold.value + distance, position=1.0, restitution=0.8, damping_ratio=0.05
        )
        step = form.amplitude(distance) * form.direction
        pair = [
            vx.periodic_orbit(machine, fold.orbit.x0 + s * step[:1], fold.orbit.v0 + s * step[1:])
            for s in (1, -1)
        ]
        apart = length(pair[0].x0 - pair[1].x0, pair[0].v0 - pair[1].v0, 1.0)
        ratios.append(apart / 2 / form.amplitude(distance))
        assert sorted(bool(one.is_stable) for one in pair) == [False, True]
    check_convergence(distances, ratios)


def test_the_square_root_of_a_grazing_is_that_of_its_closed_form(branch):
    """x'' + 0.1 x' + x = A cos t reaches x = 1 with A = 0.1 at t = pi / 2, as x = 10 A sin t."""
    (grazing,) = (point for point in branch.bifurcations if point.kind == "gr")
    form = grazing.normal_form
    flow = lambda t: scipy.linalg.expm(t * np.array([[0.0, 1.0], [-1.0, -0.1]]))  # noqa: E731
    # The gap has the acceleration sin(pi / 2), the impulse takes (1 + r) of the speed sqrt(2 d).
    told = flow(1.5 * np.pi) @ [0.0, -1.8 * np.sqrt(2)]
    np.testing.assert_allclose(form.square_root, told, rtol=0, atol=1e-10)
    np.testing.assert_allclose(form.gradient, -flow(np.pi / 2)[0], rtol=0, atol=1e-10)
    # At the same start, the change of the response less that of the transient from its start (0, 10).
    assert form.rate == pytest.approx(-(10.0 - flow(np.pi / 2)[0] @ [0.0, 10.0]), abs=1e-9)
    assert form.criticality == grazing.criticality == ""
