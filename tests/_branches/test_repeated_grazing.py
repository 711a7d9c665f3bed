"""A branch of cycles of four periods passes the grazing of the cycle of one period: three impacts touch at once, one vanishes."""

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
def test_it_passes_the_grazing_of_the_shorter_cycle():
    frequency = 1.56872
    orbit = vx.periodic_orbit(machine(frequency), [-0.476161, -0.46606], [0.909469, -0.459481], 4)
    assert orbit.num_impacts.tolist() == [4, 3]
    branch = vx.continuation(orbit, FREQUENCY, (1.5685, 1.5705), progress=False)
    assert branch.ends == ("bounds", "bounds")
    # Behind it one impact is gone, and the machine follows what is left.
    last = branch.orbit(len(branch) - 1)
    assert last.num_impacts.tolist() == [4, 2]
    run = vx.simulate(last.system, 0.0, last.period, last.x0, last.v0)
    np.testing.assert_allclose(run.x1, last.x0, rtol=0, atol=1e-10)
    (end,) = [point for point in branch.bifurcations if point.kind == "gr"]

    shorter = vx.periodic_orbit(machine(1.5699), end.orbit.x0, end.orbit.v0)
    assert shorter.num_impacts.tolist() == [1, 0]
    of_one = vx.continuation(shorter, FREQUENCY, (1.5685, 1.5705), progress=False)
    grazings = [point.value for point in of_one.bifurcations if point.kind == "gr"]
    assert np.abs(np.array(grazings) - end.value).min() < 1e-10


@pytest.mark.slow
def test_doubled_branches_of_a_closed_one_end_at_its_grazings_and_it_is_found_once():
    """A random machine: from either grazing of the closed branch a branch of two periods leads to a period doubling."""

    def slot(frequency: float) -> vx.ImpactSystem:
        load = vx.Harmonic(
            [[1.78784], [0.720234], [0.399136]], frequency, [[0.319805], [5.3614], [3.15527]], mean=[0.364744]
        )
        stops = [vx.Stop(0, -0.0547404, "lower", 0.801021), vx.Stop(0, 0.0, "upper", 1.0)]
        return vx.ImpactSystem([6.54315], [[0.0]], [[1.74354]], load, stops)

    # Between the last point of the branch from the first orbit and its first point lies the second orbit.
    values, start = [2.490049, 2.489005], {"x0": [-0.0112], "v0": [0.1552]}
    ds = vx.sweep(slot(values[0]), {FREQUENCY: values}, transient=400, progress=False, **start)
    closed, *doubled = vx.branches(vx.periodic_orbits(ds, progress=False), (1.6, 2.6), progress=False)
    assert closed.ends == ("closed", "closed")
    grazings, doublings = (
        sorted(point.value for point in closed.bifurcations if point.kind == kind) for kind in ("gr", "pd")
    )
    ends = [dict(zip(branch.ends, branch.values[[0, -1]], strict=True)) for branch in doubled]
    expected = zip(grazings, doublings[::-1], strict=True)
    for end, (grazing, doubling) in zip(sorted(ends, key=lambda own: own["gr"]), expected, strict=True):
        assert end == pytest.approx({"gr": grazing, "period_doubling": doubling}, rel=1e-9)
