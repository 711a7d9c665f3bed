"""Branches of machines with dry friction and compliant stops: their bifurcations, by figures of independent computations."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import scipy.integrate
import scipy.optimize

import vijax as vx

# The figures come from a boundary value problem in 30 digits (mpmath); they are printed to 13 digits or more.
LOCATED = 1e-10
PATH = "forcing.frequency"
# Central differences with steps of 1e-5.
DIFFERENCES = 1e-8


def rubbing(frequency: float, force: float | jax.Array = 1.0, static: float | None = None) -> vx.ImpactSystem:
    """J. P. den Hartog, Trans. ASME 53 (1931): x'' + 0.1 x' + x = 1.5 cos wt - F sgn x'."""
    load = vx.Harmonic(amplitude=[1.5], frequency=frequency)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, friction=[vx.Friction(0, force, static=static)])


def cushioned(frequency: float, amplitude: float | jax.Array) -> vx.ImpactSystem:
    """J. Ing, E. Pavlovskaia & M. Wiercigroch, Nonlinear Dyn. 46 (2006): a mass and a soft stop."""
    load = vx.Harmonic(amplitude=[amplitude], frequency=frequency)
    return vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, [vx.CompliantStop(0, 1.26, "upper", 5.0)])


def branch_of(system: vx.ImpactSystem, periods: int, bounds: tuple[float, float]) -> vx.Branch:
    sol = vx.simulate(system, 0.0, periods * system.forcing.period, throw=False)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), PATH, bounds, progress=False)


def all_are_followed(branch: vx.Branch) -> bool:
    return bool(branch.points["is_admissible"].all())


def assert_value_of(point: vx.Bifurcation) -> None:
    """The value of a bifurcation as a function of the amplitude of the load is that of the branch, and differentiable."""
    system = point.branch.system

    def value(factor: float | jax.Array) -> jax.Array:
        load = replace(system.forcing, amplitude=factor * system.forcing.amplitude)
        return vx.bifurcation_value(point, replace(system, forcing=load))

    assert float(value(1.0)) == pytest.approx(point.value, rel=LOCATED)
    step = 1e-6
    difference = (value(1.0 + step) - value(1.0 - step)) / (2 * step)
    assert float(jax.grad(value)(1.0)) == pytest.approx(float(difference), rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "static", "onset"), [(0.8, None, 0.7226791944381), (0.65, 1.1, 0.7486857316306)]
)
def test_a_branch_passes_the_onset_of_sticking_from_either_side(start, static, onset):
    branch = branch_of(rubbing(start, 1.0, static), 60, (0.6, 0.85))
    assert branch.ends == ("bounds", "bounds")
    (point,) = branch.bifurcations
    assert point.kind == "crossing_sliding"
    assert point.value == pytest.approx(onset, rel=LOCATED)
    assert all_are_followed(branch)
    sticks = np.count_nonzero(branch.points["event_kind"] == vx.STICK, axis=1)
    np.testing.assert_array_equal(sticks[branch.values < onset - 1e-6], 2)
    np.testing.assert_array_equal(sticks[branch.values > onset + 1e-6], 0)


def overshoot(frequency: float) -> float:
    """How far a mass slides that leaves a rest at -0.5, beyond 0.5."""
    begin = -np.arccos(0.5 / 1.5)  # there the load on it is the friction force

    def rate(t: float, y: np.ndarray) -> list[float]:
        return [y[1], 1.5 * np.cos(frequency * t + begin) - 1.0 - 0.1 * y[1] - y[0]]

    def stops(t: float, y: np.ndarray) -> float:
        return y[1]

    stops.terminal, stops.direction = True, -1
    sol = scipy.integrate.solve_ivp(
        rate, (0, 60), [-0.5, 0.0], "DOP853", events=stops, rtol=1e-12, atol=1e-14
    )
    return float(sol.y_events[0][0][0]) - 0.5


@pytest.mark.slow
def test_a_stick_is_split_where_the_load_at_its_peak_moves_the_mass():
    (point,) = branch_of(rubbing(0.16), 30, (0.14, 0.17)).bifurcations
    assert point.kind == "adding_sliding"
    split = scipy.optimize.brentq(overshoot, 0.14, 0.15, xtol=1e-14)
    assert point.value == pytest.approx(split, rel=LOCATED)


@pytest.mark.slow
def test_a_vibration_on_a_belt_begins_to_stick_where_its_velocity_reaches_that_of_the_belt():
    frequency, velocity = 0.8, 0.5
    load = vx.Harmonic(amplitude=[0.2], frequency=frequency)
    belt = vx.Friction(0, 0.1, velocity=velocity)
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, friction=[belt])
    bounds = 0.2, 0.26
    orbit = vx.periodic_orbit(system, [0.4], [0.0])
    branch = vx.continuation(orbit, "forcing.amplitude[0]", bounds, progress=False)
    back = vx.continuation(branch.orbit(len(branch) - 1), "forcing.amplitude[0]", bounds, progress=False)
    reached = velocity * np.hypot(1 - frequency**2, 0.1 * frequency) / frequency
    for one in (branch, back):
        grazing, switching = one.bifurcations
        assert grazing.kind == "grazing_sliding"
        assert grazing.value == pytest.approx(reached, rel=LOCATED)
        assert switching.kind == "switching_sliding"
        assert switching.value == pytest.approx(branch.bifurcations[1].value, rel=LOCATED)
        assert all_are_followed(one)


@pytest.mark.slow
def test_the_onset_of_sticking_is_a_differentiable_function_of_the_machine():
    (point,) = branch_of(rubbing(0.8), 60, (0.65, 0.85)).bifurcations
    onset = lambda force: vx.bifurcation_value(point, rubbing(0.8, force))  # noqa: E731
    assert float(onset(1.0)) == pytest.approx(0.7226791944381, rel=LOCATED)
    step = 1e-5
    difference = (onset(1.0 + step) - onset(1.0 - step)) / (2 * step)
    assert float(jax.grad(onset)(1.0)) == pytest.approx(float(difference), rel=DIFFERENCES)


@pytest.mark.slow
def test_a_vibration_that_touches_a_compliant_stop_goes_on_in_contact_and_back():
    touch = 0.801928106593235
    amplitude = 0.7 * touch**2
    branch = branch_of(cushioned(0.79, amplitude), 400, (0.785, 0.803))
    (point,) = branch.bifurcations
    assert point.kind == "gr"
    assert point.value == pytest.approx(touch, rel=LOCATED)
    assert all_are_followed(branch)
    closes = np.count_nonzero(branch.points["event_kind"] == vx.CLOSE, axis=1)
    np.testing.assert_array_equal(closes[branch.values > touch + 1e-6], 1)
    back = vx.continuation(branch.orbit(len(branch) - 1), PATH, (0.785, 0.803), progress=False)
    (same,) = back.bifurcations
    assert (same.kind, same.value) == ("gr", pytest.approx(touch, rel=LOCATED))
    # The vibration without contact is exact: (1 - w^2)^2 + c^2 w^2 = (A / 1.26)^2.
    by_amplitude = (2 * amplitude / 1.26**2) / (-4 * touch * (1 - touch**2) + 2 * 0.02**2 * touch)
    value = lambda amplitude: vx.bifurcation_value(point, cushioned(0.79, amplitude))  # noqa: E731
    assert float(jax.grad(value)(amplitude)) == pytest.approx(by_amplitude, rel=LOCATED)


@pytest.mark.slow
def test_the_period_of_a_vibration_with_one_contact_doubles():
    doubling = 0.8182308098822
    branch = branch_of(cushioned(0.83, 0.7 * doubling**2), 400, (0.81, 0.85))
    values = [point.value for point in branch.bifurcations if point.kind == "pd"]
    assert min(abs(np.array(values) - doubling)) < LOCATED


@pytest.mark.slow
def test_a_branch_passes_the_onset_of_sticking_beside_a_chatter():
    """Between two stops, with bounces down to rounding on one of them: their number changes along the branch."""
    stops = [vx.Stop(0, 0.0850659, "upper", 0.232149), vx.Stop(0, -0.337212, "lower", 0.511498)]
    rubs = [vx.Friction(0, 0.0553984)]
    load = vx.Harmonic([1.66272], 1.55, [0.656139])
    system = vx.ImpactSystem([0.36812], [[2.53786]], [[9.08557]], load, stops, friction=rubs)
    branch = branch_of(system, 100, (1.2, 1.6))
    assert branch.ends == ("bounds", "bounds")
    assert [point.kind for point in branch.bifurcations] == ["crossing_sliding"]
    assert all_are_followed(branch)


def between_stops(lower: tuple[float, float], upper: tuple[float, float], numbers: tuple) -> vx.ImpactSystem:
    """A random machine; each stop is its position and restitution."""
    mass, damping, stiffness, amplitude, phase, mean, friction, frequency = numbers
    load = vx.Harmonic([amplitude], frequency, [phase], mean=[mean])
    stops = [vx.Stop(0, *place) for place in ((lower[0], "lower", lower[1]), (upper[0], "upper", upper[1]))]
    return vx.ImpactSystem(
        [mass], [[damping]], [[stiffness]], load, stops, friction=[vx.Friction(0, friction)]
    )


PLASTIC_BELOW = (
    (-0.263591, 0.0),
    (0.729197, 0.334734),
    (1.30263, 0.0, 0.391088, 2.87188, 3.52926, 0.16757, 0.276424),
)
PLASTIC_ABOVE = (
    (-0.74715, 1.0),
    (0.557642, 0.0),
    (0.482806, 0.0844379, 1.44641, 1.06193, 0.0260363, 0.0, 0.634372),
)
# The kinks of a return map behind a stick, turns in place of slow impacts, and sticks in place of slow impacts.
PASSED = {
    "plastic below": (
        PLASTIC_BELOW,
        (1.46, 2.4),
        ["gr", "crossing_sliding", "switching_sliding", "grazing_sliding"],
    ),
    "plastic above": (PLASTIC_ABOVE, (0.72, 1.19), ["gr", "grazing_sliding"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PASSED)
def test_a_branch_passes_grazings_on_which_friction_acts_from_both_sides(name):
    (lower, upper, numbers), bounds, kinds = PASSED[name]
    branches = [
        branch_of(between_stops(lower, upper, (*numbers, frequency)), 100, bounds) for frequency in bounds
    ]
    for branch in branches:
        assert branch.ends == ("bounds", "bounds")
        assert all_are_followed(branch)
    forth, back = (sorted((point.value, point.kind) for point in branch.bifurcations) for branch in branches)
    assert [kind for _, kind in forth] == [kind for _, kind in back] == kinds
    # A slip that begins with a turn and vanishes is a double zero of its velocity: its equations lose half their digits.
    np.testing.assert_allclose([w for w, _ in forth], [w for w, _ in back], rtol=1e-8)


@pytest.mark.slow
def test_a_contact_that_vanishes_beside_another_compliant_stop_is_passed_once():
    """A random machine: behind the grazing its first simulated cycle still had the events before it."""
    load = vx.Harmonic([[0.820017], [1.6411], [0.140007]], 3.47, [[5.56242], [1.96282], [0.293217]])
    stops = [
        vx.CompliantStop(0, 0.586741, "upper", 29.2477, 0.770925),
        vx.CompliantStop(0, -0.157838, "lower", 2.02801, 0.147822),
    ]
    system = vx.ImpactSystem([0.133757], [[0.0899119]], [[8.44762]], load, stops)
    branch = branch_of(system, 100, (3.4, 3.47))
    assert branch.ends == ("bounds", "bounds")
    assert [point.kind for point in branch.bifurcations] == ["gr"]
    assert all_are_followed(branch)


def on_a_belt(frequency: float) -> vx.ImpactSystem:
    """A random machine between two stops, on a belt."""
    load = vx.Harmonic([0.605362], frequency, [3.03491])
    stops = [vx.Stop(0, -0.770777, "lower", 0.456028), vx.Stop(0, 0.755375, "upper", 0.728457)]
    belt = vx.Friction(0, 0.0487365, 0.0792958, velocity=-0.404664)
    return vx.ImpactSystem([2.93381], [[0.0]], [[0.700764]], load, stops, friction=[belt])


def num_sticks(system: vx.ImpactSystem) -> int:
    """Sticks in a period of the motion that attracts."""
    period = system.forcing.period
    sol = vx.simulate(system, 0.0, 400 * period, throw=False, max_events=8)
    sol = vx.simulate(system, 0.0, period, sol.x1, sol.v1)
    return int(np.count_nonzero(np.asarray(sol.events.kind) == vx.STICK))


@pytest.mark.slow
def test_a_branch_passes_a_stick_that_appears_right_before_an_impact():
    """The velocity of the mass falls to that of the belt at the impact; at the first bifurcation it does so behind another."""
    bounds = 0.5445, 0.547
    forth, back = (branch_of(on_a_belt(frequency), 400, bounds) for frequency in bounds)
    for branch in (forth, back):
        assert branch.ends == ("bounds", "bounds")
        assert [point.kind for point in branch.bifurcations] == ["double_impact", "double_impact"]
        assert all_are_followed(branch)
    one, other = ([point.value for point in branch.bifurcations] for branch in (forth, back))
    np.testing.assert_allclose(one, other, rtol=LOCATED)
    assert [num_sticks(on_a_belt(one[1] + away)) for away in (-1e-7, 1e-7)] == [1, 2]
    for point in forth.bifurcations:
        assert_value_of(point)
    # With a softer stop both meet.
    path = "stops[0].restitution"
    plane = {PATH: bounds, path: (0.455, 0.457)}
    curves = [vx.bifurcation_curve(point, path, plane, progress=False) for point in forth.bifurcations]
    for curve in curves:
        assert curve.attrs["ends"] == '["double_impact+double_impact", "bounds"]'
    ends = [np.array([curve[name][0] for name in plane]) for curve in curves]
    np.testing.assert_allclose(*ends, rtol=1e-12)


@pytest.mark.slow
def test_a_closed_branch_with_touches_and_turns_is_followed_to_its_start():
    """Three periods of a mass between two stops, elastic the upper one, on a slow belt, which turns it at an impact."""

    def closed_branch(frequency: float) -> vx.Branch:
        load = vx.Harmonic([0.974764], frequency, [0.0421286])
        stops = [vx.Stop(0, -0.119421, "lower", 0.58736), vx.Stop(0, 0.705297, "upper", 1.0)]
        belt = vx.Friction(0, 0.0779794, velocity=0.0204287)
        system = vx.ImpactSystem([0.359245], [[0.0275196]], [[1.37575]], load, stops, friction=[belt])
        sol = vx.simulate(system, 0.0, 600 * load.period, throw=False, max_events=8)
        orbit = vx.periodic_orbit(system, sol.x1, sol.v1, num_periods=3)
        return vx.continuation(orbit, PATH, (2.0, 3.2), progress=False)

    one, other = (closed_branch(frequency) for frequency in (2.76, 2.8))
    kinds = ["gr", "double_impact", "gr", "gr", "double_impact", "gr", "pd", "fold", "fold"]
    for branch in (one, other):
        assert branch.ends == ("closed", "closed")
        assert [
            kind for _, kind in sorted((point.value, point.kind) for point in branch.bifurcations)
        ] == kinds
        assert all_are_followed(branch)
    one, other = (sorted(point.value for point in branch.bifurcations) for branch in (one, other))
    np.testing.assert_allclose(one, other, rtol=LOCATED)


def between_preloaded(frequency: float) -> vx.ImpactSystem:
    """A random machine between two compliant stops with dampers, the lower one with a preload."""
    load = vx.Harmonic(
        [[0.605778], [0.0], [2.50545]], frequency, [[0.727769], [0.0], [0.00300965]], mean=[-0.212299]
    )
    stops = [
        vx.CompliantStop(0, 0.41089, "upper", 2.51196, 2.39912),
        vx.CompliantStop(0, -0.364469, "lower", 132.326, 0.233775, preload=0.261876),
    ]
    return vx.ImpactSystem([0.292712], [[0.330553]], [[5.41813]], load, stops)


@pytest.mark.slow
def test_a_branch_passes_a_contact_that_opens_by_its_force_instead_of_its_depth():
    """There the mass leaves the stop at the velocity at which the damper takes all of the preload."""
    bounds = 0.69, 0.72
    for frequency in bounds:
        branch = branch_of(between_preloaded(frequency), 400, bounds)
        assert branch.ends == ("bounds", "bounds")
        assert all_are_followed(branch)
        (point,) = branch.bifurcations
        assert point.kind == "double_impact"
        system = between_preloaded(point.value)
        at = branch.points.isel(point=point.index)
        sol = vx.simulate(system, 0.0, system.forcing.period, at["x0"].values, at["v0"].values)
        opens = np.flatnonzero((np.asarray(sol.events.kind) == vx.OPEN) & (np.asarray(sol.events.stop) == 1))
        velocities = sol.evaluate(np.asarray(sol.events.t)[opens])[1]
        assert np.abs(velocities - 0.261876 / 0.233775).min() < 1e-11
    assert_value_of(point)


@pytest.mark.slow
def test_a_contact_force_that_touches_zero_is_seen_beside_a_lower_minimum_elsewhere():
    """A random machine: the force of a closed contact vanishes for a moment, and falls to 0.01 in another contact."""
    load = vx.Harmonic([0.437485], 0.804, [1.87788], mean=[0.309008])
    stops = [
        vx.CompliantStop(0, 0.0644735, "upper", 23.6443, 0.06437),
        vx.CompliantStop(0, -0.15631, "lower", 74.2764),
    ]
    system = vx.ImpactSystem([0.805346], [[0.00320378]], [[0.423864]], load, stops)
    sol = vx.simulate(system, 0.0, 2000 * load.period, throw=False, max_events=8)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1, num_periods=2)
    branch = vx.continuation(orbit, PATH, (0.8, 0.806), progress=False)
    assert branch.ends == ("bounds", "bounds")
    # The depth vanishes within rounding of the moment at which the contact opens: a "gr", or a "double_impact".
    kinds = [point.kind.replace("double_impact", "gr") for point in branch.bifurcations]
    assert kinds == ["pd", "force_zero", "gr", "fold", "force_zero", "gr"]
    assert all_are_followed(branch)


@pytest.mark.slow
def test_a_branch_goes_on_behind_the_first_touch_of_a_preloaded_stop():
    """As at a rigid stop, it turns back there: the motion with the new contact has the frequencies of that without."""

    def touching(frequency: float) -> vx.ImpactSystem:
        load = vx.Harmonic([0.600289], frequency, [4.95264], mean=[0.0555143])
        stops = [
            vx.CompliantStop(0, 0.230779, "upper", 27.4465, 0.0598978, preload=0.938344),
            vx.CompliantStop(0, -0.468355, "lower", 110.109, 0.0604134, preload=0.0689147),
        ]
        return vx.ImpactSystem([0.111878], [[0.149649]], [[2.29772]], load, stops)

    bounds = 0.98, 1.2
    one, other = (branch_of(touching(frequency), 400, bounds) for frequency in bounds)
    for branch in (one, other):
        assert branch.ends == ("bounds", "bounds")
        assert all_are_followed(branch)
        assert sorted(point.kind for point in branch.bifurcations) == ["fold", "gr"]
    one, other = (sorted(point.value for point in branch.bifurcations) for branch in (one, other))
    np.testing.assert_allclose(one, other, rtol=LOCATED)
    assert one[1] - one[0] > 1e-3


@pytest.mark.slow
def test_a_doubled_branch_turns_back_beside_the_grazing_where_it_ends():
    """At that fold both halves of the orbit are nearly one, but it is not the end at the period doubling."""
    load = vx.Harmonic(
        [[1.00958], [3.03048], [0.209372]], 1.06, [[5.86431], [3.97218], [1.61575]], mean=[-0.0554809]
    )
    stops = [
        vx.CompliantStop(0, 0.53906, "upper", 86.5208, preload=0.17728),
        vx.CompliantStop(0, -0.154443, "lower", 759.669, preload=0.128135),
    ]
    system = vx.ImpactSystem([0.362058], [[0.183365]], [[25.3855]], load, stops)
    sol = vx.simulate(system, 0.0, 400 * load.period, throw=False, max_events=8)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1, num_periods=2)
    branch = vx.continuation(orbit, PATH, (1.04, 1.1), progress=False)
    assert sorted(branch.ends) == ["gr", "period_doubling"]
    values = {kind: [p.value for p in branch.bifurcations if p.kind == kind] for kind in ("gr", "fold", "bp")}
    assert [len(own) for own in values.values()] == [2, 1, 1]
    assert 0 < min(values["gr"]) - values["fold"][0] < 1e-7
