"""Branches of cycles of several periods end at the grazing of a cycle of fewer, where several impacts touch or vanish at once."""

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
def test_branches_of_four_periods_end_at_the_grazing_of_a_cycle_of_one():
    """Several meet there, and rounding would decide which continues which."""
    frequency, bounds = 1.56872, (1.5685, 1.5705)
    starts = [
        (frequency, [-0.476161, -0.46606], [0.909469, -0.459481], [4, 3]),
        (bounds[0], [-0.5601292, -0.48077038], [0.88680612, -0.41996138], [4, 2]),
    ]
    shorter = None
    for value, x, v, num_impacts in starts:
        orbit = vx.periodic_orbit(machine(value), x, v, 4)
        assert orbit.num_impacts.tolist() == num_impacts
        branch = vx.continuation(orbit, FREQUENCY, bounds, progress=False)
        assert sorted(branch.ends) == ["bounds", "gr"]
        assert [point.kind for point in branch.bifurcations].count("fold") == 1
        assert bool(branch.points.is_admissible.all())
        (end,) = [point for point in branch.bifurcations if point.kind == "gr"]
        if shorter is None:
            shorter = vx.periodic_orbit(machine(1.5699), end.orbit.x0, end.orbit.v0)
            of_one = vx.continuation(shorter, FREQUENCY, bounds, progress=False)
        assert shorter.num_impacts.tolist() == [1, 0]
        grazings = [point.value for point in of_one.bifurcations if point.kind == "gr"]
        assert np.abs(np.array(grazings) - end.value).min() < 1e-10


@pytest.mark.slow
def test_without_damping_a_branch_ends_where_all_free_vibrations_repeat():
    """There, 3 forcing periods are 4 natural ones, and impacts that take energy cannot: closed form."""
    natural = np.sqrt(12.9182 / 1.40212)
    load = vx.Harmonic([0.375594], 2.6, [0.891603], mean=[0.400537])
    system = vx.ImpactSystem([1.40212], [[0.0]], [[12.9182]], load, [vx.Stop(0, 0.134654, "upper", 0.331778)])
    orbit = vx.periodic_orbit(system, [0.06191097], [-0.07580786], 3)
    assert orbit.num_impacts.tolist() == [1]
    branch = vx.continuation(orbit, FREQUENCY, (2.1, 2.7), progress=False)
    ends = dict(zip(branch.ends, branch.values[[0, -1]], strict=True))
    assert ends == pytest.approx({"gr": 0.75 * natural, "bounds": 2.7}, rel=1e-12)
    values = [point.value for point in branch.bifurcations]
    assert [point.kind for point in branch.bifurcations].count("gr") == 2
    assert len(set(np.round(values, 9))) == len(values) == 4  # it does not come back along itself


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


@pytest.mark.thorough
def test_a_cascade_of_grazings_ends_where_the_chatter_is_complete():
    """At the same value as the branch of sticking cycles from the other side."""
    system = vx.models.wagg_bishop_b(0.6272962670434061)
    orbit = vx.periodic_orbit(system, [0.5199, 0.0400], [0.1293, 0.0971])
    branch = vx.continuation(orbit, FREQUENCY, (0.627, 0.64), progress=False)
    assert branch.ends == ("bounds", "chatter_completion")
    assert bool(branch.points.is_admissible.all())
    *_, limit = branch.bifurcations
    grazings = np.array([point.value for point in branch.bifurcations if point.kind == "gr"])
    steps = np.diff(np.append(grazings[-5:], limit.value))
    assert np.all(steps[1:-1] < 0.8 * steps[:-2])
    # Simulations bounce 80 times at 0.637296267011, and stick at 0.637296267005.
    assert limit.value == pytest.approx(0.637296267011, abs=1e-11)
    # There the stick of the other branch ends: slightly farther it exists, slightly nearer it does not.
    for away, num_sticks in ((1e-9, 1), (-1e-9, 0)):
        system = vx.models.wagg_bishop_b(limit.value + away)
        orbit = vx.periodic_orbit(system, limit.orbit.x0, limit.orbit.v0)
        assert np.count_nonzero(orbit.events.kind == vx.STICK) == num_sticks
