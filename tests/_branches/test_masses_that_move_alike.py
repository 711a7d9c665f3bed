"""Branches of symmetric machines whose masses hit, stick or close at one instant, as one of them alone does."""

from functools import partial

import equinox as eqx
import numpy as np
import pytest

import vijax as vx

AMPLITUDE, FREQUENCY, BOUNDS = 0.5, 0.9, (0.7, 1.3)
# Of the spring between two masses, and of those on the ground beside it.
BETWEEN, OWN = 0.25, np.eye(2)
COUPLING = np.array([[1.0, -1.0], [-1.0, 1.0]])


def alone(stop) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([AMPLITUDE], FREQUENCY), [stop(0, "upper")])


def in_phase(stop) -> vx.ImpactSystem:
    """Two such masses with a spring between them that never stretches."""
    load = vx.Harmonic([AMPLITUDE] * 2, FREQUENCY)
    stops = [stop(i, "upper") for i in range(2)]
    return vx.ImpactSystem([1.0] * 2, 0.1 * OWN, OWN + BETWEEN * COUPLING, load, stops)


def in_antiphase(stop) -> vx.ImpactSystem:
    """Two masses that move against each other, with softer springs on the ground and another between them."""
    load = vx.Harmonic([AMPLITUDE, -AMPLITUDE], FREQUENCY)
    stiffness = (1 - 2 * BETWEEN) * OWN + BETWEEN * COUPLING
    return vx.ImpactSystem([1.0] * 2, 0.1 * OWN, stiffness, load, [stop(0, "upper"), stop(1, "lower")])


def rigid(mass: int, side) -> vx.Stop:
    return vx.Stop(mass, 0.3 if side == "upper" else -0.3, side, 0.7)


def soft(mass: int, side) -> vx.CompliantStop:
    return vx.CompliantStop(mass, 0.3 if side == "upper" else -0.3, side, 20.0, 0.4)


def branch_of(machine: vx.ImpactSystem) -> vx.Branch:
    start = np.sign(machine.forcing.amplitude) * 0.1
    orbit = vx.periodic_orbit(machine, start, start)
    return vx.continuation(orbit, "forcing.frequency", BOUNDS, progress=False)


@pytest.mark.parametrize("make", [in_phase, pytest.param(in_antiphase, marks=pytest.mark.slow)])
@pytest.mark.parametrize("stop", [rigid, pytest.param(soft, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_a_branch_of_two_masses_that_move_alike_has_the_points_of_one(make, stop):
    one, two = branch_of(alone(stop)), branch_of(make(stop))
    assert two.ends == one.ends == ("bounds", "bounds")
    # The two may also part, which one cannot.
    known = [point for point in two.bifurcations if point.kind not in ("pd", "bp", "pitchfork", "ns")]
    assert [point.kind for point in known] == [point.kind for point in one.bifurcations]
    values = ([point.value for point in points] for points in (known, one.bifurcations))
    np.testing.assert_allclose(*values, rtol=0, atol=1e-9)
    assert float(np.abs(np.abs(two.points.x0[:, 0]) - np.abs(two.points.x0[:, 1])).max()) < 1e-12


@pytest.mark.slow
def test_so_do_curves_in_two_parameters():
    def loaded(make, frequency, amplitude):
        machine = make(rigid)
        signs = np.sign(machine.forcing.amplitude)
        return eqx.tree_at(lambda m: m.forcing, machine, vx.Harmonic(amplitude * signs, frequency))

    ends = []
    for make in (alone, in_phase):
        family = vx.Family(partial(loaded, make), frequency=FREQUENCY, amplitude=AMPLITUDE)
        start = np.full(family.system.num_masses, 0.1)
        orbit = vx.periodic_orbit(family, start, start)
        branch = vx.continuation(orbit, "frequency", BOUNDS, progress=False)
        for kind in ("fold", "gr"):
            (point,) = [one for one in branch.bifurcations if one.kind == kind]
            box = {"frequency": BOUNDS, "amplitude": (0.4, 0.6)}
            curve = vx.bifurcation_curve(point, "amplitude", box, progress=False)
            assert curve.attrs["ends"] == '["bounds", "bounds"]'
            ends.append(np.sort(curve.frequency.values[[0, -1]]))
    np.testing.assert_allclose(ends[2:], ends[:2], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_where_the_two_part_a_motion_beside_it_doubles_its_period():
    branch = branch_of(in_phase(rigid))
    (doubling,) = [point for point in branch.bifurcations if point.kind == "pd"]
    orbit = doubling.orbit
    assert np.abs(orbit.multipliers + 1).min() < 1e-6
    # A difference of two runs from beside it, along x_0 - x_1 and v_0 - v_1: after a period it has the other sign.
    apart = np.array([1.0, -1.0])

    def after_a_period(dx: float, dv: float) -> np.ndarray:
        start = orbit.x0 + dx * apart, orbit.v0 + dv * apart
        t0 = float(orbit.phase) / float(orbit.system.forcing.frequency)
        run = vx.simulate(orbit.system, t0, t0 + float(orbit.period), *start)
        return np.array([apart @ run.x1, apart @ run.v1]) / 2

    step = 1e-6
    columns = [(after_a_period(*d) - after_a_period(*(-d))) / (2 * step) for d in step * np.eye(2)]
    assert np.abs(np.linalg.eigvals(np.array(columns).T) + 1).min() < 1e-5
